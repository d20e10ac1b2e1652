"""The message of each constraint about a value that it refuses, in words for people."""

import pytest
from pyoxigraph import BlankNode, Literal, NamedNode, Triple

from linked_fleet_rdf.graph import integer
from linked_fleet_rdf.vocabulary import PREFIXES, VOM
from linked_fleet_shacl import Data, Violation, compile_shape, report
from linked_fleet_shacl.report import TermTexts, shortened
from linked_fleet_shacl.terms import SHACL, XSD
from shacl_findings import EX, turtle

_WORDS = TermTexts(PREFIXES)


def _check(shape: str, body: str) -> list[Violation]:
    return compile_shape(turtle(f"ex:Shape {shape} ."), EX.Shape).check(Data(turtle(f"ex:body {body} .")), EX.body)


def _message(shape: str, body: str) -> str:
    (violation,) = _check(shape, body)
    return violation.message.replace(f"<{EX.iri}", "ex:").replace(">", "")


@pytest.mark.parametrize(
    ("constraint", "values", "message"),
    [
        ("sh:minCount 2", "1", "must have 2 values or more, and has 1"),
        ("sh:maxCount 1", "1 , 2", "must have 1 value at most, and has 1, 2"),
        ("sh:maxCount 0", "1", "must have 0 values at most, and has 1"),
        ("sh:hasValue 2", "1", "must include 2, and has 1"),
        (
            "sh:qualifiedValueShape [ sh:class ex:C ] ; sh:qualifiedMinCount 1",
            "1",
            "must have 1 value or more that are a ex:C, and has 1",
        ),
        (
            "sh:qualifiedValueShape [ sh:nodeKind sh:Literal ] ; sh:qualifiedMaxCount 1",
            "1 , 2",
            "must have 1 value at most that are a literal, and has 1, 2",
        ),
        (
            "sh:qualifiedValueShape [ sh:and ( [ sh:class ex:C ] [ sh:nodeKind sh:IRI ] ) ] ; sh:qualifiedMinCount 1",
            "1",
            "must have 1 value or more that are a ex:C and an IRI, and has 1",
        ),
        ("sh:nodeKind sh:IRI", "1", "1 must be an IRI"),
        ("sh:nodeKind sh:BlankNode", "ex:a", "ex:a must be a blank node"),
        ("sh:nodeKind sh:Literal", "ex:a", "ex:a must be a literal"),
        ("sh:nodeKind sh:BlankNodeOrIRI", "1", "1 must be an IRI or a blank node"),
        ("sh:nodeKind sh:BlankNodeOrLiteral", "ex:a", "ex:a must be a literal or a blank node"),
        ("sh:nodeKind sh:IRIOrLiteral", "[]", "a blank node must be an IRI or a literal"),
        ("sh:class ex:C", "ex:a", "ex:a must be a ex:C"),
        ("sh:in ( ex:C )", "ex:a", "ex:a must be ex:C"),
        ("sh:datatype xsd:float", "'1.0'", "'1.0' must be of type xsd:float"),
        ("sh:minInclusive 1", "0", "0 must be at least 1"),
        ("sh:minExclusive 1", "1", "1 must be more than 1"),
        ("sh:maxExclusive 1.50", "2", "2 must be less than 1.50"),
        ("sh:maxInclusive 1.0471975511965976e0", "2e0", "2e0 must be at most 1.0471975511966"),
        ("sh:maxInclusive 1234567890123456", "1234567890123457", "1234567890123457 must be at most 1234567890123456"),
        ("sh:minLength 3", "'ab'", "'ab' must be 3 or more characters long"),
        ("sh:maxLength 1", "'ab'", "'ab' must be 1 characters long at most"),
        ("sh:languageIn ( 'en' 'DE' )", "'a'@fr", "'a' must be in the language en or de"),
        ("sh:uniqueLang true", "'a'@en , 'b'@EN", "must have one text in each language at most"),
        ("sh:equals ex:q", "1", "must have the values of ex:q; at fault: 1"),
        ("sh:disjoint ex:p", "1", "must have no value of ex:p; at fault: 1"),
        ("sh:pattern '^a'", "'b'", "'b' must be like '^a'"),
    ],
)
def test_a_message_about_a_property_says_what_would_be_right(constraint: str, values: str, message: str) -> None:
    """After its IRI, if the shape gives it no name."""
    assert _message(f"sh:property [ sh:path ex:p ; {constraint} ]", f"ex:p {values}") == f"ex:p: {message}"


@pytest.mark.parametrize(
    ("shape", "body", "message"),
    [
        (
            "sh:closed true ; sh:property [ sh:path ex:p ]",
            "ex:p 1 ; ex:q 2",
            "must have no other properties; at fault: ex:q 2",
        ),
        ("sh:hasValue ex:a", "ex:p 1", "must include ex:a, and has ex:body"),
        ("sh:not [ sh:class ex:C ]", "a ex:C", "ex:body must be other than a ex:C"),
        (
            "sh:not [ sh:path ex:p ; sh:name 'p' ; sh:minInclusive 3 ; sh:maxInclusive 5 ]",
            "ex:p 4",
            "ex:body must be other than p at least 3 and at most 5",
        ),
        (
            "sh:not [ sh:property [ sh:path ex:p ; sh:minCount 1 ] , [ sh:path ex:q ; sh:name 'q' ; sh:maxCount 1 ] ]",
            "ex:p 4",
            "ex:body must be other than ex:p have 1 value or more and q have 1 value at most",
        ),
        (
            "sh:not [ sh:property [ sh:path ( ex:p ex:q ) ; sh:maxCount 0 ] ]",
            "ex:p 4",
            "ex:body must be other than have 0 values at most",
        ),
        (
            "sh:and ( [ sh:class ex:C ] [ sh:nodeKind sh:BlankNode ] )",
            "ex:p 1",
            "ex:body must be a ex:C; ex:body must be a blank node",
        ),
        (
            "sh:xone ( [ sh:class ex:C ] [ sh:nodeKind sh:IRI ] )",
            "a ex:C",
            "ex:body must be just one of: a ex:C; an IRI",
        ),
        (
            "sh:or ( [ sh:class ex:C ] [ sh:nodeKind sh:BlankNode ] [ sh:class ex:C ] )",
            "ex:p 1",
            "ex:body must be a ex:C or a blank node",
        ),
        (
            "sh:node [ sh:class ex:C ; sh:nodeKind sh:BlankNode ]",
            "ex:p 1",
            "ex:body must be a ex:C; ex:body must be a blank node",
        ),
        ("sh:property [ sh:path ( ex:p ex:q ) ; sh:minCount 1 ]", "ex:p 1", "must have 1 value or more, and has none"),
    ],
)
def test_a_message_about_the_body_says_what_would_be_right(shape: str, body: str, message: str) -> None:
    assert _message(shape, body) == message


