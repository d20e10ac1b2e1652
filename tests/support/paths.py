"""How far a drive is from a path."""

import math
from collections.abc import Iterable, Sequence
from itertools import pairwise

from linked_fleet_agent.planar import Pose

PLACE_M, LEVEL_RAD = 0.02, math.radians(2.0)
"""The most that the last pose may be off."""


def apart(one: Pose, other: Pose) -> float:
    return math.hypot(one.x - other.x, one.y - other.y)


def off_m(driven: Iterable[Pose], path: Sequence[Pose]) -> float:
    """Return the most by which a drive leaves a path."""
    return max(min(_aside(each, *leg) for leg in pairwise(path)) for each in driven)


def cut_m(driven: Sequence[Pose], path: Iterable[Pose]) -> float:
    """Return the most by which a drive misses a pose of a path."""
    return max(min(apart(each, pose) for each in driven) for pose in path)


def _aside(at: Pose, start: Pose, end: Pose) -> float:
    along = (end.x - start.x, end.y - start.y)
    length = along[0] ** 2 + along[1] ** 2
    share = ((at.x - start.x) * along[0] + (at.y - start.y) * along[1]) / length if length else 0.0
    share = min(max(share, 0.0), 1.0)
    return math.hypot(at.x - start.x - share * along[0], at.y - start.y - share * along[1])
