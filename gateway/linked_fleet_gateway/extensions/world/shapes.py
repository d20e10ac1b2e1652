"""Collision shapes of robots and objects for coal: primitives and meshes. Metre.

Runs in the check process. A link has its collision geometry; if the agent does not serve a mesh of that, its visual
geometry is used. A link without either has no shape.
"""

import struct
from collections.abc import Callable, Set
from dataclasses import replace
from xml.etree.ElementTree import Element

import coal
import numpy as np
import pinocchio as pin

from linked_fleet_agent.urdf import geometry as forms
from linked_fleet_agent.urdf.poses import pose_of
from linked_fleet_gateway.extensions.world.robot import Body, Robot, self_collision_pairs
from linked_fleet_gateway.extensions.world.scene import Box, Cylinder, Geometry, Sphere
from linked_fleet_gateway.extensions.world.surfaces import Array, Surface
from linked_fleet_gateway.fleet.model import Joint, JointKind, RobotModel
from linked_fleet_gateway.fleet.pinocchio_model import build_model
from linked_fleet_gateway.fleet.xml import ModelError, parse_xml, rotation

Surfaces = Callable[[str], Surface]
"""Returns the mesh with a URI in the URDF. Raises ModelError if it is unusable."""

_MOST_BODIES = 1_000
_MOST_M = 1e6
_POINT_M = 1e-9  # above zero, which would mean that the joint does not move the body


def needed_meshes(urdf: str, offered: Set[str]) -> set[str]:
    """Return the URIs of the needed meshes, of those ``offered``. Raises ModelError."""
    parts = [part for link in parse_xml(urdf).findall("link") for part in _parts(link, offered)]
    meshes = [part.find("geometry/mesh") for part in parts]
    return {mesh.get("filename", "") for mesh in meshes if mesh is not None}


def build_robot(urdf: str, offered: Set[str] = frozenset(), surfaces: Surfaces | None = None) -> Robot:
    """Build a robot; ``surfaces`` returns the meshes that are ``offered``.

    Raises ModelError for an unusable URDF or mesh.
    """
    model, tree, geometry = build_model(urdf, False), RobotModel.parse(urdf), pin.GeometryModel()
    bodies: list[Body] = []
    for element in parse_xml(urdf).findall("link"):
        link = element.get("name", "").strip()
        frame = model.frames[model.getFrameId(link, pin.FrameType.BODY)]
        for part in _parts(element, offered):
            if len(bodies) == _MOST_BODIES:
                raise ModelError(f"the robot has more than {_MOST_BODIES} shapes")
            body = _body(link, frame.parentJoint, *_shape(part, surfaces, link))
            placed = frame.placement * _place(part, link)
            geometry.addGeometryObject(pin.GeometryObject(f"{len(bodies)}", frame.parentJoint, placed, body.shape))
            bodies.append(body)
    robot = Robot(tree, model, geometry, tuple(bodies), _reach(tree, model, geometry, bodies))
    return replace(robot, pairs=tuple(self_collision_pairs(robot)))


def _parts(link: Element, offered: Set[str]) -> list[Element]:
    parts = link.findall("collision")
    if all(_is_known(part, offered) for part in parts):
        return parts
    return [part for part in link.findall("visual") if _is_known(part, offered)]


def _is_known(part: Element, offered: Set[str]) -> bool:
    mesh = part.find("geometry/mesh")
    return mesh is None or mesh.get("filename", "") in offered


def _place(part: Element, name: str) -> pin.SE3:
    origin = pose_of(part.find("origin"), f"a shape of link {name!r}")
    return pin.SE3(np.array(rotation(origin.orientation_xyzw)), np.array(origin.position_m))


def _body(link: str, joint: int, shape: coal.CollisionGeometry, surface: Surface | None) -> Body:
    shape.computeLocalAABB()
    centre, radius = np.array(shape.aabb_center, dtype=float), float(shape.aabb_radius)
    if not (np.isfinite(centre).all() and radius < _MOST_M):
        raise ModelError(f"a shape of link {link!r} is too large")
    return Body(link, joint, shape, shape if surface is None else surface.hull, surface, centre, radius)


def _shape(part: Element, surfaces: Surfaces | None, name: str) -> tuple[coal.CollisionGeometry, Surface | None]:
    """Return the shape and, if it is not convex, its surface."""
    match forms.geometry_of(part, f"a shape of link {name!r}"):
        case forms.Box(size):
            return coal.Box(*size), None
        case forms.Sphere(radius):
            return coal.Sphere(radius), None
        case forms.Cylinder(radius, length):
            return coal.Cylinder(radius, length), None
        case forms.Capsule(radius, length):
            return coal.Capsule(radius, length), None
        case forms.MeshShape(uri, scale) if surfaces is not None:
            surface = surfaces(uri).scaled(np.array(scale))
            return (surface.hull, None) if surface.fills_hull else (surface.exact_shape(), surface)
    raise ModelError(f"link {name!r} has a mesh that is not available")


def _reach(tree: RobotModel, model: pin.Model, geometry: pin.GeometryModel, bodies: list[Body]) -> Array:
    """Return bounds by the triangle inequality along the chain from each body to the root."""
    reach = np.zeros((model.njoints, len(bodies)))
    for i, (body, placed) in enumerate(zip(bodies, geometry.geometryObjects, strict=True)):
        far, joint = float(np.linalg.norm(placed.placement.act(body.centre))) + body.radius, body.joint
        far = max(far, _POINT_M)
        reach[joint, i] = far
        while joint:
            far += float(np.linalg.norm(model.jointPlacements[joint].translation))
            far += _slide(tree.joints[model.names[joint]])
            joint = model.parents[joint]
            reach[joint, i] = far
    return reach


def _slide(joint: Joint) -> float:
    if joint.kind is not JointKind.PRISMATIC:
        return 0.0
    return max(abs(joint.limits.lower or 0.0), abs(joint.limits.upper or 0.0))


def build_object_shape(geometry: Geometry) -> coal.CollisionGeometry:
    """Return the shape of an object. A mesh is an exact surface, so that a robot can reach under a table."""
    if isinstance(geometry, Box):
        return coal.Box(*geometry.size_m)
    if isinstance(geometry, Sphere):
        return coal.Sphere(geometry.radius_m)
    if isinstance(geometry, Cylinder):
        return coal.Cylinder(geometry.radius_m, geometry.length_m)
    corners = np.array([each for each in struct.iter_unpack("<12x9f2x", memoryview(geometry.stl)[84:])])
    points = corners.reshape(-1, 3).astype(float)
    return Surface(points, np.arange(len(points), dtype=np.int32).reshape(-1, 3), False).exact_shape()
