"""The paths that a motion may take, and the stances in which other moving robots may be met. Pure; radian, metre,
second.

A motion of joints at rest is linear in joint space; a trajectory passes its waypoints on the cubics of Fritsch and
Carlson, like the agent. Joints that another motion moves meanwhile may be anywhere between their position and their
target. They are checked at both ends, and moving in parallel with this motion.
"""

from collections.abc import Iterable, Mapping
from itertools import pairwise

from linked_fleet_agent.wire.messages import Follow, Move
from linked_fleet_gateway.extensions.world.messages import MotionPath, PathSegment, Positions

STANCE_RAD = 0.05  # also metre
MOST_STANCES = 24


def paths_of(motion: Move | Follow, start: Positions, elsewhere: Mapping[str, float]) -> tuple[MotionPath, ...]:
    """Return the paths from ``start``; ``elsewhere`` are the targets of joints in other motions."""
    legs = _legs(motion, start)
    own = legs[-1].ends
    meanwhile = {name: end for name, end in elsewhere.items() if name not in own and name in start}
    ways = (MotionPath(start, legs),)
    if not meanwhile:
        return ways
    along = tuple(_beside(leg, (i + 1) / len(legs), start, meanwhile) for i, leg in enumerate(legs))
    return (*ways, MotionPath(start | meanwhile, legs), MotionPath(start, along))


def _beside(leg: PathSegment, share: float, start: Positions, meanwhile: Mapping[str, float]) -> PathSegment:
    there = {name: start[name] + share * (end - start[name]) for name, end in meanwhile.items()}
    return PathSegment(leg.ends | there)


def stances_of(start: Positions, ends: Mapping[str, float]) -> tuple[Positions, ...]:
    """Return joint positions at equal steps between ``start`` and ``ends``; the first are the present ones."""
    moved = {name: end - start[name] for name, end in ends.items() if name in start}
    count = min(MOST_STANCES, round(max(map(abs, moved.values()), default=0.0) / STANCE_RAD + 0.5))
    shares = [(i + 1) / count for i in range(count)]
    return (start, *({name: start[name] + share * way for name, way in moved.items()} for share in shares))


def _legs(motion: Move | Follow, start: Positions) -> tuple[PathSegment, ...]:
    if isinstance(motion, Move):
        return (PathSegment(dict(motion.targets)),)
    times = (0.0, *motion.times_s)
    rows = (tuple(start[joint] for joint in motion.joints), *motion.positions)
    velocities = [_velocities(times, column) for column in zip(*rows, strict=True)]
    legs = []
    for i, (before, after) in enumerate(pairwise(times)):
        enters, leaves = ({j: v[at] for j, v in zip(motion.joints, velocities, strict=True)} for at in (i, i + 1))
        legs.append(PathSegment(dict(zip(motion.joints, rows[i + 1], strict=True)), after - before, enters, leaves))
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
