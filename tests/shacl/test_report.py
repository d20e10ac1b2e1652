"""A compiled shape's messages about a refused body, and the bounded cost of a hostile body."""

from collections.abc import Sequence
from itertools import pairwise

import pyshacl
import pytest
import rdflib
from pyoxigraph import BlankNode, Literal, NamedNode, Triple

from graphs import graph_of
from linked_fleet_rdf.graph import integer
from linked_fleet_rdf.vocabulary import LF, PREFIXES, VOM
from linked_fleet_shacl import CompiledShape, Data, Violation, compile_shape, report
from linked_fleet_shacl.check import MOST
from linked_fleet_shacl.terms import SHACL, XSD, Term
from shacl_findings import EX, turtle

_BODY, _SHAPE = EX.body, EX.Shape
_TARGETS = """ex:Shape sh:property [ sh:path lf:target ; sh:minCount 1 ; sh:or (
    [ sh:property [ sh:path lf:ofJoint ; sh:hasValue ex:elbow ] , [ sh:path vom:numericalValue ; sh:name "angle" ;
                    sh:minCount 1 ; sh:maxInclusive 1.5 ] ]
    [ sh:property [ sh:path lf:ofJoint ; sh:hasValue ex:wrist ] ]
    [ sh:property [ sh:path lf:ofJoint ; sh:hasValue ex:knee ] ]
    [ sh:property [ sh:path lf:ofJoint ; sh:hasValue ex:hip ] ] ) ] ."""
_UNITS = """ex:Shape sh:or (
    [ sh:property [ sh:path vom:unit ; sh:in ( vom:Degree ) ] , [ sh:path vom:numericalValue ; sh:maxInclusive 60 ] ]
    [ sh:property [ sh:path vom:unit ; sh:in ( vom:Radian ) ] , [ sh:path vom:numericalValue ; sh:maxInclusive 1 ] ]
    ) ."""


def _compiled(text: str) -> CompiledShape:
    return compile_shape(turtle(text), _SHAPE, PREFIXES)


def _check(shape: str, body: str) -> list[Violation]:
    return _compiled(shape).check(Data(turtle(body)), _BODY)


@pytest.mark.parametrize(
    ("shape", "body", "message"),
    [
        ('sh:property [ sh:path ex:p ; sh:name "speed" ; sh:minCount 1 ]', "",
         "speed: must have 1 value or more, and has none"),
        ('sh:property [ sh:path vom:unit ; sh:in ( vom:Degree "x" ) ]', "vom:unit ex:m",
         "vom:unit: <http://example.org/m> must be one of vom:Degree, 'x'"),
        ('sh:property [ sh:path ex:p ; sh:name "p" ; sh:maxInclusive 5.5 ]', "ex:p 6", "p: 6 must be at most 5.5"),
        ('sh:property [ sh:path ex:p ; sh:name "p" ; sh:or ( [ sh:datatype xsd:float ] [ sh:datatype xsd:int ] ) ]',
         'ex:p "a"', "p: 'a' must be of type xsd:float or of type xsd:int"),
        ('sh:property [ sh:path ex:p ; sh:name "p" ; sh:node [ sh:property [ sh:path ex:q ; sh:minCount 1 ] ] ]',
         "ex:p [ ]", "p: <http://example.org/q>: must have 1 value or more, and has none"),
        ('sh:property [ sh:path ex:p ; sh:minCount 1 ; sh:message "say p" ]', "", "say p"),
        (_UNITS, "vom:unit vom:Degree ; vom:numericalValue 61", "vom:numericalValue: 61 must be at most 60"),
        (_UNITS, "vom:unit vom:Radian ; vom:numericalValue 2", "vom:numericalValue: 2 must be at most 1"),
        (_TARGETS, "lf:target [ lf:ofJoint ex:elbow ; vom:numericalValue 2 ]",
         "lf:target: angle: 2 must be at most 1.5"),
        (_TARGETS, "lf:target [ lf:ofJoint ex:toe ]",
         "lf:target: lf:ofJoint must be one of <http://example.org/elbow>, <http://example.org/wrist>, "
         "<http://example.org/knee>, <http://example.org/hip>"),
    ],
)  # fmt: skip
def test_a_message_says_what_would_be_right(shape: str, body: str, message: str) -> None:
    """With the name of the property; of the branches of sh:or it describes the one that was meant."""
    shape = shape if shape.startswith("ex:Shape") else f"ex:Shape {shape} ."
    (violation,) = _check(shape, f"ex:body {body or 'ex:other 1'} .")
    assert violation.message == message


