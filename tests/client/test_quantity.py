"""Numbers with units, and literals from user input."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rdflib import XSD, Literal, Namespace, URIRef

from linked_fleet_client.errors import InvalidInput
from linked_fleet_client.quantity import INTEGERS, UNITS, Quantity, literal, matching_unit, number

UNIT = Namespace("http://qudt.org/vocab/unit/")
MATHS = Namespace("http://vocab.arvida.de/2015/06/maths/vocab#")


def test_a_quantity_converts_within_its_dimension() -> None:
    half = Quantity(math.pi, str(MATHS.Radian)).to("deg")
    assert (half.number, half.unit_label, str(half)) == (180.0, "deg", "180 deg")
    assert Quantity(12.5, str(UNIT.MilliM)).to(str(UNIT.M)).number == 0.0125
    with pytest.raises(InvalidInput, match="rad cannot be given in m"):
        Quantity(1.0, str(UNIT.RAD)).to("m")
    with pytest.raises(InvalidInput):
        Quantity(1.0, "https://example.org/Smoot").to("m")


@pytest.mark.parametrize(
    ("number", "of", "to", "expected"),
    [
        (60, "REV-PER-MIN", "RAD-PER-SEC", math.tau),
        (2, "W-HR", "J", 7200),
        (1.5, "A-HR", "A-HR", 1.5),
        (3, "BAR", "PA", 3e5),
        (2, "HR", "MIN", 120),
    ],
)
def test_units_of_components_convert(number: float, of: str, to: str, expected: float) -> None:
    assert Quantity(number, str(UNIT[of])).to(str(UNIT[to])).number == pytest.approx(expected)


def test_celsius_and_kelvin_do_not_convert() -> None:
    """Their zeros differ, and a size alone cannot say so."""
    with pytest.raises(InvalidInput, match="°C cannot be given in K"):
        Quantity(20.0, str(UNIT.DEG_C)).to(str(UNIT.K))


def test_an_unknown_number_stays_unknown() -> None:
    assert Quantity(None, str(UNIT.RAD)).to("deg").number is None


@given(st.sampled_from(sorted(UNITS)), st.sampled_from(sorted(UNITS)), st.floats(-1e6, 1e6))
def test_there_and_back_is_the_same(one: str, other: str, value: float) -> None:
    if UNITS[one].dimension == UNITS[other].dimension:
        there = Quantity(value, one).to(other).to(one).number
        assert there == pytest.approx(value, rel=1e-9, abs=1e-9)


def test_the_very_unit_comes_before_one_that_it_converts_to() -> None:
    offered = [UNIT.RAD, MATHS.Degree, UNIT.DEG]
    assert matching_unit("deg", offered) == (MATHS.Degree, 1.0)
    assert matching_unit("DEG", offered) == (UNIT.DEG, 1.0)
    assert matching_unit(str(UNIT.DEG), offered) == (UNIT.DEG, 1.0)
    found = matching_unit("turn", [UNIT.RAD])
    assert found is not None
    assert found == (UNIT.RAD, math.tau)
    assert matching_unit("mm", offered) is None
    assert matching_unit("Smoot", [URIRef("https://example.org/Smoot")]) == (URIRef("https://example.org/Smoot"), 1.0)


@pytest.mark.parametrize(
    ("lexical", "datatype", "value"),
    [("1.5", XSD.float, 1.5), (" 2 ", XSD.integer, 2.0), ("INF", XSD.double, math.inf), ("NaN", XSD.float, None),
     ("x", XSD.float, None), ("1_0", XSD.integer, None), ("1", XSD.string, None)],
)  # fmt: skip
def test_text_without_a_number_is_no_quantity(lexical: str, datatype: URIRef, value: float | None) -> None:
    assert number(Literal(lexical, datatype=datatype, normalize=False)) == value


@pytest.mark.parametrize(
    ("value", "datatypes", "lexical", "datatype"),
    [
        (43, (XSD.float, XSD.integer), "43", XSD.integer),
        (43, (XSD.float,), "43.0", XSD.float),
        ("43.6", (XSD.decimal, XSD.float), "43.6", XSD.decimal),
        (1e-7, (XSD.decimal,), "0.0000001", XSD.decimal),
        ("2", (XSD.int,), "2", XSD.int),
        ("true", (XSD.boolean,), "true", XSD.boolean),
        ("home", (), "home", XSD.string),
        ("5", (XSD.string,), "5", XSD.string),
        ("2026-11-21T10:00:00Z", (XSD.dateTime,), "2026-11-21T10:00:00+00:00", XSD.dateTime),
    ],
)
def test_a_literal_is_what_the_shape_takes(
    value: object, datatypes: tuple[URIRef, ...], lexical: str, datatype: URIRef
) -> None:
    found = literal(value, datatypes)
    assert (str(found), found.datatype or XSD.string) == (lexical, datatype)


@pytest.mark.parametrize(
    ("value", "datatypes"),
    [("x", (XSD.float,)), (math.nan, (XSD.float,)), (1.5, (XSD.integer,)), (-1, (XSD.nonNegativeInteger,)),
     ("maybe", (XSD.boolean,)), (True, (XSD.float,)), ("soon", (XSD.dateTime,)), ("1e999", (XSD.double,))],
)  # fmt: skip
def test_a_unit_that_the_shape_excludes_is_reported(value: object, datatypes: tuple[URIRef, ...]) -> None:
    with pytest.raises(ValueError, match=r"is no|finite"):
        literal(value, datatypes)


@given(st.floats(allow_nan=False, allow_infinity=False), st.sampled_from([XSD.float, XSD.double, XSD.decimal]))
def test_a_number_is_written_exactly(value: float, datatype: URIRef) -> None:
    assert float(str(literal(value, (datatype,)))) == value


@given(st.integers(-(2**40), 2**40), st.sampled_from(sorted(INTEGERS)))
def test_an_integer_type_takes_what_is_in_its_range_or_refuses(value: int, datatype: URIRef) -> None:
    try:
        found = literal(value, (datatype,))
    except ValueError:
        return
    assert (found.toPython(), found.ill_typed) == (value, False)
