"""The results of pySHACL for a body, to compare with those of a compiled shape.

pySHACL validates one focus node, ignoring targets. ``pyshacl_finds`` repairs two of its faults: literals keep their
lexical form (rdflib would rewrite 01 as 1), and only numbers are ordered (pySHACL orders NaN by accident, and literals
of different types by the names of the types).
"""

import logging
import math
import warnings
from collections import Counter
from collections.abc import Iterable, Sequence
from typing import Any

import pyshacl
import pytest
import rdflib
from pyoxigraph import BlankNode, NamedNode, RdfFormat, Triple, parse
from pyshacl.constraints.core import value_range_constraints
from pyshacl.pytypes import SHACLExecutor
from pyshacl.shapes_graph import ShapesGraph

from linked_fleet_rdf.vocabulary import PREFIXES
from linked_fleet_shacl import CompiledGraph, Data, compile_shape, report
from linked_fleet_shacl.terms import RDF, SHACL, XSD, Namespace, Node, Term

logging.getLogger("rdflib.term").setLevel(logging.ERROR)
_compare = value_range_constraints.compare_literal

EX = Namespace("http://example.org/", "body Shape p q r a b C D type")
_PREFIXES = "".join(f"@prefix {prefix}: <{iri}> . " for prefix, iri in {**PREFIXES, "ex": EX.iri}.items())
Results = Counter[tuple[object, ...]]  # of all properties of each result in a report but its message
_COMPARED = (SHACL.focusNode, SHACL.value, SHACL.sourceConstraintComponent, SHACL.resultSeverity, SHACL.sourceShape)
Found = set[tuple[str, str, str, str]]  # focus, path, value and component of the top-level results


def turtle(text: str) -> list[Triple]:
    """Parse a text in which the gateway's prefixes and ``ex`` are declared."""
    return [quad.triple for quad in parse(_PREFIXES + text, format=RdfFormat.TURTLE, base_iri=EX.iri)]


def to_rdflib(term: Term) -> Any:
    if isinstance(term, NamedNode):
        return rdflib.URIRef(term.value)
    if isinstance(term, BlankNode):
        return rdflib.BNode(term.value)
    plain = term.language or term.datatype == XSD.string
    datatype = None if plain else rdflib.URIRef(term.datatype.value)
    with warnings.catch_warnings(action="ignore"):  # about invalid booleans
        return rdflib.Literal(term.value, lang=term.language, datatype=datatype, normalize=False)


def to_graph(triples: Iterable[Triple]) -> rdflib.Graph:
    graph = rdflib.Graph()
    for t in triples:
        graph.add((to_rdflib(t.subject), to_rdflib(t.predicate), to_rdflib(t.object)))
    return graph


def _compare_numbers(left: rdflib.Literal, right: rdflib.Literal) -> int:
    for literal in (left, right):
        ordered = literal.datatype in rdflib.term._NUMERIC_LITERAL_TYPES and not literal.ill_typed
        if not ordered or (isinstance(literal.value, float) and math.isnan(literal.value)):
            raise TypeError("no place among the numbers")
    return _compare(left, right)


def pyshacl_finds(shapes: Sequence[Triple], shape: Node, body: Sequence[Triple], focus: Node) -> Found:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(value_range_constraints, "compare_literal", _compare_numbers)
        return unrepaired_pyshacl_finds(shapes, shape, body, focus)


def unrepaired_pyshacl_finds(shapes: Sequence[Triple], shape: Node, body: Sequence[Triple], focus: Node) -> Found:
    graph = to_graph(shapes)
    graph.add((to_rdflib(shape), rdflib.RDF.type, rdflib.SH.NodeShape))
    known = ShapesGraph(graph)
    judge = {each.node: each for each in known.shapes}[to_rdflib(shape)]
    conforms, results = judge.validate(SHACLExecutor(), to_graph(body), focus=to_rdflib(focus))
    assert conforms == (not results)
    return {_key(node, triples) for _, node, triples in results}


def _key(result: rdflib.BNode, triples: list[tuple[rdflib.BNode, rdflib.URIRef, object]]) -> tuple[str, str, str, str]:
    about = {p: o[1] if isinstance(o, tuple) else o for s, p, o in triples if s == result}
    sh = rdflib.SH
    return tuple(_n3(about.get(p)) for p in (sh.focusNode, sh.resultPath, sh.value, sh.sourceConstraintComponent))  # type: ignore[return-value]


def _n3(term: object) -> str:
    """Return N3 without rdflib's abbreviations, so that 1.0 and 1 stay different."""
    if isinstance(term, rdflib.Literal):
        return f"{str(term)!r}^^{term.datatype or rdflib.XSD.string}@{term.language}"
    return "" if term is None else f"{type(term).__name__} {term}"


def compiled_finds(shapes: Sequence[Triple], shape: Node, body: Sequence[Triple], focus: Node) -> Found:
    found = compile_shape(shapes, shape).check(Data(body), focus)
    return {
        tuple(_n3(t and to_rdflib(t)) for t in (v.focus, v.path, v.value, v.component))  # type: ignore[misc]
        for v in found
    }


def results(about: Data, root: Node) -> Results:
    """Return the results of a report. Blank nodes are not distinguished."""
    found: Results = Counter()
    for result in about.objects(root, SHACL.result):
        values = (tuple(map(_plain, about.objects(result, each))) for each in _COMPARED)
        paths = (_path(about, path) for path in about.objects(result, SHACL.resultPath))
        found[(*values, *paths)] += 1
    conforms = [term.value in ("true", "1") for term in about.objects(root, SHACL.conforms)]
    assert conforms == [not found]
    return found


def _plain(term: Term) -> object:
    return "blank" if isinstance(term, BlankNode) else term


def _path(about: Data, path: Term) -> object:
    if not isinstance(path, BlankNode):
        return path
    if first := about.objects(path, RDF.first):
        return (_path(about, first[0]), _path(about, about.objects(path, RDF.rest)[0]))
    return tuple((kind, *(_path(about, each) for each in inner)) for kind, inner in about.statements(path).items())


def _of_report(triples: Sequence[Triple]) -> Results:
    about = Data(triples)
    (root,) = about.subjects(RDF.type, SHACL.ValidationReport)
    return results(about, root)  # type: ignore[arg-type]


def reported(shapes: CompiledGraph, data: Sequence[Triple]) -> Results:
    """Return the report of compiled shapes with targets on ``data``."""
    triples = shapes.shapes[0][0].triples if shapes.shapes else {}
    return _of_report([Triple(*each) for each in report(shapes.check(Data(data)), triples)])


def pyshacl_reports(shapes: Sequence[Triple], data: Sequence[Triple]) -> Results:
    """Return the report of pySHACL on ``data``, by the targets of the shapes."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(value_range_constraints, "compare_literal", _compare_numbers)
        _, found, _ = pyshacl.validate(to_graph(data), shacl_graph=to_graph(shapes), inference="none", advanced=False)
    return _of_report([q.triple for q in parse(found.serialize(format="nt"), format=RdfFormat.N_TRIPLES)])
