"""Data schemas of components: the subset of JSON Schema that the W3C Web of Things uses (TD 1.1, 5.3.2), and units.

A schema comes from a robot, so all that it may cost is bounded: its depth, its members and its patterns. Pure.
"""

import json
import re
from collections.abc import Iterator, Mapping
from typing import Annotated, Any, Literal

import msgspec
from msgspec import UNSET, Meta, Struct, UnsetType, field

Type = Literal["boolean", "integer", "number", "string", "object", "array"]
Scalar = bool | int | float | str
Number = int | float

MAX_DEPTH, MAX_MEMBERS, MAX_CHOICES = 4, 64, 256
MAX_TEXT, MAX_ITEMS = 65_536, 4_096
MAX_INTEGER = 2**53
"""Integers beyond this are not the same in every reader of JSON (RFC 8259, section 6)."""
MAX_NUMBER = 1e300
MAX_PATTERN, MAX_REPETITIONS, MAX_PATTERN_TEXT = 256, 2, 1_024
"""Length of a pattern, its quantifiers that may match more than once, and the length of a text with a pattern."""

Title = Annotated[str, Meta(max_length=256)]
Prose = Annotated[str, Meta(max_length=4096)]
Iri = Annotated[str, Meta(max_length=512, pattern=r"""^([A-Za-z][A-Za-z0-9+.-]*:[^\s<>"{}|\\^`\x00-\x1f]+)?\Z""")]
Unit = Annotated[str, Meta(max_length=64, pattern=r"^([A-Z][A-Za-z0-9_-]*)?\Z")]
Member = Annotated[str, Meta(min_length=1, max_length=128)]


class Schema(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True, omit_defaults=True, rename="camel"):
    """A schema. ``unit`` is the local name of a QUDT unit, such as ``M``; ``semantic_type`` is the IRI of a term."""

    type: Type
    title: Title = ""
    description: Prose = ""
    unit: Unit = ""
    semantic_type: Iri = field(default="", name="@type")
    enum: Annotated[tuple[Scalar, ...], Meta(max_length=MAX_CHOICES)] = ()
    const: Scalar | UnsetType = UNSET
    default: Any = UNSET
    minimum: Number | None = None
    maximum: Number | None = None
    exclusive_minimum: Number | None = None
    exclusive_maximum: Number | None = None
    min_length: Annotated[int, Meta(ge=0)] | None = None
    max_length: Annotated[int, Meta(ge=0)] | None = None
    pattern: Annotated[str, Meta(max_length=MAX_PATTERN)] = ""
    items: "Schema | None" = None
    min_items: Annotated[int, Meta(ge=0)] | None = None
    max_items: Annotated[int, Meta(ge=0)] | None = None
    properties: Annotated[dict[Member, "Schema"], Meta(max_length=MAX_MEMBERS)] = {}
    required: Annotated[tuple[str, ...], Meta(max_length=MAX_MEMBERS)] = ()


_BOUNDS = ("minimum", "maximum", "exclusive_minimum", "exclusive_maximum")
_OF_TYPES: Mapping[str, frozenset[str]] = {
    **dict.fromkeys((*_BOUNDS, "unit"), frozenset({"integer", "number"})),
    **dict.fromkeys(("min_length", "max_length", "pattern"), frozenset({"string"})),
    **dict.fromkeys(("items", "min_items", "max_items"), frozenset({"array"})),
    **dict.fromkeys(("properties", "required"), frozenset({"object"})),
    **dict.fromkeys(("enum", "const"), frozenset({"boolean", "integer", "number", "string"})),
}
"""The types that a keyword fits; all others fit each type."""
_UNSAID: tuple[object, ...] = (None, UNSET, "", (), {})
_JSON_NAMES = dict(zip(Schema.__struct_fields__, Schema.__struct_encode_fields__, strict=True))


