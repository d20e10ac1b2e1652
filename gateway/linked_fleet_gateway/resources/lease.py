"""The control lease of a robot as a resource."""

from pyoxigraph import Literal, NamedNode

from linked_fleet_gateway.fleet.robot import Robot
from linked_fleet_gateway.rdf.graph import Graph, number, timestamp
from linked_fleet_gateway.rdf.vocabulary import DCTERMS, HYBRIT, LF, RDFS
from linked_fleet_gateway.resources.paths import lease_path, robot_path


def describe_lease(graph: Graph, base: str, robot: Robot) -> None:
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
        graph.add(iri, LF.leaseDuration, number(lease.duration_s))
        graph.add(iri, LF.expires, timestamp(lease.expires_ns))
