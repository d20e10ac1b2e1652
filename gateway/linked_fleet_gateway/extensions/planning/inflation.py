"""Shapes that are larger than others by a distance. Metre."""

import coal
import numpy as np
import pinocchio as pin

from linked_fleet_gateway.extensions.planning.kept import Kept
from linked_fleet_gateway.extensions.world.surfaces import Array, Indices, Surface, convex_hull
from linked_fleet_gateway.extensions.world.surroundings import Shape
from linked_fleet_state.xml import ModelError

_FLATTEST, _FARTHEST = 1e-3, 3.0
"""Squared sine of the angle below which two faces are one plane, and the longest shift of a corner."""
_MOST_DISTANCES = 8
_ENLARGED: dict[float, Kept[coal.CollisionGeometry]] = {}
"""Hulls that were enlarged, by the distance."""
Triangles = tuple[Array, Indices]
"""Vertices, and rows of three indices into them."""
Solids = list[tuple[coal.CollisionGeometry, pin.SE3]]


def inflated(shape: Shape, by_m: float) -> tuple[Solids, Triangles | None]:
    """Return a shape that contains all points within ``by_m`` of another: convex solids, or a surface.

    A surface without a hull, such as that of an object, gets one beside each of its sides.
    """
    solid = shape.shape
    if isinstance(solid, coal.Box):
        return [(coal.Box(*(2 * (np.array(solid.halfSide).reshape(3) + by_m))), pin.SE3.Identity())], None
    if isinstance(solid, coal.Sphere):
        return [(coal.Sphere(solid.radius + by_m), pin.SE3.Identity())], None
    if isinstance(solid, coal.Cylinder):
        return [(coal.Cylinder(solid.radius + by_m, 2 * (solid.halfLength + by_m)), pin.SE3.Identity())], None
    if isinstance(solid, coal.Capsule):
        return _capsule(solid, by_m), None
    if shape.hull is None:
        return [], _on_both_sides(solid, by_m)
    return [(_enlarged(shape.hull, by_m), pin.SE3.Identity())], None


def _enlarged(hull: coal.CollisionGeometry, by_m: float) -> coal.CollisionGeometry:
    """Return a hull that contains another one enlarged; each costs 10 ms."""
    if by_m not in _ENLARGED:
        if len(_ENLARGED) == _MOST_DISTANCES:
            _ENLARGED.clear()
        _ENLARGED[by_m] = Kept(lambda each: _around(np.array(each.points(), dtype=float).reshape(-1, 3), by_m))
    return _ENLARGED[by_m](hull)


def _capsule(solid: coal.Capsule, by_m: float) -> Solids:
    radius, half = solid.radius + by_m, solid.halfLength
    ends = [pin.SE3(np.eye(3), np.array((0.0, 0.0, z))) for z in (half, -half)]
    cylinder: Solids = [(coal.Cylinder(radius, 2 * half), pin.SE3.Identity())]
    return [*cylinder, *((coal.Sphere(radius), end) for end in ends)]


def _around(points: Array, by_m: float) -> coal.CollisionGeometry:
    """Return the convex hull of points, each with a polyhedron around the sphere of this radius."""
    if by_m == 0.0:
        return convex_hull(points)
    low, high = -np.ones(3), np.ones(3)
    directions = np.array([[(low, high)[k][i] for i, k in enumerate(bits)] for bits in np.ndindex(2, 2, 2)])
    axes = np.concatenate([np.eye(3), -np.eye(3)]) * 1.15
    offsets = by_m * np.concatenate([directions * 0.75, axes])
    return convex_hull((points[:, None, :] + offsets[None, :, :]).reshape(-1, 3))


def _on_both_sides(solid: coal.BVHModelOBBRSS, by_m: float) -> Triangles:
    """Return a surface, and two that are parallel to it at this distance."""
    vertices = np.array(solid.vertices(), dtype=float).reshape(-1, 3)
    corners = [solid.tri_indices(i) for i in range(solid.num_tris)]
    triangles = np.array([(each[0], each[1], each[2]) for each in corners], dtype=np.int32)
    try:
        joined = Surface.from_triangles(vertices, triangles)
    except ModelError:
        return vertices, triangles
    if by_m == 0.0:
        return joined.vertices, joined.triangles
    shift, count = by_m * _shifts(joined), len(joined.vertices)
    points = np.concatenate([joined.vertices, joined.vertices + shift, joined.vertices - shift])
    return points, np.concatenate([joined.triangles + np.int32(k * count) for k in range(3)])


def _shifts(surface: Surface) -> Array:
    """Return for each vertex a shift that moves all of its faces by one along their normals, as far as one does."""
    a, b, c = (surface.vertices[column] for column in surface.triangles.T)
    faces = np.cross(b - a, c - a)
    faces /= np.maximum(np.linalg.norm(faces, axis=1, keepdims=True), 1e-30)
    count = len(surface.vertices)
    squares, sums = np.zeros((count, 3, 3)), np.zeros((count, 3))
    for column in surface.triangles.T:
        np.add.at(squares, column, faces[:, :, None] * faces[:, None, :])
        np.add.at(sums, column, faces)
    found: Array = np.einsum("nij,nj->ni", np.linalg.pinv(squares, rcond=_FLATTEST, hermitian=True), sums)
    found *= np.minimum(1.0, _FARTHEST / np.maximum(np.linalg.norm(found, axis=1, keepdims=True), 1e-30))
    return found
