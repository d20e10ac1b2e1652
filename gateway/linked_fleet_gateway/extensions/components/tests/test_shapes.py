"""Shapes of components: they accept what their schemas accept, and say what is wrong."""

from typing import Any

import msgspec
import pyshacl
import pytest
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st
from jsonschema import Draft202012Validator
from pyoxigraph import BlankNode, Literal, NamedNode, Triple

from component_schemas import ROBOT, VALUES, formed, nearly, objects, schemas
from linked_fleet_agent.wire.components import Property
from linked_fleet_agent.wire.schema import MAX_INTEGER, MAX_NUMBER, Schema, value_problem
from linked_fleet_gateway.extensions.components.declarations import CompiledProperty, Input
from linked_fleet_gateway.extensions.components.places import place_of
from linked_fleet_gateway.extensions.components.shapes import SH
from linked_fleet_rdf.graph import Graph, Node
from linked_fleet_rdf.validation import ShaclValidator
from linked_fleet_rdf.vocabulary import LDP, LF, MATHS, RDF, XSD
from linked_fleet_shacl import Data
from linked_fleet_shacl.data import predicate_path, repeated_path
from properties import examples
from shacl_findings import to_graph, turtle

FOCUS, SHAPE = NamedNode(f"{ROBOT}part/actions/act"), NamedNode(f"{ROBOT}shape")
TERM = f"{ROBOT}vocabulary#part-input-act"
SLOW = (HealthCheck.too_slow, HealthCheck.data_too_large, HealthCheck.filter_too_much)


def input_of(schema: Schema, *, is_value: bool = False) -> Input:
    return Input(place_of(schema, TERM), is_value)


def schema_of(**keywords: Any) -> Schema:
    return msgspec.convert(keywords, Schema)


def body_of(taken: Input, value: Any) -> list[Triple]:
    graph = Graph()
    taken.describe(graph, FOCUS, value)
    return graph.triples


def is_accepted(taken: Input, value: Any) -> bool:
    return taken.validator.report(body_of(taken, value), FOCUS) is None


def shape_of(taken: Input) -> list[Triple]:
    graph = Graph()
    taken.describe_shape(graph, SHAPE)
    return graph.triples


def pyshacl_accepts(shape: list[Triple], body: list[Triple], focus: Node = FOCUS) -> bool:
    """As any client of the shape validates, with the defaults of pySHACL."""
    shapes = to_graph([*shape, Triple(SHAPE, SH.targetNode, focus)])
    accepted, _, text = pyshacl.validate(to_graph(body), shacl_graph=shapes)
    assert isinstance(accepted, bool), text
    return accepted


def json_schema_accepts(schema: Schema, value: Any) -> bool:
    """Validate as another implementation does, whose objects have no further members, and numbers the largest range."""
    return bool(Draft202012Validator(closed(msgspec.to_builtins(schema))).is_valid(value))


def closed(keywords: dict[str, Any]) -> dict[str, Any]:
    most = {"integer": MAX_INTEGER, "number": MAX_NUMBER}.get(keywords["type"])
    found = keywords if most is None else {**keywords, "allOf": [{"minimum": -most, "maximum": most}]}
    if "items" in keywords:
        found = {**found, "items": closed(keywords["items"])}
    if keywords["type"] == "object":
        members = {name: closed(each) for name, each in keywords.get("properties", {}).items()}
        found = {**found, "properties": members, "additionalProperties": False}
    return found


@settings(max_examples=examples(10_000, most_long=10_000), suppress_health_check=SLOW)
@given(st.data())
def test_the_verdict_of_a_shape_is_that_of_json_schema(data: st.DataObject) -> None:
    schema = data.draw(schemas())
    value = data.draw(nearly(schema))
    assert is_accepted(input_of(schema, is_value=True), value) == json_schema_accepts(schema, value)


@settings(max_examples=examples(10_000), suppress_health_check=SLOW)
@given(st.data())
def test_the_shape_of_an_input_accepts_what_its_schema_accepts(data: st.DataObject) -> None:
    schema = data.draw(schemas(objects()))
    value = data.draw(nearly(schema).filter(lambda each: isinstance(each, dict)))
    assert is_accepted(input_of(schema), value) == (not value_problem(schema, value))


@settings(max_examples=examples(10_000), suppress_health_check=SLOW)
@given(st.data())
def test_the_shape_of_a_property_accepts_what_its_schema_accepts(data: st.DataObject) -> None:
    schema = data.draw(schemas())
    value = data.draw(nearly(schema))
    assert is_accepted(input_of(schema, is_value=True), value) == (not value_problem(schema, value))


@settings(max_examples=examples(10_000), suppress_health_check=SLOW)
@given(st.data())
def test_pyshacl_agrees(data: st.DataObject) -> None:
    schema = data.draw(schemas())
    value, taken = data.draw(nearly(schema)), input_of(schema, is_value=True)
    assert pyshacl_accepts(shape_of(taken), body_of(taken, value)) == (not value_problem(schema, value))


