"""Annotations of a robot in any vocabulary (R1.12): a layer of its agent, and one of clients above it.

Neither layer can add statements reserved for the gateway, and clients cannot remove statements of the agent. The
gateway reads two facts from annotations: named poses (``lf:namedPose``), with positions by joint, by title; and the
charge of the battery (``lf:batteryCharge``), of which agents send no message.
"""

import logging
import math
import re
from collections.abc import Iterable, Mapping, Sequence
from decimal import Decimal, InvalidOperation
from functools import lru_cache
from hashlib import blake2b

from pyoxigraph import BlankNode, Literal, NamedNode, RdfFormat, Triple, serialize

from linked_fleet_agent.wire.keys import unescape
from linked_fleet_base.errors import PayloadTooLarge, UnprocessableContent
from linked_fleet_gateway.resources.joint_kinds import POSITION_RESOLUTION
from linked_fleet_gateway.resources.paths import reserved_in_robot, robot_path
from linked_fleet_rdf.graph import UNITS, Graph, Node
from linked_fleet_rdf.serialise import ParseError, parse
from linked_fleet_rdf.validation import check_writable, refuse_statements, statements_by_subject
from linked_fleet_rdf.vocabulary import DCTERMS, HYBRIT, LDP, LF, NUMERIC, RDF, ROS, SH, SOSA, VOM, XHV
from linked_fleet_state.robot import Annotations, Robot

log = logging.getLogger(__name__)

# base for parsing, below which IRIs contain the names of joints, independent of the request
_BASE = "http://robot.invalid/r/"
_LONGEST = 128
_ROUNDING = POSITION_RESOLUTION / 2  # of a position that was read at its limit; actions clamp it


def named_poses(robot: Robot) -> Mapping[str, Mapping[str, float]]:
    """Return positions (rad or m) by joint, by title of the pose. Poses outside the robot's limits are omitted."""
    if robot.model is None:
        return {}
    agents, clients = map(read_poses, robot.annotations)
    kept = {title: each.positions for title, each in robot.kept_poses.items()}
    named = {**clients, **kept, **agents}  # poses of the agent take precedence
    return {title: targets for title, targets in named.items() if not pose_finding(robot, targets)}


def pose_finding(robot: Robot, targets: Mapping[str, float]) -> str:
    """Return a sentence why a robot cannot assume a pose; empty if its joints and limits allow it."""
    for name, position in targets.items():
        joint = robot.model.joints.get(name) if robot.model else None
        if joint is None:
            return f"{robot.name} has no joint {name}."
        if not joint.commandable:
            return f"The joint {name} takes no commands."
        low, high = joint.limits.lower, joint.limits.upper
        if (low is not None and position < low - _ROUNDING) or (high is not None and position > high + _ROUNDING):
            return f"{name} would be at {position:.6g}, outside its limits {low} to {high} (SI units)."
    return ""


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


# Statements with these namespaces are reserved for the gateway: an annotation must not add an action or a value.
_OWN = tuple(namespace.iri for namespace in (HYBRIT, LDP, LF, ROS, SH, SOSA, XHV))
# Exceptions, with which a robot may name poses and give the charge of its battery.
_ITS = frozenset({LF.namedPose, LF.target, LF.ofJoint, LF.batteryCharge})
_OWN_TERMS = frozenset({DCTERMS.title, DCTERMS.identifier, DCTERMS.hasPart})
BySubject = Mapping[Node, Sequence[Triple]]


def annotate(graph: Graph, subject: NamedNode, annotations: Annotations, base: str) -> None:
    """Add the annotations about ``subject`` and the nodes that they describe; ``base`` is the robot's IRI."""
    for layer in _layers(annotations, base):
        for triple in connected_statements(layer, subject, base):
            graph.add(triple.subject, triple.predicate, triple.object)  # type: ignore[arg-type]


def connected_statements(layer: BySubject, subject: NamedNode, base: str) -> list[Triple]:
    """Return the triples about ``subject``, and about the blank nodes and external resources that these lead to.

    ``base`` is the IRI of a robot of the fleet.
    """
    inside = (base.removesuffix("/").rpartition("/")[0] + "/", *_OWN)
    found: list[Triple] = []
    pending: list[Node] = [subject]
    done: set[Node] = set()
    while pending:
        node = pending.pop()
        if node in done:  # referenced more than once
            continue
        done.add(node)
        for triple in layer.get(node, ()):
            found.append(triple)
            value = triple.object
            if isinstance(value, BlankNode) or (isinstance(value, NamedNode) and not value.value.startswith(inside)):
                pending.append(value)
    return found


