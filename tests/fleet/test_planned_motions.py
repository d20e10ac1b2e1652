"""A simulated Panda among crates: paths that are planned, straight lines, refusals that say what would help."""

import json
import math
from collections.abc import Iterator
from typing import Any

import httpx
import pytest

from browser import Browser
from commanding import ended
from linked_fleet_gateway.extensions.planning import kept_plans, planner
from mcp_client import mcp_session
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
def place(tmp_path_factory: pytest.TempPathFactory) -> Place:
    return Place(tmp_path_factory.mktemp("world"))


@pytest.fixture(scope="module")
def browser(place: Place) -> Iterator[Browser]:
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


def prepared(browser: Browser, url: str, content: str, headers: dict[str, str]) -> httpx.Response:
    """Return the answer to a POST once the shapes are prepared."""

    def answered() -> httpx.Response | None:
        answer = browser.http.post(url, content=content, headers=headers)
        return None if answer.status_code == 503 else answer

    return eventually(answered, "an answer that is not 503")


class Arm:
    """A client that moves Panda."""

    def __init__(self, browser: Browser) -> None:
        self.browser, self.root = browser, f"{browser.root}panda/"

    def post(self, action: str, body: dict[str, Any], prefer: str = "") -> httpx.Response:
        """Send a request once the shapes are prepared."""
        headers = {"content-type": "application/json", "accept": "application/json"}
        headers |= {"prefer": prefer} if prefer else {}
        return prepared(self.browser, f"{self.root}actions/{action}", json.dumps(body), headers)

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

    def body_of_reach(self, x: float, y: float, z: float, path: str = "") -> dict[str, Any]:
        place = {"x": x, "y": y, "z": z, "unit": f"{UNITS}M"}
        return {"link": f"{self.root}panda_hand", "position": place} | ({"path": TERMS + path} if path else {})

    def reach(self, x: float, y: float, z: float, path: str = "", prefer: str = "dry-run") -> httpx.Response:
        return self.post("reach", self.body_of_reach(x, y, z, path), prefer)


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
    alone = panda.post("moveJoints", panda.body({1: 0.0}, "Planned"), "dry-run")
    assert alone.json()["type"].endswith("#no-path-found") and "Name further joints" in alone.json()["detail"]
    assert panda.post("moveJoints", panda.body(BESIDE | {1: 0.0}, "Planned"), "dry-run").status_code == 200


def test_a_rehearsal_shows_the_path(panda: Arm) -> None:
    said = panda.post("moveJoints", panda.body(BESIDE, "Planned"), "dry-run").json()
    assert said["collisionFree"] is True
    times = [each["atTime"] for each in said["waypoint"]]
    assert 10 <= len(times) <= 40 and times == sorted(times)
    assert times[-1] == pytest.approx(said["duration"]["value"], abs=0.01)
    assert {each["joint"]: each["value"] for each in said["waypoint"][-1]["target"]} == pytest.approx(
        {f"{panda.root}panda_joint{n}": value for n, value in BESIDE.items()}, abs=1e-5
    )


def test_the_rehearsal_of_a_mission_shows_the_path_of_each_step(panda: Arm) -> None:
    def step(action: str, body: dict[str, Any]) -> dict[str, Any]:
        return {"type": "invoke", "action": f"{panda.root}actions/{action}", "body": body}

    steps = [
        step("moveJoints", panda.body(BESIDE, "Planned")),
        step("moveJoints", panda.body(HOME, "Planned")),
        step("moveJoints", panda.body({1: -0.5})),
        step("moveJoints", panda.body(HOME)),
        step("reach", panda.body_of_reach(0.45, -0.2, 0.5, "Straight")),
    ]
    said = {"title": "to and fro", "step": {"type": "sequence", "steps": steps}}
    fields = {"prefer": "dry-run, return=representation", "accept": "application/json"}
    answer = panda.browser.http.post(f"{panda.browser.root}missions", json=said, headers=fields)
    assert answer.status_code == 200, answer.text
    there, back, direct, _, straight = answer.json()["steps"]
    assert all(each["plannedBecause"].startswith("on the direct path ") for each in (there, back))
    assert straight["plannedBecause"] == "a straight line was asked for" and len(straight["waypoint"]) >= 2
    assert direct["waypoint"] == [] and "plannedBecause" not in direct
    for each, end in ((there, BESIDE), (back, HOME)):
        times = [place["atTime"] for place in each["waypoint"]]
        assert 10 <= len(times) <= 40 and times == sorted(times)
        assert times[-1] == pytest.approx(each["duration"]["value"], abs=0.01)
        last = [place["value"] for place in each["waypoint"][-1]["target"]]
        assert last == pytest.approx(list(end.values()), abs=1e-5)


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


