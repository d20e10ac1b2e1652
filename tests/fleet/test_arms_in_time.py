"""Two simulated arms that share space pass each other when their times allow, and stop when these are not kept."""

import math
import re
import time
from collections.abc import Iterator
from typing import Any

import httpx
import pytest

from browser import LF, Browser, Page
from commanding import ended
from linked_fleet_gateway.extensions.world.motion_watch import OFF_TIME
from running import eventually, process
from scene_client import put_robot
from small_fleet import Place, live

pytestmark = pytest.mark.virtual

TERMS = "https://w3id.org/linked-fleet#"
RAD = "http://qudt.org/vocab/unit/RAD"
OUT = {
    "panda": {"panda_joint2": 0.9, "panda_joint4": -1.0, "panda_joint6": 1.9},
    "ur5": {"shoulder_lift_joint": -0.5, "elbow_joint": 0.6, "wrist_1_joint": -1.6, "wrist_2_joint": -1.57},
}
"""Both arms reach out, about as high as each other."""
TURN = {"panda": "panda_joint1", "ur5": "shoulder_pan_joint"}
APART_M = 1.15


class Cell:
    """A client of two arms that face each other."""

    def __init__(self, browser: Browser) -> None:
        self.browser = browser

    def post(self, robot: str, degrees: float, prefer: str = "", **more: Any) -> httpx.Response:
        """Ask an arm to turn; 0° is towards the other one."""
        targets = {TURN[robot]: math.radians(degrees)} | more.pop("out", {})
        at = [
            {"joint": f"{self.browser.root}{robot}/{joint}", "value": value, "unit": RAD}
            for joint, value in targets.items()
        ]
        return self._post(robot, "moveJoints", {"target": at} | more, prefer)

    def _post(self, robot: str, action: str, body: dict[str, Any], prefer: str) -> httpx.Response:
        headers = {"accept": "application/json"} | ({"prefer": prefer} if prefer else {})
        url = f"{self.browser.root}{robot}/actions/{action}"

        def answered() -> httpx.Response | None:
            answer = self.browser.http.post(url, json=body, headers=headers)
            return None if answer.status_code == 503 else answer

        return eventually(answered, "an answer that is not 503")

    def begin(self, robot: str, degrees: float, **more: Any) -> str:
        answer = self.post(robot, degrees, **more)
        assert answer.status_code == 204, answer.text
        return answer.headers["location"]

    def go(self, robot: str, degrees: float, **more: Any) -> None:
        page = self.end_of(self.begin(robot, degrees, **more))
        assert page.one(LF.state) == LF.succeeded, page.graph.serialize()

    def end_of(self, invocation: str) -> Page:
        return ended(self.browser, invocation)


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    place = Place(tmp_path_factory.mktemp("world"))
    robots = process("-m", "linked_fleet_agent", "--robot=panda", "--robot=ur5", "--connect", place.zenoh)
    with robots, place.gateway() as (_, browser):
        for name in OUT:
            live(browser, name)
        yield browser


@pytest.fixture
def cell(browser: Browser) -> Cell:
    """Return the cell with both arms turned to their left, far from each other."""
    cell = Cell(browser)
    put_robot(browser, "panda", 0, 0, 0)
    put_robot(browser, "ur5", 30, 0, 0)
    for name, out in OUT.items():
        cell.go(name, 100, out=out)
    put_robot(browser, "ur5", APART_M, 0, 0, math.pi)
    return cell


def begin_both(cell: Cell) -> tuple[str, str]:
    """Let both cross the same space, Panda slowly and as soon as it may. Return their invocations."""
    first = cell.begin("ur5", -100, speedScale=0.5)
    time.sleep(0.5)
    refused = cell.post("panda", -100, speedScale=0.15)
    assert refused.status_code == 409, refused.text
    assert int(refused.headers["retry-after"]) == refused.json()["retryAfter"] == pytest.approx(7, abs=1)
    while (answer := cell.post("panda", -100, "dry-run", speedScale=0.15)).status_code == 409:
        time.sleep(0.2)
    assert answer.json()["collisionFree"] is True
    assert cell.post("panda", -100, "dry-run").status_code == 409, "at full speed it is there too early"
    return first, cell.begin("panda", -100, speedScale=0.15)


def test_arms_pass_each_other(cell: Cell) -> None:
    first, second = begin_both(cell)
    assert cell.browser.page(first).one(LF.state) == LF.running
    for each in (first, second):
        assert cell.end_of(each).one(LF.state) == LF.succeeded


def test_the_later_arm_stops_if_the_other_one_does_not_keep_its_times(cell: Cell) -> None:
    first, second = begin_both(cell)
    assert cell.browser.http.delete(first).status_code == 204
    page = cell.end_of(second)
    assert page.one(LF.state) == LF.cancelled
    assert OFF_TIME in str(page.one(LF.reason)), page.graph.serialize()


def test_a_planned_motion_waits_until_the_other_arm_has_passed(cell: Cell) -> None:
    first = cell.begin("ur5", -100, speedScale=0.5)
    time.sleep(0.5)
    direct = cell.post("panda", -100)
    assert direct.json().get("retryWith") == [{"path": f"{TERMS}Planned"}], direct.text
    assert "With lf:path lf:Planned the motion waits for that." in direct.json()["detail"]
    second = cell.begin("panda", -100, path=f"{TERMS}Planned")
    page = cell.browser.page(second)
    assert re.search(r"another robot after .* it waits \d\.\d s for another robot", str(page.one(LF.plannedBecause)))
    for each in (first, second):
        assert cell.end_of(each).one(LF.state) == LF.succeeded


def test_a_motion_that_waits_ends_if_the_other_arm_stops(cell: Cell) -> None:
    first = cell.begin("ur5", -100, speedScale=0.5)
    time.sleep(0.5)
    second = cell.begin("panda", -100, path=f"{TERMS}Planned")
    time.sleep(1.5)
    assert cell.browser.http.delete(first).status_code == 204
    page = cell.end_of(second)
    assert page.one(LF.state) == LF.cancelled and OFF_TIME in str(page.one(LF.reason)), page.graph.serialize()
