"""JSON Schemas that cover several things."""

from typing import Any

import pytest
from jsonschema import Draft202012Validator

from linked_fleet_gateway.extensions.openapi.operations import segment_schema
from linked_fleet_gateway.extensions.openapi.schemas import (
    example,
    extract_alternatives,
    forbid_other_members,
    generalize_iris,
    merge_null,
    union,
)
from linked_fleet_gateway.resources.json_form import Json

DEG, RAD = "http://unit/DEG", "http://unit/RAD"


def _turn(most: float, *joints: str, limit: str = "maximum") -> Json:
    def branch(unit: str, scale: float) -> Json:
        named: Json = {"joint": {"enum": list(joints)}} if joints else {}
        value = {"minimum": -most * scale, limit: most * scale}
        return {"properties": named | {"unit": {"type": "string", "enum": [unit]}, "value": value}}

    members: Json = {"value": {"type": "number"}, "unit": {"type": "string", "enum": [DEG, RAD]}}
    members |= {"joint": {"type": "string", "enum": list(joints)}} if joints else {}
    return {"type": "object", "properties": members, "required": [*members], "oneOf": [branch(DEG, 60), branch(RAD, 1)]}


def _takes(schema: Json, **value: object) -> bool:
    return Draft202012Validator(schema).is_valid(value)


def test_the_union_accepts_values_of_each_schema_in_each_unit() -> None:
    schema = forbid_other_members(union([_turn(1.0), _turn(3.0), _turn(2.0)]))
    assert _takes(schema, value=2.9, unit=RAD) and _takes(schema, value=170, unit=DEG)
    assert not _takes(schema, value=3.1, unit=RAD) and not _takes(schema, value=181, unit=DEG)


def test_a_limit_that_is_taken_itself_is_wider_than_the_same_that_is_not() -> None:
    one, other = _turn(3.0, limit="exclusiveMaximum"), _turn(3.0)
    assert not _takes(forbid_other_members(union([one])), value=3.0, unit=RAD)
    assert _takes(forbid_other_members(union([one, other])), value=3.0, unit=RAD)
    wider = forbid_other_members(union([_turn(2.0), one]))
    assert not _takes(wider, value=3.0, unit=RAD) and _takes(wider, value=2.9, unit=RAD)


def test_a_limit_that_one_of_them_does_not_have_is_none() -> None:
    assert union([{"type": "number", "maximum": 1}, {"type": "number"}]) == {"type": "number"}


def test_joints_keep_their_own_limits_while_they_are_few() -> None:
    schema = forbid_other_members(union([_turn(1.0, "http://f/a"), _turn(3.0, "http://f/b")]))
    assert _takes(schema, value=2, unit=RAD, joint="http://f/b")
    assert not _takes(schema, value=2, unit=RAD, joint="http://f/a")
    many = forbid_other_members(union([_turn(float(n), f"http://f/{n}") for n in range(1, 20)]))
    assert len(many["oneOf"]) == 2
    assert _takes(many, value=19, unit=RAD, joint="http://f/1") and not _takes(
        many, value=20, unit=RAD, joint="http://f/1"
    )


def test_joints_of_large_fleets_are_not_named() -> None:
    schema = forbid_other_members(generalize_iris(_turn(1.0, "http://f/a"), "http://f"))
    assert _takes(schema, value=1, unit=RAD, joint="http://f/other")
    assert not _takes(schema, value=2, unit=RAD, joint="http://f/other")


def test_a_body_says_no_more_than_its_schema_names() -> None:
    schema = forbid_other_members(_turn(1.0))
    assert _takes(schema, value=1, unit=RAD) and not _takes(schema, value=1, unit=RAD, sped=1)


def test_alternatives_are_components_with_names_of_their_own() -> None:
    components: dict[str, Json] = {}
    schema = extract_alternatives(forbid_other_members(_turn(1.0)), "TurnInput", components)
    assert [*components] == ["TurnInputDEG", "TurnInputRAD"]
    assert schema["oneOf"] == [{"$ref": f"#/components/schemas/{name}"} for name in components]


def test_an_example_is_within_the_limits() -> None:
    assert _takes(forbid_other_members(_turn(1.0)), **example(_turn(1.0)))


def test_names_are_listed_while_they_are_few() -> None:
    assert segment_schema(["b", "a", "b"]) == {"type": "string", "enum": ["b", "a"]}
    assert "enum" not in segment_schema(str(n) for n in range(1000)) and "enum" not in segment_schema([])


NULL = {"type": "null"}


@pytest.mark.parametrize(
    ("schema", "merged"),
    [
        ({"oneOf": [{"type": "number"}, NULL]}, {"type": ["number", "null"]}),
        (
            {"oneOf": [{"type": "string", "format": "uri"}, NULL], "description": "x"},
            {"type": ["string", "null"], "format": "uri", "description": "x"},
        ),
        ({"oneOf": [{"type": "string", "enum": ["a"]}, NULL]}, {"type": ["string", "null"], "enum": ["a", None]}),
        ({"oneOf": [{"type": "object", "properties": {"x": {"oneOf": [NULL, {"type": "integer"}]}}}, NULL]},
         {"type": ["object", "null"], "properties": {"x": {"type": ["integer", "null"]}}}),
        ({"oneOf": [{"type": "object", "oneOf": [{}, {}]}, NULL]},
         {"oneOf": [{"type": "object", "oneOf": [{}, {}]}, NULL]}),
        ({"oneOf": [{"type": "number"}, {"type": "string"}, NULL]},
         {"oneOf": [{"type": "number"}, {"type": "string"}, NULL]}),
        ({"oneOf": [{"$ref": "#/x"}, NULL]}, {"oneOf": [{"$ref": "#/x"}, NULL]}),
        ([{"oneOf": [{"type": "number"}, NULL]}, 1, None], [{"type": ["number", "null"]}, 1, None]),
    ],
)  # fmt: skip
def test_a_type_or_null_becomes_two_types(schema: Any, merged: Any) -> None:
    assert merge_null(schema) == merged