def _choice(names: str) -> str:
    """Return a branch for each value of ex:q, which requires ex:r and IRIs at ex:p."""
    branches = (
        f"[ sh:property [ sh:path ex:q ; sh:minCount 1 ; sh:in ( ex:{name} ) ] , [ sh:path ex:r ; sh:minCount 1 ] , "
        f"[ sh:path ex:p ; sh:name '{name}' ; sh:minCount 1 ; sh:nodeKind sh:IRI ] ]"
        for name in names
    )
    return f"sh:or ( {' '.join(branches)} )"


@pytest.mark.parametrize("names", ["ab", "abcd"])
@pytest.mark.parametrize(
    ("body", "message"),
    [
        ("ex:q ex:b ; ex:r 1", "b: must have 1 value or more, and has none"),
        ("ex:q ex:b", "ex:r: must have 1 value or more, and has none; b: must have 1 value or more, and has none"),
        ("ex:q ex:a ; ex:p 1", "ex:r: must have 1 value or more, and has none; a: 1 must be an IRI"),
    ],
)
def test_the_intended_branch_of_a_choice_is_reported(names: str, body: str, message: str) -> None:
    """The number of branches, which decides whether branches are indexed, makes no difference."""
    assert _message(_choice(names), body) == message


def test_an_unknown_value_selects_no_branch() -> None:
    assert _message(_choice("abcd"), "ex:q ex:x") == "ex:q must be one of ex:a, ex:b, ex:c, ex:d"


@pytest.mark.parametrize(
    ("values", "details"),
    [("1 , 2", [3] * 16 + [2] + [0] * 3), ("1 , 2 , 3 , 4 , 5 , 6", [7] * 7 + [1] + [0] * 12)],
)
def test_a_report_at_its_limit_lists_valid_branches(values: str, details: list[int]) -> None:
    """A report has at most 50 details; each value of ex:p and the missing ex:r are one each."""
    shape, names = f"sh:property [ sh:path ex:target ; {_choice('abcd')} ]", [f"t{number}" for number in range(20)]
    body = f"ex:target {' , '.join(f'ex:{name}' for name in names)} . "
    found = _check(shape, body + " . ".join(f"ex:{name} ex:q ex:a ; ex:p {values}" for name in names))
    assert [len(each.detail) for each in found] == details
    assert f"<{EX.iri}t19> must be <{EX.iri}q> have 1 value or more and" in found[-1].message


@pytest.mark.parametrize(
    ("term", "text"),
    [
        (VOM.unit, "vom:unit"),
        (NamedNode(VOM.iri), f"<{VOM.iri}>"),
        (NamedNode(VOM.iri + "x" * 76), "vom:" + "x" * 76),
        (NamedNode(VOM.iri + "x" * 77), "vom:" + "x" * 75 + "…"),
        (NamedNode("urn:" + "x" * 80), "<urn:" + "x" * 74 + "…"),
        (integer(-5), "-5"),
        (Literal("1.50", datatype=XSD.decimal), "1.50"),
        (Literal("5"), "'5'"),
        (Literal(" 5", datatype=XSD.integer), "' 5'"),
        (Literal("", datatype=XSD.integer), "''"),
        (Literal("x" * 80), f"'{'x' * 80}'"),
        (Literal("x" * 81), f"'{'x' * 79}…'"),
        (BlankNode("b"), "a blank node"),
        (Triple(EX.body, EX.p, EX.q), "a triple"),
    ],
)
def test_a_term_is_shown_briefly(term: object, text: str) -> None:
    """A number as it is, another literal in quotes, and no label of a blank node."""
    assert _WORDS.text(term) == text


def test_a_long_list_ends_with_how_many_more_there_are() -> None:
    assert _WORDS.list_text([integer(n) for n in range(3)]) == "0, 1, 2"
    assert _WORDS.list_text([integer(n) for n in range(20)]).endswith(", 18, 19")
    assert _WORDS.list_text([integer(n) for n in range(22)]).endswith(", 18, 19, 2 more")


def test_a_text_has_at_most_300_characters() -> None:
    assert shortened("x" * 300) == "x" * 300
    assert shortened("x" * 301) == "x" * 299 + "…"


@pytest.mark.parametrize(("length", "repeated"), [(1024, True), (1025, False)])
def test_a_report_repeats_no_long_value(length: int, repeated: bool) -> None:
    (violation,) = _check("sh:property [ sh:path ex:p ; sh:nodeKind sh:IRI ]", f"ex:p '{'x' * length}'")
    values = [value for _, predicate, value in report([violation]) if predicate == SHACL.value]
    assert values == ([Literal("x" * length)] if repeated else [])
