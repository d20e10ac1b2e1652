"""What pySHACL finds in a body, to compare with what a compiled shape finds there.

pySHACL is asked about one focus node, without its targets. ``pyshacl_finds`` has two repairs: literals are as they were
written, where rdflib would rewrite 01 as 1; and nothing is less or more that has no place among the numbers, where
pySHACL orders NaN by a quirk and literals of two types by the names of these.
"""

import logging
import math
import warnings
from collections.abc import Iterable, Sequence

import pytest
import rdflib
from pyoxigraph import BlankNode, NamedNode, Triple
from pyshacl.constraints.core import value_range_constraints
from pyshacl.pytypes import SHACLExecutor
from pyshacl.shapes_graph import ShapesGraph

from gateway.rdf.compiled import Data, compile_shape
from gateway.rdf.graph import Node, Term
from gateway.rdf.vocabulary import XSD

logging.getLogger("rdflib.term").setLevel(logging.ERROR)
_compare = value_range_constraints.compare_literal

Found = set[tuple[str, str, str, str]]  # focus, path, value and component of the results at the top


def to_rdflib(term: Term) -> rdflib.term.Identifier:
    if isinstance(term, NamedNode):
        return rdflib.URIRef(term.value)
    if isinstance(term, BlankNode):
        return rdflib.BNode(term.value)
    plain = term.language or term.datatype == XSD.string
    datatype = None if plain else rdflib.URIRef(term.datatype.value)
    with warnings.catch_warnings(action="ignore"):  # of odd booleans
        return rdflib.Literal(term.value, lang=term.language, datatype=datatype, normalize=False)


def _graph(triples: Iterable[Triple]) -> rdflib.Graph:
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
    graph = _graph(shapes)
    graph.add((to_rdflib(shape), rdflib.RDF.type, rdflib.SH.NodeShape))
    known = ShapesGraph(graph)
    judge = {each.node: each for each in known.shapes}[to_rdflib(shape)]
    conforms, results = judge.validate(SHACLExecutor(), _graph(body), focus=to_rdflib(focus))
    assert conforms == (not results)
    return {_key(node, triples) for _, node, triples in results}


def _key(result: rdflib.BNode, triples: list[tuple[rdflib.BNode, rdflib.URIRef, object]]) -> tuple[str, str, str, str]:
    about = {p: o[1] if isinstance(o, tuple) else o for s, p, o in triples if s == result}
    sh = rdflib.SH
    return tuple(_n3(about.get(p)) for p in (sh.focusNode, sh.resultPath, sh.value, sh.sourceConstraintComponent))  # type: ignore[return-value]


def _n3(term: object) -> str:
    """N3 without rdflib's abbreviations, so that 1.0 and 1 stay two."""
    if isinstance(term, rdflib.Literal):
        return f"{str(term)!r}^^{term.datatype or rdflib.XSD.string}@{term.language}"
    return "" if term is None else f"{type(term).__name__} {term}"


def compiled_finds(shapes: Sequence[Triple], shape: Node, body: Sequence[Triple], focus: Node) -> Found:
    found = compile_shape(shapes, shape).check(Data(body), focus)
    return {
        tuple(_n3(t and to_rdflib(t)) for t in (v.focus, v.path, v.value, v.component))  # type: ignore[misc]
        for v in found
    }
