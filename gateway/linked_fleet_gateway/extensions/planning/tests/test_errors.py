"""Refusals of motions without a path, as the answer to a request is repeated from its invocation."""

import pytest

from linked_fleet_base.errors import MotionRefused
from linked_fleet_gateway.extensions.planning.errors import (
    BreaksConstraint,
    GoalBlocked,
    LineLeaves,
    NoPathFound,
    PlanChanged,
    StartBlocked,
)


@pytest.mark.parametrize("kind", [GoalBlocked, StartBlocked, NoPathFound, LineLeaves, PlanChanged, BreaksConstraint])
def test_a_refusal_is_known_by_its_code(kind: type[MotionRefused]) -> None:
    """A repeated request gets the first answer again, of which the invocation has code and reason."""
    found = MotionRefused.type_for_code(kind.code)
    assert found is kind
    repeated = found("The motion was not begun: it is blocked.", reason="it is blocked")
    assert (repeated.status, repeated.code, repeated.members) == (409, kind.code, {})


def test_an_unknown_code_is_of_no_refusal() -> None:
    assert MotionRefused.type_for_code("expectation") is None