def test_detail_has_the_violations_inside() -> None:
    """Those of sh:node, and of the meant branch of sh:or, down to the violated limit."""
    (outer,) = _check(_TARGETS, "ex:body lf:target [ lf:ofJoint ex:elbow ; vom:numericalValue 2 ] .")
    assert (outer.path, outer.component) == (LF.target, SHACL.OrConstraintComponent)
    (inner,) = outer.detail
    assert (inner.focus, inner.path, inner.value) == (outer.value, VOM.numericalValue, integer(2))
    assert inner.component == SHACL.MaxInclusiveConstraintComponent


def test_a_report_is_a_validation_report() -> None:
    """It conforms to the specification's shape for reports, with details below the results."""
    compiled = _compiled(_TARGETS)
    found = compiled.check(Data(turtle("ex:body lf:target [ lf:ofJoint ex:elbow ; vom:numericalValue 2 ] .")), _BODY)
    triples = report(found, compiled.triples)
    graph = graph_of([Triple(*each) for each in triples])
    sh = rdflib.SH
    (root,) = graph.subjects(rdflib.RDF.type, sh.ValidationReport)
    assert graph.value(root, sh.conforms) == rdflib.Literal(False)
    (result,) = graph.objects(root, sh.result)
    assert graph.value(result, sh.focusNode) == rdflib.URIRef(_BODY.value)
    assert graph.value(result, sh.resultPath) == rdflib.URIRef(LF.target.value)
    (detail,) = graph.objects(result, sh.detail)
    assert graph.value(detail, sh.focusNode) == graph.value(result, sh.value)
    for each in (result, detail):
        assert (each, rdflib.RDF.type, sh.ValidationResult) in graph
        assert graph.value(each, sh.resultSeverity) == sh.Violation
        assert graph.value(each, sh.sourceShape) and graph.value(each, sh.sourceConstraintComponent)
        assert graph.value(each, sh.resultMessage)
    again = graph_of(turtle(_REPORT_SHAPE))
    assert pyshacl.validate(graph, shacl_graph=again)[0]


_REPORT_SHAPE = """ex:Report a sh:NodeShape ; sh:targetClass sh:ValidationReport ;
    sh:property [ sh:path sh:conforms ; sh:minCount 1 ; sh:maxCount 1 ; sh:datatype xsd:boolean ] ;
    sh:property [ sh:path sh:result ; sh:class sh:ValidationResult ; sh:nodeKind sh:BlankNodeOrIRI ] .
ex:Result a sh:NodeShape ; sh:targetClass sh:ValidationResult ;
    sh:property [ sh:path sh:focusNode ; sh:minCount 1 ; sh:maxCount 1 ] , [ sh:path sh:value ; sh:maxCount 1 ] ,
        [ sh:path sh:resultPath ; sh:maxCount 1 ; sh:nodeKind sh:BlankNodeOrIRI ] ,
        [ sh:path sh:sourceConstraintComponent ; sh:minCount 1 ; sh:maxCount 1 ; sh:nodeKind sh:IRI ] ,
        [ sh:path sh:resultSeverity ; sh:minCount 1 ; sh:maxCount 1 ; sh:nodeKind sh:IRI ] ,
        [ sh:path sh:detail ; sh:class sh:ValidationResult ] ."""


def test_a_report_spells_out_a_path_that_is_no_predicate() -> None:
    """A reader cannot look up a blank node of the shapes graph."""
    compiled = _compiled("ex:Shape sh:property [ sh:path ( ex:p [ sh:zeroOrMorePath ex:q ] ) ; sh:minCount 1 ] .")
    triples = report(compiled.check(Data([]), _BODY), compiled.triples)
    graph = graph_of([Triple(*each) for each in triples])
    (path,) = graph.objects(None, rdflib.SH.resultPath)
    first, second = rdflib.collection.Collection(graph, path)
    assert first == rdflib.URIRef("http://example.org/p")
    assert graph.value(second, rdflib.SH.zeroOrMorePath) == rdflib.URIRef("http://example.org/q")


def test_a_report_spells_out_a_path_once() -> None:
    compiled = _compiled("ex:Shape sh:property [ sh:path ( ex:p ex:q ) ; sh:minCount 1 ; sh:hasValue 1 ] .")
    found = compiled.check(Data([]), _BODY)
    statements = report(found, compiled.triples)
    assert len(found) == 2 and len(statements) == len(set(statements))


