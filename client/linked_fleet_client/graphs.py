"""Graphs of received documents: parsed by Oxigraph, stored by rdflib, or by Oxigraph if they are large.

``python -m bench.client_graphs`` measures the choice.
"""

from collections.abc import Iterable, Iterator
from typing import Any

from oxrdflib import OxigraphStore
from rdflib import XSD, BNode, Graph
from rdflib.plugins.stores.memory import Memory
from rdflib.term import Literal, Node

BIG = 250_000
"""Number of characters.

Small documents are read completely, for which rdflib's store is faster; large ones rarely are.
"""


class _Received(Memory):
    """rdflib's store. Blank nodes of a loaded document get fresh identifiers, because oxrdflib keeps their labels."""

    filling = True

    def addN(self, quads: Iterable[Any]) -> None:  # noqa: N802 (rdflib's name)
        named: dict[Node, BNode] = {}
        own = ((_own(s, named), p, _own(o, named), context) for s, p, o, context in quads)
        super().addN(own if self.filling else quads)


def _own(term: Node, named: dict[Node, BNode]) -> Node:
    if not isinstance(term, BNode):
        return _plain(term)
    if term not in named:
        named[term] = BNode()
    return named[term]


class _Big(OxigraphStore):
    """Oxigraph's store, which renames blank nodes by itself."""

    def triples(self, triple_pattern: Any, context: Graph | None = None) -> Iterator[Any]:
        for (subject, predicate, value), contexts in super().triples(triple_pattern, context):
            yield (subject, predicate, _plain(value)), contexts


def load(text: str, syntax: str, base: str) -> Graph:
    """Return the graph of a document in ``turtle`` or ``nt``. Raises SyntaxError or ValueError if it is invalid."""
    return load_big(text, syntax, base) if len(text) > BIG else load_exactly(text, syntax, base)


def load_exactly(text: str, syntax: str, base: str) -> Graph:
    """Load with the original lexical forms, whatever the size. Oxigraph's store turns ``1.50`` into ``1.5``."""
    store = _Received()
    graph = _of_rdf_1_1(Graph(store).parse(data=text, format=f"ox-{syntax}", publicID=base), text)
    store.filling = False
    return graph


def load_big(text: str, syntax: str, base: str) -> Graph:
    return _of_rdf_1_1(Graph(_Big()).parse(data=text, format=f"ox-{syntax}", publicID=base), text)


def _of_rdf_1_1(graph: Graph, text: str) -> Graph:
    """Refuse triple terms (RDF 1.2), which rdflib does not support and oxrdflib returns as tuples."""
    if "<<" in text and any(isinstance(value, tuple) for value in graph.objects()):
        raise ValueError("a triple term, which RDF 1.1 does not have")
    return graph


def copy_in_memory(triples: Iterable[tuple[Node, Node, Node]]) -> Graph:
    """Return a copy in rdflib's own store, which pySHACL reads twice as fast, with plain strings."""
    copy = Graph()
    for subject, predicate, value in triples:
        copy.add((subject, predicate, _plain(value)))
    return copy


def _plain(term: Node) -> Node:
    """Normalize strings: rdflib treats ``"a"`` and ``"a"^^xsd:string`` as two terms, oxrdflib returns the latter for
    both.
    """
    return Literal(str(term)) if isinstance(term, Literal) and term.datatype == XSD.string else term
