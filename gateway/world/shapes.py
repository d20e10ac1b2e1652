"""Shapes of robots and objects for coal: primitives as they are, meshes of links as their convex hulls. Metre.

Runs in the process that checks motions. Of a link the collision geometry counts; where a mesh of that is none of those
that the agent hands out, its visual geometry stands for it, and a link that has neither has no shape.
"""

import struct
import tempfile
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from xml.etree.ElementTree import Element

import coal
import numpy as np
import numpy.typing as npt
import pinocchio as pin

from gateway.fleet.model import Joint, JointKind, RobotModel
from gateway.fleet.pinocchio_model import build_model
from gateway.fleet.xml import ModelError, parse_xml, quaternion, required_number, rotation, vector
from gateway.world.scene import Box, Cylinder, Geometry, Sphere

Array = npt.NDArray[np.float64]
Meshes = Mapping[str, tuple[str, bytes]]

_MOST_BODIES = 1_000
_ZERO, _ONE = (0.0, 0.0, 0.0), (1.0, 1.0, 1.0)


@dataclass(frozen=True)
class Body:
    """A convex part of a link; ``centre`` in its own frame, and no point of it is further than ``radius`` from that."""

    link: str
    joint: int
    shape: coal.CollisionGeometry
    centre: Array
    radius: float


@dataclass(frozen=True)
class Robot:
    """``geometry`` has a shape for each of ``bodies``, in their order."""

    tree: RobotModel
    model: pin.Model
    geometry: pin.GeometryModel
    bodies: tuple[Body, ...]
    reach_m: tuple[float, ...]
    """By joint of the model: no point that it moves is further from its axis; of the universe, from the root."""


def robot_of(urdf: str, meshes: Meshes) -> Robot:
    """ModelError for a URDF or a mesh that cannot be used."""
    model, tree, geometry = build_model(urdf, False), RobotModel.parse(urdf), pin.GeometryModel()
    bodies: list[Body] = []
    for element in parse_xml(urdf).findall("link"):
        link = element.get("name", "").strip()
        frame = model.frames[model.getFrameId(link, pin.FrameType.BODY)]
        for shape, place in _shapes(element, meshes, link):
            if len(bodies) == _MOST_BODIES:
                raise ModelError(f"the robot has more than {_MOST_BODIES} shapes")
            placed = frame.placement * place
            geometry.addGeometryObject(pin.GeometryObject(f"{len(bodies)}", frame.parentJoint, placed, shape))
            bodies.append(_body(link, frame.parentJoint, shape))
    return Robot(tree, model, geometry, tuple(bodies), _reach(tree, model, geometry, bodies))


def _body(link: str, joint: int, shape: coal.CollisionGeometry) -> Body:
    shape.computeLocalAABB()
    return Body(link, joint, shape, np.array(shape.aabb_center, dtype=float), float(shape.aabb_radius))


def _shapes(link: Element, meshes: Meshes, name: str) -> Iterator[tuple[coal.CollisionGeometry, pin.SE3]]:
    parts = link.findall("collision")
    if not all(_is_known(part, meshes) for part in parts):
        parts = [part for part in link.findall("visual") if _is_known(part, meshes)]
    for part in parts:
        origin = part.find("origin")
        turned = np.array(rotation(quaternion(vector(origin, "rpy", _ZERO, name))))
        yield _shape(part, meshes, name), pin.SE3(turned, np.array(vector(origin, "xyz", _ZERO, name)))


def _is_known(part: Element, meshes: Meshes) -> bool:
    mesh = part.find("geometry/mesh")
    return mesh is None or mesh.get("filename", "") in meshes


def _shape(part: Element, meshes: Meshes, name: str) -> coal.CollisionGeometry:
    geometry = part.find("geometry")
    form = None if geometry is None else next(iter(geometry), None)
    if form is not None and form.tag == "mesh":
        suffix, content = meshes[form.get("filename", "")]
        return _hull(suffix, content, np.array(vector(form, "scale", _ONE, name)), name)
    if form is not None and form.tag == "box":
        return coal.Box(*vector(form, "size", _ZERO, name))
    if form is not None and form.tag in ("sphere", "cylinder"):
        radius = required_number(form, "radius", f"a shape of {name}")
        if form.tag == "sphere":
            return coal.Sphere(radius)
        return coal.Cylinder(radius, required_number(form, "length", f"a shape of {name}"))
    raise ModelError(f"link {name!r} has a shape that is neither box, sphere, cylinder nor mesh")


def _hull(suffix: str, content: bytes, scale: Array, name: str) -> coal.CollisionGeometry:
    """The convex hull: it is larger than the mesh, never smaller, and met in microseconds."""
    with tempfile.NamedTemporaryFile(suffix=f".{suffix}") as file:
        file.write(content)
        file.flush()
        try:
            mesh = coal.MeshLoader().load(file.name, scale)
            mesh.buildConvexHull(True, "Qt")
        except (ValueError, RuntimeError) as error:
            raise ModelError(f"a mesh of link {name!r} cannot be used: {error}") from error
    return mesh.convex


def _reach(tree: RobotModel, model: pin.Model, geometry: pin.GeometryModel, bodies: list[Body]) -> tuple[float, ...]:
    """By the triangle inequality from the tips inwards; children come after their parents."""
    reach = [0.0] * model.njoints
    for body, placed in zip(bodies, geometry.geometryObjects, strict=True):
        far = float(np.linalg.norm(placed.placement.act(body.centre))) + body.radius
        reach[body.joint] = max(reach[body.joint], far)
    for joint in range(model.njoints - 1, 0, -1):
        parent, offset = model.parents[joint], model.jointPlacements[joint].translation
        far = float(np.linalg.norm(offset)) + reach[joint] + _slide(tree.joints[model.names[joint]])
        reach[parent] = max(reach[parent], far)
    return tuple(reach)


def _slide(joint: Joint) -> float:
    if joint.kind is not JointKind.PRISMATIC:
        return 0.0
    return max(abs(joint.limits.lower or 0.0), abs(joint.limits.upper or 0.0))


def object_of(geometry: Geometry) -> coal.CollisionGeometry:
    """The surface of a mesh as it is, not its hull: one may reach under a table."""
    if isinstance(geometry, Box):
        return coal.Box(*geometry.size_m)
    if isinstance(geometry, Sphere):
        return coal.Sphere(geometry.radius_m)
    if isinstance(geometry, Cylinder):
        return coal.Cylinder(geometry.radius_m, geometry.length_m)
    corners = np.array([each for each in struct.iter_unpack("<12x9f2x", memoryview(geometry.stl)[84:])])
    points = corners.reshape(-1, 3)
    surface = coal.BVHModelOBBRSS()
    surface.beginModel(len(points) // 3, len(points))
    for first, second, third in points.reshape(-1, 3, 3):
        surface.addTriangle(first, second, third)
    surface.endModel()
    return surface
