"""Distances between two placed shapes. Metre."""

from dataclasses import dataclass
from functools import cached_property

import coal
import numpy as np
import numpy.typing as npt
import pinocchio as pin

from linked_fleet_gateway.extensions.world.path import STEP_M
from linked_fleet_gateway.extensions.world.surfaces import Surface, winding

_NEARLY_M = 4 * STEP_M  # above this, the distance of the hulls replaces that of the surfaces
_REQUEST = coal.DistanceRequest()
_REQUEST.gjk_tolerance = 1e-9  # by default, convex shapes within a micrometre have distance zero


@dataclass(frozen=True)
class Shape:
    """A placed shape.

    ``shape`` is exact; ``hull``, if any, is convex and contains it; ``surface`` is that of a mesh.
    """

    shape: coal.CollisionGeometry
    hull: coal.CollisionGeometry | None
    surface: Surface | None
    at: pin.SE3

    @cached_property
    def place(self) -> coal.Transform3s:
        return coal.Transform3s(self.at.rotation, self.at.translation)


def distance(one: Shape, other: Shape, least_m: float) -> float:
    """Return a lower bound of the distance; exact near ``least_m`` and below, and not above zero for a contact."""
    exact = one.hull is one.shape and other.hull is other.shape
    if not exact and one.hull is not None and other.hull is not None:
        apart = depth(one, other)
        if apart > least_m + _NEARLY_M:
            return apart
    return _distance(one.shape, one, other.shape, other)


def depth(one: Shape, other: Shape) -> float:
    """Return the distance of the convex hulls in metre, negative for a penetration depth."""
    assert one.hull is not None and other.hull is not None
    return _distance(one.hull, one, other.hull, other)


def _distance(mine: coal.CollisionGeometry, one: Shape, yours: coal.CollisionGeometry, other: Shape) -> float:
    return float(coal.distance(mine, one.place, yours, other.place, _REQUEST, coal.DistanceResult()))


def meeting_point(one: Shape, other: Shape) -> npt.NDArray[np.float64] | None:
    """Return the middle between the nearest points of both; None if unavailable, as for some intersecting meshes."""
    request, result = coal.DistanceRequest(True), coal.DistanceResult()
    coal.distance(one.shape, one.place, other.shape, other.place, request, result)
    middle = (np.array(result.getNearestPoint1()) + np.array(result.getNearestPoint2())) / 2
    found: npt.NDArray[np.float64] = middle.reshape(3)
    return found if np.isfinite(found).all() else None


def is_inside(one: Shape, other: Shape) -> bool:
    """Return True if ``one`` is inside ``other``, given that their surfaces do not touch."""
    if other.surface is None:
        return False
    one.shape.computeLocalAABB()
    somewhere = one.surface.vertices[0] if one.surface is not None else np.array(one.shape.aabb_center, dtype=float)
    seen = other.at.actInv(one.at.act(somewhere))
    low, high = other.surface.vertices.min(axis=0), other.surface.vertices.max(axis=0)
    if (seen < low).any() or (seen > high).any():
        return False
    return abs(winding(other.surface, seen)) > 0.5
