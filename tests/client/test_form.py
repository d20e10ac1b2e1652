"""Forms from shapes: every body conforms to its shape, and an odd shape causes no failure."""

from decimal import Decimal
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rdflib import Graph, Namespace, URIRef
from rdflib.term import Node

from linked_fleet_client.errors import BadAnswer, InvalidInput
from linked_fleet_client.form import build, form_fields
from linked_fleet_client.quantity import Quantity
from linked_fleet_client.shape import read_shape
from linked_fleet_client.validation import validate
from properties import examples

EX = Namespace("https://example.org/ns#")
HYBRIT = Namespace("https://hybr-it-projekt.de/ns/hybr-it#")
VOM = Namespace("http://vocab.arvida.de/2015/06/vom/vocab#")
DEG, RAD = "http://qudt.org/vocab/unit/DEG", "http://qudt.org/vocab/unit/RAD"
PREFIXES = """
@prefix ex: <https://example.org/ns#> .
@prefix rdf: <http://www.w3.org/1999/02/22-rdf-syntax-ns#> .
@prefix sh: <http://www.w3.org/ns/shacl#> .
@prefix unit: <http://qudt.org/vocab/unit/> .
@prefix vom: <http://vocab.arvida.de/2015/06/vom/vocab#> .
@prefix xsd: <http://www.w3.org/2001/XMLSchema#> .
"""
TURN = """ex:in sh:targetClass ex:Turn ; sh:property
    [ sh:path vom:numericalValue ; sh:name "value" ; sh:minCount 1 ; sh:maxCount 1 ;
      sh:or ( [ sh:datatype xsd:float ] [ sh:datatype xsd:decimal ] ) ],
    [ sh:path vom:unit ; sh:name "unit" ; sh:minCount 1 ; sh:maxCount 1 ; sh:in ( unit:DEG unit:RAD ) ] ;
  sh:xone ( [ sh:property [ sh:path vom:unit ; sh:hasValue unit:DEG ],
                 [ sh:path vom:numericalValue ; sh:minInclusive -90.0 ; sh:maxExclusive 45.5 ] ]
            [ sh:property [ sh:path vom:unit ; sh:hasValue unit:RAD ],
                 [ sh:path vom:numericalValue ; sh:minExclusive -1.5 ; sh:maxInclusive 0.8 ] ] ) ."""


def shapes(text: str) -> Graph:
    return Graph().parse(data=PREFIXES + text, format="turtle")


def nothing(_: str) -> URIRef | None:
    return None


def built(graph: Graph, given_: dict[str, Any], node: Node = EX["in"]) -> Graph:
    return build(read_shape(graph, node), given_, nothing)


@settings(max_examples=examples(60))
@given(st.floats(-100, 100) | st.sampled_from([-90, 45.5, -1.5, 0.8]), st.sampled_from(["deg", "rad"]))
def test_built_bodies_conform_and_refused_input_would_not(value: float, unit: str) -> None:
    """The form and pySHACL agree on every number."""
    graph = shapes(TURN)
    by_hand = shapes(f'[] vom:numericalValue "{Decimal(repr(value)):f}"^^xsd:decimal ; vom:unit unit:{unit.upper()} .')
    try:
        body = built(graph, {"value": value, "unit": unit})
    except InvalidInput:
        with pytest.raises(InvalidInput):
            validate(by_hand, graph, EX["in"])
    else:
        validate(body, graph, EX["in"])
        validate(by_hand, graph, EX["in"])


def test_the_shape_of_the_paper_is_a_form() -> None:
    """Figure 5a, whose only unit need not be given."""
    figure = Graph().parse(Path(__file__).parents[1] / "golden/figure_5a.ttl", publicID="http://example.org/baxter/")
    node = next(iter(figure.objects(None, HYBRIT.consumes)))
    fields = {each.name: each for each in form_fields(read_shape(figure, node))}
    assert set(fields) == {"numericalValue", "unit"} or set(fields) == {"value", "unit"}


