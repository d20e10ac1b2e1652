"""The place where a robot comes closest to what is around it on a path.

The distance of two bodies decreases by no more than the motion of each joint, times its reach. So of two bodies, a part
of the path is looked at only if they could be nearer there than the nearest known (Piyavskii and Shubert): first by
bounding spheres, then by hulls, then by the shapes. Parts of the robot that stay where they are do not count. Metre.
"""

import heapq
import math
import time
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from linked_fleet_gateway.extensions.world.messages import Check, ClosestFound, CollisionFound
from linked_fleet_gateway.extensions.world.path import STEP_M, Path, UnknownPosition, joint_changes, path_of
from linked_fleet_gateway.extensions.world.robot import Robot
from linked_fleet_gateway.extensions.world.surfaces import Array
from linked_fleet_gateway.extensions.world.surroundings import (
    MovingRobot,
    StaticBody,
    depth,
    free_distance,
    meeting_point,
    se3,
)

_EXACT_M, _EXACT = 0.001, 0.05
"""Resolution of the distance: this much, or this share of it."""
_PARTS = 48
"""Parts of a path of which each pair is compared by bounding spheres."""

_MOST_PLACES = 10_000
"""Places of a long path, about, which are then further apart."""


class _Near(NamedTuple):
    apart_m: float
    place: int
    body: int
    thing: StaticBody


class _Part(NamedTuple):
    """A part of the path in which two bodies are at least ``bound_m`` apart; at its ends ``low_m`` and ``high_m``."""

    bound_m: float
    body: int
    thing: int
    low: int
    high: int
    low_m: float
    high_m: float


def find_closest(asked: Check, robot: Robot, things: Sequence[StaticBody]) -> ClosestFound | None:
    """Return where the robot comes closest to one of the things on its first path; None if nothing of it moves."""
    way = asked.paths[0]
    changes = joint_changes(robot, way)
    joints = tuple(name for name in changes if robot.model.existJointName(name))
    reach = robot.reach_by_joint(joints)
    bodies = np.array([i for i, known in enumerate(robot.anchored) if known and reach[:, i].any()], dtype=np.intp)
    if not len(bodies) or not things:
        return None
    weights = reach[:, bodies].max(axis=1)
    far = float(weights @ np.array([changes[name] for name in joints]))
    try:
        path = path_of(robot, way, joints, weights[None, :] / max(1.0, far / (_MOST_PLACES * STEP_M)))
    except UnknownPosition:
        return None
    search = _Search(path, path.accumulated @ reach, MovingRobot(robot, way.start), bodies, things)
    near, uncertain_m = search.run(asked.closest_within_s)
    at = None if (point := search.point(near)) is None else se3(asked.robot.base).act(point)
    met = CollisionFound(
        robot.bodies[near.body].link,
        near.thing.kind,
        near.thing.name,
        near.thing.link,
        round(near.place / max(path.steps, 1), 3),
        None if at is None else tuple(np.round(at, 4).tolist()),
    )
    return ClosestFound(met, near.apart_m, uncertain_m, _time_s(path, [leg.duration_s for leg in way.legs], near.place))


def _time_s(path: Path, durations_s: Sequence[float], place: int) -> float | None:
    """Return the time at a place of a trajectory; None on a path without times."""
    if not all(durations_s):
        return None
    gone_s = 0.0
    for (end, count, _), long_s in zip(path.legs, durations_s, strict=True):
        if place <= end:
            return gone_s + long_s * (place - (end - count)) / count
        gone_s += long_s
    return gone_s


