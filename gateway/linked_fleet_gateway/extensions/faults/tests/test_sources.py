"""What gateways find: troubles of robots, of components, and of what they do."""

from collections.abc import Mapping
from typing import Any

import pytest

from flapping import Flapping
from gateway_fixtures import Bench
from linked_fleet_agent.wire.codec import encode_state
from linked_fleet_agent.wire.messages import Condition, State
from linked_fleet_gateway.extensions.faults.fault import Trouble
from linked_fleet_gateway.extensions.faults.invocations import of_invocation, of_mission
from linked_fleet_gateway.extensions.faults.robots import (
    components_of,
    of_component,
    of_event,
    of_frame,
    of_robot,
    presence_of,
    reader_of,
    telling_events,
)
from linked_fleet_state.events import Conditioned, Framed, Vanished
from linked_fleet_state.invocation import FLEET, Invocation, InvocationState

S = 10**9


def by_kind(found: Any) -> Mapping[str, Trouble]:
    return {each.kind: each for each in found}


@pytest.fixture
def here(bench: Bench) -> Flapping:
    return Flapping(bench)


def of_parts(here: Flapping) -> Mapping[str, Trouble]:
    return by_kind(found for each in components_of(here.robot) for found in of_component(here.robot, each))


def signature(here: Flapping) -> list[object]:
    return [reader_of(each)(each) for each in components_of(here.robot)]


def test_a_robot_that_is_well_has_no_trouble(here: Flapping) -> None:
    here.say("mode", protectiveStop=False, reason="")
    here.say("battery", charge=80, powerSupplyState="discharging")
    here.say("diagnostics", status=[{"name": "arm", "level": "ok", "message": ""}])
    now_ns = here.robot.last_seen_ns or 0
    assert not [*presence_of(here.robot, now_ns), *of_robot(here.robot), *of_parts(here).values()]


def test_an_agent_that_has_gone_or_is_silent(bench: Bench, here: Flapping) -> None:
    robot = here.robot
    last_ns = robot.last_seen_ns or 0
    assert "silent" in by_kind(presence_of(robot, last_ns + 11 * S))
    bench.fleet.apply(Vanished("r", robot.incarnation or 0), 2)
    assert set(by_kind(presence_of(robot, last_ns + 11 * S))) == {"offline"}


def test_what_an_agent_says_of_itself_and_of_sensors(bench: Bench, here: Flapping) -> None:
    run = here.robot.incarnation or 0
    said = Condition(version=1, incarnation=run, fault="No power.", sensors={"pan": "It jumps."})
    bench.fleet.apply(Conditioned("r", said), 2)
    found = by_kind(of_robot(here.robot))
    assert (found["agent"].says, found["sensor"].place) == ("No power.", "/r/pan")
    assert "description" not in found


def test_a_robot_that_moves_by_no_command(here: Flapping) -> None:
    assert by_kind(of_robot(here.robot, strays=True))["uncommanded"].severity == "information"
    assert not list(of_robot(here.robot, strays=False))


def test_clocks_that_differ_and_efforts_above_the_declared_one(bench: Bench, here: Flapping) -> None:
    run, number = here.robot.incarnation or 0, here.robot.last_sequence() + 1
    state = State(
        incarnation=run, sequence=number, monotonic_ns=2, wall_ns=1, positions=(0,), velocities=(0,), efforts=(3.0,)
    )
    bench.fleet.apply(Framed("r", encode_state(state)), 5 * S)
    found = by_kind(of_frame(here.robot))
    assert set(found) == {"clock", "effort"}
    assert found["effort"].values == {"effort": "3"}
    assert "behind" in found["clock"].says


