"""How a followed path has ended, for the drive that it is a part of."""

import pytest

from linked_fleet_gateway.extensions.navigation.drive import ended
from linked_fleet_gateway.extensions.navigation.trips import Ended
from linked_fleet_gateway.extensions.world.path_watch import AHEAD
from linked_fleet_state.invocation import Invocation, InvocationState


def run(state: InvocationState, reason: str) -> Invocation:
    return Invocation(
        id="1", robot="r", action="", targets={}, created_ns=0, deadline_ns=0, started_ns=1, state=state, reason=reason
    )


@pytest.mark.parametrize(
    "reason", ["the base is off its path by 0.60 m; 0.5 m is the most", "the base has not moved for 5 s"]
)
def test_another_way_may_help_a_base_that_is_not_on_its_way(reason: str) -> None:
    assert ended(run(InvocationState.FAILED, reason)).lost


@pytest.mark.parametrize(
    "reason", ["gateway lost", "the agent did not run for 3.0 s", "the gate is open", "driver fault: no bus"]
)
def test_nothing_goes_on_by_itself_after_the_robot_has_been_held(reason: str) -> None:
    found = ended(run(InvocationState.FAILED, reason))
    assert reason in found.failed and not found.lost


def test_a_base_stands_before_what_has_come_into_its_way() -> None:
    reason = AHEAD + "base would meet a crate"
    assert ended(run(InvocationState.CANCELLED, reason)) == Ended(blocked=reason)
