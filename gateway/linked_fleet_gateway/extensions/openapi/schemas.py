"""JSON Schemas that cover several things, and example values for a schema.

The schemas themselves come from SHACL shapes (``resources.json_form``). One path of a description stands for many
things with different limits.
"""

import json
import re
from collections.abc import Callable, Iterable
from functools import partial, reduce
from typing import Any

from linked_fleet_gateway.faces import Json

_MOST_BRANCHES = 16
_LOWER, _UPPER = ("minimum", "exclusiveMinimum"), ("maximum", "exclusiveMaximum")
_NULL: Json = {"type": "null"}
_URI: Json = {"type": "string", "format": "uri"}


def union(schemas: Iterable[Json]) -> Json:
    """Return a schema that accepts whatever one of ``schemas`` accepts; they differ only in their limits."""
    return reduce(_widest, schemas)


def generalize_iris(schema: Json, base: str) -> Json:
    """Return the schema with lists of IRIs below ``base`` replaced by any IRI; a large fleet has too many."""
    found = {name: _within(value, partial(generalize_iris, base=base)) for name, value in schema.items()}
    if "properties" in schema and "type" not in schema:  # a branch
        named = {name: each for name, each in schema["properties"].items() if not _is_named(each, base)}
        return found | {"properties": named}
    return {name: value for name, value in found.items() if name != "enum"} | _URI if _is_named(schema, base) else found


def forbid_other_members(schema: Json) -> Json:
    """Return the schema of a body, refusing members that it does not name.

    Each alternative becomes a whole object, because client generators do not combine a partial one with its parent.
    """
    if schema.get("type") != "object":
        return {name: _within(value, forbid_other_members) for name, value in schema.items()}
    whole = {name: _within(value, forbid_other_members) for name, value in schema.items() if name != "oneOf"}
    whole["additionalProperties"] = False
    if not (branches := _few(schema.get("oneOf", []))):
        return whole
    said = {"description": whole.pop("description")} if "description" in whole else {}
    return said | {"oneOf": [whole | {"properties": _narrowed(whole["properties"], each)} for each in branches]}


def extract_alternatives(schema: Json, name: str, components: dict[str, Json]) -> Json:
    """Return the schema with its alternatives moved to ``components``, from which generators name classes.

    An alternative is named by its unit, as in ``RotateInputRAD``.
    """
    found = dict(schema)
    if "properties" in schema:
        members = schema["properties"].items()
        found["properties"] = {
            each: extract_alternatives(value, name + each.capitalize(), components) for each, value in members
        }
    if "items" in schema:
        found["items"] = extract_alternatives(schema["items"], name, components)
    if any("properties" in each for each in schema.get("oneOf", ())):
        found["oneOf"] = []
        for each in schema["oneOf"]:
            label = name + _unit(each)
            label += str(sum(known.startswith(label) for known in components) or "")
            components[label] = {}  # reserved before the recursion, so that nested alternatives get other names
            components[label] = extract_alternatives(each, label, components)
            found["oneOf"].append({"$ref": f"#/components/schemas/{label}"})
    return found


def merge_null(schema: Any) -> Any:
    """Return the schema with ``oneOf`` a type and null as the type array ``[type, "null"]``, also in its parts.

    Generators take the former for a class of its own, whose methods they write twice.
    """
    if isinstance(schema, list):
        return [merge_null(each) for each in schema]
    if not isinstance(schema, dict):
        return schema
    found = {name: merge_null(value) for name, value in schema.items()}
    others = [each for each in found.get("oneOf", ()) if each != _NULL]
    if len(others) == 1 and len(found["oneOf"]) == 2 and isinstance(others[0].get("type"), str):
        (known,) = others
        if "oneOf" in known:  # null has to fit one of them, not all
            return found
        beside = {name: value for name, value in found.items() if name != "oneOf"}
        if "const" in known:
            known = {name: value for name, value in known.items() if name != "const"} | {"enum": [known["const"]]}
        listed = {"enum": [*known["enum"], None]} if "enum" in known else {}
        return known | listed | {"type": [known["type"], "null"]} | beside
    return found


