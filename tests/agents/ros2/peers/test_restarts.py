"""Restarts of routers, bridges, robots, agents and gateways, in any order: the fleet finds itself again by itself."""

from contextlib import suppress
from functools import partial
from itertools import permutations
from pathlib import Path

import pytest

from linked_fleet_client.errors import ClientError
from linked_fleet_client.fleet import Fleet, Thing
from linked_fleet_client.invocation import Invocation
from linked_fleet_client.vocabulary import LF
from robot_client import await_angle, begin, joint_angle, state_of
from ros_fleet import restarts, ros_fleet
from running import eventually

pytestmark = [pytest.mark.processes, pytest.mark.test_all]

PARTS = ("router", "robot", "agent")


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
    with ros_fleet(tmp_path, side) as (running, fleet):
        for number, order in enumerate(ORDERS[side]):
            running.restart(*order)
            eventually(lambda: joint_angle(fleet, "arm/pan") is not None, f"a position after the restart of {order}")
            to = 0.1 * (number % 5)
            eventually(partial(moves, fleet["arm"], to), f"a motion after the restart of {order}")
            await_angle(fleet, "arm/pan", to, within=0.02)


@pytest.mark.parametrize(("side", "count"), [("ros2", 50), ("ros2dds", 12)])
def test_after_many_restarts_the_robots_listed_are_the_agents_alive(side: str, count: int, tmp_path: Path) -> None:
    with ros_fleet(tmp_path, side, without=()) as (running, fleet):
        for _ in restarts(running, fleet, side, count):
            pass


def test_a_robot_that_comes_long_after_its_agent_is_found(tmp_path: Path) -> None:
    """The agent has looked for it in vain."""
    with ros_fleet(tmp_path, "ros2") as (running, fleet):
        running.stop("router")
        running.stop("robot")
        running.restart("agent")
        eventually(
            lambda: "Unable to connect" in str(fleet["arm"].read().graph.value(fleet["arm"].node, LF.fault)), "why"
        )
        running.start("robot")
        running.start("router")
        eventually(lambda: joint_angle(fleet, "arm/pan") is not None, "a position")


def test_the_result_of_a_goal_of_a_minute_survives_a_restart_of_the_router(tmp_path: Path) -> None:
    with ros_fleet(tmp_path, "ros2", pause_s=1.0) as (running, fleet):
        run = count(fleet, order=62)
        eventually(lambda: state_of(run).get("feedback"), "a feedback")
        running.restart("router")
        told = len(state_of(run)["feedback"]["sequence"])
        eventually(lambda: len(state_of(run)["feedback"]["sequence"]) > told, "a feedback after the restart")
        assert run.wait(timeout_s=90) == "succeeded"
        assert len(state_of(run)["output"]["sequence"]) == 62


def test_a_goal_behind_the_bridge_survives_restarts_of_bridge_and_agent(tmp_path: Path) -> None:
    with ros_fleet(tmp_path, "ros2dds", pause_s=0.5) as (running, fleet):
        run = count(fleet, order=62)
        eventually(lambda: state_of(run).get("feedback"), "a feedback")
        running.restart("router")
        running.restart("agent")
        assert run.wait(timeout_s=90) == "succeeded"
        assert len(state_of(run)["output"]["sequence"]) == 62
