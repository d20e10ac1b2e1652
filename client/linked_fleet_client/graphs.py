"""Graphs of received documents: parsed by Oxigraph, kept by rdflib, or in Oxigraph if they are big.

README.md has the figures behind this choice.
"""

from collections.abc import Iterable, Iterator
from typing import Any

from oxrdflib import OxigraphStore
from rdflib import XSD, BNode, Graph
from rdflib.plugins.stores.memory import Memory
from rdflib.term import Literal, Node

BIG = 250_000
"""Characters. Small documents are read whole, in which rdflib's store is faster; big ones in part, if at all."""


class _Received(Memory):
    """rdflib's store. Blank nodes of the document that fills it get names of their own: oxrdflib leaves the labels."""

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
    """Oxigraph's store. It names blank nodes anew by itself."""

    def triples(self, triple_pattern: Any, context: Graph | None = None) -> Iterator[Any]:
        for (subject, predicate, value), contexts in super().triples(triple_pattern, context):
            yield (subject, predicate, _plain(value)), contexts


def load(text: str, syntax: str, base: str) -> Graph:
    """The graph of a document; ``syntax`` is ``turtle`` or ``nt``. SyntaxError or ValueError if it is not valid."""
    return load_big(text, syntax, base) if len(text) > BIG else load_exactly(text, syntax, base)


def load_exactly(text: str, syntax: str, base: str) -> Graph:
    """The same with its lexical forms, whatever its size: Oxigraph's store keeps ``1.50`` as ``1.5``."""
    store = _Received()
    graph = _of_rdf_1_1(Graph(store).parse(data=text, format=f"ox-{syntax}", publicID=base), text)
    store.filling = False
    return graph


def load_big(text: str, syntax: str, base: str) -> Graph:
    return _of_rdf_1_1(Graph(_Big()).parse(data=text, format=f"ox-{syntax}", publicID=base), text)


def _of_rdf_1_1(graph: Graph, text: str) -> Graph:
    """Refuse triple terms (RDF 1.2), which rdflib does not know and oxrdflib gives as tuples."""
    if "<<" in text and any(isinstance(value, tuple) for value in graph.objects()):
        raise ValueError("a triple stands in place of a term, as RDF 1.1 does not have it")
    return graph


def in_memory(triples: Iterable[tuple[Node, Node, Node]]) -> Graph:
    """A copy in rdflib's own store, which pySHACL reads twice as fast, with plain strings."""
    copy = Graph()
    for subject, predicate, value in triples:
        copy.add((subject, predicate, _plain(value)))
    return copy


def _plain(term: Node) -> Node:
    """rdflib takes ``"a"`` and ``"a"^^xsd:string`` for two terms, and oxrdflib gives the latter for both."""
    return Literal(str(term)) if isinstance(term, Literal) and term.datatype == XSD.string else term
