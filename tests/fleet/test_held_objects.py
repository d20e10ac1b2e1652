"""A simulated Panda that grasps a bar, carries it round a crate and puts it down, among what it may touch."""

import math
from collections.abc import Iterator
from typing import Any
from urllib.parse import urlencode

import httpx
import pytest

from browser import LF, MATHS, Browser
from commanding import ended
from running import eventually, process
from scene_client import contents, put_robot, world
from small_fleet import Place, live

pytestmark = pytest.mark.virtual

TERMS = "https://w3id.org/linked-fleet#"
UNITS = "http://qudt.org/vocab/unit/"
JSON = {"accept": "application/json"}
BAR_M, WIDTH_M = 0.9, 0.03
HOME = {1: 0.0, 2: -0.785, 3: 0.0, 4: -2.356, 5: 0.0, 6: 1.571, 7: 0.785}
BESIDE = {**HOME, 1: 1.2}
Body = dict[str, Any]


def metres(**axes: float) -> Body:
    return {**axes, "unit": f"{UNITS}M"}


class Hand:
    """A client of Panda and of the world around it."""

    def __init__(self, browser: Browser) -> None:
        self.browser, self.root = browser, f"{browser.root}panda/"

    def get(self, url: str) -> Body:
        said: Body = self.browser.http.get(url, headers=JSON).raise_for_status().json()
        return said

    def post(self, action: str, body: Body, prefer: str = "") -> httpx.Response:
        headers = JSON | ({"prefer": prefer} if prefer else {})

        def answered() -> httpx.Response | None:
            answer = self.browser.http.post(f"{self.root}{action}", json=body, headers=headers)
            return None if answer.status_code == 503 else answer

        return eventually(answered, "an answer that is not 503")

    def done(self, action: str, body: Body) -> Body:
        """Invoke an action; return its invocation once it has succeeded."""
        answer = self.post(action, body)
        assert answer.status_code == 204, answer.text
        ended(self.browser, answer.headers["location"])
        said = self.get(answer.headers["location"])
        assert said["state"] == f"{TERMS}succeeded", said
        return said

    def targets(self, positions: dict[int, float], **more: Any) -> Body:
        joints = [
            {"joint": f"{self.root}panda_joint{n}", "value": value, "unit": f"{UNITS}RAD"}
            for n, value in positions.items()
        ]
        return {"target": joints, **more}

    def add(self, title: str, size: Body, **more: Any) -> str:
        body = {"title": title, "geometry": {"form": f"{TERMS}Box", "size": size}, **more}
        answer = self.browser.http.post(f"{self.browser.root}world/objects", json=body)
        assert answer.status_code == 201, answer.text
        return answer.headers["location"]

    def patch(self, url: str, update: str) -> None:
        headers = {"content-type": "application/sparql-update"}
        answer = self.browser.http.patch(url, content=f"PREFIX lf: <{TERMS}> {update}", headers=headers)
        assert answer.status_code == 204, answer.text

    def thing(self, url: str) -> dict[str, str]:
        """Return what holds an object, if anything, and the frame of its position."""
        page = self.browser.page(url)
        said = {name: page.graph.value(page.iri, LF[name]) for name in ("heldBy", "inFrame")}
        return {name: str(value) for name, value in said.items() if value is not None}

    def pose(self, thing: str, frame: str = "") -> dict[str, float | None]:
        """Return the position of a thing in the world, or in the frame of another one; None for unknown."""
        query = urlencode({"of": thing, **({"in": frame} if frame else {})})
        page = self.browser.page(f"{self.browser.root}world/pose?{query}")
        position = page.graph.value(page.iri, LF.position)
        axes = {name: page.graph.value(position, MATHS[name]) for name in "xyz"}
        return {name: None if each == LF.unknown else float(str(each)) for name, each in axes.items()}


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    place = Place(tmp_path_factory.mktemp("world"))
    robots = process("-m", "linked_fleet_agent", "--robot=panda", "--connect", place.zenoh)
    with robots, place.gateway() as (_, browser):
        live(browser, "panda")
        yield browser


@pytest.fixture
def hand(browser: Browser) -> Hand:
    """Return Panda at home, with open fingers and nothing around it."""
    for each in contents(browser):
        assert browser.http.delete(each).status_code == 204
    put_robot(browser, "panda", 0, 0, 0)
    found = Hand(browser)
    found.post("simulation/actions/takeObject", {})
    found.done("gripper/actions/open", {})
    found.done("actions/moveJoints", found.targets(HOME))
    return found


def bar_in(hand: Hand, **more: Any) -> str:
    """Put a bar across the hand, between the fingers; return its IRI."""
    at = hand.pose(f"{hand.root}panda_hand")
    place = metres(x=at["x"], y=at["y"], z=round(at["z"] - 0.1, 4))
    return hand.add("bar", metres(x=BAR_M, y=WIDTH_M, z=WIDTH_M), position=place, **more)


