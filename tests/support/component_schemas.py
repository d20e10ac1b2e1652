"""Schemas that robots may declare, and JSON values that conform to them or nearly do."""

from functools import cache
from typing import Any

import msgspec
from hypothesis import strategies as st

from linked_fleet_agent.wire.schema import Schema, schema_problem

ROBOT = "http://example.org/arm/"
TYPES = [
    "https://example.org/terms#width",
    "https://example.org/terms#height",
    "http://www.w3.org/1999/02/22-rdf-syntax-ns#type",
    "http://www.w3.org/1999/02/22-rdf-syntax-ns#rest",
    f"{ROBOT}vocabulary#part-property-value-a",
    "https://example.org/terms#1",
    "https://example.org/%zz",
    "https://example.org/[terms]#x",
]
"""Terms that can link a value, and IRIs that cannot."""
NAMES = ["a", "b", "a-b", "a_b", ".", "ä 1", "2"]
TEXTS = st.text("ab-é\n", max_size=5)
NUMBERS = st.integers(-3, 3) | st.sampled_from([-2.5, -0.1, -0.0, 0.07, 0.1, 0.3, 1.0, 2.5, 70.00000000000001, 1e-20])
FAR = st.sampled_from([2**53, 2**53 + 1, -(2**53) - 2, 1e300, 1.1e300, -1e301, 10**300, 10**301, 1e22, 5e-324, 1.5])
SCALARS: dict[str, st.SearchStrategy[Any]] = {
    "boolean": st.booleans(),
    "integer": st.integers(-3, 3) | st.sampled_from([2.0, 2**53]),
    "number": NUMBERS | FAR,
    "string": TEXTS,
}
_BOUNDS = {key: NUMBERS | FAR for key in ("minimum", "maximum", "exclusiveMinimum", "exclusiveMaximum")}
_UNITS = {"unit": st.sampled_from(["RAD", "DEG", "M", "MilliM", "M-PER-SEC", "V", "UNITLESS"])}
_PATTERNS = st.sampled_from(["^a$", "^[ab]+$", "^a?b{1,2}$", r"^\w*-$", r"^[^a\s]*$"])
_ABOUT = {"title": TEXTS, "description": TEXTS, "@type": st.sampled_from(TYPES)}


def _of(*types: str, optional: dict[str, Any], **always: Any) -> st.SearchStrategy[dict[str, Any]]:
    return st.fixed_dictionaries({"type": st.sampled_from(types), **always}, optional={**_ABOUT, **optional})


def _choices(type_: str) -> st.SearchStrategy[dict[str, Any]]:
    one, some = SCALARS[type_], st.lists(SCALARS[type_], min_size=1, max_size=3)
    either = _of(type_, optional={"default": one}, enum=some) | _of(type_, optional={}, const=one)
    return either | _of(type_, optional={}, enum=some, const=one)


@st.composite
def _keywords(draw: st.DrawFn, depth: int) -> dict[str, Any]:
    """Draw keywords nested up to ``depth``. As a composite, the strategy has a short name in Hypothesis."""
    return draw(_any(depth))


@cache
def _any(depth: int) -> st.SearchStrategy[dict[str, Any]]:
    lengths = {"minLength": st.integers(0, 3), "maxLength": st.integers(0, 5)}
    plain = st.one_of(
        _of("boolean", optional={"default": st.booleans()}),
        _of("number", "integer", optional={**_BOUNDS, **_UNITS, "default": NUMBERS}),
        _of("string", optional=lengths),
        _of("string", optional={}, maxLength=st.integers(0, 5), pattern=_PATTERNS),
        st.sampled_from(list(SCALARS)).flatmap(_choices),
    )
    if depth == 1:
        return plain
    inner = _keywords(depth - 1)
    counts = {"minItems": st.integers(0, 2), "maxItems": st.integers(0, 3)}
    return plain | _of("array", optional=counts, items=inner) | objects(depth)


@cache
def objects(depth: int = 4) -> st.SearchStrategy[dict[str, Any]]:
    """Keywords of schemas of objects."""
    inner = _keywords(depth - 1)
    members = st.dictionaries(st.sampled_from(NAMES), inner, max_size=3)
    return members.flatmap(
        lambda properties: _of(
            "object",
            optional={"required": st.lists(st.sampled_from(sorted(properties)), unique=True)} if properties else {},
            properties=st.just(properties),
        )
    )


def schemas(keywords: st.SearchStrategy[dict[str, Any]] | None = None) -> st.SearchStrategy[Schema]:
    """Schemas without a problem."""
    found = (_keywords(4) if keywords is None else keywords).map(lambda each: msgspec.convert(each, Schema))
    return found.filter(lambda schema: not schema_problem(schema))


VALUES = st.recursive(
    st.booleans() | NUMBERS | FAR | TEXTS | st.none(),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.sampled_from(["c", *NAMES]), inner, max_size=3),
    max_leaves=6,
)


def formed(schema: Schema) -> st.SearchStrategy[Any]:
    """Values that have the form of a schema, and mostly conform to it."""
    if schema.type == "array":
        assert schema.items is not None
        return st.lists(formed(schema.items), max_size=4)
    if schema.type == "object":
        known = {name: formed(each) for name, each in schema.properties.items()}
        return st.fixed_dictionaries(
            {name: known[name] for name in schema.required},
            optional={n: each for n, each in known.items() if n not in schema.required},
        )
    stated = [*schema.enum, *([] if schema.const is msgspec.UNSET else [schema.const])]
    stated += [each for each in (schema.minimum, schema.maximum, schema.exclusive_minimum) if each is not None]
    return SCALARS[schema.type] | st.sampled_from(stated) if stated else SCALARS[schema.type]


def nearly(schema: Schema) -> st.SearchStrategy[Any]:
    """Values that mostly have the form of a schema, and sometimes not."""
    if schema.type == "object":
        known = {name: nearly(each) for name, each in schema.properties.items()}
        return st.fixed_dictionaries({}, optional={**known, "c": VALUES}) | formed(schema) | VALUES
    if schema.type == "array" and schema.items is not None:
        return st.lists(nearly(schema.items), max_size=4) | VALUES
    return formed(schema) | formed(schema) | VALUES
