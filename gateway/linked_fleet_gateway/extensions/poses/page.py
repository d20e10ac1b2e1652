"""The pages of poses: those of a robot, with the form that saves another one, and one pose."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from pyoxigraph import BlankNode, NamedNode

from linked_fleet_gateway.api import DCTERMS, LDP, RDFS
from linked_fleet_gateway.extensions.pages.api import Facts, Link, PageView, Part, Value
from linked_fleet_gateway.extensions.pages.languages import message
from linked_fleet_gateway.extensions.poses.terms import LF, MODIFIED
from linked_fleet_rdf.vocabulary import UNIT, VOM

_TEMPLATES = Path(__file__).parent / "templates"
_DECIMALS = 3
"""Digits of positions: what is rounded is less than the resolution of their changes, 1e-5 rad or m."""
_SHOWN: Mapping[NamedNode, tuple[NamedNode, float, str]] = {
    UNIT.RAD: (UNIT.DEG, math.degrees(1.0), "°"),
    UNIT.M: (UNIT.MilliM, 1000.0, "mm"),
}
"""The unit in which a position is shown and written, how many of it are one of the SI unit, and its symbol."""


@dataclass(frozen=True)
class Group:
    """Joints of which a pose can be saved alone."""

    name: str
    joints: Sequence[str]


@dataclass(frozen=True)
class Row:
    """A pose in the list of its robot."""

    link: Link
    note: str
    by: str
    when: Value | None
    joints: int
    findings: Sequence[str]


@dataclass(frozen=True)
class Position:
    """The position of a joint, in the unit of the page."""

    joint: Link
    value: str
    unit: str
    symbol: str


def poses(facts: Facts, iri: NamedNode) -> Part:
    members = facts.nodes(iri, LDP.contains)
    nodes = [each for each in facts.all(iri, LF.jointGroup) if isinstance(each, BlankNode)]
    groups = [Group(facts.text(each, DCTERMS.title), [joint.value for joint in _joints(facts, each)]) for each in nodes]
    robot = facts.iri_of(iri, LF.ofRobot)
    more = {
        "poses": sorted((_row(facts, each) for each in members), key=lambda row: row.link.text.casefold()),
        "groups": groups,
        "robot": robot,
        "action": f"{robot}actions/assumePose",
    }
    return Part(more, {LDP.contains, LF.jointGroup}, {*members, *nodes})


def _joints(facts: Facts, node: BlankNode) -> list[NamedNode]:
    return facts.nodes(node, LF.ofJoint)


def _row(facts: Facts, iri: NamedNode) -> Row:
    return Row(
        facts.link(iri),
        facts.text(iri, RDFS.comment),
        facts.text(iri, LF.savedBy),
        facts.first_value(iri, MODIFIED),
        len(facts.all(iri, LF.target)),
        [getattr(each, "value", "") for each in facts.all(iri, LF.finding)],
    )


def pose(facts: Facts, iri: NamedNode) -> Part:
    robot = facts.iri_of(iri, LF.ofRobot)
    targets = [each for each in facts.all(iri, LF.target) if isinstance(each, BlankNode)]
    more = {
        "pose": _row(facts, iri),
        "positions": [position for each in targets if (position := _position(facts, each)) is not None],
        "robot": robot,
        "action": f"{robot}actions/assumePose",
    }
    return Part(more, {LF.target, LF.finding, RDFS.comment}, {*targets})


def _position(facts: Facts, target: BlankNode) -> Position | None:
    joint, unit = facts.one(target, LF.ofJoint), facts.one(target, VOM.unit)
    if not isinstance(joint, NamedNode) or not isinstance(unit, NamedNode) or unit not in _SHOWN:
        return None
    shown, scale, symbol = _SHOWN[unit]
    number = round(float(facts.text(target, VOM.numericalValue)) * scale, _DECIMALS) + 0.0
    return Position(facts.link(joint), f"{number:.{_DECIMALS}f}".rstrip("0").rstrip("."), shown.value, symbol)


VIEWS = (
    PageView(
        LF.PoseList,
        _TEMPLATES / "pose_list.html",
        poses,
        help=message(
            "Save the pose of the robot under a name. Ticked in their order, poses become the steps of a mission."
        ),
    ),
    PageView(
        LF.SavedPose,
        _TEMPLATES / "saved_pose.html",
        pose,
        help=message("One saved pose: go there, change its positions, or teach it anew from where the robot is."),
    ),
)
