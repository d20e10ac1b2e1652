"""Differences between compiled shapes and pySHACL, and shapes left to pySHACL, each with its reason."""

import subprocess
import sys

import pytest
import rdflib
from pyoxigraph import Literal, NamedNode, Triple

from linked_fleet_rdf.graph import Graph, integer
from linked_fleet_shacl import Data, Unsupported, compile_graph, compile_shape
from linked_fleet_shacl.terms import SHACL, XSD, Term
from shacl_findings import EX, compiled_finds, turtle, unrepaired_pyshacl_finds


def _literal(text: str, datatype: NamedNode) -> Literal:
    return Literal(text, datatype=datatype)


def _of_value(*constraints: tuple[NamedNode, Term]) -> list[Triple]:
    graph = Graph()
    graph.add(EX.Shape, SHACL.property, node := graph.blank())
    for predicate, value in ((SHACL.path, EX.p), *constraints):
        graph.add(node, predicate, value)
    return graph.triples


_MOST_5 = (SHACL.maxInclusive, _literal("5", XSD.decimal))
_LEAST_5 = (SHACL.minInclusive, _literal("5", XSD.decimal))


@pytest.mark.parametrize(
    ("constraint", "value", "reason"),
    [
        ((SHACL.datatype, XSD.integer), _literal("1_0", XSD.integer), "no lexical form of XML Schema, only of Python"),
        ((SHACL.datatype, XSD.integer), _literal(" 10 ", XSD.integer), "no lexical form: white space is none of it"),
        ((SHACL.datatype, XSD.double), _literal("1\n", XSD.double), "no lexical form: white space is none of it"),
        ((SHACL.datatype, XSD.integer), _literal("\u0663", XSD.integer), "no lexical form: digits are 0 to 9"),
        ((SHACL.datatype, XSD.decimal), _literal("1e5", XSD.decimal), "no lexical form: a decimal has no exponent"),
        ((SHACL.datatype, XSD.decimal), _literal("NaN", XSD.decimal), "no lexical form: every decimal is a number"),
        ((SHACL.datatype, XSD.double), _literal("Infinity", XSD.double), "no lexical form: it is INF"),
        ((SHACL.datatype, XSD.double), _literal("nan", XSD.double), "no lexical form: it is NaN"),
        ((SHACL.datatype, XSD.dateTime), _literal("2026-01-01", XSD.dateTime), "no lexical form: it needs a time"),
        (
            (SHACL.datatype, XSD.dateTime),
            _literal("2026-01-01 00:00:00", XSD.dateTime),
            "no lexical form: it needs a T",
        ),
        (_LEAST_5, _literal("abc", XSD.float), "ill-typed, ordered by the name of its type: float after decimal"),
        (_MOST_5, _literal("true", XSD.boolean), "not comparable, ordered by the name of its type"),
        ((SHACL.maxInclusive, integer(5)), _literal("NaN", XSD.float), "not comparable: NaN is not less than 5"),
        ((SHACL.minExclusive, _literal("5", XSD.byte)), _literal("300", XSD.byte), "ill-typed: beyond a byte"),
    ],
)
def test_violations_that_pyshacl_misses_are_reported(
    constraint: tuple[NamedNode, Term], value: Literal, reason: str
) -> None:
    """SHACL 4.1.2 and 4.3: ill-typed literals have no datatype, and a comparison that is not true is a violation."""
    shapes, body = _of_value(constraint), [Triple(EX.body, EX.p, value)]
    assert unrepaired_pyshacl_finds(shapes, EX.Shape, body, EX.body) == set(), reason
    assert compiled_finds(shapes, EX.Shape, body, EX.body), reason


def test_nan_against_a_decimal_is_a_violation_and_no_crash() -> None:
    """Python refuses to order the two, which pySHACL does not expect."""
    shapes, body = _of_value(_MOST_5), [Triple(EX.body, EX.p, _literal("NaN", XSD.float))]
    with pytest.raises(ArithmeticError):
        unrepaired_pyshacl_finds(shapes, EX.Shape, body, EX.body)
    assert compiled_finds(shapes, EX.Shape, body, EX.body)


