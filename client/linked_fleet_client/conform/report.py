"""Results as a table, as JSON and as EARL 1.0 in Turtle."""

import json
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime

import rdflib
from rdflib import RDF, XSD, BNode, Literal, URIRef

from linked_fleet_client.conform.rdf import DCTERMS
from linked_fleet_client.conform.requirements import Result
from linked_fleet_client.conform.verdict import printable

_EARL = rdflib.Namespace("http://www.w3.org/ns/earl#")
_REQUIREMENTS = "https://w3id.org/linked-fleet/requirements#"


@dataclass(frozen=True)
class Report:
    url: str
    date: datetime
    extent: str
    results: Sequence[Result]

    @property
    def violates_must(self) -> bool:
        return any(result.violates_must for result in self.results)


def table(report: Report) -> str:
    rows = [
        f"{r.requirement.name:<6} {r.level:<7} {r.verdict.outcome:<13} {printable(r.verdict.evidence)}"
        for r in report.results
    ]
    counts = Counter(str(result.verdict.outcome) for result in report.results)
    summary = ", ".join(f"{count} {outcome}" for outcome, count in sorted(counts.items()))
    broken = [result.requirement.name for result in report.results if result.violates_must]
    ending = f"musts failed: {', '.join(broken)}" if broken else "no must failed"
    return "\n".join([printable(report.extent), "", *rows, "", f"{summary}; {ending}"])


def as_json(report: Report) -> str:
    results = [
        {
            "id": result.requirement.name,
            "level": str(result.level),
            "outcome": str(result.verdict.outcome),
            "evidence": printable(result.verdict.evidence),
            "requirement": result.requirement.sentence,
        }
        for result in report.results
    ]
    head = {"subject": report.url, "date": report.date.isoformat(), "extent": printable(report.extent)}
    return json.dumps({**head, "conforms": not report.violates_must, "results": results}, indent=2, ensure_ascii=False)


def earl(report: Report) -> str:
    graph = rdflib.Graph()
    for prefix, namespace in (("earl", _EARL), ("dcterms", DCTERMS)):
        graph.bind(prefix, namespace)
    subject, software = URIRef(report.url), BNode()
    graph.add((subject, RDF.type, _EARL.TestSubject))
    graph.add((software, RDF.type, _EARL.Software))
    graph.add((software, DCTERMS.title, Literal("linked-fleet conform")))
    for result in report.results:
        _assert(graph, result, subject, software, report.date)
    return graph.serialize(format="turtle")


def _assert(graph: rdflib.Graph, result: Result, subject: URIRef, software: BNode, date: datetime) -> None:
    test = URIRef(_REQUIREMENTS + result.requirement.name)
    graph.add((test, RDF.type, _EARL.TestRequirement))
    graph.add((test, DCTERMS.title, Literal(f"{result.requirement.name} ({result.requirement.level})")))
    graph.add((test, DCTERMS.description, Literal(result.requirement.sentence, lang="en")))
    assertion, found = BNode(), BNode()
    graph.add((assertion, RDF.type, _EARL.Assertion))
    graph.add((assertion, _EARL.test, test))
    graph.add((assertion, _EARL.subject, subject))
    graph.add((assertion, _EARL.assertedBy, software))
    graph.add((assertion, _EARL.mode, _EARL.automatic))
    graph.add((assertion, _EARL.result, found))
    graph.add((found, RDF.type, _EARL.TestResult))
    graph.add((found, _EARL.outcome, _EARL[result.verdict.outcome]))
    graph.add((found, _EARL.info, Literal(f"{result.level}: {printable(result.verdict.evidence)}", lang="en")))
    graph.add((found, DCTERMS.date, Literal(date.isoformat(), datatype=XSD.dateTime)))
