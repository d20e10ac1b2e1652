"""The validator's reports on bodies, and the nodes that belong to a body."""

from collections.abc import Sequence

import pytest
from pyoxigraph import BlankNode, NamedNode, RdfFormat, Triple, parse

from linked_fleet_rdf.graph import Node
from linked_fleet_rdf.validation import ShaclValidator, reachable_statements
from linked_fleet_rdf.vocabulary import PREFIXES, SH

_PREFIXES = "".join(f"@prefix {prefix}: <{iri}> .\n" for prefix, iri in PREFIXES.items())
_REQUEST = "http://example.org/r/elbow/actions/rotate"
_SHAPE = NamedNode("http://example.org/shape")
_SHAPED = """<shape> a sh:NodeShape ; sh:property
    [ sh:path vom:numericalValue ; sh:minCount 1 ; sh:maxCount 1 ; sh:minInclusive -1 ; sh:maxInclusive 2 ] ,
    [ sh:path vom:unit ; sh:minCount 1 ; sh:maxCount 1 ; sh:in ( unit:RAD ) ] ,
    [ sh:path lf:speed ; sh:maxCount 1 ; sh:node [ sh:property
        [ sh:path vom:numericalValue ; sh:minCount 1 ; sh:maxCount 1 ; sh:minExclusive 0 ] ] ] """


def _turtle(text: str) -> list[Triple]:
    return [quad.triple for quad in parse(_PREFIXES + text, format=RdfFormat.TURTLE, base_iri=_REQUEST)]


def _validator(shape: str) -> ShaclValidator:
    return ShaclValidator(_turtle(shape.replace("<shape>", f"<{_SHAPE.value}>") + "."), _SHAPE)


def _focus(body: Sequence[Triple]) -> Node:
    named = NamedNode(_REQUEST)
    return named if any(t.subject == named for t in body) else next(t.subject for t in body)  # type: ignore[return-value]


@pytest.mark.parametrize("subject", ["<>", "_:b"])
def test_a_report_is_about_the_request(subject: str) -> None:
    """Wherever the body's root is: the sentence names no internal blank node or name."""
    body = _turtle(f"{subject} vom:numericalValue 3 ; vom:unit unit:RAD .")
    found = _validator(_SHAPED).report(body, _focus(body))
    assert found is not None
    detail, report = found
    assert "vom:numericalValue: 3 must be at most 2" in detail
    if subject == "<>":
        assert NamedNode(_REQUEST) in {value for _, predicate, value in report if predicate == SH.focusNode}


def test_a_target_of_the_shape_narrows_nothing() -> None:
    """A body is validated whatever type it states, or none."""
    validator = _validator(_SHAPED + "; sh:targetClass maths:Scalar ")
    for type_ in ("", "a maths:Scalar ;", "a lf:Robot ;"):
        for value, conforms in ((1, True), (3, False)):
            body = _turtle(f"<> {type_} vom:numericalValue {value} ; vom:unit unit:RAD .")
            assert (validator.report(body, _focus(body)) is None) == conforms


def test_many_faults_are_told_briefly() -> None:
    """Five in the sentence, all in the report."""
    parts = ", ".join(f"[ sh:path lf:p{index} ; sh:minCount 1 ; sh:name 'p{index}' ]" for index in range(9))
    validator = _validator(f"<shape> a sh:NodeShape ; sh:property {parts} ")
    body = _turtle("<> vom:numericalValue 1 .")
    found = validator.report(body, _focus(body))
    assert found is not None
    assert found[0].endswith("and 4 more")
    assert len([predicate for _, predicate, _ in found[1] if predicate == SH.result]) == 9


def test_reachable_statements_are_those_below_the_root() -> None:
    """Through IRIs and blank nodes and around cycles, each triple once, and nothing else."""
    a, b = BlankNode("a"), BlankNode("b")
    focus, p, other = NamedNode(_REQUEST), NamedNode("urn:p"), NamedNode("urn:other")
    below = [Triple(focus, p, a), Triple(a, p, b), Triple(b, p, a), Triple(b, p, other), Triple(other, p, focus)]
    assert set(reachable_statements([*below, Triple(p, p, focus)], focus)) == set(below)
    assert len(reachable_statements(below, focus)) == len(below)
    deep = [Triple(BlankNode(f"n{i}"), p, BlankNode(f"n{i + 1}")) for i in range(5000)]
    assert len(reachable_statements(deep, BlankNode("n0"))) == 5000
