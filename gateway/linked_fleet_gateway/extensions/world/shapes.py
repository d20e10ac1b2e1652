"""Collision shapes of robots and objects for coal: primitives and meshes. Metre.

Runs in the check process. A link has its collision geometry; if a part of that cannot be used, its visual geometry
replaces it. If that cannot be used either, the link is unchecked, with the reason. A link without collision geometry
has no shape, as in every URDF, whatever it looks like.
"""

import struct
from collections.abc import Callable, Iterator, Set
from dataclasses import dataclass, field, replace
from xml.etree.ElementTree import Element

import coal
import numpy as np
import pinocchio as pin

from linked_fleet_agent.urdf import geometry as forms
from linked_fleet_agent.urdf.poses import pose_of
from linked_fleet_gateway.extensions.world.reach import links_m
from linked_fleet_gateway.extensions.world.robot import Body, Robot, build_reach, self_collision_pairs
from linked_fleet_gateway.extensions.world.scene import Box, Cylinder, Geometry, Sphere
from linked_fleet_gateway.extensions.world.surfaces import Surface
from linked_fleet_state.kinematics import loose_joint
from linked_fleet_state.model import RobotModel
from linked_fleet_state.pinocchio_model import build_model
from linked_fleet_state.unchecked import UncheckedLink
from linked_fleet_state.xml import ModelError, parse_xml, rotation

Surfaces = Callable[[str], Surface]
"""Returns the mesh with a URI in the URDF. Raises ModelError if it is unusable."""

_Solid = tuple[coal.CollisionGeometry, Surface | None]
"""A shape and, if it is not convex, its surface."""
_Placed = tuple[pin.Frame, pin.SE3, _Solid]

_MOST_BODIES = 1_000
_LONGEST_URI, _LONGEST_REASON = 200, 300
_MOST_M = 100.0  # size and distance of a shape; the path of a larger one is too long to be checked


def needed_meshes(urdf: str, usable: Set[str]) -> set[str]:
    """Return the URIs of the needed meshes, of those ``usable``. Raises ModelError."""
    parts = [part for link in parse_xml(urdf).findall("link") for part in _candidates(link, usable)]
    return {uri for part in parts if (uri := _mesh_uri(part)) in usable}


def build_robot(urdf: str, offered: Set[str] = frozenset(), surfaces: Surfaces | None = None) -> Robot:
    """Build a robot; ``surfaces`` returns the meshes that are ``offered``. Links that cannot be used are unchecked.

    Raises ModelError for a URDF that describes no robot.
    """
    try:
        return _Builder(urdf, offered, surfaces).build()
    except Exception as error:  # noqa: BLE001 - of a library, in data of a robot; it concerns this robot alone
        return build_unchecked_robot(urdf, str(error) or f"its shapes cannot be used ({type(error).__name__})")


def build_unchecked_robot(urdf: str, reason: str) -> Robot:
    """Build a robot without shapes, all of whose links are unchecked. Raises ModelError for an unusable URDF."""
    tree, model, geometry = RobotModel.parse(urdf), pin.Model(), pin.GeometryModel()
    links = [_name(each) for each in parse_xml(urdf).findall("link") if each.find("collision") is not None]
    unchecked = tuple(UncheckedLink(link, "", reason[:_LONGEST_REASON]) for link in links)
    reach = np.zeros((model.njoints, 0))
    return Robot(tree, model, geometry, (), reach, (), unchecked, links_m(tree, links))