def test_blank_nodes_of_body_and_shape_stay_apart() -> None:
    """Labels are arbitrary, so both may use the same; in the report they are two nodes."""
    shape = [Triple(_SHAPE, SHACL.property, BlankNode("b1")), Triple(BlankNode("b1"), SHACL.path, LF.target),
             Triple(BlankNode("b1"), SHACL.nodeKind, SHACL.IRI)]  # fmt: skip
    found = compile_shape(shape, _SHAPE).check(Data([Triple(_BODY, LF.target, BlankNode("b1"))]), _BODY)
    stated = {predicate: value for _, predicate, value in report(found)}
    assert stated[SHACL.value] != stated[SHACL.sourceShape]
    assert len({subject for subject, _, _ in report(found) if subject in stated.values()}) == 1, "the result alone"


def test_no_violations_make_a_report_that_conforms() -> None:
    assert [value for _, predicate, value in report([]) if predicate == SHACL.conforms] == [
        Literal("true", datatype=XSD.boolean)
    ]


# --- hostile bodies ---


class _Counted(Data):
    """Data that counts look-ups."""

    def __init__(self, triples: Sequence[Triple]) -> None:
        super().__init__(triples)
        self.looked_up = 0

    def objects(self, subject: Term, predicate: NamedNode) -> Sequence[Term]:
        self.looked_up += 1
        return super().objects(subject, predicate)


def test_without_the_shapes_graph_a_report_leaves_out_the_parts_of_a_path() -> None:
    compiled = _compiled("ex:Shape sh:property [ sh:path ( ex:p ex:q ) ; sh:minCount 1 ] .")
    graph = graph_of(report(compiled.check(Data([]), _BODY)))
    (path,) = graph.objects(None, rdflib.SH.resultPath)
    assert isinstance(path, rdflib.BNode) and (path, None, None) not in graph


def test_thousands_of_values_break_a_maximum_once() -> None:
    body = [Triple(_BODY, LF.target, integer(n)) for n in range(10_000)]
    compiled = _compiled("ex:Shape sh:property [ sh:path lf:target ; sh:maxCount 1 ; sh:nodeKind sh:Literal ] .")
    (violation,) = compiled.check(Data(body), _BODY)
    assert violation.component == SHACL.MaxCountConstraintComponent
    assert len(violation.message) < 1000


def test_a_report_ends_after_so_many_violations() -> None:
    """And so do the details in it."""
    targets = [NamedNode(f"http://example.org/{n}") for n in range(5_000)]
    body = [Triple(_BODY, LF.target, node) for node in targets]
    many = "sh:or ( " + "[ sh:class ex:C ; sh:nodeKind sh:Literal ] " * 15 + ")"
    found = _compiled(f"ex:Shape sh:property [ sh:path lf:target ; {many} ] .").check(Data(body), _BODY)
    assert len(found) == MOST
    assert sum(len(violation.detail) for violation in found) <= 250


def test_a_report_at_its_limit_does_not_look_for_further_details() -> None:
    """Ten values with five details each are the limit of 50."""

    def looked_up(count: int) -> int:
        first, *values = (NamedNode(f"http://example.org/{n}") for n in range(1 + count))
        body = [Triple(_BODY, LF.target, first), *(Triple(first, LF.target, value) for value in values)]
        data = _Counted(body + [Triple(value, LF.target, integer(n)) for value in values for n in range(5)])
        found = compiled.check(data, _BODY)
        assert [len(violation.detail) for violation in found] == [5] * min(count, 10) + [0] * (count - 10)
        return data.looked_up

    inner = "sh:path lf:target ; sh:and ( [ sh:path lf:target ; sh:nodeKind sh:IRI ] )"
    compiled = _compiled(f"ex:Shape sh:property [ sh:path lf:target ; sh:property [ {inner} ] ] .")
    assert looked_up(20) - looked_up(15) < looked_up(10) - looked_up(5)


@pytest.mark.parametrize("limit", ["sh:maxCount 1000", "sh:maxCount 10"])
def test_a_node_that_many_ways_lead_to_is_judged_once(limit: str) -> None:
    """Layers in which each node refers to all of the next: few triples, and a million paths."""
    layers = [[NamedNode(f"http://example.org/{layer}-{n}") for n in range(40)] for layer in range(5)]
    body = [Triple(_BODY, LF.target, node) for node in layers[0]]
    body += [Triple(a, LF.target, b) for upper, lower in pairwise(layers) for a in upper for b in lower]
    shape = f"[ sh:path lf:target ; {limit} ]"
    for _ in range(4):
        shape = f"[ sh:path lf:target ; sh:property {shape} ]"
    data = _Counted(body)
    found = _compiled(f"ex:Shape sh:property {shape} .").check(data, _BODY)
    assert len(found) == (0 if limit.endswith("1000") else MOST)
    assert data.looked_up < 2 * len(body)


