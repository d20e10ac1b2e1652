"""Validation of resources by their blueprints (SHACL), in a separate process.

Shapes from the server may take unbounded time or memory, so the process is killed at a limit. They may not access the
network: SPARQL (which can fetch) and scripts are not run.
"""

import multiprocessing
import time
from collections.abc import Sequence
from dataclasses import dataclass
from multiprocessing.connection import Connection

import rdflib
from rdflib import RDF, URIRef

from linked_fleet_client.conform.rdf import RDFS, SH, types, untrusted_input
from linked_fleet_client.graphs import load_exactly

_START_S = 20.0
_PROGRAMS = (SH.sparql, SH.select, SH.ask, SH.construct, SH.jsFunctionName, SH.js, SH.rule, SH.expression)


@dataclass(frozen=True)
class Case:
    """A resource and its blueprint, as Turtle; ``shape`` is the IRI that it names as blueprint."""

    url: str
    node: str
    data: bytes
    blueprint: str
    shapes: bytes
    shape: str


@dataclass(frozen=True)
class Conformance:
    """A result. ``conforms`` is None if undecided; ``reason`` gives the cause or the violation."""

    conforms: bool | None
    reason: str = ""


def validate(cases: Sequence[Case], timeout_s: float) -> list[Conformance]:
    """Return one result for each case, in order. Cases not reached within ``timeout_s`` are undecided."""
    context = multiprocessing.get_context("spawn")
    ours, theirs = context.Pipe(duplex=False)
    worker = context.Process(target=_work, args=(list(cases), theirs), daemon=True)
    worker.start()
    theirs.close()
    results: list[Conformance] = []
    deadline = time.monotonic() + timeout_s + _START_S
    try:
        while len(results) < len(cases) and ours.poll(max(0.0, deadline - time.monotonic())):
            results.append(Conformance(*ours.recv()))
    except EOFError:
        results.append(Conformance(None, "the validation broke down"))
    finally:
        worker.kill()
        worker.join()
        worker.close()
        ours.close()
    missing = len(cases) - len(results)
    return results + [Conformance(None, f"not validated within {timeout_s:g} s")] * missing


def _work(cases: list[Case], results: Connection) -> None:
    with untrusted_input():
        for case in cases:
            results.send(validate_case(case))


def validate_case(case: Case) -> tuple[bool | None, str]:
    """Return the fields of a ``Conformance``; in this process, without a limit of time."""
    import pyshacl  # slow to import, and needed only here

    data, shapes = (
        load_exactly(case.data.decode(), "turtle", case.url),
        load_exactly(case.shapes.decode(), "turtle", case.blueprint),
    )
    if any((None, program, None) in shapes for program in _PROGRAMS):
        return None, "the blueprint has programs, which are not run"
    if (None, RDF.type, SH.NodeShape) not in shapes and (None, SH.property, None) not in shapes:
        return None, "the blueprint has no SHACL shapes"
    node = URIRef(case.node)
    if not _aimed_at(data, shapes, node):
        if (URIRef(case.shape), RDF.type, SH.NodeShape) not in shapes:
            return None, "no shape of the blueprint is about this resource"
        shapes.add((URIRef(case.shape), SH.targetNode, node))
    try:
        conforms, report, text = pyshacl.validate(data, shacl_graph=shapes, inference="none")
    except Exception as error:  # noqa: BLE001 - the shapes are untrusted, and pyshacl raises many kinds
        return None, f"the blueprint cannot be used: {type(error).__name__} {error}"
    return bool(conforms), "" if conforms else _violation(report, text)


def _aimed_at(data: rdflib.Graph, shapes: rdflib.Graph, node: URIRef) -> bool:
    """Return True if a target of any shape selects the node; otherwise everything would conform."""
    classes = set(types(data, node))
    aimed = any(target in classes for target in shapes.objects(None, SH.targetClass))
    aimed = aimed or (None, SH.targetNode, node) in shapes
    aimed = aimed or any((node, path, None) in data for path in shapes.objects(None, SH.targetSubjectsOf))
    aimed = aimed or any((None, path, node) in data for path in shapes.objects(None, SH.targetObjectsOf))
    implicit = set(shapes.subjects(RDF.type, SH.NodeShape)) & set(shapes.subjects(RDF.type, RDFS.Class))
    return aimed or bool(classes & implicit)


def _violation(report: rdflib.Graph, text: str) -> str:
    for result in report.subjects(RDF.type, SH.ValidationResult):
        path, message = report.value(result, SH.resultPath), report.value(result, SH.resultMessage)
        return f"{path or 'the resource'}: {message}"
    return text
