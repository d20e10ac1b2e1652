"""Watches robots that follow paths: what comes into the way of one ends its drive, and the base brakes.

The whole path was checked before it began. It is checked again when an object, a zone or the map has changed, or when
the robot tells of another end, as it does while it docks; and the part that the base drives before it could stand,
while another robot is near that.
"""

import asyncio
import logging
import math
from collections.abc import Awaitable, Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from types import TracebackType
from typing import Self

from msgspec.structs import replace

from linked_fleet_agent.planar import Pose, Velocity
from linked_fleet_agent.wire.components import BASE
from linked_fleet_base.errors import AgentTimeout
from linked_fleet_gateway.api import Invocation, cancel_tasks, supervised
from linked_fleet_gateway.extensions.world.checks import Checks, Neighbour, Neighbours
from linked_fleet_gateway.extensions.world.collisions import Collides, Unchecked
from linked_fleet_gateway.extensions.world.driving import apart_m, odometry_of, poses_along, velocity_of
from linked_fleet_state.driving import FollowedPath
from linked_fleet_state.robot import Robot

log = logging.getLogger(__name__)

AHEAD = "something has come into its way: "
"""The reason by which a drive is cancelled begins like this."""
LOOK_S = 0.2
_REACTION_S = 0.5
"""From a measurement until the base brakes: a look, the check, and the way of the request to stop."""
_BEFORE_M, _NEAR_M, _SAME_M = 0.1, 0.1, 0.001
_BRAKING_SHARE = 0.7
_CAREFUL_M_S2 = 0.3
"""Assumed of a base that does not say how it brakes."""

OpenOf = Callable[[str], list[Invocation]]
"""Returns the invocations of a robot that are not over, newest first."""
Cancel = Callable[[str, str], Awaitable[bool]]


def stopping_m(velocity: Velocity, path: FollowedPath) -> float:
    """Return the way that a base needs until it stands, at most."""
    speed = math.hypot(velocity.linear, velocity.lateral)
    braking = _CAREFUL_M_S2 if path.limits is None else _BRAKING_SHARE * path.limits.linear_acceleration
    return speed * _REACTION_S + speed**2 / (2.0 * braking) + _BEFORE_M


def beginning(path: FollowedPath, here: Pose, length_m: float) -> FollowedPath:
    """Return the first part of a path, of this length."""
    kept = list[Pose]()
    for start, end in pairwise((here, *path.poses)):
        leg_m = math.hypot(end.x - start.x, end.y - start.y)
        if leg_m > length_m:
            share = length_m / leg_m
            kept.append(Pose(start.x + share * (end.x - start.x), start.y + share * (end.y - start.y), math.nan))
            break
        kept.append(end)
        length_m -= leg_m
    return replace(path, poses=tuple(kept))


def near_ones(name: str, here: Pose, path: FollowedPath, neighbours: Neighbours) -> set[str]:
    """Return the other robots that the path of a robot may meet where they are and soon come, also if unknown."""
    me, others = neighbours.get(name), {other: each for other, each in neighbours.items() if other != name}
    if me is None or me.way is None:
        return set(others)
    way = poses_along(me.way[0], here, path)
    length_m = math.fsum(math.dist(one[:2], other[:2]) for one, other in pairwise(way))
    return {other for other, each in others.items() if _may_meet(each, way, length_m, me.reach_m + _NEAR_M)}


def _may_meet(other: Neighbour, way: Sequence[Pose], length_m: float, reach_m: float) -> bool:
    if other.way is None:
        return True
    (at, end), reach_m = other.way, reach_m + other.reach_m
    if math.dist(at[:2], way[0][:2]) > length_m + math.dist(at[:2], end[:2]) + reach_m:
        return False
    return apart_m(way, other.way) <= reach_m


async def end(cancel: Cancel, run: Invocation, reason: str) -> None:
    """Cancel a motion for a reason."""
    try:
        await cancel(run.id, reason)
    except AgentTimeout as error:
        log.warning("the motion %s was not ended although %s: %s", run.id, reason, error.detail)


@dataclass
class _Watched:
    """The state in which the whole path of an invocation, to its ``end``, was found free."""

    invocation: str
    surroundings: object
    end: Pose

    def covers(self, path: FollowedPath, surroundings: object) -> bool:
        """Return True if the whole path is known to be free."""
        return self.surroundings == surroundings and self.end.error_of(path.poses[-1])[0] < _SAME_M


class PathWatch:
    """An async context manager. ``cancel`` ends an invocation for a reason (``Core.cancel``)."""

    def __init__(self, checks: Checks, robots: Mapping[str, Robot], open_of: OpenOf, cancel: Cancel) -> None:
        self._checks, self._robots, self._open_of, self._cancel = checks, robots, open_of, cancel
        self._watched = dict[str, _Watched]()
        self._tasks = list[asyncio.Task[None]]()

    async def __aenter__(self) -> Self:
        self._tasks = [supervised(self._tick, "paths that robots follow", log, "a path is not watched", LOOK_S)]
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        await cancel_tasks(self._tasks)

    async def _tick(self) -> None:
        await asyncio.sleep(LOOK_S)
        await self.look()

    async def look(self) -> None:
        """Check the paths of all robots that follow one, as far as needed."""
        surroundings, neighbours = self._checks.surroundings, self._checks.neighbours()
        for robot in list(self._robots.values()):
            path, run = self._checks.path_of(robot), self._drive_of(robot)
            if run is None:
                self._watched.pop(robot.name, None)
            elif path is not None:
                await self._look_at(robot, path, run, surroundings, neighbours)

    def _drive_of(self, robot: Robot) -> Invocation | None:
        return next((one for one in self._open_of(robot.name) if BASE in one.moves), None)

    async def _look_at(
        self, robot: Robot, path: FollowedPath, run: Invocation, now: object, neighbours: Neighbours
    ) -> None:
        here = odometry_of(robot)
        held = self._watched.get(robot.name)
        if held is None or held.invocation != run.id:
            held = self._watched[robot.name] = _Watched(run.id, now, path.poses[-1])
        if here is None:
            return
        soon, whole = beginning(path, here, stopping_m(velocity_of(robot), path)), not held.covers(path, now)
        try:
            if whole:
                await self._checks.check_ahead(robot, path, run.id)
                held.surroundings, held.end = now, path.poses[-1]
            elif near := near_ones(robot.name, here, soon, neighbours):
                await self._checks.check_ahead(robot, soon, run.id, near)
        except Collides as error:
            await end(self._cancel, run, AHEAD + error.reason)
        except Unchecked as error:
            log.debug("the path of %s is not checked now: %s", robot.name, error.detail)
