"""URDF for agents: movable joints and their limits. Parsing needs the standard library only."""

import math
import xml.etree.ElementTree as ElementTree

from linked_fleet_agent.robot import JointFacts, Limits

_MOVABLE = ("revolute", "continuous", "prismatic")


class UrdfError(ValueError):
    """The text is not a URDF; the message says what is wrong."""


def parse(urdf: str) -> ElementTree.Element:
    """Return the ``robot`` element. Raises UrdfError."""
    try:
        root = ElementTree.fromstring(urdf)  # noqa: S314 - the robot's own file, and expat bounds entity expansion
    except ElementTree.ParseError as error:
        raise UrdfError(f"not well-formed XML: {error}") from error
    if root.tag != "robot":
        raise UrdfError(f"the root element is <{root.tag}>, not <robot>")
    return root


def joints_of(urdf: str) -> tuple[JointFacts, ...]:
    """Return all joints of one degree of freedom in document order, mimic joints included. Raises UrdfError."""
    root = parse(urdf)
    return tuple(_joint(element) for element in root.findall("joint") if element.get("type") in _MOVABLE)


def _joint(element: ElementTree.Element) -> JointFacts:
    name, mimic = element.get("name"), element.find("mimic")
    if not name:
        raise UrdfError("a <joint> has no name")
    return JointFacts(
        name=name,
        linear=element.get("type") == "prismatic",
        limits=_limits(element, name),
        mimics=None if mimic is None else mimic.get("joint"),
        continuous=element.get("type") == "continuous",
    )


def _limits(element: ElementTree.Element, name: str) -> Limits:
    limit = element.find("limit")
    if limit is None:
        return Limits()
    bounded = element.get("type") != "continuous"
    return Limits(
        lower=_number(limit, "lower", name) if bounded else None,
        upper=_number(limit, "upper", name) if bounded else None,
        # Many files write 0 for an unknown limit. A joint that may neither move nor push would be useless.
        velocity=_number(limit, "velocity", name) or None,
        effort=_number(limit, "effort", name) or None,
    )


def _number(element: ElementTree.Element, attribute: str, joint: str) -> float:
    text = element.get(attribute, "0")
    try:
        value = float(text)
    except ValueError as error:
        raise UrdfError(f"joint {joint!r}: {attribute}={text!r} is not a number") from error
    if math.isnan(value):
        raise UrdfError(f"joint {joint!r}: {attribute} is NaN")
    return value