def test_values_are_counted_by_their_terms() -> None:
    """1 and 01 are different terms with one value; by default rdflib rewrites one as the other."""
    shapes = _of_value((SHACL.maxCount, integer(1)))
    body = [Triple(EX.body, EX.p, integer(1)), Triple(EX.body, EX.p, _literal("01", XSD.integer))]
    assert rdflib.Literal("01", datatype=rdflib.XSD.integer) == rdflib.Literal("1", datatype=rdflib.XSD.integer)
    assert len(compiled_finds(shapes, EX.Shape, body, EX.body)) == 1


@pytest.mark.parametrize(("day", "exists"), [("-0044-03-15", True), ("-0044-02-30", False), ("-0004-02-29", True)])
def test_days_before_the_common_era_exist_as_later_ones_do(day: str, exists: bool) -> None:
    shapes, body = _of_value((SHACL.datatype, XSD.date)), [Triple(EX.body, EX.p, _literal(day, XSD.date))]
    assert bool(compiled_finds(shapes, EX.Shape, body, EX.body)) is not exists


def test_an_integer_has_as_many_digits_as_python_reads() -> None:
    """Longer ones are no numbers, so that reading one takes a bounded time."""
    shapes = _of_value((SHACL.maxInclusive, integer(5)))
    for digits, refused in ((4_300, False), (4_301, True)):
        body = [Triple(EX.body, EX.p, _literal("-" + "1" * (digits - 1), XSD.integer))]
        assert bool(compiled_finds(shapes, EX.Shape, body, EX.body)) is refused, digits


