"""Two simulated arms hand over a bar: each is told where the bar is, and finds its way to it and away from it."""

import math
from collections.abc import Iterator
from typing import Any

import pytest

from browser import Browser
from fleet.test_held_objects import HOME, TERMS, UNITS, Hand, metres
from running import eventually, process
from scene_client import contents, put_robot
from small_fleet import Place, live

pytestmark = pytest.mark.virtual

LONG_M, WIDTH_M = 0.5, 0.03
APART_M = 1.2
REST = {
    "shoulder_pan_joint": 0.0,
    "shoulder_lift_joint": -1.5708,
    "elbow_joint": 1.5708,
    "wrist_1_joint": -1.5708,
    "wrist_2_joint": -1.5708,
    "wrist_3_joint": 0.0,
}


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    place = Place(tmp_path_factory.mktemp("world"))
    robots = process("-m", "linked_fleet_agent", "--robot=panda", "--robot=ur5", "--connect", place.zenoh)
    with robots, place.gateway() as (_, browser):
        for name in ("panda", "ur5"):
            live(browser, name)
        yield browser


def arm(browser: Browser, name: str) -> Hand:
    found = Hand(browser)
    found.root = f"{browser.root}{name}/"
    return found


def rehearsed_and_done(hand: Hand, action: str, body: dict[str, Any]) -> dict[str, Any]:
    """Carry out the very path that a rehearsal shows; return what the rehearsal says."""
    rehearsed = hand.post(f"actions/{action}", body, "dry-run")
    assert rehearsed.status_code == 200, rehearsed.text
    said: dict[str, Any] = rehearsed.json()
    hand.done(f"actions/{action}", body | {"plan": said["plan"]})
    return said


def test_a_bar_goes_from_one_arm_to_the_other(browser: Browser) -> None:
    for each in contents(browser):
        browser.http.delete(each)
    put_robot(browser, "panda", 0, 0, 0)
    put_robot(browser, "ur5", APART_M, 0, 0, math.pi)
    panda, ur5 = arm(browser, "panda"), arm(browser, "ur5")
    panda.post("simulation/actions/takeObject", {})
    panda.done("gripper/actions/open", {})
    panda.done("actions/moveJoints", panda.targets(HOME))
    palm = panda.pose(f"{panda.root}panda_hand")
    at = metres(x=round(palm["x"] + 0.2, 4), y=palm["y"], z=round(palm["z"] - 0.1, 4))
    bar = panda.add("bar", metres(x=LONG_M, y=WIDTH_M, z=WIDTH_M), position=at)
    assert panda.post("simulation/actions/putObject", {"width": WIDTH_M}, "wait=5").status_code < 300
    panda.done("gripper/actions/grasp", {"object": bar})
    eventually(lambda: panda.thing(bar).get("heldBy"), "Panda holds the bar")

    held_out = {"link": f"{panda.root}panda_hand", "position": metres(x=0.4, y=0.1, z=0.55)}
    rehearsed_and_done(panda, "reach", held_out | {"path": f"{TERMS}Planned"})

    place = {axis: round(float(value or 0.0), 4) for axis, value in ur5.pose(bar, ur5.root).items()}
    take = {
        "link": f"{ur5.root}tool0",
        "position": metres(**place),
        "mayTouch": [bar],
        "path": f"{TERMS}Planned",
    }
    said = rehearsed_and_done(ur5, "reach", take)
    assert said["closest"][0]["clearance"]["value"] >= 0.0 and len(said["closest"][0]["things"]) == 2
    tool = ur5.pose(f"{ur5.root}tool0", ur5.root)
    assert [tool[axis] for axis in "xyz"] == pytest.approx([place[axis] for axis in "xyz"], abs=2e-3)

    panda.done("gripper/actions/open", {})
    eventually(lambda: "heldBy" not in panda.thing(bar), "Panda has let the bar go")
    ur5.patch(bar, f"INSERT DATA {{ <{bar}> lf:heldBy <{ur5.root}tool0> }}")
    eventually(lambda: ur5.thing(bar).get("heldBy") == f"{ur5.root}tool0", "UR5 holds the bar")
    here = panda.pose(f"{panda.root}panda_hand")
    away = metres(x=here["x"], y=here["y"], z=round(float(here["z"] or 0.0) + 0.12, 4))
    panda.done("actions/reach", {"link": f"{panda.root}panda_hand", "position": away, "path": f"{TERMS}Straight"})
    panda.done("actions/moveJoints", panda.targets(HOME, path=f"{TERMS}Planned"))

    before = ur5.pose(bar)
    rest = [{"joint": f"{ur5.root}{name}", "value": value, "unit": f"{UNITS}RAD"} for name, value in REST.items()]
    rehearsed_and_done(ur5, "moveJoints", {"target": rest, "path": f"{TERMS}Planned"})
    assert math.dist(ur5.pose(bar).values(), before.values()) > 0.2, "the bar went with the tool"