def schema_problem(schema: Schema, depth: int = 1) -> str:
    """Return a sentence about what cannot be used in a schema, or an empty string."""
    if depth > MAX_DEPTH:
        return f"it is nested more than {MAX_DEPTH} deep"
    said = _misplaced(schema) or _contradiction(schema) or _pattern_problem(schema) or _constants_problem(schema)
    return said or next(filter(None, _problems_within(schema, depth)), "")


def _misplaced(schema: Schema) -> str:
    for keyword, types in _OF_TYPES.items():
        if schema.type not in types and getattr(schema, keyword) not in _UNSAID:
            return f"{_JSON_NAMES[keyword]!r} does not fit the type {schema.type!r}; it fits {', '.join(sorted(types))}"
    if schema.type == "array" and schema.items is None:
        return "an array has no 'items', which say what it contains"
    unknown = [name for name in schema.required if name not in schema.properties]
    return f"{unknown[0]!r} is required, and not among the properties" if unknown else ""


def _contradiction(schema: Schema) -> str:
    for value in (getattr(schema, bound) for bound in _BOUNDS):
        if value is not None and not abs(value) <= MAX_NUMBER:
            return f"the bound {value} is out of range"
    for least, most in (("min_length", "max_length"), ("min_items", "max_items"), ("minimum", "maximum")):
        low, high = getattr(schema, least), getattr(schema, most)
        if low is not None and high is not None and low > high:
            return f"{_JSON_NAMES[least]!r} is {low}, above {_JSON_NAMES[most]!r}, {high}"
    return ""


_ATOM = r"""(?:[A-Za-z0-9 _\-/:,;@#%&=!<>~"']|\.|\\[\\.\-+*?()\[\]{}|^$/dws]|\[\^?(?:[^\[\]\\^]|\\[\\\-\]\[^dws])+\])"""
_QUANTIFIER = r"(\?|\*|\+|\{[0-9]{1,4}(?:,(?:[0-9]{1,4})?)?\})?"
_PART = re.compile(_ATOM + _QUANTIFIER)


def _pattern_problem(schema: Schema) -> str:
    """Return why a pattern is refused: only those whose cost is bounded, and that all dialects read alike, are not."""
    text = schema.pattern
    if not text:
        return ""
    if not (text.startswith("^") and text.endswith("$") and len(text) > 1):
        return f"the pattern {text!r} must begin with '^' and end with '$'"
    at, wide = 1, 0
    while at < len(text) - 1:
        match = _PART.match(text, at, len(text) - 1)
        if match is None:
            return f"the pattern {text!r} has {text[at]!r}; it may have characters, classes and their repetitions"
        at, wide = match.end(), wide + ("," in (match[1] or "") or match[1] in ("*", "+"))
    if wide > MAX_REPETITIONS:
        return f"the pattern {text!r} has more than {MAX_REPETITIONS} repetitions of different lengths"
    if (schema.max_length or MAX_TEXT) > MAX_PATTERN_TEXT:
        return f"a string with a pattern needs a 'maxLength' of at most {MAX_PATTERN_TEXT}"
    try:
        re.compile(text)
    except re.error as error:
        return f"the pattern {text!r} is none: {error}"
    return ""


def _constants_problem(schema: Schema) -> str:
    plain = msgspec.structs.replace(schema, enum=(), const=UNSET, default=UNSET)
    stated = [("enum", schema.enum, plain), ("const", _given(schema.const), plain)]
    stated.append(("default", _given(schema.default), schema))
    for keyword, values, required in stated:
        for value in values:
            if said := value_problem(required, value):
                return f"{keyword!r} has {_shown(value)}, which does not conform: {said}"
    return ""


def _given(value: object) -> tuple[Any, ...]:
    return () if value is UNSET else (value,)


def _problems_within(schema: Schema, depth: int) -> Iterator[str]:
    if schema.items is not None and (said := schema_problem(schema.items, depth + 1)):
        yield f"in the items: {said}"
    for name, member in schema.properties.items():
        if said := schema_problem(member, depth + 1):
            yield f"in {name!r}: {said}"


