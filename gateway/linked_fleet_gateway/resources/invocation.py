"""Invocations and the control lease of a robot as resources.

Invocations are PROV-O activities with state, progress, target and result (paper 5.4, R0.8).
"""

import math
from collections.abc import Callable, Iterable, Mapping

from pyoxigraph import BlankNode, Literal, NamedNode, RdfFormat, Triple, parse

from linked_fleet_agent.wire.messages import Follow
from linked_fleet_gateway.resources.body_values import ROOT
from linked_fleet_gateway.resources.joint_kinds import kind_of
from linked_fleet_gateway.resources.part import part_of
from linked_fleet_gateway.resources.paths import joint_path, lease_path, link_path, robot_path
from linked_fleet_rdf.graph import METRE, RADIAN, SECOND, UNITLESS, Graph, Node, Unit, number, timestamp
from linked_fleet_rdf.vocabulary import DCTERMS, HTTP, HYBRIT, LDP, LF, METHODS, PROV, RDFS, SOSA
from linked_fleet_state.closest import Closest
from linked_fleet_state.invocations import Invocation, InvocationState
from linked_fleet_state.kept_plan import KeptPlan
from linked_fleet_state.robot import Robot
from linked_fleet_state.unchecked import UncheckedLink

STATES = {
    InvocationState.ACCEPTED: LF.accepted,
    InvocationState.RUNNING: LF.running,
    InvocationState.SUCCEEDED: LF.succeeded,
    InvocationState.FAILED: LF.failed,
    InvocationState.CANCELLED: LF.cancelled,
    InvocationState.PREEMPTED: LF.preempted,
    InvocationState.UNKNOWN: LF.unknown,
}
_FACTS: dict[str, tuple[NamedNode, Unit]] = {
    "positionResidual": (LF.positionResidual, METRE),
    "orientationResidual": (LF.orientationResidual, RADIAN),
    "pathDeviation": (LF.pathDeviation, METRE),
    "leastManipulability": (LF.leastManipulability, UNITLESS),
    "leastManipulabilityTime": (LF.leastManipulabilityTime, SECOND),
    "speedShare": (LF.speedScale, UNITLESS),
}
MOST_WAYPOINTS = 40
"""Waypoints of a planned path that a rehearsal shows."""
MOST_SUMMARISED = 100
"""Members of a container that are summarised; others are listed with their state only."""
Unchecked = Iterable[tuple[str, UncheckedLink]]
"""Links that a check did not cover, each after its path."""
OUTPUT = BlankNode("output")
"""The root of a stored result."""
_MAX_OUTPUT_BYTES = 32 * 1024


def describe_invocation(
    graph: Graph,
    base: str,
    robot: Robot | None,
    invocation: Invocation,
    others: Mapping[str, Invocation],
    answers: Mapping[str, str],
    unchecked: Unchecked = (),
) -> None:
    """Describe an invocation.

    ``others`` are the known invocations that it ended and the one that ended it. ``answers`` are those of the robots to
    an invocation of the fleet. ``unchecked`` are the links that the check of the motion did not cover.
    """
    iri = NamedNode(base + invocation_path(invocation))
    graph.a(iri, PROV.Activity, LF.Invocation, SOSA.Actuation)
    graph.add(iri, DCTERMS.title, Literal(f"Invocation {invocation.id} of {invocation.action}"))
    graph.add(iri, DCTERMS.identifier, Literal(invocation.id))
    graph.add(iri, RDFS.seeAlso, NamedNode(base + invocation.action))
    graph.add(iri, HYBRIT.blueprint, LF.InvocationShape, NamedNode(iri.value + "/blueprint"))
    if not invocation.state.terminal:
        graph.add(iri, HYBRIT.action, NamedNode(base + cancel_path(invocation)))
    graph.add(iri, LF.state, STATES[invocation.state])
    graph.scalar(iri, LF.progress, round(invocation.progress, 3), UNITLESS)
    if invocation.client:
        client = graph.blank(PROV.Agent)
        graph.add(iri, PROV.wasAssociatedWith, client)
        graph.add(client, DCTERMS.title, Literal(invocation.client))
    _times(graph, iri, invocation)
    if invocation.reason:
        graph.add(iri, LF.reason, Literal(invocation.reason))
    _add_limit(graph, iri, invocation.limited, invocation.detour)
    for name, value in invocation.facts.items():
        predicate, unit = _FACTS[name]
        graph.scalar(iri, predicate, value, unit)
    _add_stored(graph, iri, LF.input, ROOT, invocation.body)
    _add_stored(graph, iri, LF.output, OUTPUT, invocation.output)
    preempted = [others[each] for each in invocation.preempts if each in others]
    graph.add(iri, LF.preempts, *(NamedNode(base + invocation_path(each)) for each in preempted))
    if invocation.preempted_by in others:
        graph.add(iri, LF.preemptedBy, NamedNode(base + invocation_path(others[invocation.preempted_by])))
    if robot is not None:
        graph.add(iri, SOSA.actsOnProperty, *_moved(base, robot, invocation.targets))
        describe_positions(graph, iri, LF.target, base, robot, invocation.targets)
        describe_positions(graph, iri, LF.result, base, robot, invocation.result)
        if (part := part_of(robot, invocation)) is not None:
            part.describe_outcome(graph, iri, base, invocation)
    describe_unchecked(graph, iri, base, unchecked)
    for name, answer in sorted(answers.items()):
        node = graph.blank()
        graph.add(iri, LF.answer, node)
        graph.add(node, LF.ofRobot, NamedNode(base + robot_path(name)))
        graph.add(node, LF.reason, Literal(answer))