# -- kept plans -----------------------------------------------------------------------------------------------------


def rehearsed(arm: Arm, **more: Any) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return the body of a planned motion, and what its rehearsal says."""
    body = arm.body(BESIDE, "Planned") | more
    answer = arm.post("moveJoints", body, "dry-run")
    assert answer.status_code == 200, answer.text
    return body, answer.json()


def changed(answer: httpx.Response) -> dict[str, Any]:
    """Return the refusal of a plan because something has changed."""
    assert answer.status_code == 409 and answer.json()["type"].endswith("#changed"), answer.text
    said: dict[str, Any] = answer.json()
    return said


def test_a_plan_is_carried_out_as_it_was_rehearsed(panda: Arm) -> None:
    body, said = rehearsed(panda)
    again = panda.post("moveJoints", body | {"plan": said["plan"]}, "dry-run").json()
    assert again["waypoint"] == said["waypoint"] and again["plan"] == said["plan"]
    headers = {"idempotency-key": '"once"', "accept": "application/json"}
    first, repeated = (
        panda.browser.http.post(f"{panda.root}actions/moveJoints", json=body | {"plan": said["plan"]}, headers=headers)
        for _ in range(2)
    )
    assert first.status_code == 204 and repeated.headers["location"] == first.headers["location"], repeated.text
    ended(panda.browser, first.headers["location"])
    invocation = panda.browser.http.get(first.headers["location"], headers={"accept": "application/json"}).json()
    assert invocation["state"] == f"{TERMS}succeeded" and invocation["duration"] == said["duration"]
    assert invocation["plannedBecause"] == said["plannedBecause"]
    assert "is at" in changed(panda.post("moveJoints", body | {"plan": said["plan"]}))["detail"], "it is at the goal"


def test_a_plan_goes_to_another_gateway_and_another_syntax(panda: Arm, place: Place) -> None:
    targets = " , ".join(
        f"[ lf:ofJoint <{panda.root}panda_joint{n}> ; vom:numericalValue {value} ; vom:unit unit:RAD ]"
        for n, value in BESIDE.items()
    )
    prefixes = (
        f"@prefix lf: <{TERMS}> . @prefix unit: <{UNITS}> . @prefix vom: <http://vocab.arvida.de/2015/06/vom/vocab#> . "
    )
    turtle = f"[] a lf:JointTargets ; lf:path lf:Planned ; lf:target {targets} %s ."
    headers = {"content-type": "text/turtle", "prefer": "dry-run", "accept": "application/json"}
    action = f"{panda.root}actions/moveJoints"
    said = panda.browser.http.post(action, content=prefixes + turtle % "", headers=headers).json()
    with Place(place.state, zenoh=place.zenoh).gateway() as (_, other):
        live(other, "panda")
        content = (prefixes + turtle % f"; lf:plan '{said['plan']}'").replace(panda.browser.root, other.root)
        there = prepared(other, f"{other.root}panda/actions/moveJoints", content, headers)
    assert there.status_code == 200, there.text
    one, two = ([each["target"] for each in answer["waypoint"]] for answer in (said, there.json()))
    assert [[each["value"] for each in row] for row in one] == [[each["value"] for each in row] for row in two]


def test_a_plan_that_something_has_come_into_is_refused_by_name(panda: Arm) -> None:
    body, said = rehearsed(panda)
    put_object(panda.browser, crate("late", 0.15, 0.45, 0.5, 120))
    refused = changed(panda.post("moveJoints", body | {"plan": said["plan"]}))
    assert "late" in refused["detail"] and refused["names"][1].startswith("late") and len(refused["point"]) == 3


def test_a_plan_is_refused_once_the_robot_stands_elsewhere(panda: Arm) -> None:
    body, said = rehearsed(panda)
    panda.go({6: HOME[6] - 0.1})
    assert "panda_joint6" in changed(panda.post("moveJoints", body | {"plan": said["plan"]}))["detail"]
    panda.go({6: HOME[6]})
    put_robot(panda.browser, "panda", 0.05, 0, 0)
    assert "placement" in changed(panda.post("moveJoints", body | {"plan": said["plan"]}))["detail"]


def test_a_plan_belongs_to_its_request(panda: Arm) -> None:
    body, said = rehearsed(panda)
    other = panda.body(BESIDE | {7: 0.6}, "Planned") | {"plan": said["plan"]}
    assert "another one" in changed(panda.post("moveJoints", other))["detail"]
    assert "no such plan" in changed(panda.post("moveJoints", body | {"plan": "nothing"}))["detail"]


def test_reach_offers_a_plan_for_its_direct_path_too(panda: Arm) -> None:
    place = {"x": 0.45, "y": -0.2, "z": 0.5, "unit": f"{UNITS}M"}
    body = {"link": f"{panda.root}panda_hand", "position": place}
    said = panda.post("reach", body, "dry-run").json()
    assert "plannedBecause" not in said
    moved = panda.post("reach", body | {"plan": said["plan"]})
    assert moved.status_code == 204, moved.text
    ended(panda.browser, moved.headers["location"])


def test_language_models_see_the_path_and_get_the_path_that_they_saw(
    panda: Arm, monkeypatch: pytest.MonkeyPatch
) -> None:
    find, used = kept_plans.KeptPlans.find, list[str]()

    async def noting(plans: kept_plans.KeptPlans, id: str) -> kept_plans.Found | None:
        used.append(id)
        return await find(plans, id)

    monkeypatch.setattr(kept_plans.KeptPlans, "find", noting)
    action, body = f"{panda.root}actions/moveJoints", panda.body(BESIDE, "Planned")
    with mcp_session(panda.browser.root) as model:
        shown = model.call("rehearse", action=action, body=body)["structuredContent"]
        assert shown["plan"] and len(shown["waypoint"]) >= 10 and shown["closest"], shown
        put_object(panda.browser, crate("late", 0.15, 0.45, 0.5, 120))
        stale = model.call("act", action=action, body=body | {"plan": shown["plan"]})
        assert stale["isError"] and stale["structuredContent"]["type"].endswith("#changed"), stale
        for each in contents(panda.browser):
            if "late" in panda.browser.http.get(each).text:
                panda.browser.http.delete(each)
        done = model.call("act", action=action, body=body)
    assert not done["isError"], done
    assert done["structuredContent"]["plannedBecause"]
    assert used[0] == shown["plan"] and len(set(used)) == 2, "the plan of the rehearsal of the tool act is used"


def test_a_client_keeps_a_few_plans_only(panda: Arm) -> None:
    body, first = rehearsed(panda)
    for _ in range(kept_plans.MOST_OF_ONE):
        rehearsed(panda)
    assert "no such plan" in changed(panda.post("moveJoints", body | {"plan": first["plan"]}))["detail"]


# -- constraints ----------------------------------------------------------------------------------------------------

TURN = {1: 0.9}
"""A turn of the whole arm, by which the hand stays as upright as it is."""


def constrained(arm: Arm, positions: dict[int, float], **constraints: Any) -> httpx.Response:
    tip = {"tip": f"{arm.root}panda_hand"}
    return arm.post("moveJoints", arm.body(positions, "Planned") | tip | constraints, "dry-run")


def quantity(value: float, unit: str) -> dict[str, Any]:
    return {"value": value, "unit": UNITS + unit}


def point(x: float, y: float, z: float) -> dict[str, Any]:
    return {"x": x, "y": y, "z": z, "unit": f"{UNITS}M"}


def test_a_motion_keeps_to_constraints(panda: Arm) -> None:
    upright, speed = quantity(15, "DEG"), quantity(100, "MilliM-PER-SEC")
    said = constrained(panda, {1: -0.6}, upright=upright, tipSpeed=speed)
    assert said.status_code == 200, said.text
    seen = said.json()
    assert seen["plannedBecause"] == "it keeps to constraints"
    assert seen["duration"]["value"] > 0.6 * 0.5 / 0.1, "the hand is about half a metre from the axis"
    assert seen["leastManipulability"]["value"] > 0.0 and seen["leastManipulabilityTime"]["value"] >= 0.0
    body = panda.body({1: -0.6}, "Planned") | {"tip": f"{panda.root}panda_hand", "upright": upright, "tipSpeed": speed}
    moved = panda.post("moveJoints", body | {"plan": seen["plan"]})
    assert moved.status_code == 204, moved.text
    ended(panda.browser, moved.headers["location"])
    invocation = panda.browser.http.get(moved.headers["location"], headers={"accept": "application/json"}).json()
    assert invocation["leastManipulability"] == seen["leastManipulability"]


@pytest.mark.parametrize(
    ("positions", "constraints", "broken", "share", "says"),
    [
        (
            {5: 1.0},
            {"upright": quantity(10, "DEG")},
            "upright",
            1.0,
            "from the vertical, and may be 10.0°, at its goal",
        ),
        (TURN, {"upright": quantity(10, "DEG") | {"axis": "x"}}, "upright", 0.0, "its axis x is 90.0°"),
        (TURN, {"stayIn": {"lower": point(0.2, -1, 0), "upper": point(0.4, 1, 2)}}, "stayIn", 1.0, "at least 0.200 m"),
        (TURN, {"leastManipulability": 5}, "leastManipulability", 0.0, "may be 5 at least, where the motion begins"),
    ],
)
def test_what_cannot_keep_to_a_constraint_says_why(
    panda: Arm, positions: dict[int, float], constraints: dict[str, Any], broken: str, share: float, says: str
) -> None:
    refused = constrained(panda, {n: HOME[n] + by for n, by in positions.items()}, **constraints)
    assert refused.status_code == 409, refused.text
    said = refused.json()
    assert said["type"].endswith("#breaks-constraint") and says in said["detail"], said
    assert said["broken"] == TERMS + broken and said["share"] == share and "limit" in said and "value" in said


def test_a_motion_that_takes_hours_is_refused(panda: Arm) -> None:
    refused = constrained(panda, TURN, tipSpeed=quantity(1e-6, "M-PER-SEC"))
    assert refused.status_code == 409 and "takes at most 3600 s" in refused.json()["detail"], refused.text


def test_constraints_need_a_path_and_a_sense(panda: Arm) -> None:
    plain = panda.post("moveJoints", panda.body(TURN) | {"upright": quantity(10, "DEG")}, "dry-run")
    assert plain.status_code == 422 and "add lf:path lf:Planned" in plain.json()["detail"]
    inside_out = constrained(panda, TURN, stayIn={"lower": point(1, -1, 0), "upper": point(-1, 1, 2)})
    assert inside_out.status_code == 422 and "x from 1 m to -1 m" in inside_out.json()["detail"]
    still = constrained(panda, {7: 0.0}, tip=f"{panda.root}panda_link3", upright=quantity(10, "DEG"))
    assert still.status_code == 422 and "does not move panda_link3" in still.json()["detail"]


def test_a_robot_that_stands_in_something_is_told_what_it_is(panda: Arm) -> None:
    put_object(panda.browser, crate("stuck", 0.31, 0.0, 0.52, size_mm=60))
    refused = panda.post("moveJoints", panda.body(BESIDE, "Planned"), "dry-run")
    said = refused.json()
    assert refused.status_code == 409 and said["type"].endswith("#start-blocked"), said
    assert said["names"][1] == "stuck (obstacle)" and "lf:mayTouch" in said["detail"]


def test_what_is_in_the_way_of_a_path_that_was_not_found_is_named(panda: Arm, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(planner, "SEARCH_S", 1e-6)
    refused = panda.post("moveJoints", panda.body(BESIDE, "Planned"), "dry-run")
    said = refused.json()
    assert refused.status_code == 409 and said["type"].endswith("#no-path-found"), said
    assert said["names"] == ["panda_link7 of panda", "crate (obstacle)"]
    assert said["detail"].endswith("On the direct path panda_link7 of panda would meet crate (obstacle).")
