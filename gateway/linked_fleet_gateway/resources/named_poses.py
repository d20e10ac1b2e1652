"""Named poses in a robot's annotations (``lf:namedPose``): positions by joint, by title."""

import math
from collections.abc import Mapping
from functools import lru_cache

from pyoxigraph import BlankNode, Literal, NamedNode, Triple

from linked_fleet_agent.wire.names import unescape
from linked_fleet_gateway.fleet.robot import Robot
from linked_fleet_gateway.rdf.serialise import ParseError, parse
from linked_fleet_gateway.rdf.units import UNITS
from linked_fleet_gateway.rdf.vocabulary import DCTERMS, LF, VOM
from linked_fleet_gateway.resources.paths import reserved_in_robot

# base for parsing, below which IRIs contain the names of joints, independent of the request
_BASE = "http://robot.invalid/r/"
_LONGEST = 128


def poses(robot: Robot) -> Mapping[str, Mapping[str, float]]:
    """Return positions (rad or m) by joint, by title of the pose. Poses outside the robot's limits are omitted."""
    if robot.model is None:
        return {}
    agents, clients = map(read_poses, robot.annotations)
    named = {**clients, **agents}  # poses of the agent take precedence
    return {title: targets for title, targets in named.items() if _possible(robot, targets)}


def _possible(robot: Robot, targets: Mapping[str, float]) -> bool:
    for name, position in targets.items():
        joint = robot.model.joints.get(name) if robot.model else None
        if joint is None or not joint.commandable:
            return False
        low, high = joint.limits.lower, joint.limits.upper
        if (low is not None and position < low) or (high is not None and position > high):
            return False
    return True


@lru_cache(maxsize=256)
def read_poses(annotations: str) -> Mapping[str, Mapping[str, float]]:
    """Return positions by joint, by title, from one layer of annotations."""
    try:
        triples = parse(annotations.encode(), "text/turtle", _BASE)
    except ParseError:  # already logged by ``annotate``
        return {}
    by_subject: dict[object, list[Triple]] = {}
    for triple in triples:
        by_subject.setdefault(triple.subject, []).append(triple)
    found: dict[str, Mapping[str, float]] = {}
    for triple in by_subject.get(NamedNode(_BASE), ()):
        if triple.predicate == LF.namedPose and isinstance(triple.object, NamedNode | BlankNode):
            about = by_subject.get(triple.object, [])
            titles = [t.object.value for t in about if t.predicate == DCTERMS.title and isinstance(t.object, Literal)]
            targets = [_target(by_subject.get(t.object, [])) for t in about if t.predicate == LF.target]
            if titles and targets and None not in targets and len(titles[0]) <= _LONGEST:
                found[titles[0]] = dict(each for each in targets if each is not None)
    return found


def _target(about: list[Triple]) -> tuple[str, float] | None:
    said = {triple.predicate: triple.object for triple in about}
    joint, value, unit = said.get(LF.ofJoint), said.get(VOM.numericalValue), said.get(VOM.unit)
    if not (isinstance(joint, NamedNode) and isinstance(value, Literal) and isinstance(unit, NamedNode)):
        return None
    segment = joint.value.removeprefix(_BASE)
    if "/" in segment or unit not in UNITS:
        return None
    try:
        name, position = unescape(segment, reserved_in_robot()), float(value.value) * UNITS[unit].si
    except ValueError:
        return None
    return (name, position) if math.isfinite(position) else None
