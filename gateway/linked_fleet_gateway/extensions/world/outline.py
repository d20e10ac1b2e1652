"""The outline of a robot seen from above, and the space that it takes on a way. Metre, radian.

Runs in the check process. An outline is the convex hull of all shapes of the robot, as prism from its lowest to its
highest point.
"""

import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import coal
import numpy as np
import pinocchio as pin

from linked_fleet_agent.planar import Pose
from linked_fleet_gateway.extensions.world.corners import RING
from linked_fleet_gateway.extensions.world.robot import Body
from linked_fleet_gateway.extensions.world.surfaces import Array, convex_hull
from linked_fleet_state.driving import pieces

_DIRECTIONS = np.array([(math.cos(angle), math.sin(angle)) for angle in np.arange(64) * math.tau / 64])
"""A hull has the points that are the furthest in these directions: 0.1 % of its radius may be missing."""
_THIN_M = 1e-3


class Outline(NamedTuple):
    """``corners`` (N, 2) of a convex polygon, counterclockwise, and the range of heights."""

    corners: Array
    low: float
    high: float

    @property
    def radius(self) -> float:
        """The distance of the furthest corner from the origin."""
        return float(np.linalg.norm(self.corners, axis=1).max(initial=0.0))

    def at(self, pose: Pose) -> Array:
        """Return the corners (N, 2) of a robot whose root has been moved to a pose."""
        cosine, sine = math.cos(pose.heading), math.sin(pose.heading)
        turned: Array = self.corners @ np.array(((cosine, sine), (-sine, cosine))) + (pose.x, pose.y)
        return turned


def outline(placed: Sequence[tuple[Body, pin.SE3]]) -> Outline | None:
    """Return the outline of bodies where they are; None without bodies."""
    if not placed:
        return None
    points = np.concatenate([_points(*each) for each in placed])
    return Outline(hull_of(points[:, :2]), float(points[:, 2].min()), float(points[:, 2].max()))


def hull_of(points: Array) -> Array:
    """Return the corners of the convex hull of points (N, 2), counterclockwise."""
    furthest = (points @ _DIRECTIONS.T).argmax(axis=0)
    kept = furthest[np.concatenate(([True], furthest[1:] != furthest[:-1]))]
    found: Array = points[kept]
    return found


def swept(shape: Outline, way: Sequence[Pose]) -> Iterator[coal.CollisionGeometry]:
    """Yield the spaces that a robot takes on a way from the origin: one for each straight piece, and for each turn."""
    for plan in plans_along(shape, way):
        low, high = shape.low, max(shape.high, shape.low + _THIN_M)
        yield convex_hull(np.concatenate([np.column_stack((plan, np.full(len(plan), z))) for z in (low, high)]))


def plans_along(shape: Outline, way: Sequence[Pose]) -> Iterator[Array]:
    """Yield the corners (N, 2) of what a robot covers on each piece of a way from the origin."""
    for piece in pieces(Pose(), way):
        yield hull_of(np.concatenate([shape.at(each) for each in piece]))


def _points(body: Body, at: pin.SE3) -> Array:
    """Return points of which the convex hull contains a body."""
    if isinstance(body.shape, coal.Sphere | coal.Capsule):
        return _around(body.corners, body.shape.radius, at)
    found: Array = body.corners @ at.rotation.T + at.translation
    return found


def _around(centres: Array, radius: float, at: pin.SE3) -> Array:
    """Return rings about the centres of spheres, and their highest and lowest points."""
    placed = centres @ at.rotation.T + at.translation
    offsets = np.concatenate((radius * RING, ((0.0, 0.0, -radius), (0.0, 0.0, radius))))
    found: Array = (placed[:, None, :] + offsets).reshape(-1, 3)
    return found