@settings(max_examples=examples(1_000), suppress_health_check=SLOW)
@given(st.data())
def test_the_blueprint_of_a_property_accepts_its_values_and_unknown(data: st.DataObject) -> None:
    schema = data.draw(schemas())
    value = data.draw(nearly(schema) | VALUES)
    compiled = CompiledProperty(Property(schema=schema), TERM, FOCUS)
    shape, body = Graph(), Graph()
    compiled.describe_shape(shape, SHAPE)
    compiled.describe(body, FOCUS, value)
    expected = value is None or not value_problem(schema, value)
    assert (ShaclValidator(shape.triples, SHAPE).report(body.triples, FOCUS) is None) == expected


NESTED = {
    "type": "array",
    "items": {"type": "array", "items": {"type": "array", "items": {"type": "number", "unit": "RAD"}}},
}
DEEP = {
    "type": "object",
    "properties": {"a": {"type": "object", "properties": {"b": {"type": "array", "items": {"type": "number"}}}}},
}


@pytest.mark.parametrize(("keywords", "value"), [(NESTED, [[[1.5]]]), (DEEP, {"a": {"b": [1]}})])
def test_the_deepest_shapes_are_within_the_depth_of_pyshacl(keywords: dict[str, Any], value: Any) -> None:
    compiled = CompiledProperty(Property(schema=schema_of(**keywords)), TERM, FOCUS)
    shape, body = Graph(), Graph()
    compiled.describe_shape(shape, SHAPE)
    compiled.describe(body, FOCUS, value)
    assert pyshacl_accepts(shape.triples, body.triples)
    compiled.input.describe_shape(shape := Graph(), SHAPE)
    assert pyshacl_accepts(shape.triples, body.triples)


UNITS = "http://qudt.org/vocab/unit/"
ODD_TERMS = [
    *(Literal(text, datatype=XSD.decimal) for text in ("0.1", "1", "90", "-0.5")),
    *(Literal(text, datatype=XSD.float) for text in ("0.1", "1e0", "INF", "90.5")),
    *(Literal(text, datatype=XSD.integer) for text in ("1", "01", "-2", "x")),
    *(Literal(text, datatype=XSD.boolean) for text in ("1", "true", "yes")),
    *(Literal("a"), Literal("a", language="en"), BlankNode("b1"), BlankNode("other"), FOCUS, RDF.nil, LF.unknown),
    *(NamedNode(UNITS + name) for name in ("DEG", "RAD", "M", "MilliM", "V")),
    *(MATHS.Degree, MATHS.Radian, MATHS.Scalar),
]


@st.composite
def changed(draw: st.DrawFn, body: list[Triple]) -> list[Triple]:
    """The body with up to three statements left out, added, or with another object."""
    for _ in range(draw(st.integers(1, 3))):
        at = draw(st.integers(0, len(body) - 1)) if body else 0
        old = body[at] if body else Triple(FOCUS, LF.value, RDF.nil)
        new = Triple(old.subject, old.predicate, draw(st.sampled_from(ODD_TERMS)))
        kept = [*body[:at], *body[at + 1 :]]
        body = draw(st.sampled_from([kept, [*body, new], [*kept, new]]))
    return body


def has_circular_list(body: list[Triple]) -> bool:
    """pySHACL fails to report one: rdflib raises ValueError."""
    data, later = Data(body), repeated_path(predicate_path(RDF.rest), with_focus=False)
    return any(each.subject in later(data, each.subject) for each in body)


def test_a_circular_list_is_refused() -> None:
    body = turtle(f"<{FOCUS.value}> lf:value _:c . _:c rdf:first true ; rdf:rest _:c .")
    taken = input_of(schema_of(type="array", items={"type": "boolean"}), is_value=True)
    assert has_circular_list(body)
    assert taken.validator.report(body, FOCUS)
    assert taken.read(body, FOCUS)[1]


def _changed_body(data: st.DataObject) -> tuple[Schema, Input, list[Triple]]:
    """Return a schema, its input, and a body that was that of a value before something in it was changed."""
    schema = data.draw(schemas())
    taken = input_of(schema, is_value=True)
    return schema, taken, data.draw(formed(schema).map(lambda value: body_of(taken, value)).flatmap(changed))


@settings(max_examples=examples(10_000), suppress_health_check=SLOW)
@given(st.data())
def test_pyshacl_agrees_about_what_no_json_value_looks_like(data: st.DataObject) -> None:
    """Numbers in other units and datatypes, broken lists, two values of one member, nodes used twice."""
    _, taken, body = _changed_body(data)
    assume(not has_circular_list(body))
    assert pyshacl_accepts(shape_of(taken), body) == (taken.validator.report(body, FOCUS) is None)


@settings(max_examples=examples(10_000), suppress_health_check=SLOW)
@given(st.data())
def test_whatever_is_read_conforms_to_the_schema(data: st.DataObject) -> None:
    schema, taken, body = _changed_body(data)
    value, refused = taken.read(body, FOCUS)
    assert refused is not None or not value_problem(schema, value)