def agent_layer(annotations: Annotations, base: str) -> BySubject:
    """Return the agent's layer, which clients cannot change."""
    return _layers(annotations, base)[0]


def subtract_layer(layer: BySubject, lower: BySubject) -> dict[Node, list[Triple]]:
    """Return ``layer`` without the statements that ``lower`` has too; blank nodes are compared by content."""
    mine, theirs = _meanings(layer), _meanings(lower)
    said = {_key(triple, theirs) for triples in lower.values() for triple in triples}
    return {
        node: [each for each in triples if isinstance(node, BlankNode) or _key(each, mine) not in said]
        for node, triples in layer.items()
    }


def _key(triple: Triple, meanings: Mapping[BlankNode, str]) -> tuple[str, ...]:
    return tuple(meanings[term] if isinstance(term, BlankNode) else str(term) for term in triple)


def _meanings(layer: BySubject) -> dict[BlankNode, str]:
    """Return a digest of the content of each blank node: equal for equal trees, unique for nodes in a cycle."""
    found: dict[BlankNode, str] = {}
    begun: set[BlankNode] = set()
    nodes = (term for triples in layer.values() for triple in triples for term in triple if isinstance(term, BlankNode))
    pending = list(dict.fromkeys(nodes))
    while pending:
        node = pending[-1]
        inner = [t.object for t in layer.get(node, ()) if isinstance(t.object, BlankNode) and t.object not in begun]
        if node not in begun:
            begun.add(node)
            pending += inner
            continue
        pending.pop()
        if node not in found:
            said = [(t.predicate.value, found.get(t.object, str(t.object))) for t in layer.get(node, ())]  # type: ignore[arg-type]
            found[node] = blake2b(repr(sorted(said)).encode(), digest_size=16).hexdigest()
    return found


@lru_cache(maxsize=256)
def _layers(said: Annotations, base: str) -> tuple[BySubject, BySubject]:
    """Return the layer of the agent, and the statements of clients beyond it."""
    agents, clients = (statements_by_subject(_parsed(text, base)) for text in said)
    return agents, subtract_layer(clients, agents)


def _parsed(turtle: str, base: str) -> Iterable[Triple]:
    try:
        triples = parse(turtle.encode(), "text/turtle", base)
    except ParseError as error:
        log.warning("annotations of %s are left out: %s", base, error)
        return
    for triple in triples:
        if is_reserved(triple, base):
            log.warning("annotation %s of %s is left out: the gateway alone states it", triple.predicate.value, base)
        else:
            yield triple


def is_reserved(triple: Triple, base: str) -> bool:
    """Return True for a reserved statement: a gateway's term or type, or another title for a resource that it names.

    ``base`` is the IRI of the robot, below which the gateway names everything.
    """
    if triple.predicate == RDF.type:
        return isinstance(triple.object, NamedNode) and triple.object.value.startswith(_OWN)
    if triple.predicate in _ITS:
        return False
    named = isinstance(triple.subject, NamedNode) and triple.subject.value.startswith(base)
    return triple.predicate.value.startswith(_OWN) or (named and triple.predicate in _OWN_TERMS)


MAX_ANNOTATIONS = 65_536  # characters, as in the wire protocol
MAX_ANNOTATION_TRIPLES = 256
"""Limit of statements of clients. All of them are in every description and on every page of the robot."""
# matches N-Triples terms, so that IRIs within literals are left alone
_TERM = re.compile(r'"(?:[^"\\]++|\\.)*+"|<[^>]*>')


