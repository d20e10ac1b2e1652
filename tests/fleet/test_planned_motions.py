"""A simulated Panda among crates: paths that are planned, straight lines, refusals that say what would help."""

import json
import math
from collections.abc import Iterator
from typing import Any

import httpx
import pytest

from browser import Browser
from commanding import ended
from linked_fleet_gateway.extensions.planning import planner
from running import eventually, process
from scene_client import contents, crate, put_object, put_robot
from small_fleet import Place, live

pytestmark = pytest.mark.virtual

TERMS = "https://w3id.org/linked-fleet#"
UNITS = "http://qudt.org/vocab/unit/"
BESIDE = {1: 1.2, 2: -0.35, 3: 0.0, 4: -2.2, 5: 0.0, 6: 1.9, 7: 0.7}
"""The positions of joints (rad) on the other side of the crate."""
HOME = {1: 0.0, 2: -0.785, 3: 0.0, 4: -2.356, 5: 0.0, 6: 1.571, 7: 0.785}


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    place = Place(tmp_path_factory.mktemp("world"))
    robots = process("-m", "linked_fleet_agent", "--robot=panda", "--robot=ur5", "--connect", place.zenoh)
    with robots, place.gateway() as (_, browser):
        for name in ("panda", "ur5"):
            live(browser, name)
        yield browser


@pytest.fixture
def panda(browser: Browser) -> "Iterator[Arm]":
    """Yield Panda at home, with a crate to its left."""
    for each in contents(browser):
        assert browser.http.delete(each).status_code == 204
    put_robot(browser, "panda", 0, 0, 0)
    arm = Arm(browser)
    arm.go(HOME)
    put_object(browser, crate("crate", 0.5, 0.35, 0.4, 300))
    yield arm


class Arm:
    """A client that moves Panda."""

    def __init__(self, browser: Browser) -> None:
        self.browser, self.root = browser, f"{browser.root}panda/"

    def post(self, action: str, body: dict[str, Any], prefer: str = "") -> httpx.Response:
        """Send a request once the shapes are prepared."""
        headers = {"accept": "application/json"} | ({"prefer": prefer} if prefer else {})

        def answered() -> httpx.Response | None:
            answer = self.browser.http.post(f"{self.root}actions/{action}", json=body, headers=headers)
            return None if answer.status_code == 503 else answer

        return eventually(answered, "an answer that is not 503")

    def body(self, positions: dict[int, float], path: str = "") -> dict[str, Any]:
        targets = [
            {"joint": f"{self.root}panda_joint{n}", "value": value, "unit": f"{UNITS}RAD"}
            for n, value in positions.items()
        ]
        return {"target": targets} | ({"path": TERMS + path} if path else {})

    def go(self, positions: dict[int, float], path: str = "") -> dict[str, Any]:
        answer = self.post("moveJoints", self.body(positions, path))
        assert answer.status_code == 204, answer.text
        ended(self.browser, answer.headers["location"])
        said: dict[str, Any] = self.browser.http.get(
            answer.headers["location"], headers={"accept": "application/json"}
        ).json()
        assert said["state"] == f"{TERMS}succeeded", said
        return said

    def reach(self, x: float, y: float, z: float, path: str = "", prefer: str = "dry-run") -> httpx.Response:
        place = {"x": x, "y": y, "z": z, "unit": f"{UNITS}M"}
        body = {"link": f"{self.root}panda_hand", "position": place} | ({"path": TERMS + path} if path else {})
        return self.post("reach", body, prefer)


def test_a_crate_in_the_way_is_passed(panda: Arm) -> None:
    direct = panda.post("moveJoints", panda.body(BESIDE), "dry-run")
    assert direct.status_code == 409
    assert direct.json()["retryWith"] == [{"path": f"{TERMS}Planned"}]
    assert "lf:Planned" in direct.json()["detail"]
    said = panda.go(BESIDE, "Planned")
    assert said["plannedBecause"].startswith("on the direct path panda_link7 would meet an obstacle")
    reached = {each["joint"].rpartition("joint")[2]: each["value"] for each in said["result"]}
    assert {int(n): value for n, value in reached.items()} == pytest.approx(BESIDE, abs=2e-3)


def test_a_single_joint_is_offered_no_way_round(panda: Arm) -> None:
    panda.go(BESIDE, "Planned")
    refused = panda.post("moveJoints", panda.body({1: 0.0}), "dry-run")
    assert refused.status_code == 409 and "retryWith" not in refused.json(), refused.text


def test_a_rehearsal_shows_the_path(panda: Arm) -> None:
    said = panda.post("moveJoints", panda.body(BESIDE, "Planned"), "dry-run").json()
    assert said["collisionFree"] is True
    times = [each["atTime"] for each in said["waypoint"]]
    assert 10 <= len(times) <= 40 and times == sorted(times)
    assert times[-1] == pytest.approx(said["duration"]["value"], abs=0.01)
    assert {each["joint"]: each["value"] for each in said["waypoint"][-1]["target"]} == pytest.approx(
        {f"{panda.root}panda_joint{n}": value for n, value in BESIDE.items()}, abs=1e-5
    )


