"""The occupied cells of the map of the floor as obstacles, in the process that checks motions. Metre, radian.

The boxes are as many as a map has. So those that a robot cannot reach are left out at once, and the others are cut off
where it cannot reach: a long wall then lies within a small sphere. That changes no answer, because what is cut off is
further away than any part of the robot comes.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import coal
import numpy as np
import pinocchio as pin

from linked_fleet_gateway.extensions.world.messages import PrepareMap
from linked_fleet_gateway.extensions.world.path import UnknownPosition
from linked_fleet_gateway.extensions.world.surfaces import Array

MOST_NEAR = 4_000
_BEYOND_M = 0.5  # kept of a box beyond the reach, so that depths within it are those of the whole box


@dataclass(frozen=True)
class MapObstacles:
    """The boxes of a map: the plan of each in the frame of the map, and where that lies in the world."""

    asked: PrepareMap

    @cached_property
    def plans(self) -> Array:
        """Lower and upper x and y of each box: x, y, x, y."""
        cells = np.frombuffer(self.asked.boxes, dtype="<u2").reshape(-1, 4).astype(float)
        found: Array = np.concatenate((cells[:, :2], cells[:, :2] + cells[:, 2:]), axis=1) * self.asked.resolution_m
        return found

    @cached_property
    def _at(self) -> pin.SE3:
        x, y, yaw = self.asked.origin
        return pin.SE3(pin.utils.rotate("z", yaw), np.array((x, y, 0.0)))

    def near(self, root: pin.SE3, reach_m: float) -> Iterator[tuple[coal.Box, pin.SE3]]:
        """Yield the boxes that come within ``reach_m`` of the root of a robot in the world, in its frame.

        Raises UnknownPosition if they are too many.
        """
        height_m, seen = self.asked.height_m, self._at.inverse() * root
        x, y, z = seen.translation
        above = max(-z, z - height_m, 0.0)
        if not above <= reach_m:
            return
        found = self._within(float(x), float(y), reach_m)
        if len(found) > MOST_NEAR:
            raise UnknownPosition(f"more than {MOST_NEAR} boxes of the map of the floor are near it")
        to_root = seen.inverse()
        for low_x, low_y, high_x, high_y in found.tolist():
            middle = np.array(((low_x + high_x) / 2, (low_y + high_y) / 2, height_m / 2))
            box = coal.Box(high_x - low_x, high_y - low_y, height_m)
            yield box, to_root * pin.SE3(np.eye(3), middle)

    def _within(self, x: float, y: float, reach_m: float) -> Array:
        """Return the plans that come within ``reach_m`` of a point of the map, without what is far beyond that."""
        if not math.isfinite(reach_m):
            return self.plans
        far_m = reach_m + _BEYOND_M
        cut = np.concatenate(
            (
                np.maximum(self.plans[:, :2], (x - far_m, y - far_m)),
                np.minimum(self.plans[:, 2:], (x + far_m, y + far_m)),
            ),
            axis=1,
        )
        gaps = np.maximum(np.maximum(self.plans[:, :2] - (x, y), (x, y) - self.plans[:, 2:]), 0.0)
        found: Array = cut[np.linalg.norm(gaps, axis=1) <= reach_m]
        return found
