"""The resource ``/audit`` with its pages."""

from collections.abc import Iterator
from functools import partial

from linked_fleet_gateway.api import (
    CONTAINER,
    DCTERMS,
    LDP,
    RDFS,
    FleetBranch,
    Graph,
    InSteps,
    Literal,
    NamedNode,
    NotFound,
    RequestView,
    Resource,
    Right,
    integer,
    robot_path,
    timestamp,
)
from linked_fleet_gateway.extensions.audit.log import PAGE_SIZE, AuditEntry, AuditLog
from linked_fleet_gateway.rdf.vocabulary import LF as CORE
from linked_fleet_gateway.rdf.vocabulary import PROV, XHV

LF = CORE.extended("Audit")
PATH = "/audit"
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
        return Resource(path, "Audit", InSteps(steps), CONTAINER, publishes_changes=False)

    return FleetBranch(PATH[1:], None, reading=RIGHTS, load=load)


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
