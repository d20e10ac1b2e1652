"""Audit records of requests, and the resource ``/audit`` with its pages, for administrators."""

from collections.abc import Iterator
from functools import partial

from pyoxigraph import Literal, NamedNode

from linked_fleet_gateway.base.errors import NotFound
from linked_fleet_gateway.http.request import AUDIT_RIGHTS, Connection
from linked_fleet_gateway.rdf.graph import Graph, integer, timestamp
from linked_fleet_gateway.rdf.vocabulary import DCTERMS, LDP, LF, PROV, RDFS, XHV
from linked_fleet_gateway.resources.description import InSteps
from linked_fleet_gateway.resources.paths import AUDIT as PATH
from linked_fleet_gateway.resources.paths import robot_of, robot_path
from linked_fleet_gateway.resources.resource import CONTAINER, Resource
from linked_fleet_gateway.runtime.audit_log import PAGE_SIZE, AuditEntry, AuditLog
from linked_fleet_gateway.runtime.log import current_request

_NOTHING_DONE = (401, 404, 405)
_LONGEST = 500


def record_request(connection: Connection, event: str, status: int | None, location: str = "") -> None:
    """Record a request that was executed, or refused although its resource was found."""
    if status in _NOTHING_DONE:
        return
    audit: AuditLog = connection.services.audit
    asked, path = current_request(), connection.scope["path"][:_LONGEST]
    audit.record(
        connection.caller_name, event, path, robot_of(path) or "", "" if status is None else str(status),
        "" if asked is None else asked.id, location.removeprefix(connection.base).partition("?")[0],
    )  # fmt: skip


async def audit_resource(connection: Connection) -> Resource:
    """Return a page of entries, newest first. Raises NotFound, RedisUnavailable."""
    path: str = connection.scope["path"]
    audit: AuditLog = connection.services.audit
    try:
        entries = await audit.read_page(path.removeprefix(PATH).removeprefix("/"))
    except ValueError as error:
        raise NotFound(f"There is no such page: {error}.") from error
    steps = partial(_steps, connection.base, path, entries)
    return Resource(path, "Audit", InSteps(steps), CONTAINER, publishes_changes=False)


def is_audit_path(path: str) -> bool:
    return path == PATH or path.startswith(PATH + "/")


def add_audit_link(connection: Connection, resource: Resource) -> Resource:
    """Add a link to the audit log to the fleet and its link set, for callers who may read it.

    The RDF does not contain the link, because it is equal for all callers with the same view, like messages about it.
    """
    if not connection.caller.has_any_right(AUDIT_RIGHTS, None):
        return resource
    if resource.path == "/":
        return resource.replace(own_paths=(*resource.own_paths, PATH))
    of = resource.linkset_of
    return resource if of is None or of.path != "/" else resource.replace(linkset_of=add_audit_link(connection, of))


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