@dataclass
class _Builder:
    """A robot being built from its URDF."""

    urdf: str
    offered: Set[str]
    surfaces: Surfaces | None
    bodies: list[Body] = field(default_factory=list)
    unchecked: list[UncheckedLink] = field(default_factory=list)

    def build(self) -> Robot:
        self.model, self.tree = build_model(self.urdf, False), RobotModel.parse(self.urdf)
        self.geometry = pin.GeometryModel()
        for element in parse_xml(self.urdf).findall("link"):
            self._add_link(element)
        self._add_loose_links()
        reach = build_reach(self.tree, self.model, self.geometry, self.bodies)
        far_m = links_m(self.tree, (each.link for each in self.unchecked))
        robot = Robot(self.tree, self.model, self.geometry, tuple(self.bodies), reach, (), tuple(self.unchecked), far_m)
        return replace(robot, pairs=tuple(self_collision_pairs(robot)))

    def _add_link(self, element: Element) -> None:
        """Add the bodies of a link; what replaces a part that cannot be used covers the whole link."""
        found, failed = self._solids(element, element.findall("collision"))
        if failed is not None and (visuals := element.findall("visual")):
            replaced, failed_too = self._solids(element, visuals)
            if failed_too is None:
                found, failed = replaced, None
        for frame, placed, solid in found:
            body = _body(_name(element), frame.parentJoint, *solid)
            name = f"{len(self.bodies)}"
            self.geometry.addGeometryObject(pin.GeometryObject(name, frame.parentJoint, placed, body.shape))
            self.bodies.append(body)
        if failed is not None:
            self.unchecked.append(failed)

    def _solids(self, element: Element, parts: list[Element]) -> tuple[list[_Placed], UncheckedLink | None]:
        """Return the shapes of the usable parts, and the first part that cannot be used."""
        found: list[_Placed] = []
        link, failed = _name(element), None
        for part in parts:
            try:
                if len(self.bodies) + len(found) >= _MOST_BODIES:
                    raise ModelError(f"the robot has more than {_MOST_BODIES} shapes")
                frame = self._frame(element)
                solid = self._solid(part, link)
                _body(link, frame.parentJoint, *solid)
                found.append((frame, frame.placement * _place(part, link), solid))
            except (ModelError, MemoryError, RuntimeError, ValueError) as error:
                reason = str(error) or "it takes too much memory"
                failed = failed or UncheckedLink(link, _mesh_uri(part)[:_LONGEST_URI], reason[:_LONGEST_REASON])
        return found, failed

    def _add_loose_links(self) -> None:
        """Add the links behind floating and planar joints: they are checked among each other only."""
        known = {each.link for each in self.unchecked}
        for link in dict.fromkeys(each.link for each in self.bodies):
            joint = loose_joint(self.tree, link)
            if joint is not None and link not in known:
                where = f"it is carried by the {joint.kind} joint {joint.name}, whose position is unknown"
                self.unchecked.append(UncheckedLink(link, "", where))

    def _frame(self, element: Element) -> pin.Frame:
        """Return the frame of a link, whose name Pinocchio keeps as it is in the file."""
        for name in (element.get("name", ""), _name(element)):
            if self.model.existFrame(name, pin.FrameType.BODY):
                return self.model.frames[self.model.getFrameId(name, pin.FrameType.BODY)]
        raise ModelError("Pinocchio does not know this link")

    def _solid(self, part: Element, link: str) -> _Solid:
        is_mesh, uri = part.find("geometry/mesh") is not None, _mesh_uri(part)
        if is_mesh and (self.surfaces is None or uri not in self.offered):
            raise ModelError("the agent does not offer it")
        return _shape(part, self.surfaces, link)


def _name(link: Element) -> str:
    return link.get("name", "").strip()


def _candidates(link: Element, usable: Set[str]) -> Iterator[Element]:
    """Yield the parts of a link of which shapes may be built."""
    parts = link.findall("collision")
    yield from parts
    if any((uri := _mesh_uri(part)) and uri not in usable for part in parts):
        yield from link.findall("visual")


def _mesh_uri(part: Element) -> str:
    mesh = part.find("geometry/mesh")
    return "" if mesh is None else mesh.get("filename", "")


def _place(part: Element, name: str) -> pin.SE3:
    origin = pose_of(part.find("origin"), f"a shape of link {name!r}")
    return pin.SE3(np.array(rotation(origin.orientation_xyzw)), np.array(origin.position_m))


def _body(link: str, joint: int, shape: coal.CollisionGeometry, surface: Surface | None) -> Body:
    shape.computeLocalAABB()
    centre, radius = np.array(shape.aabb_center, dtype=float), float(shape.aabb_radius)
    if not (np.abs(centre) < _MOST_M).all() or not radius < _MOST_M:  # also refuses NaN
        raise ModelError(f"its shape is larger or further away than {_MOST_M:g} m")
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
