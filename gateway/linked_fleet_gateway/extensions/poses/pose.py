"""The record of a saved pose: what a body says, or the present positions of joints. Pure."""

import math
from collections.abc import Iterable, Mapping, Sequence
from urllib.parse import urlsplit

from msgspec import Struct

from linked_fleet_gateway.api import (
    DCTERMS,
    RDFS,
    Body,
    Conflict,
    Joint,
    NamedNode,
    Robot,
    UnprocessableContent,
    joint_path,
    thing_at,
)
from linked_fleet_gateway.extensions.poses.terms import LF
from linked_fleet_gateway.faces import commandable_joints, kind_of, pose_finding
from linked_fleet_rdf.graph import Node
from linked_fleet_rdf.vocabulary import VOM

_SETTLED = 2e-4
"""Radian or metre: a joint at its limit may be measured this far beyond it, as for actions."""
_DIGITS = 9


class SavedPose(Struct, frozen=True, omit_defaults=True):
    """A pose of a robot: positions in rad or m by joint. ``saved_ns`` is the wall time of its last change.

    ``base`` is that of the addresses of joints in the body, until it is compared with the base of the gateway.
    """

    robot: str
    title: str
    positions: dict[str, float]
    note: str = ""
    by: str = ""
    saved_ns: int = 0
    base: str | None = None


def read_pose(robot: Robot, body: Body) -> SavedPose:
    """Return what a body says. Raises UnprocessableContent; Conflict if present positions cannot be had."""
    title = (body.text(body.root, DCTERMS.title) or "").strip()
    if not title or not title.isprintable():
        raise UnprocessableContent("The title of a pose is one line of visible characters, such as above the table.")
    note = (body.text(body.root, RDFS.comment) or "").strip()
    named, targets = body.nodes(body.root, LF.ofJoint), body.nodes(body.root, LF.target)
    if named and targets:
        raise UnprocessableContent(
            "A pose has targets, or joints whose present positions are saved: leave out one of them."
        )
    if robot.model is None:
        raise Conflict(f"{robot.name} has not described its joints so far.")
    addressed = named or [_joint_of(body, each) for each in targets]
    joints = [_joint_at(robot, each) for each in addressed]
    base = _base_of(robot, joints, addressed)
    if targets:
        positions = _given(robot, body, joints, targets)
    else:
        positions = _present(robot, joints or commandable_joints(robot))
    return SavedPose(robot.name, title, positions, note, base=base)


def _joint_of(body: Body, target: Node) -> Node:
    node = body.node(target, LF.ofJoint)
    assert node is not None  # the shape requires it
    return node


def _joint_at(robot: Robot, node: Node) -> Joint:
    iri = node.value if isinstance(node, NamedNode) else ""
    try:
        found = thing_at(urlsplit(iri).path, {robot.name: robot})
    except ValueError:
        found = None
    joint = None if found is None else found[1]
    if not isinstance(joint, Joint):
        known = ", ".join(each.name for each in commandable_joints(robot)[:8])
        raise UnprocessableContent(f"{robot.name} has no joint at {iri[:200]!r}; it has {known} …")
    if joint not in commandable_joints(robot):
        raise UnprocessableContent(f"The joint {joint.name} takes no commands, so no pose can have it.")
    return joint


def _base_of(robot: Robot, joints: Sequence[Joint], nodes: Iterable[Node]) -> str | None:
    """Return the base URL that the addresses of joints share; None without any. Raises UnprocessableContent."""
    pairs = zip(joints, nodes, strict=True)
    bases = {node.value.removesuffix(joint_path(robot.name, joint.name)) for joint, node in pairs}
    if len(bases) > 1:
        raise UnprocessableContent("All joints of a pose are of one robot at one gateway.")
    return next(iter(bases), None)


def _given(robot: Robot, body: Body, joints: Sequence[Joint], targets: Sequence[Node]) -> dict[str, float]:
    found = dict[str, float]()
    for joint, target in zip(joints, targets, strict=True):
        if joint.name in found:
            raise UnprocessableContent(f"Two targets name {joint.name}; a joint has one position in a pose.")
        dimension, unit = kind_of(joint).dimension, body.node(target, VOM.unit)
        accepted = [] if dimension is None else [iri for each in dimension.accepted for iri in each.accepted]
        if unit not in accepted:
            right = " or ".join(each.qudt.value.rpartition("/")[2] for each in dimension.accepted) if dimension else ""
            raise UnprocessableContent(f"The position of {joint.name} has the unit {right}.")
        found[joint.name] = round(body.quantity(target), _DIGITS)
    if finding := pose_finding(robot, found):
        raise UnprocessableContent(finding)
    return found


def _present(robot: Robot, joints: Sequence[Joint]) -> dict[str, float]:
    if not joints:
        raise Conflict(f"{robot.name} has no joint that takes commands.")
    if not robot.online:
        raise Conflict(f"{robot.name} is offline, so its present positions are unknown; give targets instead.")
    found = {each.name: _settled(each, robot.positions.get(each.name, math.nan)) for each in joints}
    if finding := pose_finding(robot, found):
        raise Conflict(f"No action could bring it back to where it is now. {finding}")
    return found


def _settled(joint: Joint, position: float) -> float:
    """Return a measured position, or the limit that it exceeds by no more than a joint that has settled there."""
    if not math.isfinite(position):
        raise Conflict(f"The position of {joint.name} is unknown at present; name other joints, or give targets.")
    low, high = joint.limits.lower, joint.limits.upper
    if low is not None and low - _SETTLED <= position < low:
        return low
    if high is not None and high < position <= high + _SETTLED:
        return high
    return round(position, _DIGITS)


def groups_of(robot: Robot) -> Mapping[str, Sequence[str]]:
    """Return the joints that follow each other without a branch, such as those of an arm, by a name for them.

    Joints that slide and joints that turn are of different groups, as a hand and its arm. There are none if all joints
    are of one group.
    """
    model = robot.model
    if model is None:
        return {}
    able = {each.name: each for each in commandable_joints(robot)}
    above = {name: _above(robot, joint, able) for name, joint in able.items()}
    below = dict[str | None, list[str]]()
    for name in able:
        below.setdefault(above[name], []).append(name)
    chains = dict[str, list[str]]()
    for name in able:
        first = name
        while (upper := above[first]) is not None and len(below[upper]) == 1 and _alike(able[first], able[upper]):
            first = upper
        chains.setdefault(first, []).append(name)
    if len(chains) < 2:
        return {}
    return {_name_of(chain): chain for chain in chains.values()}


def _alike(joint: Joint, other: Joint) -> bool:
    return kind_of(joint).dimension is kind_of(other).dimension


def _above(robot: Robot, joint: Joint, able: Mapping[str, Joint]) -> str | None:
    """Return the next joint towards the root that takes commands."""
    assert robot.model is not None
    parent = robot.model.links[joint.parent].parent_joint
    while parent is not None and parent not in able:
        parent = robot.model.links[robot.model.joints[parent].parent].parent_joint
    return parent


def _name_of(chain: Sequence[str]) -> str:
    return chain[0] if len(chain) == 1 else f"{chain[0]} to {chain[-1]}"