def describe_rehearsal(
    graph: Graph,
    base: str,
    action: str,
    robot: Robot | None,
    targets: Mapping[str, float],
    facts: Mapping[str, float],
    duration_s: float,
    preempts: Iterable[Invocation],
    findings: Mapping[NamedNode, bool],
    unchecked: Unchecked = (),
    limited: str = "",
    path: Follow | None = None,
    detour: str = "",
    closest: Iterable[Closest] = (),
    plan: KeptPlan | None = None,
    things: Iterable[tuple[NamedNode, str]] = (),
    describe: Callable[[Graph, Node], None] | None = None,
) -> None:
    """Describe the effect that the action would have, for the preference ``dry-run``.

    ``findings``: whether the guards of motions found the path free, by their predicates; False if it is unknown.
    ``unchecked``: the links that they did not cover. ``limited``: why they reduce its speed.
    ``path`` is a path that was planned, and ``detour`` why it is not the direct one. ``closest``: where it comes
    closest to something. ``plan`` is kept for a request of this very motion. ``things`` are what the
    findings depend on, by predicate and path. ``describe`` adds what an operation says about its rehearsal.
    """
    iri = graph.blank(LF.Rehearsal)
    graph.add(iri, DCTERMS.title, Literal(f"Rehearsal of {action}; nothing has moved"))
    graph.add(iri, RDFS.seeAlso, NamedNode(base + action))
    graph.scalar(iri, LF.duration, round(duration_s, 3), SECOND)
    for name, value in facts.items():
        predicate, unit = _FACTS[name]
        graph.scalar(iri, predicate, value, unit)
    for predicate, free in findings.items():
        graph.add(iri, predicate, Literal(True) if free else LF.unknown)
    for predicate, path_of in things:
        graph.add(iri, predicate, NamedNode(base + path_of))
    _add_limit(graph, iri, limited, detour)
    if plan is not None:
        graph.add(iri, LF.plan, Literal(plan.id))
        graph.add(iri, LF.expires, timestamp(plan.until_ns))
    describe_unchecked(graph, iri, base, unchecked)
    for near in closest:
        _describe_closest(graph, iri, base, near)
    if describe is not None:
        describe(graph, iri)
    graph.add(iri, LF.preempts, *(NamedNode(base + invocation_path(each)) for each in preempts))
    if robot is not None:
        describe_positions(graph, iri, LF.target, base, robot, targets)
        if path is not None:
            describe_path(graph, iri, base, robot, path)


def _describe_closest(graph: Graph, iri: Node, base: str, closest: Closest) -> None:
    node = graph.blank()
    graph.add(iri, LF.closest, node)
    graph.add(node, DCTERMS.title, Literal(" and ".join(closest.names)))
    graph.add(node, LF.nearTo, *(NamedNode(base + path) for path in closest.things))
    graph.scalar(node, LF.clearance, round(closest.apart_m, 4), METRE)
    graph.scalar(node, LF.uncertainty, round(closest.uncertain_m, 4), METRE)
    graph.add(node, LF.share, number(closest.share))
    if closest.at_s is not None:
        graph.add(node, LF.atTime, number(round(closest.at_s, 3)))
    if closest.point is not None:
        graph.vector(node, LF.position, closest.point, METRE)


