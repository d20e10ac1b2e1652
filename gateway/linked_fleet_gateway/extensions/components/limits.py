"""Limits of declared numbers as literals of shapes.

Validators compare exactly: the float 0.1 is a little more than the decimal 0.1. Both must be within a limit of 0.1, so
that a limit is the outer one of the two.
"""

import math
from collections.abc import Mapping
from decimal import Decimal

from pyoxigraph import Literal, NamedNode

from linked_fleet_agent.wire.schema import MAX_INTEGER, MAX_NUMBER, Schema
from linked_fleet_rdf.graph import integer, lexical
from linked_fleet_rdf.vocabulary import SH, XSD

Range = Mapping[NamedNode, Literal]

_LARGEST_DECIMAL = 1e15
_DIGITS = 12
"""Of a limit in another unit than the declared one: 0.07 m are 70 mm."""


def stated_range(schema: Schema, factor: float = 1.0) -> Range:
    """Return the limits that a schema states, by parameter, in a unit of which ``factor`` are one declared unit."""
    stated = {
        SH.minInclusive: schema.minimum,
        SH.minExclusive: schema.exclusive_minimum,
        SH.maxInclusive: schema.maximum,
        SH.maxExclusive: schema.exclusive_maximum,
    }
    return {
        parameter: forms_of(limit if factor == 1 else _rounded(limit * factor))[parameter in _UPPER_FORM]
        for parameter, limit in stated.items()
        if limit is not None
    }


_UPPER_FORM = (SH.maxInclusive, SH.minExclusive)


def largest_range(schema: Schema) -> Range:
    """Return the limits of all numbers of the type."""
    return _LARGEST_INTEGERS if schema.type == "integer" else _LARGEST_NUMBERS


def full_range(schema: Schema) -> Range:
    """Return the stated limits, and those of the type where they are tighter or the only ones."""
    stated, largest = stated_range(schema), largest_range(schema)
    most = MAX_INTEGER if schema.type == "integer" else MAX_NUMBER
    low, high = schema.minimum, schema.maximum
    return {
        **stated,
        SH.minInclusive: stated[SH.minInclusive] if low is not None and low >= -most else largest[SH.minInclusive],
        SH.maxInclusive: stated[SH.maxInclusive] if high is not None and high <= most else largest[SH.maxInclusive],
    }


def forms_of(value: float) -> tuple[Literal, Literal]:
    """Return the lowest and the highest literal that people write for a number."""
    if isinstance(value, int):
        return integer(value), integer(value)
    binary = Literal(lexical(value), datatype=XSD.float)
    if value.is_integer() or not 1 / _LARGEST_DECIMAL < abs(value) < _LARGEST_DECIMAL:
        return binary, binary
    written = Decimal(repr(value))
    decimal = Literal(f"{written:f}", datatype=XSD.decimal)
    return (binary, decimal) if Decimal(value) <= written else (decimal, binary)


_LARGEST_INTEGERS, _LARGEST_NUMBERS = (
    {SH.minInclusive: forms_of(-most)[0], SH.maxInclusive: forms_of(most)[1]} for most in (MAX_INTEGER, MAX_NUMBER)
)


def _rounded(value: float) -> float:
    return float(f"{value:.{_DIGITS}g}") if math.isfinite(value) else value