WIDTH = {"type": "number", "unit": "M", "minimum": 0, "maximum": 0.07, "title": "Opening width"}
GRASP = {
    "type": "object",
    "required": ["width"],
    "properties": {
        "width": WIDTH,
        "mode": {"type": "string", "enum": ["soft", "hard"], "description": "how hard to grip"},
        "name": {"type": "string", "maxLength": 3, "pattern": "^[A-Z]*$"},
        "gear": {"type": "number", "enum": [1, 2.5]},
        "angles": {"type": "array", "minItems": 1, "maxItems": 2, "items": {"type": "number", "maximum": 1}},
        "at": {"type": "object", "properties": {"x": {"type": "integer", "minimum": 0}}, "required": ["x"]},
    },
}


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"width": 0.08}, "width: value in M: 0.08 must be at most 0.07"),
        (
            {"width": "a"},
            "width: unit: must have 1 value or more, and has none; value: must have 1 value or more",
        ),
        ({"mode": "x"}, "mode: 'x' must be one of 'soft', 'hard'"),
        ({"name": "ABCD"}, "name: 'ABCD' must be 3 characters long at most"),
        ({"name": "a"}, "name: 'a' must be like '^[A-Z]*$'"),
        ({"gear": 2}, "gear: value: must be one of 1, 2.5"),
        ({"angles": []}, "angles: 1 to 2 items are allowed"),
        ({"angles": [0, 2]}, "an item of angles: value: 2.0 must be at most 1"),
        ({"angles": "none"}, "angles: must be an RDF list"),
        ({"at": {"x": -1}}, "at: x: value: -1 must be at least 0"),
        ({"at": {"x": 0.5}}, "at: x: value: 0.5 must be of type xsd:integer"),
        ({"at": {}}, "at: x: must have 1 value or more, and has none"),
        ({"at": []}, "at: rdf:nil must be a blank node"),
        ({"widht": 1}, "must have no other properties; at fault: robot:part-input-act-widht a blank node"),
    ],
)
def test_a_refusal_names_the_member_and_what_is_right(changes: dict[str, Any], said: str) -> None:
    taken = input_of(schema_of(**GRASP))
    value, refused = taken.read(body_of(taken, {"width": 0.05, **changes}), FOCUS)
    assert value is None and refused is not None
    assert refused[0].startswith(said)
    assert any(predicate == SH.resultPath for _, predicate, _ in refused[1])


def test_a_missing_member_is_named() -> None:
    taken = input_of(schema_of(**GRASP))
    _, refused = taken.read([], FOCUS)
    assert refused is not None and refused[0] == "width: must have 1 value or more, and has none"


def test_a_shape_describes() -> None:
    data = Data(
        shape_of(
            input_of(schema_of(**GRASP | {"properties": {**GRASP["properties"], "width": WIDTH | {"default": 0.04}}}))
        )
    )
    by_name = {
        data.objects(node, SH.name)[0].value: node
        for node in data.objects(SHAPE, SH.property)
        if data.objects(node, SH.name)
    }
    assert list(by_name) == list(GRASP["properties"])
    assert [data.objects(node, SH.order)[0].value for node in by_name.values()] == ["0", "1", "2", "3", "4", "5"]
    assert data.objects(by_name["mode"], SH.description) == [Literal("how hard to grip")]
    (default,) = [value for _, value in data.subject_objects(SH.defaultValue) if isinstance(value, Literal)]
    assert default.value == "0.04"


@pytest.mark.parametrize("written", ["0.1", "0.10", "1e-1", "'0.1'^^xsd:float"])
@pytest.mark.parametrize("keyword", ["minimum", "maximum", "const"])
def test_a_limit_is_within_itself_however_it_is_written(keyword: str, written: str) -> None:
    """The float 0.1 is a little more than the decimal 0.1."""
    body = turtle(f"<{FOCUS.value}> lf:value [ vom:numericalValue {written} ; vom:unit unit:V ] .")
    taken = input_of(schema_of(type="number", unit="V", **{keyword: 0.1}), is_value=True)
    assert taken.read(body, FOCUS)[0] == pytest.approx(0.1)


@pytest.mark.parametrize("keyword", ["exclusiveMinimum", "exclusiveMaximum"])
@pytest.mark.parametrize("written", ["0.1", "1e-1"])
def test_an_exclusive_limit_is_not_within_itself(keyword: str, written: str) -> None:
    body = turtle(f"<{FOCUS.value}> lf:value [ vom:numericalValue {written} ; vom:unit unit:V ] .")
    assert input_of(schema_of(type="number", unit="V", **{keyword: 0.1}), is_value=True).read(body, FOCUS)[1]


def test_types_that_go_without_saying_are_accepted_and_others_not() -> None:
    taken = input_of(schema_of(type="object"))
    assert taken.read([Triple(FOCUS, RDF.type, LDP.Resource)], FOCUS) == ({}, None)
    assert taken.read([Triple(FOCUS, RDF.type, LF.Robot)], FOCUS)[1]
