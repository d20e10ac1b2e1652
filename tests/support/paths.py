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
    return max(min(each.to_leg_m(*leg) for leg in pairwise(path)) for each in driven)


def cut_m(driven: Sequence[Pose], path: Iterable[Pose]) -> float:
    """Return the most by which a drive misses a pose of a path."""
    return max(min(apart(each, pose) for each in driven) for pose in path)