def _unit(schema: Json) -> str:
    members = schema["properties"].get("value", schema)
    named = schema["properties"].get("unit") or members.get("properties", {}).get("unit") or {}
    return re.sub(r"[^A-Za-z0-9]", "", named.get("enum", [""])[-1].rpartition("/")[2])


def example(schema: Json) -> Any:
    """Return a value with the required members, in the middle of the limits."""
    if "const" in schema:
        return schema["const"]
    if "enum" in schema:
        return schema["enum"][-1]
    if schema.get("type") == "object":
        branch: Json = schema["oneOf"][-1]["properties"] if "oneOf" in schema else {}
        members = schema.get("properties", {})
        return {name: example(members[name] | branch.get(name, {})) for name in schema.get("required", ())}
    if schema.get("type") == "array":
        return [example(schema["items"])] * max(1, schema.get("minItems", 1)) if "items" in schema else []
    if schema.get("type") in ("number", "integer"):
        middle = _middle(schema)
        return int(middle) if schema["type"] == "integer" else middle
    if schema.get("type") == "boolean":
        return True
    return "Linked Fleet".ljust(schema.get("minLength", 0), ".")[: schema.get("maxLength")]


def has_example(schema: Json) -> bool:
    """Return False if a text has a pattern, to which no example is known."""
    return '"pattern"' not in json.dumps(schema)


def _middle(schema: Json) -> float:
    low, high = (next((schema[each] for each in side if each in schema), None) for side in (_LOWER, _UPPER))
    if low is None or high is None:
        return next((each for each in (low, high) if each is not None), 1)
    return float(round(low + (high - low) * 0.4, 3))


def _within(value: Any, change: Callable[[Json], Json]) -> Any:
    """Return the value with all schemas in it changed."""
    if isinstance(value, dict):
        return change(value)
    return [_within(each, change) for each in value] if isinstance(value, list) else value


def _is_named(schema: Json, base: str) -> bool:
    return any(each.startswith(base + "/") for each in schema.get("enum", ())[:1])


def _narrowed(members: Json, branch: Json) -> Json:
    return members | {name: members.get(name, {}) | each for name, each in branch["properties"].items()}


def _few(branches: list[Json]) -> list[Json]:
    """Return the branches; if there are many, merged over joints so that only units distinguish them."""
    if len(branches) <= _MOST_BRANCHES:
        return branches
    return reduce(_branches, ([_without_joint(each)] for each in branches))


def _without_joint(branch: Json) -> Json:
    return branch | {"properties": {name: each for name, each in branch["properties"].items() if name != "joint"}}


def _widest(one: Json, other: Json) -> Json:
    if one == other:
        return one
    merged = {name: value for name, value in one.items() if other.get(name) == value}
    for side, pick in ((_LOWER, min), (_UPPER, max)):
        merged |= _limit(one, other, side, pick)
    for name in ("properties", "items", "enum", "oneOf", "required"):
        if name in one and name in other and name not in merged:
            merged[name] = _MERGES[name](one[name], other[name])
    return merged


def _limit(one: Json, other: Json, side: tuple[str, str], pick: Any) -> Json:
    """Return the wider of two limits; empty if one of them has none."""
    said = [(each[name], name) for each in (one, other) for name in side if name in each]
    if len(said) < 2:
        return {}
    wider = pick(value for value, _ in said)
    inclusive = any(said_here == (wider, side[0]) for said_here in said)
    return {side[0] if inclusive else side[1]: wider}


def _properties(one: Json, other: Json) -> Json:
    shared = {name: _widest(one[name], other[name]) for name in one if name in other}
    return one | other | shared


def _branches(one: list[Json], other: list[Json]) -> list[Json]:
    """Merge the branches of both; branches for the same joints and units become one."""
    found: dict[str, Json] = {}
    for branch in (*one, *other):
        key = _key(branch)
        found[key] = _widest(found[key], branch) if key in found else branch
    return list(found.values())


def _key(branch: Json) -> str:
    return json.dumps({name: each.get("enum") for name, each in sorted(branch.get("properties", {}).items())})


_MERGES: dict[str, Any] = {
    "properties": _properties,
    "items": _widest,
    "enum": lambda one, other: list(dict.fromkeys((*one, *other))),
    "oneOf": _branches,
    "required": lambda one, other: [each for each in one if each in other],
}
