"""The joints of a description. A joint that cannot be commanded is refused, and the robot keeps the others."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Final
from xml.etree.ElementTree import Element

from linked_fleet_agent.urdf.document import UrdfError
from linked_fleet_agent.urdf.limits import Limits, Range, limits_of
from linked_fleet_agent.urdf.poses import Pose, pose_of
from linked_fleet_agent.urdf.values import (
    Finding,
    Findings,
    Vector,
    name_of,
    named,
    only,
    optional_number,
    unit_vector,
    vector,
)


class JointKind(StrEnum):
    """The joint types of URDF."""

    REVOLUTE = "revolute"
    CONTINUOUS = "continuous"
    PRISMATIC = "prismatic"
    FIXED = "fixed"
    FLOATING = "floating"
    PLANAR = "planar"


_MOVABLE: Final = frozenset({JointKind.REVOLUTE, JointKind.CONTINUOUS, JointKind.PRISMATIC})
_WITH_RANGE: Final = frozenset({JointKind.REVOLUTE, JointKind.PRISMATIC})
_X: Vector = (1.0, 0.0, 0.0)


@dataclass(frozen=True)
class Mimic:
    """The position of this joint is ``multiplier`` times that of ``joint``, plus ``offset``."""

    joint: str
    multiplier: float
    offset: float


@dataclass(frozen=True)
class Joint:
    """A joint; ``origin`` is its pose in the parent link, ``axis`` a unit vector in its own frame.

    ``limits`` hold for commands; ``stops`` is the range that it can reach. ``refusal`` says why it takes no commands,
    ``unranged`` why it takes none to move although it could be held; both are empty for a sound joint. A joint of an
    unknown type or axis is read as floating: the poses below it are unknown.
    """

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
    stops: Range = (None, None)
    refusal: str = ""
    unranged: str = ""

    @property
    def movable(self) -> bool:
        """True if the joint has exactly one degree of freedom."""
        return self.kind in _MOVABLE

    @property
    def commandable(self) -> bool:
        """True if it takes commands: it is movable, mimics no other joint, and is not refused."""
        return self.movable and self.mimic is None and not self.refusal


def joints_by_name(robot: Element, findings: Findings) -> dict[str, Joint]:
    """Return the joints in document order.

    Raises UrdfError for a joint without name, ends or known origin, and for two of one name.
    """
    found: dict[str, Joint] = {}
    for element in robot.findall("joint"):
        joint = _joint(element, name_of(element, f"joint number {len(found) + 1}"), findings)
        if joint.name in found:
            raise UrdfError(f"two joints are called {joint.name!r}")
        found[joint.name] = joint
    return {name: _with_leader(joint, found) for name, joint in found.items()}


def refusals(joints: dict[str, Joint]) -> Iterator[Finding]:
    """Yield the findings about joints that take no commands, or none to move."""
    for joint in joints.values():
        subject = named("joint", joint.name)
        if joint.refusal:
            yield Finding("joint", joint.name, f"{subject} takes no commands: {joint.refusal}.")
        elif joint.unranged:
            yield Finding("joint", joint.name, f"{subject} can be held but not moved: {joint.unranged}.")


def _joint(element: Element, name: str, findings: Findings) -> Joint:
    where = f"joint {name!r}"
    if element.get("name") != name:
        findings.add("joint", name, f"{named('joint', name)} has white space around its name, which is left out.")
    kind, axis, unknown = _motion(element, name, findings)
    read = limits_of(element, name, kind in _WITH_RANGE, findings) if kind in _MOVABLE else None
    mimic, no_mimic = _mimic(element, name, findings)
    dynamics = only(element, "dynamics", "joint", name, findings)
    return Joint(
        name=name,
        kind=kind,
        parent=_end(element, "parent", where),
        child=_end(element, "child", where),
        axis=axis,
        origin=pose_of(only(element, "origin", "joint", name, findings), where),
        limits=Limits() if read is None else read.limits,
        friction=_coefficient(dynamics, "friction", name, findings),
        damping=_coefficient(dynamics, "damping", name, findings),
        mimic=mimic if kind in _MOVABLE else None,
        stops=(None, None) if read is None else read.stops,
        refusal=unknown or no_mimic,
        # The range of a mimic joint is that of the joint that it follows.
        unranged="" if read is None or mimic is not None else read.unranged,
    )


def _motion(element: Element, name: str, findings: Findings) -> tuple[JointKind, Vector, str]:
    """Return type and axis, and why the motion is unknown; then the type is floating."""
    stated = element.get("type", "").strip()
    try:
        kind = JointKind(stated)
    except ValueError:
        refusal = f"it has type {stated[:40]!r}, which is none of {', '.join(JointKind)}; poses below it are unknown"
        return JointKind.FLOATING, _X, refusal
    axis = only(element, "axis", "joint", name, findings)
    # Files state the axis "0 0 0" for joints without one; it must be a direction only where it has a meaning.
    if kind not in _MOVABLE and kind is not JointKind.PLANAR:
        return kind, _X, ""
    try:
        return kind, unit_vector(vector(axis, "xyz", _X, f"joint {name!r}"), f"joint {name!r}"), ""
    except UrdfError as error:
        return JointKind.FLOATING, _X, f"{error}; poses below it are unknown"


def _end(element: Element, end: str, where: str) -> str:
    found = element.find(end)
    link = "" if found is None else found.get("link", "").strip()
    if not link:
        raise UrdfError(f"{where} lacks its {end} link")
    return link


def _coefficient(dynamics: Element | None, attribute: str, name: str, findings: Findings) -> float | None:
    try:
        value = optional_number(dynamics, attribute, f"joint {name!r}")
        if value is not None and value < 0:
            raise UrdfError(f"{value} is below zero")
    except UrdfError as error:
        findings.add("joint", name, f"{named('joint', name)} has unknown {attribute}: {error}.")
        return None
    return value


def _mimic(element: Element, name: str, findings: Findings) -> tuple[Mimic | None, str]:
    """Return the mimic, or None and why it is unusable."""
    mimic = only(element, "mimic", "joint", name, findings)
    if mimic is None:
        return None, ""
    try:
        multiplier = optional_number(mimic, "multiplier", f"the mimic of joint {name!r}")
        offset = optional_number(mimic, "offset", f"the mimic of joint {name!r}")
    except UrdfError as error:
        return None, str(error)
    leader = mimic.get("joint", "").strip()
    return Mimic(leader, 1.0 if multiplier is None else multiplier, 0.0 if offset is None else offset), ""


def _with_leader(joint: Joint, joints: dict[str, Joint]) -> Joint:
    """Return the joint; if its mimic leads to no joint that moves by itself, without it and refused."""
    names, one = {joint.name}, joint
    while one.mimic is not None:
        leader = joints.get(one.mimic.joint)
        if leader is None or not leader.movable or leader.name in names:
            fault = "itself" if leader is not None and leader.name in names else repr(one.mimic.joint[:128])
            which = "" if fault == "itself" else ", which is no joint of this robot that moves"
            of = "it" if one is joint else f"joint {one.name!r}, which it follows,"
            return replace(joint, mimic=None, refusal=joint.refusal or f"{of} mimics {fault}{which}")
        names.add(leader.name)
        one = leader
    return joint
