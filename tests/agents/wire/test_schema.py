"""Data schemas of components: which are refused and why, and which values conform to them."""

import json
from typing import Any

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st
from jsonschema import Draft202012Validator

from linked_fleet_agent.wire.schema import MAX_DEPTH, Schema, schema_problem, value_problem


def schema(**keywords: Any) -> Schema:
    return msgspec.convert(keywords, Schema)


def nested(depth: int) -> dict[str, Any]:
    return {"type": "number"} if depth == 1 else {"type": "array", "items": nested(depth - 1)}


@pytest.mark.parametrize(
    "keywords",
    [
        {"type": "boolean", "title": "On", "description": "Whether it is on", "default": False},
        {"type": "number", "unit": "M", "minimum": 0, "maximum": 0.08, "default": 0.04},
        {"type": "number", "exclusiveMinimum": 0, "exclusiveMaximum": 1},
        {"type": "integer", "enum": [1, 2, 4], "@type": "https://example.org/terms#gear"},
        {"type": "string", "maxLength": 7, "pattern": "^[A-Z]{2}-[0-9]{4}$"},
        {"type": "string", "maxLength": 80, "pattern": r"^\w+\.[a-z]{2,5}$"},
        {"type": "string", "const": ""},
        {"type": "array", "items": {"type": "string"}, "minItems": 1, "maxItems": 4},
        {"type": "object", "properties": {"a": {"type": "integer"}}, "required": ["a"]},
        {"type": "object"},
        nested(MAX_DEPTH),
    ],
)
def test_schemas_that_can_be_used(keywords: dict[str, Any]) -> None:
    made = schema(**keywords)
    assert schema_problem(made) == ""
    assert json.loads(msgspec.json.encode(made)) == keywords


@pytest.mark.parametrize(
    ("keywords", "said"),
    [
        ({"type": "boolean", "minimum": 3}, "'minimum' does not fit the type 'boolean'; it fits integer, number"),
        ({"type": "string", "unit": "M"}, "'unit' does not fit the type 'string'"),
        ({"type": "array"}, "an array has no 'items'"),
        ({"type": "object", "required": ["a"]}, "'a' is required, and not among the properties"),
        ({"type": "object", "const": 1}, "'const' does not fit the type 'object'"),
        ({"type": "number", "minimum": 3, "maximum": 1}, "'minimum' is 3, above 'maximum', 1"),
        ({"type": "number", "maximum": 10**301}, "out of range"),
        ({"type": "string", "minLength": 3, "maxLength": 1}, "'minLength' is 3, above 'maxLength', 1"),
        ({"type": "integer", "enum": [1, 2.5]}, "'enum' has 2.5, which does not conform: 2.5 is not an integer"),
        ({"type": "number", "const": True}, "'const' has true, which does not conform: true is not a number"),
        ({"type": "number", "maximum": 1, "default": 2}, "'default' has 2, which does not conform: 2 is above 1"),
        ({"type": "string", "maxLength": 9, "pattern": "a"}, "must begin with '^' and end with '$'"),
        ({"type": "string", "maxLength": 9, "pattern": "^(a+)+$"}, "has '('"),
        ({"type": "string", "maxLength": 9, "pattern": "^a*b*c*$"}, "more than 2 repetitions"),
        ({"type": "string", "maxLength": 9, "pattern": "^a{1,}b{1,}c{1,2}$"}, "more than 2 repetitions"),
        ({"type": "string", "maxLength": 9, "pattern": r"^(?=a)$"}, "has '('"),
        ({"type": "string", "maxLength": 9, "pattern": r"^a\1$"}, r"has '\\'"),
        ({"type": "string", "maxLength": 9, "pattern": "^[z-a]$"}, "is none: bad character range"),
        ({"type": "string", "maxLength": 9, "pattern": "^a{3,1}$"}, "is none"),
        ({"type": "string", "pattern": "^a$"}, "needs a 'maxLength' of at most 1024"),
        (nested(MAX_DEPTH + 1), "nested more than 4 deep"),
        ({"type": "object", "properties": {"a": {"type": "array"}}}, "in 'a': an array has no 'items'"),
    ],
)
def test_schemas_that_are_refused_say_why(keywords: dict[str, Any], said: str) -> None:
    assert said in schema_problem(schema(**keywords))


@pytest.mark.parametrize(
    "keywords",
    [
        {"type": "null"},
        {"type": "number", "multipleOf": 2},
        {"type": ["number", "string"]},
        {"anyOf": [{"type": "number"}]},
        {"$ref": "#"},
        {"type": "number", "unit": "http://qudt.org/vocab/unit/M"},
        {"type": "number", "@type": "no IRI"},
        {"type": "number", "@type": "https://example.org/a b"},
        {"type": "object", "properties": {f"m{i}": {"type": "boolean"} for i in range(65)}},
    ],
)
def test_what_is_not_in_the_subset_does_not_decode(keywords: dict[str, Any]) -> None:
    with pytest.raises(msgspec.ValidationError):
        msgspec.convert(keywords, Schema)