def describe_path(graph: Graph, iri: Node, base: str, robot: Robot, path: Follow, most: int = MOST_WAYPOINTS) -> None:
    """Add evenly chosen waypoints of a path, with its end."""
    step = math.ceil(len(path.times_s) / min(most, MOST_WAYPOINTS))
    for time_s, row in list(zip(path.times_s, path.positions, strict=True))[::-1][::step][::-1]:
        node = graph.blank()
        graph.add(iri, LF.waypoint, node)
        graph.add(node, LF.atTime, number(round(time_s, 3)))
        describe_positions(graph, node, LF.target, base, robot, dict(zip(path.joints, row, strict=True)))


def _add_limit(graph: Graph, iri: Node, limited: str, detour: str) -> None:
    if limited:
        graph.add(iri, LF.limitedBecause, Literal(limited))
    if detour:
        graph.add(iri, LF.plannedBecause, Literal(detour))


def unchecked_links(robot: Robot) -> tuple[tuple[str, UncheckedLink], ...]:
    """Return the links of a robot that checks of motions do not cover, each after its path."""
    model = robot.model
    return () if model is None else tuple((link_path(robot.name, model, each.link), each) for each in robot.unchecked)


def describe_unchecked(graph: Graph, iri: Node, base: str, unchecked: Unchecked) -> None:
    """Add the links that a check does not cover, each with its mesh and the reason."""
    for path, each in unchecked:
        node = graph.blank()
        graph.add(iri, LF.unchecked, node)
        graph.add(node, LF.ofLink, NamedNode(base + path))
        if each.mesh:
            graph.add(node, LF.meshUri, Literal(each.mesh))
        graph.add(node, LF.reason, Literal(each.reason))


def describe_cancel(graph: Graph, base: str, invocation: Invocation) -> None:
    """Describe the action that stops an invocation; it takes no input."""
    iri, whole = NamedNode(base + cancel_path(invocation)), NamedNode(base + invocation_path(invocation))
    graph.a(iri, HYBRIT.Action, LF.CancelInvocation)
    graph.add(iri, DCTERMS.title, Literal(f"Cancel invocation {invocation.id}"))
    graph.add(iri, RDFS.comment, Literal("The robot brakes and holds; the invocation stays, as cancelled."))
    graph.add(iri, RDFS.seeAlso, whole)
    graph.add(iri, HYBRIT.produces, LF.InvocationShape)
    request = graph.blank(HTTP.Request)
    graph.add(iri, HYBRIT.binding, request)
    graph.add(request, HTTP.mthd, METHODS.POST)
    graph.add(request, HTTP.requestURI, iri)


def describe_invocations(
    graph: Graph, base: str, action: str, robot: Robot | None, invocations: list[Invocation]
) -> None:
    """Describe the LDP container of an action's invocations, newest first."""
    iri = NamedNode(f"{base}{action}/invocations")
    graph.a(iri, LF.InvocationList, LDP.BasicContainer, LDP.Container)
    graph.add(iri, DCTERMS.title, Literal(f"Invocations of {action}"))
    graph.add(iri, RDFS.seeAlso, NamedNode(base + action))
    for invocation in invocations:
        member = NamedNode(base + invocation_path(invocation))
        graph.add(iri, LDP.contains, member)
        graph.a(member, PROV.Activity, LF.Invocation)
        graph.add(member, LF.state, STATES[invocation.state])
    for invocation in invocations[:MOST_SUMMARISED]:
        _summarise(graph, base, robot, invocation)


def _summarise(graph: Graph, base: str, robot: Robot | None, invocation: Invocation) -> None:
    member = NamedNode(base + invocation_path(invocation))
    graph.add(member, DCTERMS.created, timestamp(invocation.created_ns))
    if invocation.reason:
        graph.add(member, LF.reason, Literal(invocation.reason))
    if invocation.client:
        client = graph.blank(PROV.Agent)
        graph.add(member, PROV.wasAssociatedWith, client)
        graph.add(client, DCTERMS.title, Literal(invocation.client))
    if robot is not None:
        describe_positions(graph, member, LF.target, base, robot, invocation.targets)


