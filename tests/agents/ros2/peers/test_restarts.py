"""Restarts of routers, bridges, robots, agents and gateways, in any order: the fleet finds itself again by itself."""

from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from functools import partial
from itertools import permutations
from pathlib import Path
from typing import Any

import pytest

from linked_fleet_client.errors import ClientError
from linked_fleet_client.fleet import Fleet, Thing
from linked_fleet_client.invocation import Invocation
from robot_client import await_angle, begin, joint_angle, state_of
from ros_peers import SOURCES, Restarting, bridge, endpoint, free_domain, hiroz_robot, rclpy_robot, router
from running import eventually, process
from small_fleet import Place

pytestmark = [pytest.mark.processes, pytest.mark.test_all]

PARTS = ("router", "robot", "agent")


def programs(place: Place, side: str, pause_s: float) -> dict[str, Callable[[], Any]]:
    """Return how the programs of a fleet are run: a router, or a bridge, is ``router`` here."""
    where, domain = endpoint(), free_domain()
    source = f"--robot=arm={side}:{where}?expose=/fibonacci&types={SOURCES}/interfaces_of_tests&distro=kilted"
    agent = partial(process, "-m", "linked_fleet_agent", source, "--connect", place.zenoh)
    if side == "ros2":
        way: dict[str, Callable[[], Any]] = {
            "router": partial(router, where),
            "robot": partial(hiroz_robot, where, pause_s),
        }
    else:
        way = {"robot": partial(rclpy_robot, domain, pause_s), "router": partial(bridge, where, domain)}
    return {**way, "gateway": place.gateway, "agent": agent}


@contextmanager
def fleet_of(folder: Path, side: str, pause_s: float = 0.2) -> Iterator[tuple[Restarting, Fleet]]:
    place = Place(folder)
    with ExitStack() as stack:
        running = stack.enter_context(Restarting(**programs(place, side, pause_s)))
        fleet = stack.enter_context(Fleet(place.root))
        eventually(lambda: joint_angle(fleet, "arm/pan") is not None, "the position of a joint")
        yield running, fleet


def count(fleet: Fleet, order: int) -> Invocation:
    (action,) = [action for part in fleet["arm"].parts for action in part.actions if "fibonacci" in action.names]
    return begin(action, order=order)


def moves(arm: Thing, to: float) -> bool:
    """Return True once a motion to the position has succeeded."""
    with suppress(ClientError):
        return arm["pan"].actions["rotate"](value=to, unit="rad").wait(timeout_s=20) == "succeeded"
    return False


# The bridge alone often does not find nodes of Fast DDS that come again.
ORDERS = {
    "ros2": [*[(part,) for part in PARTS], *permutations(PARTS)],
    "ros2dds": [("router",), ("robot", "router"), ("agent",)],
}


@pytest.mark.parametrize("side", ORDERS)
def test_whatever_is_restarted_the_robot_is_there_again_and_moves(side: str, tmp_path: Path) -> None:
    with fleet_of(tmp_path, side) as (running, fleet):
        for number, order in enumerate(ORDERS[side]):
            running.restart(*order)
            eventually(lambda: joint_angle(fleet, "arm/pan") is not None, f"a position after the restart of {order}")
            to = 0.1 * (number % 5)
            eventually(partial(moves, fleet["arm"], to), f"a motion after the restart of {order}")
            await_angle(fleet, "arm/pan", to, within=0.02)


def test_the_result_of_a_goal_of_a_minute_survives_a_restart_of_the_router(tmp_path: Path) -> None:
    with fleet_of(tmp_path, "ros2", pause_s=1.0) as (running, fleet):
        run = count(fleet, order=62)
        eventually(lambda: state_of(run).get("feedback"), "a feedback")
        running.restart("router")
        told = len(state_of(run)["feedback"]["sequence"])
        eventually(lambda: len(state_of(run)["feedback"]["sequence"]) > told, "a feedback after the restart")
        assert run.wait(timeout_s=90) == "succeeded"
        assert len(state_of(run)["output"]["sequence"]) == 62


def test_a_goal_behind_the_bridge_survives_restarts_of_bridge_and_agent(tmp_path: Path) -> None:
    with fleet_of(tmp_path, "ros2dds", pause_s=0.5) as (running, fleet):
        run = count(fleet, order=62)
        eventually(lambda: state_of(run).get("feedback"), "a feedback")
        running.restart("router")
        running.restart("agent")
        assert run.wait(timeout_s=90) == "succeeded"
        assert len(state_of(run)["output"]["sequence"]) == 62
