"""Faults as triples and in plain JSON. Pure."""

import json

from pyoxigraph import Literal, NamedNode

from linked_fleet_gateway.api import Graph, Member, integer, timestamp
from linked_fleet_gateway.extensions.faults.fault import Fault
from linked_fleet_gateway.extensions.faults.links import Links
from linked_fleet_gateway.extensions.faults.terms import LF, STATES
from linked_fleet_rdf.vocabulary import DCTERMS, VOM


def describe(graph: Graph, member: Member[Fault], links: Links) -> None:
    """Add all statements about a fault, besides its types and title."""
    iri, fault = member.iri, member.record
    trouble = fault.trouble
    graph.add(iri, LF.faultKind, Literal(trouble.kind))
    graph.add(iri, LF.severity, LF.terms[trouble.severity])
    graph.add(iri, LF.state, STATES[fault.state])
    graph.add(iri, LF.since, timestamp(fault.since_ns))
    graph.add(iri, LF.lastRaised, timestamp(fault.last_ns))
    graph.add(iri, LF.count, integer(fault.before + fault.count))
    graph.add(iri, LF.present, Literal(fault.present))
    graph.add(iri, LF.latched, Literal(trouble.latched))
    _describe_people(graph, iri, fault)
    for predicate, path in zip((LF.about, LF.evidence, LF.recording), links, strict=True):
        if path:
            graph.add(iri, predicate, member.view.iri(path))
    for name, value in trouble.values.items():
        node = graph.blank()
        graph.add(iri, LF.valuesThen, node)
        graph.add(node, DCTERMS.title, Literal(name))
        graph.add(node, VOM.numericalValue, Literal(value))


def _describe_people(graph: Graph, iri: NamedNode, fault: Fault) -> None:
    if fault.acknowledged_ns:
        graph.add(iri, LF.acknowledgedAt, timestamp(fault.acknowledged_ns))
        graph.add(iri, LF.acknowledgedBy, Literal(fault.acknowledged_by))
    if fault.remark:
        graph.add(iri, LF.remark, Literal(fault.remark))
    if fault.cleared_ns:
        graph.add(iri, LF.clearedAt, timestamp(fault.cleared_ns))
        if fault.cleared_by:
            graph.add(iri, LF.clearedBy, Literal(fault.cleared_by))


def fault_json(member: Member[Fault], links: Links) -> bytes:
    """Return a fault in plain JSON."""
    fault, base = member.record, member.view.base
    trouble = fault.trouble
    told: dict[str, object] = {
        "title": trouble.says,
        "faultKind": trouble.kind,
        "severity": trouble.severity,
        "state": fault.state,
        "since": timestamp(fault.since_ns).value,
        "lastRaised": timestamp(fault.last_ns).value,
        "count": fault.before + fault.count,
        "present": fault.present,
        "latched": trouble.latched,
    }
    more: dict[str, object] = {
        "acknowledgedBy": fault.acknowledged_by,
        "acknowledgedAt": fault.acknowledged_ns and timestamp(fault.acknowledged_ns).value,
        "remark": fault.remark,
        "clearedBy": fault.cleared_by,
        "clearedAt": fault.cleared_ns and timestamp(fault.cleared_ns).value,
        **{name: path and base + path for name, path in links._asdict().items()},
        "valuesThen": trouble.values,
    }
    return json.dumps(told | {name: value for name, value in more.items() if value}, ensure_ascii=False).encode()
