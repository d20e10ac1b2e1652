"""JSON values of components as RDF, and back.

A number is a ``maths:Scalar`` with number and unit, a text or boolean a literal, an array an RDF list, an object a
blank node whose members are linked by the predicates of their places. Null is ``lf:unknown``.
"""

from collections.abc import Generator, Iterator, Mapping
from typing import Any

from pyoxigraph import Literal, NamedNode

from linked_fleet_agent.wire.schema import MAX_NUMBER, Schema
from linked_fleet_gateway.extensions.components.places import Place, is_iri, member_iri, place_of
from linked_fleet_gateway.extensions.components.things import ThingSchema
from linked_fleet_gateway.extensions.components.units import declared_unit, in_declared_unit
from linked_fleet_rdf.graph import Graph, Node, Term, integer, number
from linked_fleet_rdf.vocabulary import LF, MATHS, RDF, VOM, XSD
from linked_fleet_shacl import Data

_UNDECLARED = Schema(type="object")
_STEP = 50
"""Items of an array that are added in one step."""


def add_value(graph: Graph, place: Place, value: object, subject: Node, predicate: NamedNode) -> None:
    """Add a value, also one that does not conform to its schema."""
    graph.add(subject, predicate, _term(graph, place, value))


def add_value_in_steps(
    graph: Graph, place: Place, value: object, subject: Node, predicate: NamedNode
) -> Iterator[None]:
    """Add a value with many values in it, in steps of about a millisecond."""
    term = yield from _term_in_steps(graph, place, value)
    graph.add(subject, predicate, term)


def _term_in_steps(graph: Graph, place: Place, value: object) -> Generator[None, None, Term]:
    if isinstance(value, list):
        terms = list[Term]()
        for number, each in enumerate(value):
            if number % _STEP == 0:
                yield
            terms.append((yield from _term_in_steps(graph, place.items or place, each)))
        return graph.collection(terms)
    if isinstance(value, Mapping):
        node = graph.blank()
        for name, member in value.items():
            known = _member(place, name)
            graph.add(node, known.predicate, (yield from _term_in_steps(graph, known, member)))
        return node
    return _term(graph, place, value)


def has_more_values(value: object, most: int) -> bool:
    """Return True if there are more than ``most`` values in a value."""
    pending, count = [value], 0
    while pending and count <= most:
        each = pending.pop()
        inner = list(each.values()) if isinstance(each, Mapping) else each if isinstance(each, list) else []
        count += len(inner)
        pending += inner
    return count > most


def add_members(graph: Graph, place: Place, value: Mapping[str, Any], node: Node) -> None:
    """Add the members of an object to ``node``. A member that is not declared gets the own term that it would have."""
    for name, member in value.items():
        known = _member(place, name)
        add_value(graph, known, member, node, known.predicate)


def _member(place: Place, name: str) -> Place:
    return place.members.get(name) or place_of(_UNDECLARED, member_iri(place.term.value, name))


def _term(graph: Graph, place: Place, value: object) -> Term:
    if isinstance(value, bool):
        return Literal("true" if value else "false", datatype=XSD.boolean)
    if isinstance(value, int | float) or (value is None and place.schema.type in ("number", "integer")):
        return _scalar(graph, place.schema, value)
    if isinstance(value, str):
        names = isinstance(place.schema, ThingSchema) and is_iri(value)
        return NamedNode(value) if names else Literal(value)
    if isinstance(value, list | tuple):
        return graph.collection([_term(graph, place.items or place, each) for each in value])
    if isinstance(value, Mapping):
        node = graph.blank()
        add_members(graph, place, value, node)
        return node
    return LF.unknown


def _scalar(graph: Graph, schema: Schema, value: float | None) -> Node:
    node = graph.blank(MATHS.Scalar)
    graph.add(node, VOM.numericalValue, _number(schema, value))
    graph.unit(node, declared_unit(schema))
    return node


def _number(schema: Schema, value: float | None) -> Term:
    """Return an xsd:float, as for all values of robots; an xsd:integer for integers and where no float is equal."""
    if value is None or not abs(value) <= MAX_NUMBER:
        return integer(value) if isinstance(value, int) else number(value)
    if value == int(value) and (schema.type == "integer" or float(value) != value):
        return integer(int(value))
    return number(value)


def value_in(data: Data, place: Place, term: Term) -> Any:
    """Return the JSON value of ``term``, which conforms to the shape of the place; None for ``lf:unknown``."""
    return None if term == LF.unknown else _READERS[place.schema.type](data, place, term)


def members_in(data: Data, place: Place, node: Term) -> dict[str, Any]:
    """Return the JSON object whose members are stated about ``node``, in the order of the schema."""
    return {
        name: value_in(data, member, found[0])
        for name, member in place.members.items()
        if (found := data.objects(node, member.predicate))
    }


def _items_in(data: Data, place: Place, head: Term) -> list[Any]:
    assert place.items is not None
    return [value_in(data, place.items, each) for each in _listed(data, head)]


def _listed(data: Data, cell: Term) -> Iterator[Term]:
    while cell != RDF.nil:
        yield data.objects(cell, RDF.first)[0]
        (cell,) = data.objects(cell, RDF.rest)


def _number_in(data: Data, place: Place, node: Term) -> float | None:
    (literal,) = data.objects(node, VOM.numericalValue)
    stated = data.number(literal) if isinstance(literal, Literal) else None
    if stated is None:
        return None
    plain = stated if isinstance(stated, int) else float(stated)
    return in_declared_unit(place.schema, plain, data.objects(node, VOM.unit))


_READERS = {
    "boolean": lambda _data, _place, term: term.value in ("true", "1"),
    "string": lambda _data, _place, term: term.value,
    "integer": _number_in,
    "number": _number_in,
    "array": _items_in,
    "object": members_in,
}