def test_a_quantity_says_number_and_unit() -> None:
    graph = shapes(TURN + " ex:out sh:property [ sh:path ex:at ; sh:minCount 1 ; sh:node ex:in ] .")
    body = built(graph, {"at": Quantity(12.5, DEG)}, EX.out)
    assert [str(each) for each in body.objects(None, VOM.unit)] == [DEG]
    with pytest.raises(InvalidInput, match=r"at\.value is missing"):
        built(graph, {"at": Quantity(None, RAD)}, EX.out)


def test_a_name_that_is_no_iri_is_looked_up() -> None:
    graph = shapes("ex:in sh:property [ sh:path ex:at ; sh:minCount 1 ; sh:nodeKind sh:IRI ] .")
    tool = "urn:uuid:6d7b2a3e-8f0c-4f6e-9b53-6f5d0a1c2e47"
    assert [str(each) for each in built(graph, {"at": tool}).objects(None, EX.at)] == [tool]
    with pytest.raises(InvalidInput, match="at: nothing is called 'tool'; give its name or its IRI"):
        built(graph, {"at": "tool"})


def test_the_only_allowed_value_need_not_be_given() -> None:
    graph = shapes('ex:in sh:property [ sh:path ex:mode ; sh:minCount 1 ; sh:in ( "slow" ) ] .')
    assert [str(each) for each in built(graph, {}).objects(None, EX.mode)] == ["slow"]


def test_values_of_no_alternative_are_refused() -> None:
    graph = shapes(
        """ex:in sh:property [ sh:path ex:one ; sh:in ( 1 2 ) ], [ sh:path ex:two ; sh:in ( 1 2 ) ] ;
        sh:or ( [ sh:property [ sh:path ex:one ; sh:hasValue 1 ], [ sh:path ex:two ; sh:hasValue 1 ] ]
                [ sh:property [ sh:path ex:one ; sh:hasValue 2 ], [ sh:path ex:two ; sh:hasValue 2 ] ] ) ."""
    )
    assert len(built(graph, {"one": 1, "two": 1})) == 2
    with pytest.raises(InvalidInput, match="input: these values do not go together"):
        built(graph, {"one": 1, "two": 2})


@pytest.mark.parametrize(
    ("text", "names"),
    [
        ("ex:in sh:property [ sh:path [ sh:alternativePath ( ex:one ex:two ) ] ] .", ["one"]),
        ("ex:in sh:property [ sh:path [ sh:inversePath ex:one ] ], [ sh:path ex:two ; sh:deactivated true ] .", []),
        ("ex:in sh:and ( ex:a [ sh:property [ sh:path ex:two ] ] ) . ex:a sh:property [ sh:path ex:one ] .",
         ["one", "two"]),
        ("ex:in sh:node ex:in ; sh:property [ sh:path ex:one ; sh:node ex:in ] .", ["one"]),
        ("ex:in sh:or 5 ; sh:in ex:no ; sh:property [ sh:path ex:one ; sh:minCount ex:x ; sh:in 7 ] .", ["one"]),
        ("ex:in sh:or ex:l ; sh:property [ sh:path ex:one ] . ex:l rdf:rest ex:l .",
         ["one"]),
        ("", []),
    ],
)  # fmt: skip
def test_an_odd_shape_is_read_as_far_as_it_is_one(text: str, names: list[str]) -> None:
    assert [each.name for each in form_fields(read_shape(shapes(text), EX["in"]))] == names


def test_a_shape_brings_no_program_and_no_broken_validator_down() -> None:
    """A query in a shape is not run; a shape that the validator cannot read is reported as the server's fault."""
    query = 'ex:in sh:sparql [ sh:select "SELECT $this WHERE { SERVICE <http://127.0.0.1:1/> { ?s ?p ?o } }" ] .'
    validate(shapes("[] ex:one 1 ."), shapes(query), EX["in"])
    with pytest.raises(BadAnswer):
        validate(shapes("[] ex:one 1 ."), shapes("ex:in sh:property [ sh:minCount 1 ] ."), EX["in"])


def test_a_body_needs_one_root() -> None:
    with pytest.raises(InvalidInput, match="2 roots"):
        validate(shapes("[] ex:one 1 . [] ex:one 2 ."), shapes(TURN), EX["in"])
    with pytest.raises(InvalidInput, match="unit: is missing"):
        validate(Graph(), shapes(TURN), EX["in"])
