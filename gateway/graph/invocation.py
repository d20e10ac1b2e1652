"""Invocations as resources: PROV-O activities with state, target and result (paper 5.4, R0.8)."""

from pyoxigraph import Literal, NamedNode

from gateway.fleet.invocations import Invocation, InvocationState
from gateway.fleet.robot import Robot
from gateway.graph.build import Graph, timestamp
from gateway.graph.kinds import UNITLESS, kind_of
from gateway.graph.paths import joint_path
from gateway.graph.vocab import DCTERMS, LDP, LF, PROV, RDFS

_STATES = {
    InvocationState.ACCEPTED: LF.accepted,
    InvocationState.RUNNING: LF.running,
    InvocationState.SUCCEEDED: LF.succeeded,
    InvocationState.FAILED: LF.failed,
    InvocationState.PREEMPTED: LF.preempted,
    InvocationState.UNKNOWN: LF.unknown,
}


def describe_invocation(graph: Graph, base: str, robot: Robot, invocation: Invocation) -> None:
    iri = NamedNode(base + invocation_path(invocation))
    graph.a(iri, PROV.Activity, LF.Invocation)
    graph.add(iri, DCTERMS.title, Literal(f"Invocation {invocation.id} of {invocation.action}"))
    graph.add(iri, DCTERMS.identifier, Literal(invocation.id))
    graph.add(iri, RDFS.seeAlso, NamedNode(base + invocation.action))
    graph.add(iri, LF.state, _STATES[invocation.state])
    graph.add(iri, DCTERMS.created, timestamp(invocation.created_ns))
    for predicate, stamp in ((PROV.startedAtTime, invocation.started_ns), (PROV.endedAtTime, invocation.ended_ns)):
        if stamp is not None:
            graph.add(iri, predicate, timestamp(stamp))
    if invocation.reason:
        graph.add(iri, LF.reason, Literal(invocation.reason))
    for predicate, positions in ((LF.target, invocation.targets), (LF.result, invocation.result)):
        for joint, position in positions.items():
            node = graph.blank()
            graph.add(iri, predicate, node)
            graph.add(node, LF.ofJoint, NamedNode(base + joint_path(robot.name, joint)))
            known = robot.model.joints.get(joint) if robot.model else None
            dimension = kind_of(known).dimension if known else None
            graph.scalar(node, LF.value, round(position, 6), dimension.position if dimension else UNITLESS)


def describe_invocations(graph: Graph, base: str, action: str, invocations: list[Invocation]) -> None:
    """The LDP container of an action's invocations, newest first."""
    iri = NamedNode(f"{base}{action}/invocations")
    graph.a(iri, LDP.BasicContainer, LDP.Container)
    graph.add(iri, DCTERMS.title, Literal(f"Invocations of {action}"))
    graph.add(iri, RDFS.seeAlso, NamedNode(base + action))
    for invocation in invocations:
        member = NamedNode(base + invocation_path(invocation))
        graph.add(iri, LDP.contains, member)
        graph.a(member, PROV.Activity, LF.Invocation)
        graph.add(member, LF.state, _STATES[invocation.state])


def invocations_path(action: str) -> str:
    return f"{action}/invocations"


def invocation_path(invocation: Invocation) -> str:
    return f"{invocations_path(invocation.action)}/{invocation.id}"