def test_a_grasped_bar_is_carried_round_a_crate_and_stays_where_it_is_put_down(hand: Hand) -> None:
    bar, palm = bar_in(hand), f"{hand.root}panda_hand"
    blocked = hand.post("actions/moveJoints", hand.targets(BESIDE), "dry-run")
    assert (blocked.status_code, blocked.json()["names"][1]) == (409, "bar (obstacle)"), blocked.text
    assert hand.post("simulation/actions/putObject", {"width": WIDTH_M}, "wait=5").status_code < 300
    rehearsed = hand.post("gripper/actions/grasp", {"object": bar}, "dry-run")
    assert rehearsed.json()["object"] == bar, rehearsed.text
    assert "heldBy" not in hand.thing(bar)
    hand.done("gripper/actions/grasp", {"object": bar})
    held = eventually(lambda: said if (said := hand.thing(bar)).get("heldBy") else None, "the bar is held")
    assert held["heldBy"] == held["inFrame"] == palm
    in_hand, before = hand.pose(bar, palm), hand.pose(bar)
    crate = hand.add("crate", metres(x=0.1, y=0.1, z=0.6), position=metres(x=0.4, y=0.55, z=0.3))
    refused = hand.post("actions/moveJoints", hand.targets(BESIDE), "dry-run")
    assert refused.status_code == 409, refused.text
    assert refused.json()["names"] == ["bar, which panda_hand of panda holds", "crate (obstacle)"]
    assert refused.json()["things"] == [bar, crate]
    carried = hand.done("actions/moveJoints", hand.targets(BESIDE, path=f"{TERMS}Planned"))
    assert "what panda_hand holds would meet" in carried["plannedBecause"]
    assert hand.pose(bar, palm) == pytest.approx(in_hand, abs=1e-4)
    assert math.dist(hand.pose(bar).values(), before.values()) > 0.3
    hand.done("gripper/actions/open", {})
    stands = eventually(lambda: said if "heldBy" not in (said := hand.thing(bar)) else None, "the bar is let go")
    assert stands["inFrame"] == f"{hand.browser.root}world"
    put_down = hand.pose(bar)
    hand.browser.http.delete(crate)
    hand.done("actions/moveJoints", hand.targets(HOME, mayTouch=[bar]))
    assert hand.pose(bar) == put_down


def test_what_is_taken_out_of_the_hand_stays_where_it_was_lost(hand: Hand) -> None:
    bar = bar_in(hand)
    assert hand.post("simulation/actions/putObject", {"width": WIDTH_M}, "wait=5").status_code < 300
    hand.done("gripper/actions/grasp", {"object": bar})
    eventually(lambda: hand.thing(bar).get("heldBy"), "the bar is held")
    assert hand.post("simulation/actions/takeObject", {}, "wait=5").status_code < 300
    eventually(lambda: "heldBy" not in hand.thing(bar), "the bar is lost")
    assert hand.thing(bar)["inFrame"] == f"{hand.browser.root}world"


def test_a_grasp_of_nothing_holds_nothing(hand: Hand) -> None:
    bar = bar_in(hand)
    said = hand.done("gripper/actions/grasp", {"object": bar})
    assert said["output"]["holding"] is False
    assert "heldBy" not in hand.thing(bar)


def test_a_motion_that_names_an_object_may_touch_it_and_says_so(hand: Hand) -> None:
    bar = bar_in(hand)
    turned = hand.targets(BESIDE)
    assert hand.post("actions/moveJoints", turned, "dry-run").status_code == 409
    said = hand.post("actions/moveJoints", turned | {"mayTouch": [bar]}, "dry-run").json()
    assert (said["mayTouch"], said["collisionFree"]) == ([bar], True)
    one = hand.post("panda_joint1/actions/rotate", {"value": 0.5, "unit": f"{UNITS}RAD", "mayTouch": [bar]}, "dry-run")
    assert one.json()["collisionFree"] is True, one.text


@pytest.mark.parametrize("action", ["moveJoints", "grasp"])
def test_an_object_that_is_not_there_is_refused(hand: Hand, action: str) -> None:
    gone = f"{hand.browser.root}world/objects/gone"
    asked = hand.targets(BESIDE, mayTouch=[gone]) if action == "moveJoints" else {"object": gone}
    refused = hand.post(f"actions/{action}" if action == "moveJoints" else "gripper/actions/grasp", asked, "dry-run")
    assert refused.status_code == 422 and "is not an object of the world" in refused.json()["detail"], refused.text


def test_an_object_that_is_far_from_the_hand_is_not_grasped(hand: Hand) -> None:
    far = hand.add("far", metres(x=0.1, y=0.1, z=0.1), position=metres(x=5, y=5, z=0.05))
    refused = hand.post("gripper/actions/grasp", {"object": far}, "dry-run")
    assert refused.status_code == 409, refused.text
    assert "m away from panda_hand of panda" in refused.json()["detail"]


