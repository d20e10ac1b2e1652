"""The tree of joints and links in a URDF. Lengths in metre, angles in radian, masses in kilogram.

Source of the rules: https://wiki.ros.org/urdf/XML (joint, link, inertial). The text comes from an agent and is
untrusted: sizes are bounded and nothing recurses over its depth.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from functools import cached_property
from typing import Self
from weakref import WeakValueDictionary
from xml.etree.ElementTree import Element

from linked_fleet_gateway.fleet.xml import (
    ModelError,
    Quaternion,
    Vector,
    name_of,
    optional_number,
    parse_xml,
    quaternion,
    required_number,
    rotation,
    unit_vector,
    vector,
)

__all__ = ["Inertial", "Joint", "JointKind", "Limits", "Link", "Mimic", "ModelError", "Pose", "RobotModel"]

MAX_LINKS = 2048
_ZERO: Vector = (0.0, 0.0, 0.0)
_INERTIA = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")


class JointKind(StrEnum):
    """The joint types of URDF."""

    REVOLUTE = "revolute"
    CONTINUOUS = "continuous"
    PRISMATIC = "prismatic"
    FIXED = "fixed"
    FLOATING = "floating"
    PLANAR = "planar"


_MOVABLE = frozenset({JointKind.REVOLUTE, JointKind.CONTINUOUS, JointKind.PRISMATIC})


@dataclass(frozen=True)
class Pose:
    """A rigid placement; the quaternion x y z w has unit length."""

    position_m: Vector
    orientation_xyzw: Quaternion


@dataclass(frozen=True)
class Limits:
    """Limits in rad or m, rad/s or m/s, Nm or N; None if the URDF has none, and for positions of a continuous joint."""

    lower: float | None
    upper: float | None
    velocity: float | None
    effort: float | None


@dataclass(frozen=True)
class Mimic:
    """The position of this joint is ``multiplier`` times that of ``joint``, plus ``offset``."""

    joint: str
    multiplier: float
    offset: float


@dataclass(frozen=True)
class Joint:
    """A joint; ``origin`` is its pose in the parent link, ``axis`` a unit vector in its own frame."""

    name: str
    kind: JointKind
    parent: str
    child: str
    axis: Vector
    origin: Pose
    limits: Limits
    friction: float | None
    damping: float | None
    mimic: Mimic | None

    @property
    def movable(self) -> bool:
        """True if the joint has exactly one degree of freedom."""
        return self.kind in _MOVABLE

    @property
    def commandable(self) -> bool:
        """True if it takes commands, i.e. is movable and mimics no other joint."""
        return self.movable and self.mimic is None


@dataclass(frozen=True)
class Inertial:
    """Inertia ixx ixy ixz iyy iyz izz about the centre of mass, in link axes, as stated in the file.

    Real files (TIAGo) contain matrices that are not positive definite.
    """

    mass_kg: float
    centre_m: Vector
    inertia_kg_m2: tuple[float, float, float, float, float, float]


@dataclass(frozen=True)
class Link:
    """A rigid body; ``parent_joint`` is None for the root only."""

    name: str
    inertial: Inertial | None
    parent_joint: str | None
    child_joints: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class RobotModel:
    """A tree: one root, every other link below exactly one joint. Both mappings keep file order."""

    name: str
    root: str
    joints: dict[str, Joint]
    links: dict[str, Link]

    @cached_property
    def unknown_positions(self) -> Mapping[str, float]:
        """NaN for each joint with one degree of freedom, by name."""
        return {joint.name: math.nan for joint in self.joints.values() if joint.movable}

    @classmethod
    def for_urdf(cls, urdf: str) -> "RobotModel":
        """Return the parsed model; robots with the same URDF share one while any of them uses it."""
        model = _shared.get(urdf)
        if model is None:
            model = _shared[urdf] = cls.parse(urdf)
        return model

    @classmethod
    def parse(cls, urdf: str) -> Self:
        """Parse a URDF. Raises ModelError, whose text says what is wrong and where."""
        robot = parse_xml(urdf)
        if robot.tag != "robot":
            raise ModelError(f"the root element is <{robot.tag[:40]}>, not <robot>")
        inertials = _inertials(robot)
        joints = _joints(robot)
        _check_references(joints, inertials)
        above = _parents(joints)
        root = _root(joints, inertials, above)
        below: dict[str, list[str]] = {link: [] for link in inertials}
        for joint in joints.values():
            below[joint.parent].append(joint.name)
        links = {name: Link(name, inertials[name], above.get(name), tuple(below[name])) for name in inertials}
        return cls(name_of(robot, "the robot"), root, joints, links)


# A fleet has many robots but few models, which take most of a robot's memory and of its time to join.
_shared: WeakValueDictionary[str, RobotModel] = WeakValueDictionary()


def _inertials(robot: Element) -> dict[str, Inertial | None]:
    """Return the inertial (or None) of every link, by name."""
    found: dict[str, Inertial | None] = {}
    for element in robot.findall("link"):
        name = name_of(element, f"link number {len(found) + 1}")
        if name in found:
            raise ModelError(f"two links are called {name!r}")
        if len(found) == MAX_LINKS:
            raise ModelError(f"the robot has more than {MAX_LINKS} links")
        found[name] = _inertial(element.find("inertial"), f"link {name!r}")
    if not found:
        raise ModelError("the robot has no link")
    return found


def _inertial(element: Element | None, where: str) -> Inertial | None:
    if element is None:
        return None
    mass = required_number(element.find("mass"), "value", f"the mass of {where}")
    if mass < 0:
        raise ModelError(f"the mass of {where} is {mass} kg, below zero")
    origin = _pose(element.find("origin"), where)
    tensor = element.find("inertia")
    given = [required_number(tensor, part, f"the inertia of {where}") for part in _INERTIA]
    return Inertial(mass, origin.position_m, _rotated(given, origin.orientation_xyzw))


def _rotated(inertia: list[float], orientation: Quaternion) -> tuple[float, float, float, float, float, float]:
    """Return R I Rᵀ: the tensor in the axes in which ``orientation`` is expressed."""
    xx, xy, xz, yy, yz, zz = inertia
    if orientation == (0.0, 0.0, 0.0, 1.0):
        return xx, xy, xz, yy, yz, zz  # the usual case stays exact
    tensor = ((xx, xy, xz), (xy, yy, yz), (xz, yz, zz))
    rows = rotation(orientation)

    def entry(i: int, j: int) -> float:
        return sum(rows[i][k] * tensor[k][m] * rows[j][m] for k in range(3) for m in range(3))

    return entry(0, 0), entry(0, 1), entry(0, 2), entry(1, 1), entry(1, 2), entry(2, 2)


def _pose(origin: Element | None, where: str) -> Pose:
    return Pose(vector(origin, "xyz", _ZERO, where), quaternion(vector(origin, "rpy", _ZERO, where)))


def _joints(robot: Element) -> dict[str, Joint]:
    found: dict[str, Joint] = {}
    for element in robot.findall("joint"):
        joint = _joint(element, name_of(element, f"joint number {len(found) + 1}"))
        if joint.name in found:
            raise ModelError(f"two joints are called {joint.name!r}")
        found[joint.name] = joint
    return found


def _joint(element: Element, name: str) -> Joint:
    where = f"joint {name!r}"
    kind = _kind(element, where)
    dynamics = element.find("dynamics")
    # Files state the axis "0 0 0" for joints without one; it must be a direction only where it has a meaning.
    has_axis = kind in _MOVABLE or kind is JointKind.PLANAR
    axis = vector(element.find("axis"), "xyz", (1.0, 0.0, 0.0), where) if has_axis else (1.0, 0.0, 0.0)
    return Joint(
        name=name,
        kind=kind,
        parent=_end(element, "parent", where),
        child=_end(element, "child", where),
        axis=unit_vector(axis, where),
        origin=_pose(element.find("origin"), where),
        limits=_limits(element.find("limit"), kind, where),
        friction=optional_number(dynamics, "friction", where),
        damping=optional_number(dynamics, "damping", where),
        mimic=_mimic(element.find("mimic"), where),
    )


def _kind(element: Element, where: str) -> JointKind:
    try:
        return JointKind(element.get("type", ""))
    except ValueError:
        kinds = ", ".join(JointKind)
        raise ModelError(f"{where} has type {element.get('type', '')[:40]!r}, which is none of {kinds}") from None


def _end(element: Element, end: str, where: str) -> str:
    found = element.find(end)
    link = "" if found is None else found.get("link", "").strip()
    if not link:
        raise ModelError(f"{where} lacks its {end} link")
    return link


def _limits(element: Element | None, kind: JointKind, where: str) -> Limits:
    if element is None:
        return Limits(None, None, None, None)
    velocity, effort = (optional_number(element, name, where) for name in ("velocity", "effort"))
    if kind not in (JointKind.REVOLUTE, JointKind.PRISMATIC):
        return Limits(None, None, velocity, effort)
    # An omitted bound is zero by the specification.
    lower, upper = (optional_number(element, name, where) or 0.0 for name in ("lower", "upper"))
    if lower > upper:
        raise ModelError(f"{where} has a lower limit of {lower} above its upper limit of {upper}")
    return Limits(lower, upper, velocity, effort)


def _mimic(element: Element | None, where: str) -> Mimic | None:
    if element is None:
        return None
    multiplier = optional_number(element, "multiplier", where)
    joint = element.get("joint", "").strip()
    offset = optional_number(element, "offset", where)
    return Mimic(joint, 1.0 if multiplier is None else multiplier, 0.0 if offset is None else offset)


def _check_references(joints: dict[str, Joint], links: dict[str, Inertial | None]) -> None:
    for joint in joints.values():
        for end, link in (("parent", joint.parent), ("child", joint.child)):
            if link not in links:
                raise ModelError(f"joint {joint.name!r} has {end} {link[:128]!r}, but no link is called so")
        mimic = joint.mimic
        if mimic is not None and (mimic.joint not in joints or mimic.joint == joint.name):
            raise ModelError(f"joint {joint.name!r} mimics {mimic.joint[:128]!r}, which is no other joint")


def _parents(joints: dict[str, Joint]) -> dict[str, str]:
    """Return the joint above each link that has one."""
    above: dict[str, str] = {}
    for joint in joints.values():
        if joint.child in above:
            raise ModelError(f"link {joint.child!r} is the child of both {above[joint.child]!r} and {joint.name!r}")
        above[joint.child] = joint.name
    return above


def _root(joints: dict[str, Joint], links: dict[str, Inertial | None], above: dict[str, str]) -> str:
    roots = [link for link in links if link not in above]
    if len(roots) > 1:
        raise ModelError(f"the links form no single tree: {', '.join(map(repr, roots[:5]))} have no parent joint")
    below: dict[str, list[str]] = {}
    for joint in joints.values():
        below.setdefault(joint.parent, []).append(joint.child)
    reached, ahead = set(roots), list(roots)
    while ahead:
        children = below.get(ahead.pop(), [])
        reached.update(children)
        ahead.extend(children)
    for link in links:
        if link not in reached:
            raise ModelError(f"link {link!r} is its own ancestor: the joints form a cycle")
    return roots[0]
