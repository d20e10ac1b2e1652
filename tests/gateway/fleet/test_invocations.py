"""The life of an invocation: progress, the unknown, deadlines, and what is remembered."""

from typing import Literal

import pytest

from agents.wire.messages import WIRE_VERSION, Progress
from gateway.fleet.invocations import MAX_TERMINAL, Invocation, Invocations, InvocationState

ACTION = "/r/elbow/actions/rotate"


def invocation(id: str = "i", state: InvocationState = InvocationState.ACCEPTED) -> Invocation:
    return Invocation(id, "r", ACTION, {"elbow": 1.0}, created_ns=1, deadline_ns=100, state=state)


def progress(
    state: Literal["running", "succeeded", "failed", "preempted"], id: str = "i", wall_ns: int = 10
) -> Progress:
    positions = {"elbow": 0.9}
    return Progress(
        version=WIRE_VERSION, id=id, incarnation=1, state=state, wall_ns=wall_ns, reason="why", positions=positions
    )


def with_one(state: InvocationState = InvocationState.ACCEPTED) -> Invocations:
    invocations = Invocations()
    invocations.add(invocation(state=state))
    return invocations


@pytest.mark.parametrize("start", [InvocationState.ACCEPTED, InvocationState.UNKNOWN])
def test_progress_leads_to_the_end(start: InvocationState) -> None:
    invocations = with_one(start)
    running = invocations.apply("r", progress("running"))
    assert running is not None
    assert (running.state, running.started_ns, running.ended_ns) == (InvocationState.RUNNING, 10, None)
    done = invocations.apply("r", progress("succeeded", wall_ns=20))
    assert done is running
    assert (done.state, done.started_ns, done.ended_ns) == (InvocationState.SUCCEEDED, 10, 20)
    assert (done.result, done.reason) == ({"elbow": 0.9}, "why")


def test_progress_of_others_and_after_the_end_is_nothing() -> None:
    invocations = with_one()
    assert invocations.apply("x", progress("failed")) is None
    assert invocations.apply("r", progress("failed", id="x")) is None
    assert invocations.apply("r", progress("preempted")) is not None
    assert invocations.apply("r", progress("running")) is None


@pytest.mark.parametrize("state", [InvocationState.ACCEPTED, InvocationState.RUNNING])
def test_when_the_agent_is_gone_what_was_open_is_unknown_until_news(state: InvocationState) -> None:
    invocations = with_one(state)
    assert invocations.lose("x") == []
    (lost,) = invocations.lose("r")
    assert (lost.state, lost.ended_ns) == (InvocationState.UNKNOWN, None)
    assert state.value in lost.reason
    assert invocations.lose("r") == []
    assert invocations.apply("r", progress("failed")) is lost
    assert invocations.lose("r") == []
    assert (lost.state, lost.reason) == (InvocationState.FAILED, "why")


@pytest.mark.parametrize("state", [InvocationState.ACCEPTED, InvocationState.RUNNING, InvocationState.UNKNOWN])
def test_what_is_open_after_its_deadline_failed(state: InvocationState) -> None:
    invocations = with_one(state)
    assert invocations.expire(100) == []
    (late,) = invocations.expire(101)
    assert (late.state, late.ended_ns) == (InvocationState.FAILED, 101)
    assert "deadline" in late.reason
    assert invocations.expire(102) == []


def test_those_of_an_action_and_of_a_robot_come_newest_first() -> None:
    invocations = Invocations()
    for id in "abc":
        invocations.add(invocation(id))
    assert (
        [one.id for one in invocations.of(ACTION)] == [one.id for one in invocations.of_robot("r")] == ["c", "b", "a"]
    )
    assert invocations.of("/r/other") == invocations.of_robot("x") == []


def test_an_id_is_taken_once() -> None:
    with pytest.raises(ValueError, match="exists already"):
        with_one().add(invocation())


def test_the_oldest_that_are_over_are_forgotten_and_the_open_ones_never() -> None:
    invocations = with_one()
    for number in range(MAX_TERMINAL + 5):
        invocations.add(invocation(str(number), InvocationState.SUCCEEDED))
    assert invocations.get("i") is not None
    assert invocations.get("4") is None
    assert invocations.get("5") is not None
    assert len(invocations.of_robot("r")) == MAX_TERMINAL + 1
