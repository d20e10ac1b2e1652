"""The shapes of links: boxes, spheres, cylinders, capsules (URDF 1.1) and meshes. Metre."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Literal
from xml.etree.ElementTree import Element

from linked_fleet_agent.urdf.document import UrdfError
from linked_fleet_agent.urdf.poses import ORIGIN, Pose, contradicts_itself, pose_of
from linked_fleet_agent.urdf.values import Findings, Vector, named, numbers, required_number, vector

_LEAST_M = 1e-9
"""Lengths below count as zero, as in the readers that get the shapes."""


@dataclass(frozen=True)
class Box:
    size_m: Vector


@dataclass(frozen=True)
class Sphere:
    radius_m: float


@dataclass(frozen=True)
class Cylinder:
    """A cylinder about the z axis."""

    radius_m: float
    length_m: float


@dataclass(frozen=True)
class Capsule:
    """A cylinder about the z axis, of this length, with half a sphere at each end."""

    radius_m: float
    length_m: float


@dataclass(frozen=True)
class MeshShape:
    """A mesh by its URI in the file; a negative factor of ``scale`` mirrors it."""

    uri: str
    scale: Vector


Geometry = Box | Sphere | Cylinder | Capsule | MeshShape
Colour = tuple[float, float, float, float]
"""Red, green, blue, opacity, each from 0 to 1."""
Use = Literal["collision", "visual"]


@dataclass(frozen=True)
class Shape:
    """A shape in the frame of its link. Without geometry, ``problem`` says why it is unusable."""

    origin: Pose
    geometry: Geometry | None
    problem: str = ""
    colour: Colour | None = None


def geometry_of(part: Element, where: str) -> Geometry:
    """Return the geometry of a ``<collision>`` or ``<visual>``.

    Raises UrdfError if it is unknown or its size is not above zero.
    """
    geometry = part.find("geometry")
    form = None if geometry is None else next(iter(geometry), None)
    if form is None:
        raise UrdfError(f"{where} has no geometry")
    read = _READERS.get(form.tag)
    if read is None:
        raise UrdfError(f"{where} is a <{form.tag[:40]}>, which is none of {', '.join(_READERS)}")
    return read(form, where)


def _box(form: Element, where: str) -> Box:
    if form.get("size") is None:
        raise UrdfError(f"{where} is a box that lacks size")
    size = vector(form, "size", (0.0, 0.0, 0.0), where)
    if not min(size) >= _LEAST_M:
        raise UrdfError(f"{where} is a box of size {form.get('size', '')[:60]!r}; each length must be above zero")
    return Box(size)


def _length(form: Element, attribute: str, where: str) -> float:
    value = required_number(form, attribute, where)
    if not value >= _LEAST_M:
        raise UrdfError(f"{where} is a {form.tag} with {attribute} {value}, which must be above zero")
    return value


def _sphere(form: Element, where: str) -> Sphere:
    return Sphere(_length(form, "radius", where))


def _cylinder(form: Element, where: str) -> Cylinder:
    return Cylinder(_length(form, "radius", where), _length(form, "length", where))


def _capsule(form: Element, where: str) -> Capsule:
    return Capsule(_length(form, "radius", where), _length(form, "length", where))


def _mesh(form: Element, where: str) -> MeshShape:
    uri, scale = form.get("filename", ""), vector(form, "scale", (1.0, 1.0, 1.0), where)
    if not uri.strip():
        raise UrdfError(f"{where} is a mesh that lacks filename")
    if min(map(abs, scale)) < _LEAST_M:
        raise UrdfError(f"{where} is a mesh of scale {form.get('scale', '')[:60]!r}; no factor may be zero")
    return MeshShape(uri, scale)


_READERS: Mapping[str, Callable[[Element, str], Geometry]] = {
    "box": _box,
    "sphere": _sphere,
    "cylinder": _cylinder,
    "capsule": _capsule,
    "mesh": _mesh,
}


def shapes_of(
    link: Element, use: Use, name: str, colours: Mapping[str, Colour], findings: Findings
) -> tuple[Shape, ...]:
    """Return the shapes of a link, the unusable ones with their problem.

    Raises UrdfError for an origin that contradicts itself.
    """
    found = []
    for count, part in enumerate(link.findall(use), 1):
        shape = _shape(part, f"{use} shape {count} of link {name!r}", colours)
        if shape.problem:
            findings.add("link", name, f"{named('link', name)} has a {use} shape that is left out: {shape.problem}.")
        found.append(shape)
    return tuple(found)


def _shape(part: Element, where: str, colours: Mapping[str, Colour]) -> Shape:
    origin = part.find("origin")
    if contradicts_itself(origin):
        pose_of(origin, where)
    try:
        return Shape(pose_of(origin, where), geometry_of(part, where), colour=_colour(part.find("material"), colours))
    except UrdfError as error:
        return Shape(ORIGIN, None, str(error))


def colours_of(robot: Element) -> dict[str, Colour]:
    """Return the colours of the materials that the robot declares for all its links, by name."""
    found = {each.get("name", ""): _colour(each, {}) for each in robot.findall("material")}
    return {name: colour for name, colour in found.items() if colour is not None}


def _colour(material: Element | None, declared: Mapping[str, Colour]) -> Colour | None:
    """Return the colour of a material, its own or the declared one; None for one that cannot be read."""
    if material is None:
        return None
    stated = material.find("color")
    if stated is None:
        return declared.get(material.get("name", ""))
    try:
        red, green, blue, opacity = (
            min(max(part, 0.0), 1.0) for part in numbers(stated.get("rgba", ""), 4, "a colour")
        )
    except UrdfError:
        return None
    return red, green, blue, opacity