def test_components_tell_of_stops_of_diagnostics_and_of_low_batteries(here: Flapping) -> None:
    here.say("mode", protectiveStop=True, reason="the gate is open")
    here.say("battery", charge=3, powerSupplyState="discharging")
    here.say("gripper", fault="no answer")
    here.say("diagnostics", status=[
        {"name": "arm", "level": "error", "message": "too hot"}, {"name": "fan", "level": "warning", "message": ""},
        {"name": "hand", "level": "ok", "message": ""},
    ])  # fmt: skip
    found = of_parts(here)
    assert set(found) == {"protective-stop", "battery", "component", "diagnostics arm", "diagnostics fan"}
    assert found["protective-stop"].says == "the gate is open"
    assert (found["battery"].severity, found["diagnostics fan"].severity) == ("error", "warning")
    here.say("battery", charge=3, powerSupplyState="charging")
    assert "battery" not in of_parts(here)


def test_what_changes_no_trouble_changes_no_signature(here: Flapping) -> None:
    here.say("battery", charge=80.5, powerSupplyState="discharging")
    before = signature(here)
    here.say("battery", charge=80.4, powerSupplyState="discharging")
    assert signature(here) == before
    here.say("battery", charge=14, powerSupplyState="discharging")
    low = signature(here)
    assert low != before
    here.say("battery", charge=14, powerSupplyState="charging")
    assert signature(here) != low


def test_events_of_grippers_and_of_the_type_fault(here: Flapping) -> None:
    here.happen("feeder", "filled")
    here.happen("feeder", "jammed", "A part is in the way.")
    here.happen("gripper", "lost")
    telling = telling_events(components_of(here.robot))
    assert [(part.name, event) for part, event in telling] == [("gripper", "lost"), ("feeder", "jammed")]
    last = here.state.components["feeder"].events["jammed"]
    trouble = of_event(here.robot, telling[1][0], "jammed", last.data)
    assert (trouble.kind, trouble.says, trouble.event) == ("jammed", "A part is in the way.", True)
    assert of_event(here.robot, telling[0][0], "lost", None).kind == "object-lost"


def invocation(**more: Any) -> Invocation:
    about: dict[str, Any] = {
        "id": "1", "robot": "r", "action": "/r/pan/actions/rotate", "targets": {"pan": 1.0}, "created_ns": 1,
        "deadline_ns": 2, "state": InvocationState.FAILED, "reason": "blocked",
    }  # fmt: skip
    return Invocation(**about | more)


@pytest.mark.parametrize(
    ("more", "kind", "severity"),
    [
        ({}, "motion-failed", "error"),
        ({"refused": "fault"}, "motion-failed", "error"),
        ({"targets": {}, "stops": ()}, "stop-failed", "critical"),
        ({"targets": {}, "robot": FLEET, "action": "/actions/stopAll", "stops": (), "robots": {"r": "failed"}},
         "stop-failed", "critical"),
        ({"targets": {}, "operation": True}, "action-failed", "warning"),
    ],
)  # fmt: skip
def test_what_robots_had_begun_and_failed(more: dict[str, Any], kind: str, severity: str) -> None:
    found = of_invocation(invocation(**more))
    assert found is not None
    assert (found.kind, found.severity, found.robots) == (kind, severity, ("r",))
    assert "blocked" in found.says


@pytest.mark.parametrize(
    "more",
    [
        {"state": InvocationState.CANCELLED},
        {"state": InvocationState.PREEMPTED},
        {"refused": "limits"},
        {"refused": "stale"},
        {"targets": {}, "robot": FLEET, "operation": True, "action": "/stations/1/actions/reserve"},
    ],
)
def test_mistakes_of_clients_are_no_faults(more: dict[str, Any]) -> None:
    assert of_invocation(invocation(**more)) is None


def test_a_failed_mission_is_a_fault_at_the_mission() -> None:
    run = invocation(robot=FLEET, action="/missions/7/actions/run", operation=True, targets={})
    found = of_mission(run, "Nod", ("r", "s"))
    assert found is not None
    assert (found.place, found.robots, found.says) == ("/missions/7", ("r", "s"), "Nod failed: blocked")
