"""JSON values of components as RDF: the same value in both forms."""

from collections.abc import Sequence
from typing import Any

import msgspec
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from pyoxigraph import BlankNode, Literal, NamedNode, Triple

from component_schemas import ROBOT, formed, schemas
from linked_fleet_agent.wire.components import Property
from linked_fleet_agent.wire.schema import Schema, value_problem
from linked_fleet_gateway.extensions.components.declarations import CompiledProperty, Input
from linked_fleet_gateway.extensions.components.places import Place, place_of
from linked_fleet_gateway.extensions.components.values import value_in
from linked_fleet_rdf.graph import METRE, UNITLESS, Graph
from linked_fleet_rdf.vocabulary import LF, MATHS, RDF, VOM, XSD
from linked_fleet_shacl import Data
from properties import examples

IRI = NamedNode(f"{ROBOT}part/value")
TERM = f"{ROBOT}vocabulary#part-property-value"


def place(**keywords: Any) -> Place:
    return place_of(msgspec.convert(keywords, Schema), TERM)


def stated(where: Place, value: object) -> Graph:
    graph = Graph()
    Input(where, is_value=True).describe(graph, IRI, value)
    return graph


def read(where: Place, triples: Sequence[Triple]) -> Any:
    data = Data(triples)
    (term,) = data.objects(IRI, LF.value)
    return value_in(data, where, term)


def relabelled(triples: Sequence[Triple]) -> list[Triple]:
    """The same graph with fresh blank nodes."""
    fresh: dict[BlankNode, BlankNode] = {}

    def term(each: Any) -> Any:
        return fresh.setdefault(each, BlankNode()) if isinstance(each, BlankNode) else each

    return [Triple(*map(term, each)) for each in triples]


def exact(value: object) -> object:
    """Tell 1 from true, and not from 1.0."""
    if isinstance(value, dict):
        return {name: exact(each) for name, each in value.items()}
    if isinstance(value, list):
        return [exact(each) for each in value]
    return (isinstance(value, bool), value)


@settings(max_examples=examples(10_000))
@given(st.data())
def test_a_value_is_the_same_after_its_way_through_rdf(data: st.DataObject) -> None:
    """In any order of triples, and with other blank nodes."""
    schema = data.draw(schemas())
    value = data.draw(formed(schema))
    assume(not value_problem(schema, value))
    where = place_of(schema, TERM)
    triples = data.draw(st.permutations(relabelled(stated(where, value).triples)))
    assert exact(read(where, triples)) == exact(value)


def test_a_number_is_written_as_all_properties_write_theirs() -> None:
    expected = Graph()
    expected.scalar(IRI, LF.value, 0.04, METRE)
    assert set(stated(place(type="number", unit="M"), 0.04).triples) == set(expected.triples)
    expected = Graph()
    expected.scalar(IRI, LF.value, None, METRE)
    assert set(stated(place(type="number", unit="M"), None).triples) == set(expected.triples)
    expected = Graph()
    expected.scalar(IRI, LF.value, 2.0, UNITLESS)
    assert set(stated(place(type="number"), 2).triples) == set(expected.triples)


def test_an_integer_and_a_number_beyond_floats_are_integers() -> None:
    for where, value in ((place(type="integer"), 2.0), (place(type="number"), 2**53 + 1)):
        assert Literal(str(int(value)), datatype=XSD.integer) in [t.object for t in stated(where, value).triples]


@pytest.mark.parametrize("type_", ["boolean", "integer", "number", "string", "array", "object"])
def test_null_is_unknown(type_: str) -> None:
    where = place(type=type_, **({"items": {"type": "string"}} if type_ == "array" else {}))
    triples = stated(where, None).triples
    assert LF.unknown in [each.object for each in triples]
    assert read(where, triples) is None


def test_arrays_are_lists_and_members_have_predicates() -> None:
    width = "https://example.org/terms#width"
    members = {"w": {"type": "string", "@type": width}, "v": {"type": "array", "items": {"type": "boolean"}}}
    data = Data(stated(place(type="object", properties=members), {"w": "x", "v": [True]}).triples)
    (node,) = data.objects(IRI, LF.value)
    assert data.objects(node, NamedNode(width)) == [Literal("x")]
    (cell,) = data.objects(node, NamedNode(f"{TERM}-v"))
    assert data.objects(cell, RDF.first) == [Literal("true", datatype=XSD.boolean)]
    assert data.objects(cell, RDF.rest) == [RDF.nil]


def test_a_client_may_state_a_number_in_another_unit_of_the_quantity() -> None:
    where = Input(place(type="number", unit="M", minimum=0.03, maximum=0.07), is_value=True)

    def sent(number: str, unit: str) -> Any:
        node = BlankNode("n")
        literal = Literal(number, datatype=XSD.decimal)
        scalar = [Triple(node, VOM.numericalValue, literal), Triple(node, VOM.unit, NamedNode(unit))]
        return where.read([Triple(IRI, LF.value, node), *scalar], IRI)

    unit = "http://qudt.org/vocab/unit/"
    assert sent("0.07", f"{unit}M") == (0.07, None)
    assert sent("70", f"{unit}MilliM") == (0.07, None)
    assert sent("30", f"{unit}MilliM") == (0.03, None)
    refused = sent("70.1", f"{unit}MilliM")[1]
    assert refused is not None and refused[0] == "value: value in MilliM: 70.1 must be at most 70"
    assert sent("0.05", f"{unit}DEG")[1] is not None
    assert sent("0.05", MATHS.Degree.value)[1] is not None


def test_a_property_states_its_value_and_reads_it() -> None:
    compiled = CompiledProperty(Property(schema=Schema(type="string")), TERM, NamedNode(TERM))
    graph = Graph()
    compiled.describe(graph, IRI, "ready")
    assert graph.triples == [Triple(IRI, LF.value, Literal("ready"))]
    assert compiled.input.read(graph.triples, IRI) == ("ready", None)