def test_a_rehearsal_says_where_the_robot_comes_closest_to_what(panda: Arm) -> None:
    direct = panda.post("moveJoints", panda.body({1: -1.2}), "dry-run").json()["closest"][0]
    (crate_iri,) = contents(panda.browser)
    assert crate_iri in direct["things"] and direct["clearance"]["value"] > 0.01, direct
    assert direct["share"] == 0.0 and "atTime" not in direct, "it turns away from the crate"
    planned = panda.post("moveJoints", panda.body(BESIDE, "Planned"), "dry-run").json()
    (near,) = planned["closest"]
    assert near["things"][1] == crate_iri and near["title"].endswith("crate (obstacle)"), near
    assert 0.01 <= near["clearance"]["value"] < 0.2 and near["uncertainty"]["value"] <= 0.01
    assert 0.0 < near["atTime"] < planned["duration"]["value"]
    assert abs(near["position"]["x"] - 0.5) < 0.3 and abs(near["position"]["y"] - 0.35) < 0.3


def test_a_planned_path_keeps_to_the_speed_that_was_asked_for(panda: Arm) -> None:
    whole, half = (
        panda.post("moveJoints", panda.body(BESIDE, "Planned") | {"speedScale": scale}, "dry-run").json()
        for scale in (1.0, 0.5)
    )
    assert half["duration"]["value"] > 1.5 * whole["duration"]["value"]
    slow = {"value": 10, "unit": f"{UNITS}DEG-PER-SEC"}
    turn = {"value": 1.2, "unit": f"{UNITS}RAD", "path": f"{TERMS}Planned", "speed": slow}
    said = panda.browser.http.post(
        f"{panda.root}panda_joint1/actions/rotate",
        json=turn,
        headers={"prefer": "dry-run", "accept": "application/json"},
    )
    assert said.status_code in {200, 409}, said.text
    assert said.status_code == 409 or said.json()["duration"]["value"] > 1.2 / math.radians(10)


def test_a_free_direct_path_is_taken_although_a_planned_one_was_asked_for(panda: Arm) -> None:
    said = panda.go({1: -0.5}, "Planned")
    assert "plannedBecause" not in said


def test_reach_finds_a_way_by_itself_and_says_so(panda: Arm) -> None:
    panda.go(BESIDE, "Planned")
    said = panda.reach(0.45, -0.1, 0.5)
    assert said.status_code == 200, said.text
    assert said.json()["plannedBecause"].startswith("on the direct path")
    assert panda.reach(0.45, -0.1, 0.5, "Direct").status_code == 409


def test_a_pose_inside_of_something_is_refused_by_name(panda: Arm) -> None:
    refused = panda.reach(0.5, 0.35, 0.45)
    assert refused.status_code == 409
    said = refused.json()
    assert said["type"].endswith("#goal-blocked")
    assert "crate" in said["detail"] and said["names"][1].startswith("crate")
    assert len(said["things"]) == 2 and len(said["point"]) == 3


def test_a_straight_line_is_straight(panda: Arm) -> None:
    said = panda.reach(0.45, -0.2, 0.5, "Straight").json()
    assert said["pathDeviation"]["value"] <= 0.001
    assert said["plannedBecause"] == "a straight line was asked for"
    moved = panda.reach(0.45, -0.2, 0.5, "Straight", "")
    assert moved.status_code == 204, moved.text
    ended(panda.browser, moved.headers["location"])


def test_a_straight_line_that_ends_says_where(panda: Arm) -> None:
    refused = panda.reach(-0.45, -0.1, 0.5, "Straight")
    said = refused.json()
    assert refused.status_code == 409 and said["type"].endswith("#line-ends"), said
    assert 0 < said["share"] < 1 and len(said["point"]) == 3


def test_a_straight_line_through_a_crate_is_refused(panda: Arm) -> None:
    panda.go(BESIDE, "Planned")
    refused = panda.reach(0.45, -0.1, 0.5, "Straight")
    assert refused.status_code == 409 and refused.json()["type"].endswith(("#collision", "#line-ends"))


def test_joints_of_two_arms_are_on_no_line(panda: Arm) -> None:
    fingers = {"joint": f"{panda.root}panda_finger_joint1", "value": 0.02, "unit": f"{UNITS}M"}
    body = panda.body({1: 0.3}, "Straight")
    body["target"].append(fingers)
    refused = panda.post("moveJoints", body, "dry-run")
    assert refused.status_code in {204, 409, 422}, refused.text


def test_without_a_placement_nothing_can_be_planned(panda: Arm) -> None:
    body = {"target": [{"joint": f"{panda.browser.root}ur5/elbow_joint", "value": 0.3, "unit": f"{UNITS}RAD"}]}
    refused = panda.browser.http.post(
        f"{panda.browser.root}ur5/actions/moveJoints",
        content=json.dumps(body | {"path": f"{TERMS}Planned"}),
        headers={"content-type": "application/json", "prefer": "dry-run"},
    )
    assert refused.status_code == 409 and "placement" in refused.json()["detail"]


def test_a_client_that_plans_too_much_is_busy(panda: Arm, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(planner, "MOST_OF_ONE", 0)
    answer = panda.browser.http.post(
        f"{panda.root}actions/moveJoints", json=panda.body(BESIDE, "Planned"), headers={"prefer": "dry-run"}
    )
    assert answer.status_code == 503 and answer.json()["type"].endswith("#busy")


def test_an_arm_that_moves_is_refused_a_planned_path(panda: Arm) -> None:
    moving = panda.post("moveJoints", panda.body({1: -2.0, 4: -1.0}) | {"speedScale": 0.05}, "respond-async")
    assert moving.status_code == 202, moving.text
    refused = panda.post("moveJoints", panda.body(BESIDE, "Planned"))
    assert refused.status_code == 409 and "is moving" in refused.json()["detail"], refused.text
    panda.browser.http.post(f"{panda.root}actions/stop")
    ended(panda.browser, moving.headers["location"])