def _compile(text: str) -> None:
    compile_shape(turtle(text), EX.Shape)


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ('ex:Shape sh:equals "p"', "sh:equals 'p'"),
        ("ex:Shape sh:disjoint [ sh:inversePath ex:p ]", "sh:disjoint a blank node"),
        ("ex:Shape sh:lessThan ex:p", "sh:lessThan"),
        ("ex:Shape sh:lessThanOrEquals ex:p", "sh:lessThanOrEquals"),
        ("ex:Shape sh:uniqueLang true", "sh:uniqueLang in a node shape"),
        ('ex:Shape sh:property [ sh:path ex:p ; sh:uniqueLang "1"^^xsd:boolean ]', "sh:uniqueLang '1'"),
        ("ex:Shape sh:languageIn ( 1 )", "sh:languageIn 1"),
        ("ex:Shape sh:closed 1", "sh:closed 1"),
        ("ex:Shape sh:closed true ; sh:ignoredProperties ( [ ] )", "sh:ignoredProperties a blank node"),
        ('ex:Shape sh:sparql [ sh:select "" ]', "sh:sparql"),
        ("ex:Shape sh:inn ( 1 )", "sh:inn"),
        ('ex:Shape sh:severity "high"', "sh:severity 'high'"),
        ('ex:Shape sh:deactivated "true"', "sh:deactivated 'true'"),
        ("ex:Shape sh:class ex:C ; sh:target [ ]", "sh:target"),
        ("ex:Shape sh:class ex:C . ex:graph sh:entailment ex:RDFS", "sh:entailment"),
        ("ex:Shape sh:node ex:Shape", "<http://example.org/Shape> refers to itself"),
        (
            "ex:Shape sh:property [ sh:path ex:p ; sh:node ex:Other ] . ex:Other sh:not ex:Shape",
            "<http://example.org/Shape> refers to itself",
        ),
        ("ex:Shape sh:node ex:Missing", "<http://example.org/Missing> is not described as a shape"),
        ("ex:Shape sh:node [ sh:path ex:p ; sh:minCount 1 ]", "sh:node of a property shape"),
        ("ex:Shape sh:property [ sh:class ex:C ]", "sh:property a blank node without sh:path"),
        (
            "ex:Shape sh:property ex:Other . ex:Other sh:class ex:C",
            "sh:property <http://example.org/Other> without sh:path",
        ),
        ("ex:Shape sh:minCount 1", "a count in a node shape"),
        ("ex:Shape sh:maxCount 1", "a count in a node shape"),
        ("ex:Shape sh:property [ sh:path ex:p , ex:q ]", "2 values of sh:path"),
        ('ex:Shape sh:property [ sh:path ex:p ; sh:minCount "1" ]', "sh:minCount '1'"),
        ("ex:Shape sh:property [ sh:path ex:p ; sh:minCount -1 ]", "sh:minCount -1"),
        ("ex:Shape sh:property [ sh:path ex:p ; sh:minCount ex:a ]", "sh:minCount <http://example.org/a>"),
        ('ex:Shape sh:property [ sh:path ex:p ; sh:maxCount "1"^^xsd:int ]', "sh:maxCount 1"),
        ("ex:Shape sh:property [ sh:path ex:p ; sh:maxCount 1234567890123456789 ]", "sh:maxCount 1234567890123456789"),
        ("ex:Shape sh:minLength 1 , 2", "2 values of sh:minLength"),
        ("ex:Shape sh:maxLength -1", "sh:maxLength -1"),
        ("ex:Shape sh:property [ sh:path ex:p ; sh:minCount 1 , 2 ]", "2 values of sh:minCount"),
        ("ex:Shape sh:property [ sh:path [ sh:inversePath ( ex:p ex:q ) ] ]", "sh:inversePath of a blank node"),
        ("ex:Shape sh:property [ sh:path ( ex:p ) ]", "a path of fewer than two parts"),
        ("ex:Shape sh:property [ sh:path [ ] ]", "a path that is none"),
        ("ex:Shape sh:property [ sh:path [ sh:zeroOrMorePath ex:p ; sh:oneOrMorePath ex:q ] ]", "a path that is none"),
        ("ex:Shape sh:property [ sh:path [ sh:zeroOrMorePath ex:p , ex:q ] ]", "2 values of sh:zeroOrMorePath"),
        ("ex:Shape sh:property [ sh:path [ ex:q ex:p ] ]", "<http://example.org/q> of <http://example.org/p>"),
        ("ex:Shape sh:property [ sh:path [ sh:alternativePath ( ex:p ) ] ]", "a path of fewer than two parts"),
        ("ex:Shape sh:property [ sh:path ( ex:p [ sh:zeroOrMorePath 1 ] ) ]", "1 as path"),
        ('ex:Shape sh:property [ sh:path "p" ]', "a literal as path"),
        ("ex:Shape sh:property [ sh:path _:p ] . _:p sh:zeroOrMorePath _:p", "a blank node as path"),
        ("ex:Shape sh:datatype xsd:integer , xsd:float", "2 values of sh:datatype"),
        ("ex:Shape sh:datatype xsd:time", "sh:datatype xsd:time"),
        ('ex:Shape sh:datatype "x"', "sh:datatype 'x'"),
        ("ex:Shape sh:datatype rdf:HTML", "sh:datatype rdf:HTML"),
        ("ex:Shape sh:datatype rdfs:Literal", "sh:datatype rdfs:Literal"),
        ("ex:Shape sh:nodeKind ex:Kind", "sh:nodeKind <http://example.org/Kind>"),
        ("ex:Shape sh:class [ ]", "sh:class a blank node"),
        ("ex:Shape sh:hasValue [ ]", "a blank node as value"),
        ("ex:Shape sh:in ( [ ] )", "a blank node as value"),
        ("ex:Shape sh:in _:l . _:l rdf:first 1 ; rdf:rest _:l", "a collection without an end"),
        ("ex:Shape sh:in ex:list", "0 values of rdf:first"),
        ("ex:Shape sh:or ( )", "an empty collection of shapes"),
        ("ex:Shape sh:or ( [ ] )", "a blank node is not described as a shape"),
        ('ex:Shape sh:minInclusive "a"', "sh:minInclusive 'a'"),
        ('ex:Shape sh:maxInclusive "2026-01-01T00:00:00Z"^^xsd:dateTime', "sh:maxInclusive '2026-01-01T00:00:00Z'"),
        ('ex:Shape sh:maxInclusive "NaN"^^xsd:float', "sh:maxInclusive NaN"),
        ('ex:Shape sh:pattern "("', "sh:pattern '(': missing ), unterminated subpattern at position 0"),
        ('ex:Shape sh:pattern "a"@en', "sh:pattern 'a'"),
        ("ex:Shape sh:pattern ex:a", "sh:pattern <http://example.org/a>"),
        ('ex:Shape sh:pattern "a" ; sh:flags "x"', "sh:flags 'x'"),
        ('ex:Shape sh:pattern "a" ; sh:flags "i" , "s"', "2 values of sh:flags"),
        (
            "ex:Shape sh:property [ sh:path ex:p ; sh:qualifiedValueShape [ sh:class ex:C ] ; sh:qualifiedMinCount 1 ; "
            "sh:qualifiedValueShapesDisjoint true ]",
            "sh:qualifiedValueShapesDisjoint",
        ),
        ("ex:Shape sh:qualifiedValueShape [ sh:class ex:C ] ; sh:qualifiedMinCount 1", "a count in a node shape"),
        (
            "ex:Shape sh:property [ sh:path ex:p ; sh:qualifiedValueShape [ sh:class ex:C ] ]",
            "sh:qualifiedValueShape without a count",
        ),
        ("ex:Shape sh:property [ sh:path ex:p ; sh:qualifiedMinCount 1 ]", "sh:qualifiedMinCount"),
        ("ex:Shape ex:odd 1 . ex:Odd sh:parameter [ sh:path ex:odd ]", "constraint components of one's own"),
        ("ex:Other sh:class ex:C", "<http://example.org/Shape> is not described as a shape"),
    ],
)
def test_unknown_constraints_are_refused(text: str, reason: str) -> None:
    """A constraint is compiled or refused, never ignored; the reason states why."""
    with pytest.raises(Unsupported) as refused:
        _compile(text + " .")
    assert str(refused.value) == reason


