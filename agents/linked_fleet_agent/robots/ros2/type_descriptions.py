"""Descriptions of types as nodes send them (type_description_interfaces/msg/TypeDescription), and their hashes. Pure.

REP 2016 defines both. A description comes from a node that may be hostile, so all of it is bounded.
"""

import json
from collections.abc import Mapping
from hashlib import sha256
from typing import Any

from linked_fleet_agent.robots.ros2.definitions import (
    Arity,
    Definition,
    DefinitionError,
    Definitions,
    Field,
    checked,
    read_default,
)

MAX_TYPES, MAX_DEFAULT = 512, 4096
_IDS = {
    "int8": 2, "uint8": 3, "int16": 4, "uint16": 5, "int32": 6, "uint32": 7, "int64": 8, "uint64": 9, "float32": 10,
    "float64": 11, "char": 13, "wchar": 14, "bool": 15, "byte": 16, "string": 17, "wstring": 18,
}  # fmt: skip
_NESTED = 1
_BOUNDED = {"string": 21, "wstring": 22}
_TYPES = {number: name for name, number in _IDS.items()} | {number: name for name, number in _BOUNDED.items()}
_ARITIES: Mapping[Arity, int] = {"one": 0, "array": 48, "bounded": 96, "sequence": 144}


def type_hash(definitions: Mapping[str, Definition], name: str) -> str:
    """Return the RIHS01 hash of a type. Raises DefinitionError if a part of it is not defined."""
    return f"RIHS01_{sha256(json.dumps(description(definitions, name)).encode()).hexdigest()}"


def description(definitions: Mapping[str, Definition], name: str) -> dict[str, Any]:
    """Return the description of a type and of all that it contains, without defaults, which the hash leaves out."""
    found, waiting = dict[str, Any](), [name]
    while waiting:
        each = waiting.pop()
        if each not in found:
            found[each] = {"type_name": each, "fields": [_field(field) for field in definitions[each].fields]}
            waiting += [field.type for field in definitions[each].fields if field.type not in _IDS]
    first = found.pop(name)
    return {"type_description": first, "referenced_type_descriptions": [found[each] for each in sorted(found)]}


def _field(field: Field) -> dict[str, Any]:
    bounded = field.text_size and field.type in _BOUNDED
    number = _BOUNDED[field.type] if bounded else _IDS.get(field.type, _NESTED)
    said = {
        "type_id": number + _ARITIES[field.arity],
        "capacity": field.size,
        "string_capacity": field.text_size,
        "nested_type_name": "" if field.type in _IDS else field.type,
    }
    return {"name": field.name, "type": said}


def definitions_of(description: Mapping[str, Any]) -> Definitions:
    """Return the definitions of a TypeDescription, as ``types.py`` reads it. Raises DefinitionError."""
    said = [description["type_description"], *description["referenced_type_descriptions"]]
    if len(said) > MAX_TYPES:
        raise DefinitionError(f"the description refers to {len(said)} types; {MAX_TYPES} is the maximum")
    return Definitions({each["type_name"]: _definition(each) for each in said})


def _definition(said: Mapping[str, Any]) -> Definition:
    return checked(Definition(said["type_name"], tuple(_read_field(each) for each in said["fields"])))


def _read_field(said: Mapping[str, Any]) -> Field:
    kind = said["type"]
    offset = kind["type_id"] // 48 * 48
    arity = next((arity for arity, number in _ARITIES.items() if number == offset), None)
    number = kind["type_id"] - offset
    type_ = kind["nested_type_name"] if number == _NESTED else _TYPES.get(number, "")
    if arity is None or not type_:
        raise DefinitionError(f"{said['name'][:80]!r} has the type {kind['type_id']}, which cannot be used")
    size = kind["capacity"] if arity in ("array", "bounded") else 0
    field = Field(said["name"], type_, arity, size, kind["string_capacity"] if number in (21, 22) else 0)
    if not said["default_value"]:
        return field
    if len(said["default_value"]) > MAX_DEFAULT:
        raise DefinitionError(f"{said['name'][:80]!r} has a default of more than {MAX_DEFAULT} characters")
    return Field(field.name, type_, arity, size, field.text_size, read_default(said["default_value"], field))
