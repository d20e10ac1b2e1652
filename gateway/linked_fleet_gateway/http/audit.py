"""Audit records of requests, and the resource ``/audit`` with its pages, for administrators."""

from collections.abc import Iterator
from functools import partial

from pyoxigraph import Literal, NamedNode

from linked_fleet_gateway.base.errors import NotFound
from linked_fleet_gateway.http.request_events import RequestEvent
from linked_fleet_gateway.identity.rights import Right
from linked_fleet_gateway.rdf.graph import Graph, integer, timestamp
from linked_fleet_gateway.rdf.vocabulary import DCTERMS, LDP, LF, PROV, RDFS, XHV
from linked_fleet_gateway.resources.branches import FleetBranch, RequestView
from linked_fleet_gateway.resources.paths import AUDIT as PATH
from linked_fleet_gateway.resources.paths import robot_path
from linked_fleet_gateway.resources.resource import CONTAINER, Resource, run_steps
from linked_fleet_gateway.runtime.audit_log import PAGE_SIZE, AuditEntry, AuditLog

RIGHTS = (Right.ADMIN,)


def audit_branch(log: AuditLog) -> FleetBranch:
    """Return the branch of the pages of the log."""

    async def load(view: RequestView, rest: list[str]) -> Resource:
        path = "/".join((PATH, *rest))
        try:
            entries = await log.read_page("/".join(rest))
        except ValueError as error:
            raise NotFound(f"There is no such page: {error}.") from error
        steps = partial(_steps, view.base, path, entries)
        return Resource(
            path, "Audit", lambda graph: run_steps(steps(graph)), CONTAINER, publishes_changes=False, steps=steps
        )

    return FleetBranch(PATH[1:], None, reading=RIGHTS, load=load)


def record(log: AuditLog, event: RequestEvent) -> None:
    """Record an event."""
    status = "" if event.status is None else str(event.status)
    log.record(event.client, event.event, event.path, event.robot, status, event.request, event.created)


def _steps(base: str, path: str, entries: list[tuple[str, AuditEntry]], graph: Graph) -> Iterator[None]:
    iri = NamedNode(base + path)
    graph.a(iri, LF.Audit, LDP.BasicContainer, LDP.Container)
    graph.add(iri, DCTERMS.title, Literal("Audit"))
    graph.add(iri, RDFS.seeAlso, NamedNode(base + "/"))
    if len(entries) == PAGE_SIZE:
        graph.add(iri, XHV.next, NamedNode(f"{base}{PATH}/{entries[-1][0]}"))
    for id, entry in entries:
        one = NamedNode(f"{base}{PATH}#{id}")
        graph.add(iri, LDP.contains, one)
        _describe_entry(graph, base, one, entry)
        yield


def _describe_entry(graph: Graph, base: str, iri: NamedNode, entry: AuditEntry) -> None:
    graph.a(iri, PROV.Activity)
    graph.add(iri, DCTERMS.title, Literal(f"{entry.what} {entry.target}"))
    graph.add(iri, DCTERMS.created, timestamp(entry.at_ns))
    agent = graph.blank(PROV.Agent)
    graph.add(iri, PROV.wasAssociatedWith, agent)
    graph.add(agent, DCTERMS.title, Literal(entry.who))
    if entry.result:  # a literal and not a link: the created resource may be gone, and a target may be anything
        graph.add(iri, DCTERMS.description, Literal(entry.result))
    if entry.robot:
        graph.add(iri, LF.ofRobot, NamedNode(base + robot_path(entry.robot)))
    if entry.outcome:
        graph.add(iri, LF.status, integer(int(entry.outcome)))
    if entry.request:
        graph.add(iri, DCTERMS.identifier, Literal(entry.request))