def test_the_shapes_of_a_graph_report_with_the_prefixes_that_they_are_given() -> None:
    """The prefixes shorten IRIs in messages, as they do for a single shape."""
    text = "ex:Shape sh:targetNode ex:body ; sh:property [ sh:path ex:p ; sh:minCount 1 ] ."
    (violation,) = compile_graph(turtle(text), {"x": "http://example.org/"}).check(Data([]))
    assert violation.message == "x:p: must have 1 value or more, and has none"


def test_targets_that_it_does_not_know_are_refused() -> None:
    """Otherwise a shape with no other target would validate nothing."""
    for text in ("ex:Shape sh:target [ ]", "ex:Shape sh:targetNode [ ]"):
        with pytest.raises(Unsupported):
            compile_graph(turtle(text + " ."))


def test_terms_without_constraints_are_ignored() -> None:
    """Names and other texts for people, targets, and terms outside SHACL."""
    _compile("""ex:Shape a sh:NodeShape ; rdfs:label "a shape" ; ex:note 1 ; sh:severity sh:Violation ;
        sh:targetClass ex:C ; sh:targetSubjectsOf ex:p ; sh:deactivated false ;
        sh:property [ sh:path ex:p ; sh:name "p" ; sh:description "p" ; sh:order 1 ; sh:group ex:G ;
                      sh:defaultValue 1 ; sh:message "p" ] .""")


def test_the_package_stands_alone() -> None:
    """It imports no other part of the gateway, and no validator."""
    said = "import sys, linked_fleet_shacl; print(*sys.modules)"
    loaded = subprocess.run([sys.executable, "-c", said], capture_output=True, text=True, check=True).stdout.split()
    assert not {"linked_fleet_agent", "linked_fleet_gateway", "rdflib", "pyshacl", "asyncio"}.intersection(loaded)
