"""What a handler plans is carried out only if its kind may: a stop moves nothing, and nothing else stops."""

import asyncio
from types import SimpleNamespace
from typing import Any, cast

import pytest

from linked_fleet_agent.wire.messages import Move
from linked_fleet_gateway.actions.execution import empty_body, make_plan
from linked_fleet_gateway.actions.operations import Operation
from linked_fleet_gateway.actions.plan import DeferredPlan, Halt, Motion, RobotTime

_MOTION = Motion(cast(Any, None), Move({"j": 1.0}), {}, RobotTime(1, 1))
_HALT = Halt(None)


async def _nothing(call: object) -> None:
    """Carry out nothing."""


_OPERATION = Operation(_nothing)


class _Actions:
    def __init__(self, plan: object) -> None:
        self._plan = plan

    def plan(self, request: object, offer: object) -> object:
        return self._plan

    async def compute(self, plan: DeferredPlan) -> Motion:
        return plan.compute()


def _planned(plan: object, *, is_stop: bool) -> object:
    offer = cast(Any, SimpleNamespace(robot=None, joint=None, thing="/", path="/actions/x", is_stop=is_stop))
    body = empty_body(offer, "http://fleet")
    return asyncio.run(make_plan(cast(Any, _Actions(plan)), offer, "http://fleet", body))


@pytest.mark.parametrize("plan", [_HALT, _OPERATION])
def test_a_stop_stops_or_operates(plan: object) -> None:
    assert _planned(plan, is_stop=True) is plan


@pytest.mark.parametrize("plan", [_MOTION, _OPERATION])
def test_another_kind_moves_or_operates(plan: object) -> None:
    assert _planned(plan, is_stop=False) is plan


def test_a_deferred_plan_is_computed() -> None:
    assert _planned(DeferredPlan(lambda: _MOTION), is_stop=False) is _MOTION


@pytest.mark.parametrize(("plan", "is_stop"), [(_MOTION, True), (DeferredPlan(lambda: _MOTION), True), (_HALT, False)])
def test_a_plan_of_another_kind_is_not_carried_out(plan: object, is_stop: bool) -> None:
    with pytest.raises(AssertionError):
        _planned(plan, is_stop=is_stop)
