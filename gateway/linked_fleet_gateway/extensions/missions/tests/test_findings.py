"""What is wrong with a mission is said of each step and parameter, with the place in it."""

from typing import Any

import msgspec
import pytest

from linked_fleet_gateway.api import Busy, Conflict, FleetError, UnprocessableContent
from linked_fleet_gateway.extensions.missions.findings import Findings, finding_of_decoding
from linked_fleet_gateway.extensions.missions.mission import Mission, Notify, walk_paths
from linked_fleet_gateway.extensions.missions.reading import check, decoded

BASE = "http://localhost/missions"


def refusal(mission: dict[str, Any]) -> FleetError:
    with pytest.raises(UnprocessableContent) as refused:
        check(decoded(msgspec.json.encode(mission), Mission, "mission", BASE))
    return refused.value


def findings_of(error: FleetError) -> list[dict[str, str]]:
    found = error.added["findings"]
    assert isinstance(found, list)
    return [each for each in found if isinstance(each, dict)]


@pytest.mark.parametrize(
    ("step", "path", "member", "message"),
    [
        ({"type": "wait", "seconds": -1}, "0", "seconds", "Expected a number >= 0.0."),
        ({"type": "sequence", "steps": []}, "0", "steps", "Expected a list of length >= 1."),
        ({"type": "repeat", "times": 2}, "0", None, "step is missing."),
        ({"type": "repeat", "times": 0, "step": {"type": "wait"}}, "0", "times", None),
        ({"type": "repeat", "times": 1, "step": {"type": "notify", "text": 1}}, "0.0", "text", None),
        ({"type": "parallel", "steps": [{"type": "wait"}, {"type": "confirm", "text": True}]}, "0.1", "text", None),
    ],
)
def test_a_step_that_is_not_of_its_form_is_named(step: dict[str, Any], path: str, member: str, message: str) -> None:
    (found,) = findings_of(refusal({"title": "a", "step": step}))
    assert (found["step"], found.get("member")) == (path, member)
    assert message is None or found["message"] == message


def test_all_steps_and_parameters_that_are_wrong_are_named() -> None:
    steps = [
        {"type": "wait", "seconds": 1, "until": "2026-11-29T20:00:00Z"},
        {"type": "invoke", "name": "a"},
        {"type": "wait", "name": "a", "seconds": 1},
    ]
    parameter = {"name": "angle", "type": "number", "minimum": 1, "default": 0}
    refused = refusal({"title": "a", "parameters": [parameter], "step": {"type": "sequence", "steps": steps}})
    places = [each.get("step") or each.get("parameter") for each in findings_of(refused)]
    assert places == ["0.0", "0.1", "0.2", "angle"]
    assert refused.detail.startswith("Step 0.0: ")


def test_a_parameter_that_is_not_of_its_form_is_named_by_its_number() -> None:
    parameters = [{"name": "a", "type": "text"}, {"name": "b b", "type": "text"}]
    refused = refusal({"title": "a", "parameters": parameters, "step": {"type": "wait", "seconds": 1}})
    (found,) = findings_of(refused)
    assert (found["parameterNumber"], found["member"]) == ("1", "name")


def test_what_is_wrong_with_the_mission_as_a_whole_is_of_no_step() -> None:
    assert "findings" not in refusal({"title": "", "step": {"type": "wait", "seconds": 1}}).added
    assert finding_of_decoding("Expected `str` - at `$.title`") == []


def test_what_the_gateway_cannot_do_is_raised_at_once() -> None:
    findings, step = Findings(), Notify(text="a")
    with pytest.raises(Busy), findings.at("0", step):
        raise Busy("Later.")
    with findings.at("0", step):
        raise Conflict("Not now.")
    with pytest.raises(Conflict, match="Step 0: Not now"):
        findings.check()


def test_paths_of_steps_are_those_of_runs() -> None:
    step = {"type": "sequence", "steps": [{"type": "repeat", "times": 2, "step": {"type": "wait", "seconds": 1}}]}
    mission = msgspec.convert({"title": "a", "step": step}, Mission)
    assert [path for path, _ in walk_paths(mission.step)] == ["0", "0.0", "0.0.0"]