def test_conforming_nodes_are_checked_once_for_an_explanation() -> None:
    """Only the last node of a path of its own is wrong; before it is found, no other path is followed twice."""
    layers = [[NamedNode(f"http://example.org/{layer}-{n}") for n in range(40)] for layer in range(4)]
    body = [Triple(_BODY, LF.target, node) for node in layers[0]]
    body += [Triple(a, LF.target, b) for upper, lower in pairwise(layers) for a in upper for b in lower]
    own = [_BODY, *(NamedNode(f"http://example.org/own-{layer}") for layer in range(4))]
    body += [Triple(a, LF.target, b) for a, b in pairwise(own)]
    body.append(Triple(own[-1], LF.target, integer(1)))
    shape = "[ sh:path lf:target ; sh:nodeKind sh:IRI ]"
    for _ in range(4):
        shape = f"[ sh:path lf:target ; sh:property {shape} ]"
    data = _Counted(body)
    found = _compiled(f"ex:Shape sh:property {shape} .").check(data, _BODY)
    assert [each.focus for each in found] == [own[-1]]
    assert data.looked_up < 2 * len(body)


def test_a_branch_is_found_by_its_joint() -> None:
    """However many joints there are, a target is validated only against its own branch."""
    joints = " ".join(
        f"[ sh:property [ sh:path lf:ofJoint ; sh:hasValue ex:j{n} ] , [ sh:path vom:unit ; sh:minCount 1 ] ]"
        for n in range(100)
    )
    data = _Counted(turtle("ex:body lf:target [ lf:ofJoint ex:j99 ; vom:unit vom:Degree ] ."))
    compiled = _compiled(f"ex:Shape sh:property [ sh:path lf:target ; sh:or ( {joints} ) ] .")
    assert compiled.check(data, _BODY) == []
    assert data.looked_up < 6


_SWITCH = """ex:Shape sh:or (
    [ sh:property [ sh:path lf:ofJoint ; sh:hasValue ex:a ] , [ sh:path vom:unit ; sh:hasValue vom:Degree ] ]
    [ sh:property [ sh:path lf:ofJoint ; sh:hasValue ex:a ] , [ sh:path vom:unit ; sh:hasValue vom:Radian ] ]
    [ sh:property [ sh:path lf:ofJoint ; sh:in ( ex:b ex:c ) ; sh:minCount 1 ] ]
    [ sh:property [ sh:path lf:ofJoint ; sh:in ( ex:d ) ; sh:minCount %s ] ] ) ."""


@pytest.mark.parametrize(
    ("least", "body", "admitted"),
    [
        (1, "lf:ofJoint ex:a ; vom:unit vom:Degree", True),
        (1, "lf:ofJoint ex:a ; vom:unit vom:Radian", True),
        (1, "lf:ofJoint ex:a ; vom:unit ex:other", False),
        (1, "lf:ofJoint ex:x , ex:a ; vom:unit vom:Degree", True),
        (1, "lf:ofJoint ex:b , ex:c", True),
        (1, "lf:ofJoint ex:b , ex:x", False),
        (1, "lf:ofJoint ex:d", True),
        (1, "vom:unit vom:Degree", False),
        (0, "vom:unit vom:Degree", True),
        (0, "lf:ofJoint ex:x", False),
    ],
)
def test_a_branch_that_may_apply_is_not_passed_over(least: int, body: str, admitted: bool) -> None:
    """Two branches of one joint, a list of joints, and a list to which no joint conforms."""
    assert (not _check(_SWITCH % least, f"ex:body {body} .")) == admitted


@pytest.mark.parametrize("datatype", [XSD.integer, XSD.decimal, XSD.float, XSD.byte])
@pytest.mark.parametrize(
    "text", ["9" * 100_000, "-" + "0" * 100_000 + "x", "0." + "0" * 100_000 + "1", "1e" + "9" * 100_000]
)
def test_enormous_literals_are_judged_and_cut_short(text: str, datatype: NamedNode) -> None:
    """None crashes, and no message repeats one."""
    compiled = _compiled("ex:Shape sh:property [ sh:path ex:p ; sh:minInclusive 1 ; sh:maxInclusive 5.5 ] .")
    found = compiled.check(
        Data([Triple(_BODY, NamedNode("http://example.org/p"), Literal(text, datatype=datatype))]), _BODY
    )
    assert found and all(len(violation.message) < 300 for violation in found)
