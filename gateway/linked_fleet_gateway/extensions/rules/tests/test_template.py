"""Bodies with variables replaced by terms."""

import pytest
from pyoxigraph import BlankNode, Literal, NamedNode

from linked_fleet_base.errors import UnprocessableContent
from linked_fleet_gateway.extensions.rules.template import LF, fill, template, triples_of, variables
from linked_fleet_rdf.serialise import parse
from linked_fleet_rdf.vocabulary import VOM

_BEGIN = "@prefix lf: <https://w3id.org/linked-fleet#> . @prefix vom: <http://vocab.arvida.de/2015/06/vom/vocab#> .\n"
_ACTION = NamedNode("http://fleet/arm/joint/actions/rotate")


def written(body: str) -> str:
    triples = parse((_BEGIN + f"<> lf:body {body} .").encode(), "text/turtle", "http://fleet/rules")
    (root,) = [each.object for each in triples if each.predicate == LF.body]
    assert isinstance(root, BlankNode)
    return template(triples, root)


def test_terms_stand_where_variables_stood() -> None:
    body = written('[ vom:numericalValue [ lf:variable "angle" ] ; lf:target [ lf:ofJoint [ lf:variable "joint" ] ] ]')
    assert variables(body) == {"angle", "joint"}
    joint = NamedNode("http://fleet/arm/joint")
    said = {(each.predicate, each.object) for each in fill(body, {"angle": Literal(1.5), "joint": joint}, _ACTION)}
    assert (VOM.numericalValue, Literal(1.5)) in said and (LF.ofJoint, joint) in said
    assert not [each for each in said if each[0] == LF.variable]


def test_a_term_says_no_more_than_itself() -> None:
    body = written('[ vom:numericalValue [ lf:variable "angle" ] ]')
    hostile = Literal('1 ; <http://evil/> "x" ] . <http://evil/> <http://evil/> "')
    (triple,) = fill(body, {"angle": hostile}, _ACTION)
    assert (triple.subject, triple.predicate, triple.object) == (_ACTION, VOM.numericalValue, hostile)


@pytest.mark.parametrize("row", [{}, {"angle": BlankNode()}])
def test_a_variable_that_is_bound_to_nothing_is_refused(row: dict[str, BlankNode]) -> None:
    with pytest.raises(UnprocessableContent, match="angle"):
        fill(written('[ vom:numericalValue [ lf:variable "angle" ] ]'), row, _ACTION)


@pytest.mark.parametrize(
    "body",
    ['[ lf:variable "x" ]', '[ lf:value [ lf:variable "x" ; lf:value 1 ] ]', "[ lf:value [ lf:variable 1, 2 ] ]"],
)
def test_a_variable_stands_alone(body: str) -> None:
    with pytest.raises(UnprocessableContent, match="lf:variable"):
        written(body)


def test_a_body_is_bounded() -> None:
    with pytest.raises(UnprocessableContent, match="triples"):
        written("[ lf:value " + ", ".join(map(str, range(300))) + " ]")


def test_a_circle_of_blank_nodes_ends() -> None:
    triples = parse((_BEGIN + "_:a lf:value _:b . _:b lf:value _:a .").encode(), "text/turtle", "http://fleet/rules")
    assert len(triples_of(template(triples, triples[0].subject))) == 2  # type: ignore[arg-type]
