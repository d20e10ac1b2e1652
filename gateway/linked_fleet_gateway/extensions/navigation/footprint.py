"""The outline of a base on the floor, and its distance from obstacles. Metre, radian."""

import math
from collections.abc import Iterable, Sequence

import numpy as np
import numpy.typing as npt

from linked_fleet_agent.planar import Pose
from linked_fleet_gateway.extensions.navigation.floor_grid import Floats, distance_to
from linked_fleet_gateway.extensions.navigation.messages import Point

_APART_M = 0.04


class Footprint:
    """A convex outline in the frame of the base, and the obstacles around it."""

    def __init__(self, outline: Sequence[Point]) -> None:
        corners = np.asarray(outline, dtype=float)
        self._corners, self._edge = corners, np.concatenate(list(_sampled(corners)))
        self.radius = float(np.linalg.norm(corners, axis=1).max())
        """The distance of the furthest corner: a disc of this radius contains the base, however it turns."""
        self.inner = _inner(corners)
        """The radius of the largest disc about the origin that the base covers."""
        self._obstacles = list[Floats]()
        self._centres, self._radii = np.zeros((0, 2)), np.zeros(0)

    def add(self, polygons: Iterable[npt.ArrayLike]) -> None:
        """Add obstacles, each a convex polygon."""
        new = [np.asarray(each, dtype=float) for each in polygons]
        if not new:
            return
        self._obstacles += new
        centres = np.array([each.mean(axis=0) for each in new])
        radii = [float(np.linalg.norm(each - at, axis=1).max()) for each, at in zip(new, centres, strict=True)]
        self._centres, self._radii = np.concatenate((self._centres, centres)), np.append(self._radii, radii)

    def fits(self, pose: Pose, kept_m: float) -> bool:
        """Return True if the base at a pose keeps this distance from everything."""
        return self._apart(pose, kept_m) >= kept_m

    def kept(self, pose: Pose) -> float:
        """Return the distance of the base at a pose from what is next to it, as far as half a metre."""
        return max(self._apart(pose, 0.5), 0.0)

    def _apart(self, pose: Pose, within_m: float) -> float:
        at = np.array((pose.x, pose.y))
        near = np.linalg.norm(self._centres - at, axis=1) <= self._radii + self.radius + within_m
        if not near.any():
            return within_m
        cosine, sine = math.cos(pose.heading), math.sin(pose.heading)
        turned = np.array(((cosine, sine), (-sine, cosine)))
        edge, corners = self._edge @ turned + at, self._corners @ turned + at
        return min(_apart(edge, corners, self._obstacles[index], within_m) for index in np.flatnonzero(near).tolist())


def _apart(edge: Floats, corners: Floats, obstacle: Floats, within_m: float) -> float:
    """Return the distance of an outline from an obstacle; below zero if that is inside."""
    if float(distance_to(corners, obstacle[:, 0], obstacle[:, 1]).min()) == 0.0:
        return -1.0
    return min(float(distance_to(obstacle, edge[:, 0], edge[:, 1]).min()), within_m)


def _sampled(corners: Floats) -> Iterable[Floats]:
    for start, end in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        count = max(1, math.ceil(float(np.linalg.norm(end - start)) / _APART_M))
        yield start + np.arange(count)[:, None] / count * (end - start)


def _inner(corners: Floats) -> float:
    ends = np.roll(corners, -1, axis=0)
    along = ends - corners
    beside = (along[:, 1] * corners[:, 0] - along[:, 0] * corners[:, 1]) / np.maximum(
        np.linalg.norm(along, axis=1), 1e-12
    )
    return max(float(beside.min()), 0.0)
