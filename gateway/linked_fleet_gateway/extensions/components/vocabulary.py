"""The vocabulary of a robot: each own term of its components, with title, range, unit and limits."""

from collections.abc import Iterator

from pyoxigraph import Literal, NamedNode

from linked_fleet_agent.wire.schema import Schema
from linked_fleet_gateway.extensions.components.limits import forms_of
from linked_fleet_gateway.extensions.components.places import Place
from linked_fleet_gateway.extensions.components.units import declared_unit
from linked_fleet_rdf.graph import Graph
from linked_fleet_rdf.vocabulary import HYBRIT, MATHS, QUDT, RDF, RDFS, XSD

_RDF, _RDFS = RDF.extended("List"), RDFS.extended("range subPropertyOf isDefinedBy")
_QUDT = QUDT.extended("minInclusive minExclusive maxInclusive maxExclusive")
_RANGES = {
    "boolean": XSD.boolean,
    "string": XSD.string,
    "number": MATHS.Scalar,
    "integer": MATHS.Scalar,
    "array": _RDF.List,
}
"""The kind of values of a term; the objects of a robot have no class."""
_LIMITS = {
    "minimum": _QUDT.minInclusive,
    "exclusive_minimum": _QUDT.minExclusive,
    "maximum": _QUDT.maxInclusive,
    "exclusive_maximum": _QUDT.maxExclusive,
}


def describe_link(graph: Graph, place: Place) -> None:
    """Describe the own term of a property, which leads to its resource, and the terms in its value."""
    if place.predicate == place.term:
        _describe_term(graph, place, HYBRIT.Property)
    describe_terms(graph, place)


def describe_event(graph: Graph, term: NamedNode, title: str, description: str) -> None:
    """Describe the own term of an event, which leads to its resource."""
    graph.a(term, RDF.Property)
    graph.add(term, RDFS.label, Literal(title))
    if description:
        graph.add(term, RDFS.comment, Literal(description))
    graph.add(term, _RDFS.range, HYBRIT.Property)
    graph.add(term, _RDFS.isDefinedBy, NamedNode(term.value.partition("#")[0]))


def describe_terms(graph: Graph, place: Place) -> None:
    """Describe the own terms that link values within a value."""
    for each in _within(place):
        if each.predicate == each.term:
            _describe_term(graph, each, _RANGES.get(each.schema.type))
        describe_terms(graph, each)


def _within(place: Place) -> Iterator[Place]:
    yield from place.members.values()
    if place.items is not None:
        yield from _within(place.items)


def _describe_term(graph: Graph, place: Place, values: NamedNode | None) -> None:
    term, schema = place.term, place.schema
    graph.a(term, RDF.Property)
    graph.add(term, RDFS.label, Literal(place.title))
    if schema.description:
        graph.add(term, RDFS.comment, Literal(schema.description))
    if values is not None:
        graph.add(term, _RDFS.range, values)
    if place.stands_for is not None:
        graph.add(term, _RDFS.subPropertyOf, place.stands_for)
    graph.add(term, _RDFS.isDefinedBy, NamedNode(term.value.partition("#")[0]))
    _describe_numbers(graph, term, schema)


def _describe_numbers(graph: Graph, term: NamedNode, schema: Schema) -> None:
    if schema.unit:
        graph.unit(term, declared_unit(schema))
    for keyword, predicate in _LIMITS.items():
        limit = getattr(schema, keyword)
        if limit is not None:
            graph.add(term, predicate, forms_of(limit)[0])
