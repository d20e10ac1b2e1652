"""rdflib graphs parsed by pyoxigraph: strictly, and many times faster than by rdflib."""

import functools
from collections.abc import Iterable

import pyoxigraph
import rdflib
from pyoxigraph import RdfFormat, Triple
from rdflib import BNode, Literal, URIRef
from rdflib.term import Node


def triples_of(body: bytes | str, base: str, form: RdfFormat = RdfFormat.TURTLE) -> list[Triple]:
    return [quad.triple for quad in pyoxigraph.parse(body, format=form, base_iri=base)]


def graph_of(triples: Iterable[Triple]) -> rdflib.Graph:
    graph = rdflib.Graph()
    for triple in triples:
        graph.add(tuple(map(_term, triple)))  # type: ignore[arg-type]
    return graph


def read(body: bytes | str, base: str, form: RdfFormat = RdfFormat.TURTLE) -> rdflib.Graph:
    """Parse ``body``, which was retrieved from ``base``."""
    return graph_of(triples_of(body, base, form))


@functools.lru_cache(200_000)
def _term(term: object) -> Node:
    if isinstance(term, pyoxigraph.NamedNode):
        return URIRef(term.value)
    if isinstance(term, pyoxigraph.BlankNode):
        return BNode(term.value)
    assert isinstance(term, pyoxigraph.Literal)
    plain = term.language or term.datatype.value == str(rdflib.XSD.string)  # like rdflib's own parsers
    return Literal(term.value, lang=term.language, datatype=None if plain else URIRef(term.datatype.value))
