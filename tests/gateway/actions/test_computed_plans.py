"""Plans that take time to compute, and the time to live of their commands."""

import asyncio

import pytest

from linked_fleet_agent.wire.messages import Move
from linked_fleet_gateway.actions.plan import (
    MAX_TIME_TO_LIVE_NS,
    TIME_TO_LIVE_NS,
    DeferredPlan,
    Motion,
    RobotTime,
    build_command,
)
from linked_fleet_gateway.actions.service import Actions
from linked_fleet_gateway.actions.store import ActionStore
from linked_fleet_gateway.app.application import create_live
from linked_fleet_gateway.app.settings import GatewaySettings
from linked_fleet_state.events import Frames
from linked_fleet_state.robot import Robot
from virtual.zenoh_network import ZenohNetwork

_SECOND_NS = 1_000_000_000


@pytest.mark.parametrize("seconds", [0, 3, 600])
def test_a_long_computation_does_not_make_a_motion_stale(seconds: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """The first ``reach`` of a gateway loads its library, which takes longer than a command lives on a busy machine."""
    now_ns = 17 * _SECOND_NS

    def compute() -> Motion:
        nonlocal now_ns
        now_ns += seconds * _SECOND_NS
        return Motion(robot, Move({"turn": 1.0}), {"turn": 1.0}, RobotTime(1, 17))

    async def computed() -> Motion:
        live = create_live(GatewaySettings(), ZenohNetwork().gateway("g"))
        return await Actions(live, ActionStore("redis://127.0.0.1:1", "test", "run"), 1).compute(DeferredPlan(compute))

    robot = Robot("arm", lambda name, error: None, Frames())
    monkeypatch.setattr("time.monotonic_ns", lambda: now_ns)
    command = build_command("id", asyncio.run(computed()))
    assert command.seen_ns == 17
    assert command.time_to_live_ns == min(TIME_TO_LIVE_NS + seconds * _SECOND_NS, MAX_TIME_TO_LIVE_NS)
