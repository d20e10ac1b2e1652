"""The places along a path at which a robot is checked, and the motion of its joints between them. Radian, metre.

Between two neighbouring places the distance of a pair decreases by at most ``STEP_M``; on the refined path between two
places, by at most ``FINEST_M``.
"""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np

from linked_fleet_gateway.extensions.world.messages import MotionPath, PathSegment, Positions
from linked_fleet_gateway.extensions.world.robot import Robot
from linked_fleet_gateway.extensions.world.segments import interpolate
from linked_fleet_gateway.extensions.world.surfaces import Array

STEP_M = 0.002
FINEST_M = 0.0001
_FINER = round(STEP_M / FINEST_M)
MOST_STEPS = 200_000


class UnknownPosition(Exception):  # noqa: N818
    """A position is unknown."""


@dataclass(frozen=True)
class Path:
    """Positions of ``joints`` at each place (rows).

    Each of ``legs``: index of the last row, number of steps, and a function from its completed share to positions.
    """

    joints: tuple[str, ...]
    positions: Array
    legs: tuple[tuple[int, int, Callable[[Array], Array]], ...] = ()

    @cached_property
    def accumulated(self) -> Array:
        """By place (rows), the accumulated motion of each joint."""
        found = np.zeros_like(self.positions)
        np.cumsum(np.abs(np.diff(self.positions, axis=0)), axis=0, out=found[1:])
        return found

    @property
    def steps(self) -> int:
        return len(self.positions) - 1

    def between(self, place: int) -> "Path":
        """Return the refined path from a place to the next."""
        ends, count, positions = next(leg for leg in self.legs if place < leg[0])
        begun = place - (ends - count)
        return Path(self.joints, positions((begun + np.arange(_FINER + 1) / _FINER) / count))


def path_of(robot: Robot, way: MotionPath, joints: Sequence[str], weights: Array) -> Path:
    """Return the path of the moving ``joints``. A row of ``weights`` bounds the approach of a pair per joint motion.

    Raises UnknownPosition if the path is too long.
    """
    if not joints:
        return Path((), np.zeros((1, 0)))
    rows, legs, steps = [np.array([[way.start.get(name, math.nan) for name in joints]])], [], 0
    for before, after, leg in _between(robot, way):
        changes = np.array([abs(after.get(name, 0.0) - before.get(name, 0.0)) for name in joints])
        changes *= _easing(before, leg)
        far = float((weights @ np.nan_to_num(changes)).max(initial=0.0))
        if not far <= STEP_M * (MOST_STEPS - steps):  # also refuses NaN
            raise UnknownPosition("the path is too long to be checked; split the motion")
        count = max(1, math.ceil(far / STEP_M))
        positions, steps = partial(_positions, robot, joints, before, leg), steps + count
        rows.append(positions(np.arange(1, count + 1) / count))
        legs.append((steps, count, positions))
    return Path(tuple(joints), np.concatenate(rows), tuple(legs))


def times_along(path: Path, way: MotionPath) -> Array:
    """Return when the joints are at each place of a path, in seconds from its start."""
    times, begun_s = [np.zeros(1)], 0.0
    for (_, count, _), leg in zip(path.legs, way.legs, strict=True):
        shares = np.arange(1, count + 1) / count
        times_s, done = zip(*(leg.timing or ((0.0, 0.0), (leg.duration_s, 1.0))), strict=True)
        times.append(begun_s + np.interp(shares, done, times_s))
        begun_s += times_s[-1]
    return np.concatenate(times)


def _easing(before: Positions, leg: PathSegment) -> float:
    """Return a bound of the speed of the joints on a leg, relative to their mean speeds."""
    if not leg.duration_s:
        return 1.0
    moved = [(name, end - before[name]) for name, end in leg.ends.items() if end != before[name]]
    found = 1.0
    for name, way in moved:
        enters, leaves = (each.get(name, 0.0) * leg.duration_s for each in (leg.start_velocities, leg.end_velocities))
        found = max(found, highest_speed(way, enters, leaves) / abs(way))
    return found


def highest_speed(way: float, enters: float, leaves: float) -> float:
    """Return the highest speed on a cubic that goes this ``way``; both speeds, and the result, are per its duration."""
    a, b = 3.0 * (enters + leaves - 2.0 * way), 2.0 * (3.0 * way - 2.0 * enters - leaves)
    turn = -b / (2.0 * a) if a else -1.0
    middle = enters + turn * (b + turn * a) if 0.0 < turn < 1.0 else 0.0
    return max(abs(enters), abs(leaves), abs(middle), abs(way))


def _positions(robot: Robot, joints: Sequence[str], before: Positions, leg: PathSegment, shares: Array) -> Array:
    """Return the positions of ``joints`` by share of a leg (rows)."""
    here = moved_positions(robot, before, {name: interpolate(leg, name, before[name], shares) for name in leg.ends})
    return np.column_stack([np.broadcast_to(here[name], len(shares)) for name in joints])


def joint_changes(robot: Robot, way: MotionPath) -> dict[str, float]:
    """Return the total motion of each moving joint."""
    sums: dict[str, float] = {}
    for before, after, _ in _between(robot, way):
        for name, end in after.items():
            if end != before[name]:
                sums[name] = sums.get(name, 0.0) + abs(end - before[name])
    return sums


def configurations(robot: Robot, ways: Sequence[MotionPath]) -> Iterator[Positions]:
    """Yield the positions at the ends of all legs; between them no joint goes further."""
    for way in ways:
        yield way.start
        for _, after, _ in _between(robot, way):
            yield after


def moved_positions(robot: Robot, start: Positions, moved: Mapping[str, "float | Array"]) -> "dict[str, float | Array]":
    """Return all positions after some joints have ``moved``, including those that mimic them."""
    found: dict[str, float | Array] = {**start, **moved}
    for name, joint in robot.tree.joints.items():
        driver, factor = joint, 1.0
        for _ in range(len(robot.tree.joints)):
            if driver.mimic is None:
                break
            factor *= driver.mimic.multiplier
            driver = robot.tree.joints[driver.mimic.joint]
        if driver is not joint and driver.name in moved:
            found[name] = start.get(name, math.nan) + factor * (moved[driver.name] - start.get(driver.name, math.nan))
    return found


def _between(robot: Robot, way: MotionPath) -> Iterator[tuple[Positions, Positions, PathSegment]]:
    before, moved = way.start, Positions()
    for leg in way.legs:
        moved |= leg.ends
        after: Positions = moved_positions(robot, way.start, moved)  # type: ignore[assignment]  # of numbers, a number
        yield before, after, leg
        before = after
