"""Points of which the convex hull contains a shape. Metre, in the frame of the shape."""

import math

import coal
import numpy as np

from linked_fleet_gateway.extensions.world.surfaces import Array

_SIDES = 24
RING = np.array([(math.cos(angle), math.sin(angle), 0.0) for angle in np.arange(_SIDES) * math.tau / _SIDES])
RING /= math.cos(math.pi / _SIDES)


def corners_of(shape: coal.CollisionGeometry) -> Array:
    """Return the corners of a shape in its own frame; of one with round ends, the centres of these."""
    match shape:
        case coal.Sphere():
            return np.zeros((1, 3))
        case coal.Capsule():
            return np.array([(0.0, 0.0, -shape.halfLength), (0.0, 0.0, shape.halfLength)])
        case coal.Cylinder():
            ends = np.array([(0.0, 0.0, -shape.halfLength), (0.0, 0.0, shape.halfLength)])
            rings: Array = (ends[:, None, :] + shape.radius * RING).reshape(-1, 3)
            return rings
        case coal.Box():
            return _box(-np.array(shape.halfSide), np.array(shape.halfSide))
        case coal.ConvexBase():
            return np.array(shape.points(), dtype=float).reshape(-1, 3)
    shape.computeLocalAABB()
    bounds = shape.aabb_local
    return _box(np.array(bounds.min_), np.array(bounds.max_))


def _box(low: Array, high: Array) -> Array:
    ends = np.stack((low, high)).reshape(2, 3)
    return np.array([[ends[i, 0], ends[j, 1], ends[k, 2]] for i, j, k in np.ndindex(2, 2, 2)])
