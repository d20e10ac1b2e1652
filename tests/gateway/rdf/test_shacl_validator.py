"""A judge gives the same verdict whether its shape is compiled or pySHACL has to run it."""

from collections.abc import Sequence

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pyoxigraph import BlankNode, NamedNode, RdfFormat, Triple, parse

from gateway.rdf.compiled import Unsupported, compile_shape
from gateway.rdf.graph import Node
from gateway.rdf.shacl_validator import Judge, reachable
from gateway.rdf.vocabulary import PREFIXES, SH

_PREFIXES = "".join(f"@prefix {prefix}: <{iri}> .\n" for prefix, iri in PREFIXES.items())
_REQUEST = "http://example.org/r/elbow/actions/rotate"
_SHAPE = NamedNode("http://example.org/shape")
_COMPILED = """<shape> a sh:NodeShape ; sh:property
    [ sh:path vom:numericalValue ; sh:minCount 1 ; sh:maxCount 1 ; sh:minInclusive -1 ; sh:maxInclusive 2 ] ,
    [ sh:path vom:unit ; sh:minCount 1 ; sh:maxCount 1 ; sh:in ( unit:RAD ) ] ,
    [ sh:path lf:speed ; sh:maxCount 1 ; sh:node [ sh:property
        [ sh:path vom:numericalValue ; sh:minCount 1 ; sh:maxCount 1 ; sh:minExclusive 0 ] ] ] """
# The compiler does not know the languages of texts; no body here has any, so it changes no verdict.
_UNSUPPORTED = _COMPILED + ", [ sh:path dcterms:title ; <http://www.w3.org/ns/shacl#uniqueLang> true ] "


def _turtle(text: str) -> list[Triple]:
    return [quad.triple for quad in parse(_PREFIXES + text, format=RdfFormat.TURTLE, base_iri=_REQUEST)]


def _judge(shape: str) -> Judge:
    return Judge(_turtle(shape.replace("<shape>", f"<{_SHAPE.value}>") + "."), _SHAPE)


_numbers = st.sampled_from(["0", "2", "2.5", "-1.0", "-7", "1e0", '"1"', '"x"^^xsd:decimal', "true", "unit:RAD"])
_speeds = st.sampled_from(
    [
        "",
        *(
            f"; lf:speed {each}"
            for each in ("1", "<s>", "[]", *(f"[ vom:numericalValue {n} ]" for n in ("1", "0", "1, 2")))
        ),
    ]
)


@st.composite
def _bodies(draw: st.DrawFn) -> str:
    values = ", ".join(draw(st.lists(_numbers, min_size=1, max_size=2)))
    units = ", ".join(draw(st.lists(st.sampled_from(["unit:RAD", "unit:DEG", '"rad"']), min_size=1, max_size=2)))
    subject = draw(st.sampled_from(["<>", "_:b", "vom:numericalValue"]))
    return f"{subject} vom:numericalValue {values} ; vom:unit {units} {draw(_speeds)} ."


def _focus(body: Sequence[Triple]) -> Node:
    named = NamedNode(_REQUEST)
    return named if any(t.subject == named for t in body) else next(t.subject for t in body)  # type: ignore[return-value]


def test_the_shape_of_the_comparison_is_not_compiled() -> None:
    """Or the tests below would compare the compiler with itself."""
    compile_shape(_turtle(_COMPILED.replace("<shape>", f"<{_SHAPE.value}>") + "."), _SHAPE)
    with pytest.raises(Unsupported):
        compile_shape(_turtle(_UNSUPPORTED.replace("<shape>", f"<{_SHAPE.value}>") + "."), _SHAPE)


_FAST, _SLOW = _judge(_COMPILED), _judge(_UNSUPPORTED)


@settings(derandomize=True, deadline=None, max_examples=60)
@given(_bodies())
def test_both_ways_give_one_verdict(turtle: str) -> None:
    """On good and bad bodies alike, and the same paths are to blame."""
    body = _turtle(turtle)
    fast, slow = (each.report(body, _focus(body), _REQUEST) for each in (_FAST, _SLOW))
    assert (fast is None) == (slow is None)
    if fast is not None and slow is not None:
        assert all(detail.strip() for detail, _ in (fast, slow))
        assert _blamed(fast[1]) == _blamed(slow[1])


def _blamed(report: Sequence[Triple]) -> set[object]:
    """Paths of the results that the report lists, not of what it says in detail."""
    results = {t.object for t in report if t.predicate == SH.result}
    return {t.object for t in report if t.predicate == SH.resultPath and t.subject in results}


@pytest.mark.parametrize("judge", [_FAST, _SLOW], ids=["compiled", "pySHACL"])
@pytest.mark.parametrize("subject", ["<>", "_:b"])
def test_a_report_is_about_the_request(judge: Judge, subject: str) -> None:
    """Wherever the body's root stands: the sentence names no blank node of ours and no inner name."""
    body = _turtle(f"{subject} vom:numericalValue 3 ; vom:unit unit:RAD .")
    found = judge.report(body, _focus(body), _REQUEST)
    assert found is not None
    detail, report = found
    assert "urn:linked-fleet:body" not in detail
    assert "urn:linked-fleet:body" not in str(report)
    if subject == "<>":
        assert NamedNode(_REQUEST) in {t.object for t in report if t.predicate == SH.focusNode}


def test_a_target_of_the_shape_narrows_nothing() -> None:
    """A body is judged whatever type it states, or none."""
    for shape in (_COMPILED, _UNSUPPORTED):
        judge = _judge(shape + "; sh:targetClass maths:Scalar ")
        for type_ in ("", "a maths:Scalar ;", "a lf:Robot ;"):
            for value, conforms in ((1, True), (3, False)):
                body = _turtle(f"<> {type_} vom:numericalValue {value} ; vom:unit unit:RAD .")
                assert (judge.report(body, _focus(body), _REQUEST) is None) == conforms


def test_many_faults_are_told_briefly() -> None:
    """Five in the sentence, all in the report."""
    parts = ", ".join(f"[ sh:path lf:p{index} ; sh:minCount 1 ; sh:name 'p{index}' ]" for index in range(9))
    judge = _judge(f"<shape> a sh:NodeShape ; sh:property {parts} ")
    body = _turtle("<> vom:numericalValue 1 .")
    found = judge.report(body, _focus(body), _REQUEST)
    assert found is not None
    assert found[0].endswith("and 4 more")
    assert len([t for t in found[1] if t.predicate == SH.result]) == 9


def test_reachable_is_what_hangs_below() -> None:
    """Through IRIs and blank nodes, round cycles, each triple once; nothing beside it."""
    a, b = BlankNode("a"), BlankNode("b")
    focus, p, other = NamedNode(_REQUEST), NamedNode("urn:p"), NamedNode("urn:other")
    below = [Triple(focus, p, a), Triple(a, p, b), Triple(b, p, a), Triple(b, p, other), Triple(other, p, focus)]
    assert set(reachable([*below, Triple(p, p, focus)], focus)) == set(below)
    assert len(reachable(below, focus)) == len(below)
    deep = [Triple(BlankNode(f"n{i}"), p, BlankNode(f"n{i + 1}")) for i in range(5000)]
    assert len(reachable(deep, BlankNode("n0"))) == 5000
