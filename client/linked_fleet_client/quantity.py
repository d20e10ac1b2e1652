"""Numbers with units, and RDF literals from values that people and programs provide.

Units come from a small table by IRI. Numbers are converted within a dimension.
"""

import math
import re
from collections.abc import Iterable
from dataclasses import dataclass, replace
from datetime import datetime
from decimal import Decimal
from typing import Any

from rdflib.term import Literal, URIRef

from linked_fleet_client.errors import InvalidInput
from linked_fleet_client.vocabulary import MATHS, QUDT, UNIT, VOM, XSD, local_name


@dataclass(frozen=True)
class Unit:
    """A unit: its ``label``, the ``dimension`` within which it converts, and ``si``, its size in the SI unit."""

    label: str
    dimension: str
    si: float = 1.0


def _qudt(*names: str) -> tuple[str, ...]:
    return tuple(str(UNIT[name]) for name in names)


# The known IRIs of each unit; the SI unit of a dimension has size 1.
_TABLE: tuple[tuple[Unit, tuple[str, ...]], ...] = (
    (Unit("rad", "angle"), (*_qudt("RAD"), str(MATHS.Radian), str(VOM.Radian))),
    (Unit("deg", "angle", math.pi / 180), (*_qudt("DEG"), str(MATHS.Degree), str(VOM.Degree))),
    (Unit("turn", "angle", math.tau), _qudt("REV")),
    (Unit("m", "length"), (*_qudt("M"), str(MATHS.Meter), str(VOM.Meter), str(VOM.Metre))),
    (Unit("mm", "length", 1e-3), (*_qudt("MilliM"), str(VOM.Millimeter), str(VOM.Millimetre))),
    (Unit("cm", "length", 1e-2), (*_qudt("CentiM"), str(VOM.Centimeter), str(VOM.Centimetre))),
    (Unit("km", "length", 1e3), _qudt("KiloM")),
    (Unit("kg", "mass"), _qudt("KiloGM")),
    (Unit("g", "mass", 1e-3), _qudt("GM")),
    (Unit("N", "force"), _qudt("N")),
    (Unit("N m", "torque"), _qudt("N-M")),
    (Unit("rad/s", "angular velocity"), _qudt("RAD-PER-SEC")),
    (Unit("deg/s", "angular velocity", math.pi / 180), _qudt("DEG-PER-SEC")),
    (Unit("rpm", "angular velocity", math.tau / 60), _qudt("REV-PER-MIN")),
    (Unit("m/s", "velocity"), _qudt("M-PER-SEC")),
    (Unit("mm/s", "velocity", 1e-3), _qudt("MilliM-PER-SEC")),
    (Unit("rad/s2", "angular acceleration"), _qudt("RAD-PER-SEC2")),
    (Unit("m/s2", "acceleration"), _qudt("M-PER-SEC2")),
    (Unit("kg m2", "moment of inertia"), _qudt("KiloGM-M2")),
    (Unit("N m s/rad", "rotary damping"), _qudt("N-M-SEC-PER-RAD")),
    (Unit("N s/m", "damping"), _qudt("N-SEC-PER-M")),
    (Unit("s", "time"), _qudt("SEC")),
    (Unit("ms", "time", 1e-3), _qudt("MilliSEC")),
    (Unit("min", "time", 60.0), _qudt("MIN")),
    (Unit("h", "time", 3600.0), _qudt("HR")),
    (Unit("Hz", "frequency"), _qudt("HZ")),
    (Unit("V", "voltage"), _qudt("V")),
    (Unit("mV", "voltage", 1e-3), _qudt("MilliV")),
    (Unit("A", "electric current"), _qudt("A")),
    (Unit("mA", "electric current", 1e-3), _qudt("MilliA")),
    (Unit("A h", "electric charge", 3600.0), _qudt("A-HR")),
    (Unit("W", "power"), _qudt("W")),
    (Unit("J", "energy"), _qudt("J")),
    (Unit("W h", "energy", 3600.0), _qudt("W-HR")),
    (Unit("K", "temperature"), _qudt("K")),
    (Unit("°C", "temperature in degrees Celsius"), _qudt("DEG_C")),
    (Unit("Pa", "pressure"), _qudt("PA")),
    (Unit("bar", "pressure", 1e5), _qudt("BAR")),
    (Unit("", "number"), _qudt("UNITLESS")),
    (Unit("%", "number", 1e-2), _qudt("PERCENT")),
)
NUMBERS = frozenset({VOM.numericalValue, QUDT.numericValue, QUDT.value})
UNIT_PATHS = frozenset({VOM.unit, QUDT.unit, QUDT.hasUnit})
UNITS: dict[str, Unit] = {iri: unit for unit, iris in _TABLE for iri in iris}
_SPELLINGS = {unit.label: unit for unit, _ in _TABLE} | {
    unit.label: unit
    for unit in (
        Unit("°", "angle", math.pi / 180),
        Unit("degree", "angle", math.pi / 180),
        Unit("degrees", "angle", math.pi / 180),
        Unit("radian", "angle"),
        Unit("radians", "angle"),
        Unit("Nm", "torque"),
        Unit("unitless", "number"),
    )
}


