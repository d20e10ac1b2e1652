"""A part of the audit as triples, in plain JSON and as CSV. Pure."""

import json
from collections.abc import Iterator, Mapping

from msgspec import Struct

from linked_fleet_base.spreadsheet import csv_table
from linked_fleet_gateway.api import (
    DCTERMS,
    LDP,
    RDFS,
    Graph,
    Literal,
    NamedNode,
    Namespace,
    integer,
    robot_path,
    timestamp,
)
from linked_fleet_gateway.extensions.audit.entry import AuditEntry
from linked_fleet_gateway.extensions.audit.query import Query
from linked_fleet_gateway.extensions.audit.search import BY_PAGE, Found
from linked_fleet_gateway.faces import lexical_time
from linked_fleet_rdf.vocabulary import LF as CORE
from linked_fleet_rdf.vocabulary import PROV, XHV

LF: Namespace = CORE.extended("Audit filter newestEntry byPage")
PATH = "/audit"
_COLUMNS = ("time", "who", "what", "target", "robot", "status", "reason", "result", "request", "by page", "id")


class Selected(Struct, frozen=True):
    """The entries that a query has selected; ``addresses``: those of the paths in them that lead to a resource."""

    query: Query
    found: Found
    addresses: Mapping[str, str]

    @property
    def next_query(self) -> str:
        """The query of the entries before these; empty if there are none."""
        return self.query.at(self.found.entries[-1][0]) if self.found.has_more else ""


def steps(graph: Graph, base: str, selected: Selected) -> Iterator[None]:
    """Describe a part of the audit, one entry in each step."""
    iri, found = NamedNode(base + PATH), selected.found
    graph.a(iri, LF.Audit, LDP.BasicContainer, LDP.Container)
    graph.add(iri, DCTERMS.title, Literal("Audit"))
    graph.add(iri, RDFS.seeAlso, NamedNode(base + "/"))
    if selected.query.filters or selected.query.before:
        graph.add(iri, LF.filter, Literal(selected.query.at(selected.query.before)))
    if found.newest:
        graph.add(iri, LF.newestEntry, Literal(found.newest))
    if selected.next_query:
        graph.add(iri, XHV.next, NamedNode(f"{iri.value}?{selected.next_query}"))
    for id, entry in found.entries:
        one = NamedNode(f"{iri.value}#{id}")
        graph.add(iri, LDP.contains, one)
        _describe_entry(graph, base, one, entry, selected.addresses)
        yield


def _describe_entry(graph: Graph, base: str, iri: NamedNode, entry: AuditEntry, addresses: Mapping[str, str]) -> None:
    """Describe an entry. What is gone is a literal and no link, and a target may be anything."""
    graph.a(iri, PROV.Activity)
    graph.add(iri, DCTERMS.title, Literal(f"{entry.what} {entry.target}"))
    graph.add(iri, DCTERMS.created, timestamp(entry.at_ns))
    agent = graph.blank(PROV.Agent)
    graph.add(iri, PROV.wasAssociatedWith, agent)
    graph.add(agent, DCTERMS.title, Literal(entry.who))
    if entry.target in addresses:
        graph.add(iri, PROV.used, NamedNode(addresses[entry.target]))
    if entry.result:
        graph.add(iri, DCTERMS.description, Literal(entry.result))
    if entry.result in addresses:
        graph.add(iri, PROV.generated, NamedNode(addresses[entry.result]))
    if entry.robot:
        graph.add(iri, LF.ofRobot, NamedNode(base + robot_path(entry.robot)))
    if entry.outcome:
        graph.add(iri, LF.status, integer(int(entry.outcome)))
    if entry.reason:
        graph.add(iri, LF.reason, Literal(entry.reason))
    if entry.request:
        graph.add(iri, DCTERMS.identifier, Literal(entry.request))
    if iri.value.endswith(BY_PAGE):
        graph.add(iri, LF.byPage, Literal(True))


# -- plain JSON and CSV -----------------------------------------------------------------------------------------------


def audit_json(base: str, selected: Selected) -> bytes:
    """Return a part of the audit in plain JSON."""
    entries = [_entry_json(id, entry, selected.addresses) for id, entry in selected.found.entries]
    said: dict[str, object] = {"newest": selected.found.newest, "entries": entries}
    if selected.next_query:
        said["next"] = f"{base}{PATH}?{selected.next_query}"
    return json.dumps(said, ensure_ascii=False).encode()


def _entry_json(id: str, entry: AuditEntry, addresses: Mapping[str, str]) -> dict[str, object]:
    links = {"targetAddress": entry.target, "resultAddress": entry.result}
    said: dict[str, object] = {
        "id": id,
        "time": lexical_time(entry.at_ns),
        "who": entry.who,
        "what": entry.what,
        "target": entry.target,
        "robot": entry.robot,
        "status": int(entry.outcome) if entry.outcome else None,
        "reason": entry.reason,
        "result": entry.result,
        "request": entry.request,
        "byPage": id.endswith(BY_PAGE),
        **{name: addresses[path] for name, path in links.items() if path in addresses},
    }
    return {name: value for name, value in said.items() if value not in ("", None)}


def audit_csv(selected: Selected) -> bytes:
    """Return a part of the audit as CSV, one entry in each line."""
    return csv_table(_COLUMNS, (_line(id, each) for id, each in selected.found.entries))


def _line(id: str, entry: AuditEntry) -> tuple[str, ...]:
    by_page = "yes" if id.endswith(BY_PAGE) else "no"
    return (
        lexical_time(entry.at_ns), entry.who, entry.what, entry.target, entry.robot, entry.outcome, entry.reason,
        entry.result, entry.request, by_page, id,
    )  # fmt: skip