class _Search:
    """The search for the least distance; ``gone`` bounds by place and body how far the body has moved."""

    def __init__(
        self, path: Path, gone: Array, mover: MovingRobot, bodies: npt.NDArray[np.intp], things: Sequence[StaticBody]
    ) -> None:
        self._path, self._gone, self._mover, self._bodies, self._things = path, gone, mover, bodies, things
        self._best = _Near(math.inf, 0, int(bodies[0]), things[0])

    def run(self, within_s: float) -> tuple[_Near, float]:
        """Return what is nearest, and by how much something may come nearer elsewhere.

        After a comparison by bounding spheres it takes ``within_s`` seconds at most.
        """
        parts, lowest = self._parts(), math.inf
        ends_s = time.thread_time() + within_s
        while parts and parts[0].bound_m < self._best.apart_m - max(_EXACT_M, _EXACT * self._best.apart_m):
            if time.thread_time() > ends_s:
                break
            part = heapq.heappop(parts)
            if part.high - part.low <= 1:  # so near each other that it does not matter
                lowest = min(lowest, part.bound_m)
                continue
            middle = (part.low + part.high) // 2
            apart = self._look(middle, part.body, part.thing)
            for low, high, low_m, high_m in (
                (part.low, middle, part.low_m, apart),
                (middle, part.high, apart, part.high_m),
            ):
                heapq.heappush(parts, self._part(part.body, part.thing, (low, high), (low_m, high_m)))
        least, lowest = self._best.apart_m, min(lowest, parts[0].bound_m if parts else math.inf)
        return self._best, least - min(max(lowest, 0.0), least)

    def _parts(self) -> list[_Part]:
        """Return parts of the path, with bounds by bounding spheres; where these are least the shapes are compared."""
        last = self._path.steps
        places = sorted({round(k * last / _PARTS) for k in range(_PARTS + 1)})
        gaps = np.array([self._gaps(place) for place in places])
        for n in (int(gaps.argmin()) // gaps[0].size, 0, len(places) - 1):
            i, k = divmod(int(gaps[n].argmin()), len(self._things))
            self._look(places[n], int(self._bodies[i]), k)
        found = list(self._possible(places, gaps))
        heapq.heapify(found)
        return found

    def _gaps(self, place: int) -> Array:
        """Return lower bounds of the distances by body and thing."""
        self._stand(place)
        centres = self._mover.centres(self._bodies)[self._bodies]
        there = np.array([each.centre for each in self._things])
        found: Array = np.linalg.norm(centres[:, None, :] - there[None, :, :], axis=2)
        found -= np.array([self._mover.robot.bodies[i].radius for i in self._bodies])[:, None]
        found -= np.array([each.radius for each in self._things])[None, :]
        return found

    def _possible(self, places: list[int], gaps: Array) -> Iterator[_Part]:
        """Yield the parts between places in which two bodies may be nearer than the nearest known."""
        if len(places) == 1:
            places, gaps = places * 2, np.repeat(gaps, 2, axis=0)
        moved = np.diff(self._gone[places][:, self._bodies], axis=0)[:, :, None]
        bounds = (gaps[:-1] + gaps[1:] - moved) / 2
        for n, i, k in zip(*(each.tolist() for each in np.nonzero(bounds < self._best.apart_m)), strict=True):
            ends = float(gaps[n, i, k]), float(gaps[n + 1, i, k])
            yield self._part(int(self._bodies[i]), k, (places[n], places[n + 1]), ends)

    def _part(self, body: int, thing: int, places: tuple[int, int], ends_m: tuple[float, float]) -> _Part:
        (low, high), (low_m, high_m) = places, ends_m
        gone = float(self._gone[high, body] - self._gone[low, body])
        return _Part(max((low_m + high_m - gone) / 2, max(ends_m) - gone), body, thing, low, high, low_m, high_m)

    def _stand(self, place: int) -> None:
        row = self._path.positions[place].tolist()
        self._mover.set_positions(dict(zip(self._path.joints, row, strict=True)))

    def _look(self, place: int, body: int, number: int) -> float:
        """Return a lower bound of the distance of two bodies, exact if they are nearer than the nearest known."""
        self._stand(place)
        one, thing = self._mover.shape(body), self._things[number]
        least_m = self._best.apart_m
        if thing.shape.hull is not None and (apart := depth(one, thing.shape)) >= least_m:
            return apart
        apart = max(free_distance(one, thing.shape, least_m), 0.0)
        if apart < least_m:
            self._best = _Near(apart, place, body, thing)
        return apart

    def point(self, near: _Near) -> Array | None:
        """Return the middle between what is nearest."""
        self._stand(near.place)
        return meeting_point(self._mover.shape(near.body), near.thing.shape)
