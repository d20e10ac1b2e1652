"""Data schemas of Python types: what a driver's author annotates becomes what the fleet is told. Pure."""

from collections.abc import Callable, Mapping
from typing import Any

import msgspec
from msgspec import UNSET, Meta, inspect

from linked_fleet_agent.wire.schema import Schema


class DeclarationError(ValueError):
    """A component cannot be declared; the message says what is wrong and what would be right."""


def unit(name: str) -> Meta:
    """Return an annotation that gives the QUDT unit of a number by its local name, as ``M`` or ``DEG_C``."""
    return Meta(extra_json_schema={"unit": name})


def term(iri: str) -> Meta:
    """Return an annotation that gives the term of a vocabulary that a value means."""
    return Meta(extra_json_schema={"@type": iri})


def schema_of(annotation: Any) -> Schema:
    """Return the schema of a type. Raises DeclarationError for one that no schema describes."""
    try:
        return _schema(inspect.type_info(annotation))
    except TypeError as error:  # what msgspec itself does not take
        raise DeclarationError(f"{annotation} has no schema: {error}") from error


def _schema(found: inspect.Type) -> Schema:
    extra: Mapping[str, Any] = {}
    if isinstance(found, inspect.Metadata):
        extra, found = found.extra_json_schema or {}, found.type
    schema = next((make(found) for kind, make in _MAKERS.items() if isinstance(found, kind)), None)
    if schema is None:
        raise DeclarationError(
            f"{type(found).__name__.removesuffix('Type').lower()} has no schema; these types have: bool, int, float, "
            "str, Literal, Enum, list, tuple[…, ...] and msgspec.Struct"
        )
    try:
        return msgspec.convert({**extra, **msgspec.to_builtins(schema)}, Schema)
    except msgspec.ValidationError as error:
        raise DeclarationError(f"{error}: {dict(extra)}") from error


def _number(found: inspect.IntType | inspect.FloatType) -> Schema:
    if found.multiple_of is not None:
        raise DeclarationError("multiple_of cannot be declared")
    return Schema(
        type="integer" if isinstance(found, inspect.IntType) else "number",
        minimum=found.ge,
        maximum=found.le,
        exclusive_minimum=found.gt,
        exclusive_maximum=found.lt,
    )


def _text(found: inspect.StrType) -> Schema:
    return Schema(type="string", min_length=found.min_length, max_length=found.max_length, pattern=found.pattern or "")


def _choice(values: tuple[Any, ...]) -> Schema:
    kinds = {type(value) for value in values}
    if len(kinds) != 1 or not kinds <= {int, str}:
        raise DeclarationError(f"the choices {', '.join(map(repr, values))} are neither all texts nor all integers")
    return Schema(type="string" if kinds == {str} else "integer", enum=values)


def _array(found: inspect.ListType | inspect.VarTupleType) -> Schema:
    return Schema(type="array", items=_schema(found.item_type), min_items=found.min_length, max_items=found.max_length)


def _vector(found: inspect.TupleType) -> Schema:
    items, length = [_schema(each) for each in found.item_types], len(found.item_types)
    if len(set(map(msgspec.json.encode, items))) != 1:
        raise DeclarationError("the items of a tuple have different types; a msgspec.Struct can name them")
    return Schema(type="array", items=items[0], min_items=length, max_items=length)


def _object(found: inspect.StructType) -> Schema:
    if found.array_like or found.tag is not None:
        raise DeclarationError(f"{found.cls.__name__} is array_like or tagged; a plain msgspec.Struct has a schema")
    properties, required = {}, []
    for field in found.fields:
        try:
            properties[field.encode_name] = _with_default(_schema(_known(field.type)), field)
        except DeclarationError as error:
            raise DeclarationError(f"{field.encode_name}: {error}") from error
        if field.required:
            required.append(field.encode_name)
    return Schema(type="object", properties=properties, required=tuple(required))


def _known(found: inspect.Type) -> inspect.Type:
    """Return the type of a member without None, which stands for a member that is left out."""
    if isinstance(found, inspect.UnionType):
        kinds = [each for each in found.types if not isinstance(each, inspect.NoneType)]
        if len(kinds) == 1:
            return kinds[0]
    return found


def _with_default(schema: Schema, field: inspect.Field) -> Schema:
    made = field.default_factory() if field.default_factory is not msgspec.NODEFAULT else field.default
    if made in (msgspec.NODEFAULT, UNSET, None):
        return schema
    return msgspec.structs.replace(schema, default=msgspec.to_builtins(made))


_MAKERS: Mapping[type[inspect.Type], Callable[[Any], Schema]] = {
    inspect.BoolType: lambda _: Schema(type="boolean"),
    inspect.IntType: _number,
    inspect.FloatType: _number,
    inspect.StrType: _text,
    inspect.LiteralType: lambda found: _choice(tuple(found.values)),
    inspect.EnumType: lambda found: _choice(tuple(each.value for each in found.cls)),
    inspect.ListType: _array,
    inspect.VarTupleType: _array,
    inspect.TupleType: _vector,
    inspect.StructType: _object,
}