def read_annotations(
    triples: Sequence[Triple], robot: Robot, base: str, iri: str, current: frozenset[Triple] = frozenset()
) -> str:
    """Return the statements that are not the agent's, with IRIs relative to the fleet, valid under every base URL.

    ``current`` describes the resource ``iri`` as it is. Raises UnprocessableContent for terms reserved for the gateway,
    and for statements that are not connected to the robot; PayloadTooLarge for too many.
    """
    path, constraint = robot_path(robot.name), f"{iri}/blueprint"
    subject = NamedNode(base + path)
    said = connected_statements(statements_by_subject(triples), subject, subject.value)
    check_writable(said, constraint)
    own = [triple.predicate.value for triple in said if is_reserved(triple, subject.value)]
    if own:
        raise UnprocessableContent(
            f"Only the gateway says <{own[0][:200]}> of a robot; annotations speak in other vocabularies.",
            constraint=constraint,
        )
    heard = current.union(said)
    refuse_statements(
        [triple for triple in dict.fromkeys(triples) if triple not in heard], constraint,
        f"Annotations are about <{subject.value}>, and about blank nodes and resources outside the fleet that its"
        " statements lead to; nothing uses",
    )  # fmt: skip
    mine = connected_statements(
        subtract_layer(statements_by_subject(said), agent_layer(robot.annotations, subject.value)),
        subject,
        subject.value,
    )
    if len(mine) > MAX_ANNOTATION_TRIPLES:
        raise PayloadTooLarge(
            f"The annotations of clients would have {len(mine)} statements; {MAX_ANNOTATION_TRIPLES} are the most."
        )
    written = serialize(mine, format=RdfFormat.N_TRIPLES)
    assert written is not None  # nothing is written to a file
    text = _TERM.sub(lambda term: _relative(term[0], base, path), written.decode())
    if len(text) > MAX_ANNOTATIONS:
        raise UnprocessableContent(
            f"The annotations have {len(text)} characters; {MAX_ANNOTATIONS} are the most.", constraint=constraint
        )
    _check_poses(text, robot, constraint)
    return text


def agent_statements(description: Sequence[Triple], robot: Robot, base: str, iri: str) -> list[Triple]:
    """Return the triples in the description of ``iri`` that clients do not own: its own and the agent's."""
    subject = NamedNode(base + robot_path(robot.name))
    agents = set(connected_statements(agent_layer(robot.annotations, subject.value), subject, subject.value))
    return [triple for triple in description if triple in agents or triple.subject == NamedNode(iri)]


def _check_poses(text: str, robot: Robot, constraint: str) -> None:
    """Refuse a pose whose title the robot's agent, or a kept pose, already uses."""
    named = read_poses(text).keys()
    if taken := sorted(named & read_poses(robot.annotations[0]).keys()):
        raise UnprocessableContent(
            f"The robot itself names a pose {taken[0]!r}; give another one another title.", constraint=constraint
        )
    if taken := sorted(named & robot.kept_poses.keys()):
        raise UnprocessableContent(
            f"There is a pose {taken[0]!r} at {robot.kept_poses[taken[0]].path}; give another one another title.",
            constraint=constraint,
        )


def _relative(term: str, base: str, path: str) -> str:
    """Return an IRI below the robot as relative, one elsewhere in the fleet by its path, other terms unchanged."""
    if term.startswith(f"<{base}{path}"):
        return f"<./{term.removeprefix(f'<{base}{path}')}"
    return f"<{term.removeprefix(f'<{base}')}" if re.match(f"<{re.escape(base)}/(?!/)", term) else term


def battery_charge(robot: Robot) -> Decimal | None:
    """Return the charge in percent (0 to 100) from the agent's annotations, else the clients'; None if unknown."""
    return next((found for each in robot.annotations if (found := read_charge(each)) is not None), None)


def read_charge(annotations: str) -> Decimal | None:
    """Return the charge in one layer of annotations; None if missing or not a number from 0 to 100."""
    return _read(annotations) if "batteryCharge" in annotations else None  # to parse takes long


@lru_cache(maxsize=4096)
def _read(annotations: str) -> Decimal | None:
    try:
        triples = parse(annotations.encode(), "text/turtle", _BASE)
    except ParseError:  # ``annotate`` has said so in the log
        return None
    about = (each for each in triples if each.subject == NamedNode(_BASE) and each.predicate == LF.batteryCharge)
    numbers = [number for each in about if (number := _number(each.object)) is not None]
    return next((each for each in numbers if 0 <= each <= 100), None)


def _number(term: object) -> Decimal | None:
    if not isinstance(term, Literal) or term.datatype not in NUMERIC:
        return None
    try:
        found = Decimal(term.value)
    except InvalidOperation:
        return None
    return found if found.is_finite() else None
