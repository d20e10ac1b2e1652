"""Missions of two simulated arms that share space, rehearsed: each step from where those before it leave the arms."""

import math
from collections.abc import Iterator
from typing import Any

import httpx
import pyshacl
import pytest
import rdflib

from browser import LF, Browser
from commanding import ended
from running import eventually, process
from scene_client import put_robot
from small_fleet import Place, live

pytestmark = pytest.mark.virtual

RAD = "http://qudt.org/vocab/unit/RAD"
OUT = {
    "panda": {"panda_joint2": 0.9, "panda_joint4": -1.0, "panda_joint6": 1.9},
    "ur5": {"shoulder_lift_joint": -0.5, "elbow_joint": 0.6, "wrist_1_joint": -1.6, "wrist_2_joint": -1.57},
}
"""Both arms reach out, about as high as each other."""
TURN = {"panda": "panda_joint1", "ur5": "shoulder_pan_joint"}


class Cell:
    """A client of two arms that face each other, 1.15 m apart."""

    def __init__(self, browser: Browser) -> None:
        self.browser = browser

    def turn(self, robot: str, degrees: float, **more: Any) -> dict[str, Any]:
        """Return a step that turns an arm; 0° is towards the other one."""
        targets = {TURN[robot]: math.radians(degrees)} | more.pop("out", {})
        at = [
            {"joint": f"{self.browser.root}{robot}/{joint}", "value": value, "unit": RAD}
            for joint, value in targets.items()
        ]
        action = f"{self.browser.root}{robot}/actions/moveJoints"
        return {"type": "invoke", "action": action, "body": {"target": at}, "title": f"{robot} to {degrees}", **more}

    def go(self, step: dict[str, Any]) -> None:
        def answered() -> httpx.Response | None:
            answer = self.browser.http.post(step["action"], json=step["body"])
            return None if answer.status_code == 503 else answer

        answer = eventually(answered, "an answer that is not 503")
        assert ended(self.browser, answer.headers["location"]).one(LF.state) == LF.succeeded

    def mission(self, *steps: dict[str, Any], kind: str = "sequence", **more: Any) -> str:
        said = {"title": "crossing", "step": {"type": kind, "steps": list(steps)}, **more}
        answer = self.browser.http.post(f"{self.browser.root}missions", json=said)
        assert answer.status_code == 201, answer.text
        return answer.headers["location"]

    def rehearse(self, *steps: dict[str, Any], kind: str = "sequence", accept: str = "json") -> httpx.Response:
        fields = {"prefer": "dry-run", "accept": f"application/{accept}"}
        mission = self.mission(*steps, kind=kind)
        answer = self.browser.http.post(f"{mission}/actions/run", headers=fields)
        assert answer.status_code != 200 or answer.headers["preference-applied"] == "dry-run"
        return answer


@pytest.fixture(scope="module")
def cell(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Cell]:
    """Yield the cell with both arms turned to their left, far from each other."""
    place = Place(tmp_path_factory.mktemp("world"))
    robots = process("-m", "linked_fleet_agent", "--robot=panda", "--robot=ur5", "--connect", place.zenoh)
    with robots, place.gateway() as (_, browser):
        for name in OUT:
            live(browser, name)
        cell = Cell(browser)
        put_robot(browser, "panda", 0, 0, 0)
        put_robot(browser, "ur5", 30, 0, 0)
        for name, out in OUT.items():
            cell.go(cell.turn(name, 100, out=out))
        put_robot(browser, "ur5", 1.15, 0, 0, math.pi)
        yield cell


def steps(answer: httpx.Response) -> list[tuple[str, bool | None, str]]:
    """Return path, verdict and reason of each step."""
    assert answer.status_code == 200, answer.text
    return [(each["step"], each.get("collisionFree"), each.get("reason", "")) for each in answer.json()["steps"]]


def test_a_step_begins_where_the_one_before_has_ended(cell: Cell) -> None:
    answer = cell.rehearse(cell.turn("panda", -100), cell.turn("panda", 100), cell.turn("panda", 40))
    assert steps(answer) == [("0.0", True, ""), ("0.1", True, ""), ("0.2", True, "")]
    there, back, _ = (each["duration"]["value"] for each in answer.json()["steps"])
    assert there == pytest.approx(back, rel=0.05), "the way back is as long as the way there"
    total = sum(each["duration"]["value"] for each in answer.json()["steps"])
    assert answer.json()["duration"]["value"] == pytest.approx(total, abs=0.01)


def test_an_arm_that_an_earlier_step_has_moved_is_in_the_way(cell: Cell) -> None:
    alone = cell.rehearse(cell.turn("panda", -100))
    assert steps(alone) == [("0.0", True, "")]
    refused = cell.rehearse(cell.turn("ur5", 0), cell.turn("panda", -100))
    assert (refused.status_code, refused.json()["type"].rpartition("#")[2]) == (409, "collision")
    assert refused.json()["detail"].startswith("Step panda to -100: ")
    assert any("/ur5" in each for each in refused.json()["things"])
    back = cell.rehearse(cell.turn("ur5", 0), cell.turn("ur5", 100), cell.turn("panda", -100))
    assert steps(back) == [("0.0", True, ""), ("0.1", True, ""), ("0.2", True, "")]


def test_branches_count_together_for_what_comes_after_them(cell: Cell) -> None:
    both = {"type": "parallel", "steps": [cell.turn("ur5", 0), {"type": "wait", "seconds": 60}]}
    refused = cell.rehearse(both, cell.turn("panda", -100))
    assert refused.status_code == 409, refused.text
    waited = cell.rehearse(both)
    assert waited.json()["duration"]["value"] == 60


