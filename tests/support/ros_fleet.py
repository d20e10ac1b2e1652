"""A fleet with a real robot of ROS 2, of which every program may be restarted."""

import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from functools import partial
from pathlib import Path
from random import Random
from typing import Any

from httpx import HTTPError

from linked_fleet_client.errors import ClientError
from linked_fleet_client.fleet import Fleet
from robot_client import joint_angle
from ros_peers import SOURCES, Restarting, bridge, endpoint, free_domain, hiroz_robot, rclpy_robot, router
from running import eventually, process
from small_fleet import Place

PARTS = {
    "ros2": ("router", "robot", "agent", "twin", "gateway"),
    # Without the robot: after some restarts of nodes of Fast DDS in one domain no bridge finds them.
    "ros2dds": ("router", "agent", "twin", "gateway"),
}
"""The programs of a fleet by transport. ``twin`` is a second agent of the same robot; a bridge is ``router`` too."""
_AGENTS = {"agent": "arm", "twin": "twin"}


@contextmanager
def ros_fleet(
    folder: Path, side: str, pause_s: float = 0.2, without: tuple[str, ...] = ("twin",)
) -> Iterator[tuple[Restarting, Fleet]]:
    """Run a fleet with a robot, whose steps of actions are ``pause_s`` apart."""
    place = Place(folder)
    with ExitStack() as stack:
        made = _programs(place, side, pause_s)
        running = stack.enter_context(Restarting(**{name: made[name] for name in made if name not in without}))
        fleet = stack.enter_context(Fleet(place.root))
        eventually(lambda: joint_angle(fleet, "arm/pan") is not None, "the position of a joint")
        yield running, fleet


def restarts(running: Restarting, fleet: Fleet, side: str, count: int, seed: int = 41) -> Iterator[float]:
    """Restart so many programs, one to three at once and in any order; an agent may stay away for a while.

    Wait each time until the fleet lists the robots of the agents that are alive, and no others, and their joints are
    known. Yield how long that took.
    """
    random, done, away = Random(seed), 0, set[str]()
    while done < count:
        for name in away:
            running.start(name)
        parts = random.sample(PARTS[side], random.randint(1, 3))
        away = {name for name in parts if name in _AGENTS and random.random() < 0.3}
        for name in away:
            running.stop(name)
        running.restart(*(name for name in parts if name not in away))
        done += len(parts)
        begun_s = time.monotonic()
        _await({name for part, name in _AGENTS.items() if part not in away}, fleet, parts)
        yield time.monotonic() - begun_s


def _await(alive: set[str], fleet: Fleet, parts: list[str]) -> None:
    eventually(
        lambda: usable(fleet) == alive,
        lambda: f"{alive} in the fleet after a restart of {', '.join(parts)}; there are {usable(fleet)}",
    )


def usable(fleet: Fleet) -> set[str]:
    """Return the robots that the fleet lists as online, and a joint of which is known."""
    with suppress(ClientError, HTTPError):
        listed = {str(robot.iri).rstrip("/").rpartition("/")[2]: robot for robot in fleet}
        return {
            name
            for name, robot in listed.items()
            if robot.presence == "online" and joint_angle(fleet, f"{name}/pan") is not None
        }
    return set()


def _programs(place: Place, side: str, pause_s: float) -> dict[str, Callable[[], Any]]:
    where, domain = endpoint(), free_domain()
    source = f"{side}:{where}?expose=/fibonacci&types={SOURCES}/interfaces_of_tests&distro=kilted"
    agents = {
        part: partial(process, "-m", "linked_fleet_agent", f"--robot={name}={source}", "--connect", place.zenoh)
        for part, name in _AGENTS.items()
    }
    if side == "ros2":
        way: dict[str, Callable[[], Any]] = {
            "router": partial(router, where),
            "robot": partial(hiroz_robot, where, pause_s),
        }
    else:
        way = {"robot": partial(rclpy_robot, domain, pause_s), "router": partial(bridge, where, domain)}
    return {**way, "gateway": place.gateway, **agents}