def _moved(base: str, robot: Robot, joints: Iterable[str]) -> list[NamedNode]:
    """Return the position properties of the known joints of a motion."""
    known = robot.model.joints if robot.model else {}
    return [
        NamedNode(f"{base}{joint_path(robot.name, joint)}/{kind_of(known[joint]).position}")
        for joint in joints
        if joint in known
    ]


def describe_positions(
    graph: Graph, iri: Node, predicate: NamedNode, base: str, robot: Robot, values: Mapping[str, float]
) -> None:
    """Add joint positions with their units as values of ``predicate`` of ``iri``."""
    for joint, position in values.items():
        node = graph.blank()
        graph.add(iri, predicate, node)
        graph.add(node, LF.ofJoint, NamedNode(base + joint_path(robot.name, joint)))
        known = robot.model.joints.get(joint) if robot.model else None
        dimension = kind_of(known).dimension if known else None
        graph.scalar(node, LF.value, round(position, 6), dimension.position if dimension else UNITLESS)


def _times(graph: Graph, iri: NamedNode, invocation: Invocation) -> None:
    graph.add(iri, DCTERMS.created, timestamp(invocation.created_ns))
    if invocation.duration_s is not None:
        graph.scalar(iri, LF.duration, round(invocation.duration_s, 3), SECOND)
    for predicate, stamp in ((PROV.startedAtTime, invocation.started_ns), (PROV.endedAtTime, invocation.ended_ns)):
        if stamp is not None:
            graph.add(iri, predicate, timestamp(stamp))


def _add_stored(graph: Graph, iri: NamedNode, predicate: NamedNode, root: BlankNode, stored: str) -> None:
    """Add stored statements, such as the body as the client sent it, and link their root."""
    names: dict[BlankNode, Node] = {}

    def own(term: object) -> object:
        name = f"{root.value}{len(names)}"
        return names.setdefault(term, BlankNode(name)) if isinstance(term, BlankNode) else term

    for quad in parse(stored, format=RdfFormat.N_TRIPLES):
        graph.add(own(quad.subject), quad.predicate, own(quad.object))  # type: ignore[arg-type]
    if root in names:
        graph.add(iri, predicate, names[root])


def output_ntriples(triples: Iterable[Triple], root: Node) -> str:
    """Return statements as stored with an invocation, about ``_:output`` instead of ``root``.

    Raises ValueError if they are too long to store.
    """

    def own(term: object) -> object:
        return OUTPUT if term == root else term

    written = "".join(f"{own(each.subject)} {each.predicate} {own(each.object)} .\n" for each in triples)
    if len(written.encode()) > _MAX_OUTPUT_BYTES:
        raise ValueError(f"an output has at most {_MAX_OUTPUT_BYTES} bytes as N-Triples")
    return written


def invocations_path(action: str) -> str:
    return f"{action}/invocations"


def invocation_path(invocation: Invocation) -> str:
    """Return the path of an invocation."""
    return f"{invocations_path(invocation.action)}/{invocation.id}"


def cancel_path(invocation: Invocation) -> str:
    return f"{invocation_path(invocation)}/actions/cancel"


def describe_lease(graph: Graph, base: str, robot: Robot) -> None:
    """Describe the control lease of a robot."""
    iri, lease = NamedNode(base + lease_path(robot.name)), robot.lease
    graph.a(iri, LF.ControlLease)
    graph.add(iri, DCTERMS.title, Literal(f"Control of {robot.name}"))
    graph.add(iri, RDFS.seeAlso, NamedNode(base + robot_path(robot.name)))
    graph.add(iri, HYBRIT.blueprint, LF.ControlLeaseShape, NamedNode(iri.value + "/blueprint"))
    graph.add(iri, HYBRIT.consumes, LF.ControlLeaseInput)
    graph.add(iri, LF.state, LF.free if lease is None else LF.held)
    if lease is not None:
        graph.add(iri, DCTERMS.identifier, Literal(lease.id))
        graph.add(iri, LF.holder, Literal(lease.holder))
        graph.add(iri, LF.priority, Literal(lease.priority))
        graph.add(iri, LF.leaseDuration, number(lease.duration_s))
        graph.add(iri, LF.expires, timestamp(lease.expires_ns))
