"""The model of one robot: the only form in which agent, gateway, simulation, check and pages know a description.

Lengths in metre, angles in radian, masses in kilogram. Source of the rules: https://wiki.ros.org/urdf/XML (joint, link,
inertial); for its versions, the notes of urdfdom, the reader of ROS. The text is untrusted: sizes are bounded and
nothing recurses over its depth.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Final, Self
from weakref import WeakValueDictionary
from xml.etree.ElementTree import Element

from linked_fleet_agent.urdf.document import UrdfError, parse
from linked_fleet_agent.urdf.geometry import Colour, Shape, colours_of, shapes_of
from linked_fleet_agent.urdf.inertials import Inertial, inertial_of
from linked_fleet_agent.urdf.joints import Joint, Mimic, joints_by_name, refusals
from linked_fleet_agent.urdf.values import About, Finding, Findings, name_of

MAX_LINKS: Final = 2048
VERSIONS: Final = ("1.0", "1.1", "1.2")


@dataclass(frozen=True)
class Link:
    """A rigid body; ``parent_joint`` is None for the root only."""

    name: str
    inertial: Inertial | None
    parent_joint: str | None
    child_joints: tuple[str, ...]
    collisions: tuple[Shape, ...] = ()
    visuals: tuple[Shape, ...] = ()


@dataclass(frozen=True, eq=False)
class RobotModel:
    """A tree: one root, every other link below exactly one joint. Both mappings keep file order.

    ``findings`` are sentences about what was left out, repaired or refused; refused joints come first.
    """

    name: str
    root: str
    joints: dict[str, Joint]
    links: dict[str, Link]
    findings: tuple[Finding, ...] = field(default=())

    @cached_property
    def unknown_positions(self) -> Mapping[str, float]:
        """NaN for each joint with one degree of freedom, by name."""
        return {joint.name: math.nan for joint in self.joints.values() if joint.movable}

    @cached_property
    def mimics(self) -> tuple[tuple[str, Mimic], ...]:
        """The joints that mimic another one, each after the joint that it mimics."""
        found: dict[str, Mimic] = {}
        waiting = {joint.name: joint.mimic for joint in self.joints.values() if joint.mimic is not None}
        while ready := {name: mimic for name, mimic in waiting.items() if mimic.joint not in waiting}:
            found |= ready
            waiting = {name: mimic for name, mimic in waiting.items() if name not in ready}
        return tuple(found.items())

    def findings_about(self, about: About, name: str) -> list[str]:
        """Return the sentences about one joint or link."""
        return [each.sentence for each in self.findings if (each.about, each.name) == (about, name)]

    @classmethod
    def for_urdf(cls, urdf: str) -> "RobotModel":
        """Return the parsed model; robots with the same URDF share one while any of them uses it."""
        model = _shared.get(urdf)
        if model is None:
            model = _shared[urdf] = cls.parse(urdf)
        return model

    @classmethod
    def parse(cls, urdf: str) -> Self:
        """Parse a URDF. Raises UrdfError, whose text says what is wrong and where."""
        robot, findings = parse(urdf), Findings()
        _check_version(robot, findings)
        elements = _link_elements(robot)
        joints = joints_by_name(robot, findings)
        _check_ends(joints, elements)
        above = _parents(joints)
        root = _root(joints, elements, above)
        below: dict[str, list[str]] = {link: [] for link in elements}
        for joint in joints.values():
            below[joint.parent].append(joint.name)
        colours = colours_of(robot)
        links = {
            name: _link(element, name, above.get(name), tuple(below[name]), colours, findings)
            for name, element in elements.items()
        }
        found = (*refusals(joints), *findings.found)
        return cls(name_of(robot, "the robot"), root, joints, links, found)


# A fleet has many robots but few models, which take most of a robot's memory and of its time to join.
_shared: WeakValueDictionary[str, RobotModel] = WeakValueDictionary()


def _check_version(robot: Element, findings: Findings) -> None:
    """Raise UrdfError for a version that this reader does not know."""
    stated = robot.get("version", "1.0").strip()
    version = stated if "." in stated else f"{stated}.0"
    if version not in VERSIONS:
        raise UrdfError(f"the robot states URDF version {stated[:40]!r}; the versions {', '.join(VERSIONS)} are known")
    if version == "1.0" and any("quat_xyzw" in origin.attrib for origin in robot.iter("origin")):
        name = robot.get("name", "").strip()
        sentence = "The description states version 1.0 but uses quat_xyzw of version 1.1, which is read as such."
        findings.add("robot", name, sentence)


def _link_elements(robot: Element) -> dict[str, Element]:
    found: dict[str, Element] = {}
    for element in robot.findall("link"):
        name = name_of(element, f"link number {len(found) + 1}")
        if name in found:
            raise UrdfError(f"two links are called {name!r}")
        if len(found) == MAX_LINKS:
            raise UrdfError(f"the robot has more than {MAX_LINKS} links")
        found[name] = element
    if not found:
        raise UrdfError("the robot has no link")
    return found


def _link(
    element: Element,
    name: str,
    parent: str | None,
    children: tuple[str, ...],
    colours: Mapping[str, Colour],
    findings: Findings,
) -> Link:
    collisions = shapes_of(element, "collision", name, colours, findings)
    visuals = shapes_of(element, "visual", name, colours, findings)
    return Link(name, inertial_of(element, name, findings), parent, children, collisions, visuals)


def _check_ends(joints: Mapping[str, Joint], links: Mapping[str, Element]) -> None:
    for joint in joints.values():
        for end, link in (("parent", joint.parent), ("child", joint.child)):
            if link not in links:
                raise UrdfError(f"joint {joint.name!r} has {end} {link[:128]!r}, but no link is called so")


def _parents(joints: Mapping[str, Joint]) -> dict[str, str]:
    """Return the joint above each link that has one."""
    above: dict[str, str] = {}
    for joint in joints.values():
        if joint.child in above:
            raise UrdfError(f"link {joint.child!r} is the child of both {above[joint.child]!r} and {joint.name!r}")
        above[joint.child] = joint.name
    return above


def _root(joints: Mapping[str, Joint], links: Mapping[str, Element], above: Mapping[str, str]) -> str:
    roots = [link for link in links if link not in above]
    if len(roots) > 1:
        raise UrdfError(f"the links form no single tree: {', '.join(map(repr, roots[:5]))} have no parent joint")
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
            raise UrdfError(f"link {link!r} is its own ancestor: the joints form a cycle")
    return roots[0]