def unit_label(iri: str) -> str:
    """Return the symbol of the unit; for an unknown unit the local name of its IRI."""
    return UNITS[iri].label if iri in UNITS else local_name(iri)


def known_unit(text: str) -> Unit | None:
    """Return the unit with the label, word or IRI ``text``."""
    return UNITS.get(text) or _SPELLINGS.get(text)


@dataclass(frozen=True)
class Quantity:
    """A number as served. ``number`` is None, never zero, if the server says that the value is unknown.

    ``time`` is the time of measurement with time zone; None if not stated.
    """

    number: float | None
    unit: str | None = None
    time: datetime | None = None

    @property
    def unit_label(self) -> str:
        return unit_label(self.unit) if self.unit else ""

    def to(self, unit: str) -> "Quantity":
        """Convert to another unit, given as ``"deg"`` or by IRI. Raises InvalidInput if the dimensions differ."""
        here, there = known_unit(self.unit or ""), known_unit(unit)
        if here is None or there is None or here.dimension != there.dimension:
            raise InvalidInput([f"{self.unit_label or 'a number without unit'} cannot be given in {unit_label(unit)}"])
        iri = unit if unit in UNITS else next(iri for known, iris in _TABLE for iri in iris if _same(known, there))
        number = None if self.number is None else self.number * here.si / there.si
        return replace(self, number=number, unit=iri)

    def __str__(self) -> str:
        number = "unknown" if self.number is None else f"{self.number:.6g}"
        return f"{number} {self.unit_label}".rstrip()


def matching_unit(unit: str, choices: Iterable[URIRef]) -> tuple[URIRef, float] | None:
    """Return the first of ``choices`` that means ``unit``, and the factor from ``unit`` to it.

    An identical unit is preferred to one that needs conversion; None if there is neither.
    """
    offered = list(choices)
    for choice in offered:
        if unit in (str(choice), local_name(str(choice))):
            return choice, 1.0
    wanted = known_unit(unit)
    if wanted is None:
        return None
    alike = [(choice, UNITS[str(choice)]) for choice in offered if str(choice) in UNITS]
    alike = [(choice, known) for choice, known in alike if known.dimension == wanted.dimension]
    exact = [(choice, 1.0) for choice, known in alike if _same(known, wanted)]
    return next(iter(exact + [(choice, wanted.si / known.si) for choice, known in alike]), None)


def number(literal: Literal) -> float | None:
    """Return the number in a literal of a numeric XSD type; None for others."""
    text = str(literal).strip()
    if literal.datatype not in _NUMERIC or "_" in text:
        return None
    try:
        found = float(text)
    except ValueError:
        return None
    return None if math.isnan(found) else found


