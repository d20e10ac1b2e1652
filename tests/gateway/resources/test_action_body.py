"""An admitted body as typed values in SI units."""

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pyoxigraph import BlankNode, Literal, NamedNode, Triple

from linked_fleet_base.errors import UnprocessableContent
from linked_fleet_gateway.resources.body_values import Body
from linked_fleet_rdf.graph import UNITS
from linked_fleet_rdf.vocabulary import LF, UNIT, VOM, XSD

_ROOT = NamedNode("http://example.org/r/elbow/actions/rotate")


def _scalar(text: str, datatype: NamedNode, unit: NamedNode | None) -> Body:
    number = Triple(_ROOT, VOM.numericalValue, Literal(text, datatype=datatype))
    return Body([number, *([Triple(_ROOT, VOM.unit, unit)] if unit else [])], _ROOT)


@settings(derandomize=True)
@given(st.floats(-1e6, 1e6).filter(lambda x: x == 0 or abs(x) > 1e-300), st.sampled_from(list(UNITS)))
def test_quantities_are_in_si(value: float, unit: NamedNode) -> None:
    """Whatever unit the body states; without a unit the value counts as given."""
    assert _scalar(repr(value), XSD.double, unit).quantity(_ROOT) == pytest.approx(value * UNITS[unit].si)
    assert _scalar(repr(value), XSD.double, None).quantity(_ROOT) == value


@pytest.mark.parametrize(
    ("text", "datatype", "unit"),
    [
        ("0." + "0" * 400 + "1", XSD.decimal, None),
        ("-0." + "0" * 4000 + "1", XSD.decimal, UNIT.RAD),
        ("1e-400", XSD.double, UNIT.M),
        ("1e-323", XSD.double, UNIT.DEG),
        ("1e-323", XSD.double, UNIT.terms["DEG-PER-SEC"]),
    ],
)
def test_numbers_that_a_float_rounds_to_zero_are_refused(
    text: str, datatype: NamedNode, unit: NamedNode | None
) -> None:
    """A shape that requires a positive number admits them; as zero they would mean the opposite."""
    with pytest.raises(UnprocessableContent, match="too near zero"):
        _scalar(text, datatype, unit).quantity(_ROOT)


@pytest.mark.parametrize("text", ["0", "-0.0", "+.0", "0e10", "0.000E-5", " 0 "])
def test_zero_is_zero(text: str) -> None:
    """In all of its spellings."""
    assert _scalar(text, XSD.double, UNIT.DEG).quantity(_ROOT) == 0


def test_long_numbers_keep_their_value() -> None:
    """4,000 digits keep their value."""
    assert _scalar("1." + "3" * 4000, XSD.decimal, UNIT.RAD).quantity(_ROOT) == pytest.approx(4 / 3)
    assert _scalar("0" * 4000 + "7", XSD.integer, UNIT.DEG).quantity(_ROOT) == pytest.approx(math.radians(7))


def test_nodes_and_texts_are_told_apart() -> None:
    """A missing value is None, never a default; equal triples count once."""
    node = BlankNode("w")
    twice = [Triple(_ROOT, LF.waypoint, node), Triple(_ROOT, LF.waypoint, node)]
    body = Body(
        [*twice, Triple(_ROOT, LF.waypoint, Literal("no node")), Triple(node, LF.frame, Literal("base"))], _ROOT
    )
    assert body.nodes(_ROOT, LF.waypoint) == [node]
    assert body.node(_ROOT, LF.waypoint) == node
    assert body.text(_ROOT, LF.waypoint) == "no node"
    assert body.text(node, LF.frame) == "base"
    assert body.node(node, LF.frame) is None
    assert (body.node(node, LF.target), body.text(node, LF.target), body.number(node, LF.atTime)) == (None, None, None)
