"""The paths of a motion, and the places along them at which a robot is looked at. Radian, metre, second.

Between two neighbouring places the distance of a pair decreases by at most ``STEP_M``; on the refined path between two
places, by at most ``FINEST_M``.

A motion of joints at rest is linear in joint space; a trajectory passes its waypoints on the cubics of Fritsch and
Carlson, like the agent. Joints that another motion moves meanwhile may be anywhere between their position and their
target. They are checked at both ends, and moving in parallel with this motion.
"""

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from itertools import pairwise

import numpy as np

from linked_fleet_agent.wire.messages import Follow, Move
from linked_fleet_gateway.extensions.world.messages import Leg, Positions, Way
from linked_fleet_gateway.extensions.world.robot import Robot
from linked_fleet_gateway.extensions.world.surfaces import Array

STEP_M = 0.002
FINEST_M = 0.0001
_FINER = round(STEP_M / FINEST_M)
MOST_STEPS = 200_000
_EASING = 3.0  # upper bound of a monotone cubic's speed relative to its mean


class Unknown(Exception):  # noqa: N818
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
    def gone(self) -> Array:
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


def path_of(robot: Robot, way: Way, joints: Sequence[str], weights: Array) -> Path:
    """Return the path of the moving ``joints``. A row of ``weights`` bounds the approach of a pair per joint motion.

    Raises Unknown if the path is too long.
    """
    if not joints:
        return Path((), np.zeros((1, 0)))
    rows, legs, steps = [np.array([[way.start.get(name, math.nan) for name in joints]])], [], 0
    for before, after, leg in _between(robot, way):
        changes = np.array([abs(after.get(name, 0.0) - before.get(name, 0.0)) for name in joints])
        far = float((weights @ np.nan_to_num(changes)).max(initial=0.0)) * (_EASING if leg.duration_s else 1.0)
        if not far <= STEP_M * (MOST_STEPS - steps):  # also refuses NaN
            raise Unknown("the way is too long to be checked; go it in parts")
        count = max(1, math.ceil(far / STEP_M))
        positions, steps = partial(_positions, robot, joints, before, leg), steps + count
        rows.append(positions(np.arange(1, count + 1) / count))
        legs.append((steps, count, positions))
    return Path(tuple(joints), np.concatenate(rows), tuple(legs))


def _positions(robot: Robot, joints: Sequence[str], before: Positions, leg: Leg, shares: Array) -> Array:
    """Return the positions of ``joints`` by share of a leg (rows)."""
    here = follow(robot, before, {name: on_leg(leg, name, before[name], shares) for name in leg.ends})
    return np.column_stack([np.broadcast_to(here[name], len(shares)) for name in joints])


def changed(robot: Robot, way: Way) -> dict[str, float]:
    """Return the total motion of each moving joint."""
    sums: dict[str, float] = {}
    for before, after, _ in _between(robot, way):
        for name, end in after.items():
            if end != before[name]:
                sums[name] = sums.get(name, 0.0) + abs(end - before[name])
    return sums


def follow(robot: Robot, start: Positions, moved: Mapping[str, "float | Array"]) -> "dict[str, float | Array]":
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


def on_leg(leg: Leg, name: str, start: float, share: "float | Array") -> "float | Array":
    """Return positions on a cubic Hermite or linear leg."""
    end = leg.ends[name]
    if not leg.duration_s:
        return start + share * (end - start)
    enters, leaves = leg.enters.get(name, 0.0) * leg.duration_s, leg.leaves.get(name, 0.0) * leg.duration_s
    a, b = 2 * (start - end) + enters + leaves, 3 * (end - start) - 2 * enters - leaves
    return start + share * (enters + share * (b + share * a))


def _between(robot: Robot, way: Way) -> Iterator[tuple[Positions, Positions, Leg]]:
    before, moved = way.start, Positions()
    for leg in way.legs:
        moved |= leg.ends
        after: Positions = follow(robot, way.start, moved)  # type: ignore[assignment]  # of numbers, a number
        yield before, after, leg
        before = after


STANCE_RAD = 0.05  # also metre
MOST_STANCES = 24


def ways_of(motion: Move | Follow, start: Positions, elsewhere: Mapping[str, float]) -> tuple[Way, ...]:
    """Return the paths from ``start``; ``elsewhere`` are the targets of joints in other motions."""
    legs = _legs(motion, start)
    own = legs[-1].ends
    meanwhile = {name: end for name, end in elsewhere.items() if name not in own and name in start}
    ways = (Way(start, legs),)
    if not meanwhile:
        return ways
    along = tuple(_beside(leg, (i + 1) / len(legs), start, meanwhile) for i, leg in enumerate(legs))
    return (*ways, Way(start | meanwhile, legs), Way(start, along))


def _beside(leg: Leg, share: float, start: Positions, meanwhile: Mapping[str, float]) -> Leg:
    there = {name: start[name] + share * (end - start[name]) for name, end in meanwhile.items()}
    return Leg(leg.ends | there)


def stances_of(start: Positions, ends: Mapping[str, float]) -> tuple[Positions, ...]:
    """Return joint positions at equal steps between ``start`` and ``ends``; the first are the present ones."""
    moved = {name: end - start[name] for name, end in ends.items() if name in start}
    count = min(MOST_STANCES, round(max(map(abs, moved.values()), default=0.0) / STANCE_RAD + 0.5))
    shares = [(i + 1) / count for i in range(count)]
    return (start, *({name: start[name] + share * way for name, way in moved.items()} for share in shares))


def _legs(motion: Move | Follow, start: Positions) -> tuple[Leg, ...]:
    if isinstance(motion, Move):
        return (Leg(dict(motion.targets)),)
    times = (0.0, *motion.times_s)
    rows = (tuple(start[joint] for joint in motion.joints), *motion.positions)
    velocities = [_velocities(times, column) for column in zip(*rows, strict=True)]
    legs = []
    for i, (before, after) in enumerate(pairwise(times)):
        enters, leaves = ({j: v[at] for j, v in zip(motion.joints, velocities, strict=True)} for at in (i, i + 1))
        legs.append(Leg(dict(zip(motion.joints, rows[i + 1], strict=True)), after - before, enters, leaves))
    return tuple(legs)


def _velocities(times: Iterable[float], positions: Iterable[float]) -> list[float]:
    """Return the velocities at the waypoints, from rest to rest (Fritsch and Butland, 1984)."""
    steps = [after - before for before, after in pairwise(times)]
    slopes = [(after - before) / step for (before, after), step in zip(pairwise(positions), steps, strict=True)]
    inner = [_slope(*one, *other) for one, other in pairwise(zip(steps, slopes, strict=True))]
    return [0.0, *inner, 0.0]


def _slope(step: float, slope: float, next_step: float, next_slope: float) -> float:
    if slope * next_slope <= 0.0:
        return 0.0
    weight, next_weight = 2.0 * next_step + step, next_step + 2.0 * step
    return (weight + next_weight) / (weight / slope + next_weight / next_slope)