def _same(one: Unit, other: Unit) -> bool:
    return one.dimension == other.dimension and one.si == other.si


INTEGERS = frozenset(
    XSD[name]
    for name in (
        "integer", "int", "long", "short", "byte", "nonNegativeInteger", "positiveInteger", "nonPositiveInteger",
        "negativeInteger", "unsignedLong", "unsignedInt", "unsignedShort", "unsignedByte",
    )
)  # fmt: skip
_NUMERIC = INTEGERS | {XSD.float, XSD.double, XSD.decimal}


# The first datatype that the shape allows is used. Decimals keep the given value exactly, which matters at limits: the
# double nearest to 0.8 is more than 0.8.
_WHOLE = (XSD.integer, XSD.decimal, XSD.double, XSD.float)
_BROKEN = (XSD.decimal, XSD.double, XSD.float)
_NUMBER = re.compile(r"[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]{1,3})?")
_WORDS = {"true": True, "false": False}


def literal(value: Any, datatypes: tuple[URIRef, ...], scale: float = 1.0, numeric: bool = False) -> Literal:
    """Return ``value``, a number multiplied by ``scale``, as a literal of one of ``datatypes`` (any if empty).

    ``numeric`` says that it is a number although no datatype says so. Raises ValueError with the valid forms.
    """
    takes_numbers = any(_is_numeric(datatype) for datatype in datatypes) or (numeric and not datatypes)
    if takes_numbers and not isinstance(value, bool) and (number := _number(value)) is not None:
        return _numeral(number if scale == 1.0 else number * scale, datatypes)
    if isinstance(value, int | float) and not datatypes:
        return Literal(value) if isinstance(value, bool) else _numeral(value, datatypes)
    if XSD.boolean in datatypes and (value := _WORDS.get(str(value).lower(), value)) in (True, False):
        return Literal(bool(value))
    if isinstance(value, datetime):
        return Literal(value)
    if not datatypes and not numeric:
        return Literal(str(value))
    for datatype in datatypes:
        if not _is_numeric(datatype) and datatype != XSD.boolean:
            return _checked(str(value), datatype)
    raise ValueError(f"{str(value)[:80]!r} is not a valid {_said(datatypes)}")


def _checked(text: str, datatype: URIRef) -> Literal:
    found = Literal(text, datatype=datatype)
    if found.ill_typed:
        raise ValueError(f"{text[:80]!r} is not a valid {_said((datatype,))}")
    return found


def _number(value: Any) -> float | int | None:
    if isinstance(value, int | float | Decimal):
        return value if isinstance(value, int) else float(value)
    text = str(value).strip()
    if not _NUMBER.fullmatch(text):
        return None
    return int(text) if text.lstrip("+-").isdigit() and len(text) < 30 else float(text)


def _numeral(number: float | int, datatypes: tuple[URIRef, ...]) -> Literal:
    if not math.isfinite(number):
        raise ValueError(f"{number} is not a finite number")
    whole = isinstance(number, int) or number.is_integer()
    order = (*(_WHOLE if whole else _BROKEN), *(sorted(INTEGERS) if whole else ()))
    offered = [datatype for datatype in order if datatype in datatypes or not datatypes]
    if not offered:
        raise ValueError(f"{number:.9g} is not a valid {_said(datatypes)}")
    return _checked(_lexical(number, offered[0]), offered[0])


def _lexical(number: float | int, datatype: URIRef) -> str:
    if datatype in INTEGERS:
        return str(int(number))
    return f"{Decimal(repr(number)):f}" if datatype == XSD.decimal else repr(float(number))


def _is_numeric(datatype: URIRef) -> bool:
    return datatype in INTEGERS or datatype in _BROKEN


def _said(datatypes: tuple[URIRef, ...]) -> str:
    if any(datatype in _BROKEN for datatype in datatypes):
        return "number"
    return " or ".join(local_name(str(datatype)) for datatype in datatypes if datatype) or "number"