def test_what_is_not_known_is_said_step_by_step(cell: Cell) -> None:
    either = {"type": "parallel", "anySuffices": True, "steps": [cell.turn("ur5", 50), {"type": "wait", "seconds": 9}]}
    answer = cell.rehearse(either, cell.turn("ur5", 100), cell.turn("panda", 90))
    assert [each[0] for each in steps(answer)] == ["0.0.0", "0.1", "0.2"]
    assert steps(answer)[1][2] == "where ur5 is then is unknown"
    assert answer.json()["steps"][1]["title"] == "ur5 to 100"


def test_the_first_step_that_is_not_refused_counts(cell: Cell) -> None:
    choice = {"type": "firstOf", "steps": [cell.turn("panda", -100), cell.turn("panda", 70)]}
    answer = cell.rehearse(cell.turn("ur5", 0), choice)
    (_, first, second) = steps(answer)
    assert (first[0], second) == ("0.1.0", ("0.1.1", True, ""))
    assert "would meet" in first[2]


def test_a_repeated_step_takes_its_time_again(cell: Cell) -> None:
    there = cell.rehearse({"type": "repeat", "times": 5, "step": {"type": "wait", "seconds": 2}})
    assert there.json()["duration"]["value"] == 10
    rounds = cell.rehearse({"type": "repeat", "times": 100, "step": cell.turn("panda", 60)})
    assert [each[0] for each in steps(rounds)] == ["0.0.0#0", "0.0.0#1"]
    assert rounds.json()["steps"][1]["duration"]["value"] == 0


def test_a_precondition_is_that_of_the_place_where_the_step_begins(cell: Cell) -> None:
    expects = {"joint": f"{cell.browser.root}panda/panda_joint1", "value": 1.0, "unit": RAD, "tolerance": 0.01}
    step = cell.turn("panda", 90)
    step["body"] = {**step["body"], "precondition": [expects]}
    assert cell.rehearse(step).json()["type"].endswith("#changed")
    assert steps(cell.rehearse(cell.turn("panda", math.degrees(1.0)), step))[1] == ("0.1", True, "")
    assert cell.rehearse(cell.turn("panda", 60), step).json()["type"].endswith("#changed")


def test_a_mission_in_a_mission_is_rehearsed_with_its_steps(cell: Cell) -> None:
    degrees = {"variable": "angle"}
    step = cell.turn("panda", 90)
    step["body"] = {"target": [{**step["body"]["target"][0], "value": degrees}]}
    parameters = [{"name": "angle", "type": "number", "minimum": -2, "maximum": 2}]
    inner = cell.mission(step, parameters=parameters)
    run = {"type": "invoke", "action": f"{inner}/actions/run", "body": {"angle": math.radians(-100)}}
    assert steps(cell.rehearse(run)) == [("0.0/0.0", True, "")]
    assert cell.rehearse(cell.turn("ur5", 0), run).json()["type"].endswith("#collision")


def test_many_steps_end_in_time(cell: Cell) -> None:
    step: dict[str, Any] = cell.turn("panda", 60)
    for _ in range(13):
        step = {"type": "repeat", "times": 1000, "step": step}
    answer = cell.rehearse(step)
    assert any("too many steps" in each[2] or "too long" in each[2] for each in steps(answer))


def test_a_rehearsal_conforms_to_its_shape_and_moves_nothing(cell: Cell) -> None:
    before = cell.browser.http.get(f"{cell.browser.root}mission-runs").text
    answer = cell.rehearse(cell.turn("panda", -100), cell.turn("panda", 60), accept="n-triples")
    graph = rdflib.Graph().parse(data=answer.text, format="nt")
    assert len(list(graph.objects(None, LF.stepRehearsal))) == 2
    assert cell.browser.http.get(f"{cell.browser.root}mission-runs").text == before
    shapes = rdflib.Graph().parse(data=cell.browser.http.get(f"{cell.browser.root}vocabulary").text)
    assert (LF.RehearsalShape, None, None) in shapes and (LF.StepRehearsalShape, None, None) in shapes
    conforms, _, text = pyshacl.validate(graph, shacl_graph=shapes)
    assert conforms, text


def test_a_mission_is_rehearsed_before_it_is_kept(cell: Cell) -> None:
    def ask(*steps: dict[str, Any], **more: Any) -> httpx.Response:
        said = {"title": "crossing", "step": {"type": "sequence", "steps": steps}} | more
        fields = {"prefer": "dry-run, return=representation", "accept": "application/json"}
        return cell.browser.http.post(f"{cell.browser.root}missions", json=said, headers=fields)

    def kept() -> int:
        return cell.browser.http.get(f"{cell.browser.root}missions").text.count("/run>")

    before, turn = kept(), cell.turn("ur5", 60)
    turn["body"]["target"][0]["value"] = {"variable": "angle"}
    parameters = [
        {"name": "angle", "type": "number", "minimum": 0.9, "maximum": 1.1},
        {"name": "where", "type": "iri"},
    ]
    somewhere = {"type": "invoke", "kind": str(LF.StopRobot), "of": {"variable": "where"}}
    answer = ask(turn, somewhere, parameters=parameters)
    assert (answer.status_code, answer.headers["preference-applied"]) == (200, "dry-run, return=representation")
    first, second = answer.json()["steps"]
    (target,) = first["target"]
    assert (first["step"], target["value"], target["joint"].rpartition("/")[2]) == (
        "0.0", pytest.approx(1.0, abs=1e-5), TURN["ur5"],
    )  # fmt: skip
    assert second["reason"] == "it needs where, which who runs it gives"
    refused = ask(cell.turn("ur5", 60), cell.turn("panda", 0), cell.turn("ur5", 0))
    assert (refused.status_code, refused.json()["findings"][0]["step"]) == (409, "0.2")
    assert kept() == before
