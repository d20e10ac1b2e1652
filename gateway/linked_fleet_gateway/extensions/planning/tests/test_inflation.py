"""Shapes that are larger than others contain all points within the distance."""

import coal
import numpy as np
import pinocchio as pin
import pytest

from linked_fleet_gateway.extensions.planning.inflation import inflated
from linked_fleet_gateway.extensions.world.surfaces import Array, Surface, convex_hull
from linked_fleet_gateway.extensions.world.surroundings import Shape
from meshes import BOX, channel

BY_M = 0.0115
_HULL = convex_hull(np.array([[0, 0, 0], [0.3, 0, 0], [0, 0.2, 0], [0, 0, 0.4], [0.1, 0.1, 0.1]], dtype=float))
SHAPES = {
    "box": coal.Box(0.2, 0.3, 0.4),
    "sphere": coal.Sphere(0.1),
    "cylinder": coal.Cylinder(0.1, 0.4),
    "capsule": coal.Capsule(0.1, 0.4),
    "hull": _HULL,
}


def around(shape: coal.CollisionGeometry, count: int = 400) -> Array:
    """Return points at nearly the distance from a shape."""
    random, found = np.random.default_rng(1), []
    while len(found) < count:
        point = random.uniform(-0.6, 0.6, 3)
        request, result = coal.DistanceRequest(True), coal.DistanceResult()
        apart = coal.distance(
            shape, coal.Transform3s(), coal.Sphere(1e-6), coal.Transform3s(np.eye(3), point), request, result
        )
        if apart > BY_M:
            near = np.array(result.getNearestPoint1()).reshape(3)
            found.append(near + (point - near) / np.linalg.norm(point - near) * BY_M * 0.99)
    return np.array(found)


@pytest.mark.parametrize("name", SHAPES)
def test_points_at_the_distance_are_inside(name: str) -> None:
    shape = SHAPES[name]
    solids, mesh = inflated(Shape(shape, shape, None, pin.SE3.Identity()), BY_M)
    assert mesh is None
    for point in around(shape):
        depths = [
            coal.distance(solid, coal.Transform3s(at.rotation, at.translation), coal.Sphere(1e-6),
                          coal.Transform3s(np.eye(3), point), coal.DistanceRequest(), coal.DistanceResult())
            for solid, at in solids
        ]  # fmt: skip
        assert min(depths) <= 1e-6, point


@pytest.mark.parametrize("triangles", [BOX, channel()])
def test_a_surface_gets_one_at_the_distance_on_each_side(triangles: Array) -> None:
    corners = np.array(triangles, dtype=float).reshape(-1, 3)
    surface = Surface.from_triangles(corners, np.arange(len(corners), dtype=np.int32).reshape(-1, 3))
    _, mesh = inflated(Shape(surface.exact_shape(), None, surface, pin.SE3.Identity()), BY_M)
    assert mesh is not None
    vertices, faces = mesh
    assert len(faces) == 3 * len(surface.triangles)
    low, high = surface.vertices.min(axis=0), surface.vertices.max(axis=0)
    assert (vertices.min(axis=0) <= low - BY_M * 0.99).all() and (vertices.max(axis=0) >= high + BY_M * 0.99).all()