def test_a_zone_is_not_touched_by_naming_it(hand: Hand) -> None:
    zone = hand.add("zone", metres(x=1, y=1, z=1), position=metres(x=5, y=5, z=5), kind=f"{TERMS}KeepOutZone")
    refused = hand.post("actions/moveJoints", hand.targets(BESIDE, mayTouch=[zone]), "dry-run")
    assert refused.status_code == 422 and "KeepOutZone" in refused.json()["detail"], refused.text


def test_somebody_may_say_that_a_link_holds_something(hand: Hand) -> None:
    """A client mounts a bar, turns the arm, and takes the bar off where it is by then."""
    link = f"{hand.root}panda_link7"
    bar = hand.add("bar", metres(x=0.02, y=0.02, z=0.2), position=metres(x=0, y=0.2, z=0), heldBy=link, inFrame=link)
    assert hand.thing(bar)["heldBy"] == link
    assert hand.pose(bar, link) == pytest.approx({"x": 0.0, "y": 0.2, "z": 0.0}, abs=1e-4)
    hand.done("actions/moveJoints", hand.targets(BESIDE))
    there = hand.pose(bar)
    hand.patch(bar, "DELETE { ?bar lf:heldBy ?link } WHERE { ?bar lf:heldBy ?link }")
    assert "heldBy" not in hand.thing(bar)
    assert hand.pose(bar) == pytest.approx(there, abs=1e-3)


def test_an_object_that_stands_somewhere_is_mounted_and_placed_by_a_frame(hand: Hand) -> None:
    """A link takes it where it stands; a place beside a link is one in the world."""
    link = f"{hand.root}panda_link7"
    bar = hand.add("bar", metres(x=0.02, y=0.02, z=0.2), position=metres(x=0.5, y=0.4, z=0.3))
    hand.patch(bar, f"INSERT {{ <> lf:heldBy <{link}> }} WHERE {{}}")
    assert hand.thing(bar) == {"heldBy": link, "inFrame": link}
    assert hand.pose(bar) == pytest.approx({"x": 0.5, "y": 0.4, "z": 0.3}, abs=1e-4)
    cup = hand.add("cup", metres(x=0.1, y=0.1, z=0.1), position=metres(x=0, y=0.3, z=0), inFrame=link)
    assert hand.thing(cup) == {"inFrame": f"{hand.browser.root}world"}
    assert hand.pose(cup, link) == pytest.approx({"x": 0.0, "y": 0.3, "z": 0.0}, abs=1e-4)


def test_without_its_placement_the_place_of_what_a_robot_holds_is_unknown(hand: Hand) -> None:
    link = f"{hand.root}panda_link7"
    bar = hand.add("bar", metres(x=0.02, y=0.02, z=0.2), position=metres(x=0, y=0.2, z=0), heldBy=link, inFrame=link)
    placement = f"{hand.root}placement"
    assert hand.browser.http.delete(placement).status_code == 204
    assert hand.pose(bar) == {"x": None, "y": None, "z": None}
    assert hand.pose(bar, link) == pytest.approx({"x": 0.0, "y": 0.2, "z": 0.0}, abs=1e-4)
    refused = hand.browser.http.post(
        f"{hand.browser.root}world/objects",
        json={
            "title": "cup", "position": metres(x=0, y=0, z=0), "heldBy": link,
            "geometry": {"form": f"{TERMS}Sphere", "radius": {"value": 0.1, "unit": f"{UNITS}M"}},
        },
    )  # fmt: skip
    assert refused.status_code == 409 and "is unknown" in refused.json()["detail"], refused.text
    grasp = hand.post("gripper/actions/grasp", {"object": bar}, "dry-run")
    assert grasp.status_code == 409 and "It is unknown where bar is" in grasp.json()["detail"], grasp.text


@pytest.mark.parametrize(
    ("more", "said"),
    [
        ({"heldBy": "http://elsewhere.test/panda/panda_hand"}, "of this fleet"),
        ({"heldBy": "panda/panda_joint1"}, "is not a link"),
        ({"kind": f"{TERMS}KeepOutZone", "heldBy": "panda/panda_hand"}, "empty space"),
    ],
)
def test_what_cannot_hold_an_object_is_refused(hand: Hand, more: Body, said: str) -> None:
    holder = more["heldBy"] if "://" in more["heldBy"] else hand.browser.root + more["heldBy"]
    body = {
        "title": "cup", "position": metres(x=0, y=0, z=0),
        "geometry": {"form": f"{TERMS}Sphere", "radius": {"value": 0.1, "unit": f"{UNITS}M"}}, **more, "heldBy": holder,
    }  # fmt: skip
    refused = hand.browser.http.post(str(world(hand.browser).url) + "/objects", json=body)
    assert refused.status_code == 422 and said in refused.json()["detail"], refused.text
