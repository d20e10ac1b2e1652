"""Rectangles on a plane, and whether they overlap: contacts as tests see them, without the check of motions."""

import itertools
import math

import numpy as np
import numpy.typing as npt

from linked_fleet_agent.planar import Pose

Corners = npt.NDArray[np.float64]


def rectangle(pose: Pose, length_m: float, width_m: float) -> Corners:
    cosine, sine = math.cos(pose.heading), math.sin(pose.heading)
    corners = [(length_m / 2, width_m / 2), (-length_m / 2, width_m / 2)]
    corners += [(-x, -y) for x, y in corners]
    return np.array([(pose.x + x * cosine - y * sine, pose.y + x * sine + y * cosine) for x, y in corners])


def overlap(one: Corners, other: Corners) -> bool:
    """Return True if two convex polygons overlap (separating axes)."""
    for corners in (one, other):
        for start, end in itertools.pairwise([*corners, corners[0]]):
            across = np.array([end[1] - start[1], start[0] - end[0]])
            mine, yours = one @ across, other @ across
            if mine.max() < yours.min() or yours.max() < mine.min():
                return False
    return True