def value_problem(schema: Schema, value: object) -> str:
    """Return a sentence about how a JSON value violates a schema, or an empty string.

    ``value`` is what a JSON parser returns, with tuples as good as lists.
    """
    said = _CHECKS[schema.type](schema, value)
    if said:
        return said
    if schema.enum and not any(_same(value, choice) for choice in schema.enum):
        return f"{_shown(value)} is none of {', '.join(map(_shown, schema.enum))}"
    if schema.const is not UNSET and not _same(value, schema.const):
        return f"{_shown(value)} is not {_shown(schema.const)}"
    return ""


def _same(one: object, other: object) -> bool:
    """Compare as JSON Schema does: numbers by value, and no boolean is a number."""
    return one == other and isinstance(one, bool) == isinstance(other, bool)


def _shown(value: object) -> str:
    # Python's strings may have unpaired surrogates, which no answer could carry.
    text = json.dumps(value, ensure_ascii=False).encode("utf-8", "replace").decode()
    return text if len(text) <= 64 else f"{text[:60]}…"


def _check_boolean(_: Schema, value: object) -> str:
    return "" if isinstance(value, bool) else f"{_shown(value)} is not true or false"


def _check_number(schema: Schema, value: object) -> str:
    if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) <= MAX_NUMBER:
        return f"{_shown(value)} is not a number of at most {MAX_NUMBER:g}"
    if schema.type == "integer" and (value != int(value) or abs(value) > MAX_INTEGER):
        return f"{_shown(value)} is not an integer of at most 53 bits"
    unit = f" {schema.unit}" if schema.unit else ""
    if schema.minimum is not None and value < schema.minimum:
        return f"{_shown(value)}{unit} is below {schema.minimum}{unit}"
    if schema.maximum is not None and value > schema.maximum:
        return f"{_shown(value)}{unit} is above {schema.maximum}{unit}"
    if schema.exclusive_minimum is not None and value <= schema.exclusive_minimum:
        return f"{_shown(value)}{unit} is not above {schema.exclusive_minimum}{unit}"
    if schema.exclusive_maximum is not None and value >= schema.exclusive_maximum:
        return f"{_shown(value)}{unit} is not below {schema.exclusive_maximum}{unit}"
    return ""


def _check_string(schema: Schema, value: object) -> str:
    if not isinstance(value, str):
        return f"{_shown(value)} is not a text"
    longest = MAX_TEXT if schema.max_length is None else min(schema.max_length, MAX_TEXT)
    if not (schema.min_length or 0) <= len(value) <= longest:
        return f"a text of {len(value)} characters, where {schema.min_length or 0} to {longest} are allowed"
    if schema.pattern and re.search(schema.pattern, value) is None:
        return f"{_shown(value)} does not match {schema.pattern}"
    return ""


def _check_array(schema: Schema, value: object) -> str:
    if not isinstance(value, list | tuple):
        return f"{_shown(value)} is not an array"
    longest = MAX_ITEMS if schema.max_items is None else min(schema.max_items, MAX_ITEMS)
    if not (schema.min_items or 0) <= len(value) <= longest:
        return f"an array of {len(value)} items, where {schema.min_items or 0} to {longest} are allowed"
    assert schema.items is not None
    for index, item in enumerate(value):
        if said := value_problem(schema.items, item):
            return f"item {index}: {said}"
    return ""


def _check_object(schema: Schema, value: object) -> str:
    if not isinstance(value, Mapping):
        return f"{_shown(value)} is not an object"
    if missing := [name for name in schema.required if name not in value]:
        return f"{missing[0]!r} is missing"
    for name, member in value.items():
        if name not in schema.properties:
            return f"{name!r} is unknown; the members are {', '.join(schema.properties) or 'none'}"
        if said := value_problem(schema.properties[name], member):
            return f"{name}: {said}"
    return ""


_CHECKS = {
    "boolean": _check_boolean,
    "integer": _check_number,
    "number": _check_number,
    "string": _check_string,
    "array": _check_array,
    "object": _check_object,
}