@pytest.mark.parametrize(
    ("keywords", "value", "said"),
    [
        ({"type": "number", "unit": "M", "maximum": 0.08}, 0.1, "0.1 M is above 0.08 M"),
        ({"type": "number", "exclusiveMinimum": 0}, 0, "0 is not above 0"),
        ({"type": "number"}, True, "true is not a number"),
        ({"type": "number"}, float("nan"), "is not a number"),
        ({"type": "number"}, 10**400, "is not a number"),
        ({"type": "integer"}, 2**53 + 1, "is not an integer of at most 53 bits"),
        ({"type": "integer"}, 1.5, "1.5 is not an integer"),
        ({"type": "boolean"}, 1, "1 is not true or false"),
        ({"type": "string", "maxLength": 2}, "abc", "a text of 3 characters, where 0 to 2 are allowed"),
        ({"type": "string", "maxLength": 9, "pattern": "^a$"}, "b", '"b" does not match ^a$'),
        ({"type": "string", "enum": ["a", "b"]}, "c", '"c" is none of "a", "b"'),
        ({"type": "integer", "const": 1}, 2, "2 is not 1"),
        ({"type": "array", "items": {"type": "boolean"}, "maxItems": 1}, [True, True], "an array of 2 items"),
        ({"type": "array", "items": {"type": "boolean"}}, [True, 0], "item 1: 0 is not true or false"),
        ({"type": "object", "properties": {"a": {"type": "number"}}, "required": ["a"]}, {}, "'a' is missing"),
        ({"type": "object", "properties": {"a": {"type": "number"}}}, {"b": 1}, "'b' is unknown; the members are a"),
        ({"type": "object", "properties": {"a": {"type": "number"}}}, {"a": "x"}, 'a: "x" is not a number'),
        ({"type": "object"}, [], "[] is not an object"),
        ({"type": "array", "items": {"type": "number"}}, {}, "{} is not an array"),
        ({"type": "string"}, None, "null is not a text"),
    ],
)
def test_values_that_do_not_conform_say_why(keywords: dict[str, Any], value: object, said: str) -> None:
    assert said in value_problem(schema(**keywords), value)


def closed(keywords: Any) -> Any:
    """Objects have no members but those of their schema, and texts and arrays have a greatest length."""
    if not isinstance(keywords, dict):
        return keywords
    inner = {name: closed(each) for name, each in keywords.get("properties", {}).items()}
    items = {"items": closed(keywords["items"])} if "items" in keywords else {}
    more = {"additionalProperties": False, "properties": inner} if keywords["type"] == "object" else {}
    return {**keywords, **items, **more}


TEXTS = st.text("ab-é\n", max_size=5)
NUMBERS = st.integers(-3, 3) | st.sampled_from([-2.5, -0.5, 0.0, 0.5, 1.0, 2.5])
SCALARS: dict[str, st.SearchStrategy[Any]] = {
    "boolean": st.booleans(), "integer": st.integers(-3, 3), "number": NUMBERS, "string": TEXTS,
}  # fmt: skip


def schemas(depth: int = 3) -> st.SearchStrategy[dict[str, Any]]:
    bound = {key: NUMBERS for key in ("minimum", "maximum", "exclusiveMinimum", "exclusiveMaximum")}
    numbers = st.fixed_dictionaries({"type": st.sampled_from(["integer", "number"])}, optional=bound)
    length = {"minLength": st.integers(0, 3), "maxLength": st.integers(0, 5)}
    pattern = st.sampled_from(["^a$", "^[ab]+$", "^a?b{1,2}$", r"^\w*-$"])
    texts = st.fixed_dictionaries({"type": st.just("string")}, optional=length)
    patterns = st.fixed_dictionaries({"type": st.just("string"), "maxLength": st.integers(0, 5), "pattern": pattern})
    choices = st.sampled_from(list(SCALARS)).flatmap(
        lambda type_: st.one_of(
            st.fixed_dictionaries({"type": st.just(type_), "enum": st.lists(SCALARS[type_], min_size=1, max_size=3)}),
            st.fixed_dictionaries({"type": st.just(type_), "const": SCALARS[type_]}),
        )
    )
    plain = st.one_of(st.just({"type": "boolean"}), numbers, texts, patterns, choices)
    if depth == 1:
        return plain
    inner = schemas(depth - 1)
    counts = {"minItems": st.integers(0, 2), "maxItems": st.integers(0, 3)}
    arrays = st.fixed_dictionaries({"type": st.just("array"), "items": inner}, optional=counts)
    objects = st.dictionaries(st.sampled_from("abc"), inner, max_size=3).flatmap(
        lambda properties: st.fixed_dictionaries(
            {"type": st.just("object"), "properties": st.just(properties)},
            optional={"required": st.lists(st.sampled_from(sorted(properties)), unique=True)} if properties else {},
        )
    )
    return plain | arrays | objects


VALUES = st.recursive(
    st.booleans() | NUMBERS | TEXTS | st.none(),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.sampled_from("abcd"), inner, max_size=3),
    max_leaves=6,
)


def conforming(keywords: dict[str, Any]) -> st.SearchStrategy[Any]:
    """Values that have the form of a schema, and mostly conform to it."""
    match keywords["type"]:
        case "array":
            return st.lists(conforming(keywords["items"]), max_size=3)
        case "object":
            return st.fixed_dictionaries({}, optional={n: conforming(s) for n, s in keywords["properties"].items()})
        case type_:
            return SCALARS[type_]


@given(st.data())
def test_verdicts_are_those_of_json_schema(data: st.DataObject) -> None:
    keywords = data.draw(schemas())
    made = schema(**keywords)
    if schema_problem(made):
        return
    value = data.draw(conforming(keywords) | VALUES)
    assert (value_problem(made, value) == "") == Draft202012Validator(closed(keywords)).is_valid(value)
