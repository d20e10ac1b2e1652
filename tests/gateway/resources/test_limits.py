"""Limits in shapes, as a client with any SHACL validator uses them."""

import pyshacl
import pytest
import rdflib
from pyoxigraph import Literal, NamedNode

from graphs import graph_of
from linked_fleet_rdf.vocabulary import HYBRIT, SH, XSD
from sample_resources import BASE, described, described_paths, tree

_LIMITS = (SH.minInclusive, SH.maxInclusive, SH.minExclusive, SH.maxExclusive)
_PREFIXES = """@prefix vom: <http://vocab.arvida.de/2015/06/vom/vocab#> . @prefix unit: <http://qudt.org/vocab/unit/> .
@prefix lf: <https://w3id.org/linked-fleet#> . @prefix xsd: <http://www.w3.org/2001/XMLSchema#> .
"""
_OF_JOINT = f"lf:ofJoint <{BASE}/fixed/revolute_joint>"
_BODIES = {
    "/fixed/revolute_joint/actions/rotate": "<> vom:numericalValue {} ; vom:unit unit:RAD .",
    "/fixed/continuous_joint/actions/rotate": "<> vom:numericalValue {} ; vom:unit unit:DEG .",
    "/fixed/revolute_joint/actions/rotateBy": "<> vom:numericalValue {} ; vom:unit unit:DEG .",
    "/fixed/prismatic_joint/actions/translate": "<> vom:numericalValue {} ; vom:unit unit:MilliM .",
    "/fixed/actions/moveJoints": f"<> lf:target [ {_OF_JOINT} ; vom:numericalValue {{}} ; vom:unit unit:RAD ] .",
}


def test_no_limit_is_a_decimal() -> None:
    """In none of the served documents; rdflib raises an exception when it compares a decimal with NaN."""
    here, types = tree(), set()
    for path in described_paths(here):
        for triple in described(here, path):
            if triple.predicate in _LIMITS:
                assert isinstance(triple.object, Literal)
                types.add(triple.object.datatype)
    assert types == {XSD.integer, XSD.double}


@pytest.mark.parametrize("path", _BODIES)
@pytest.mark.parametrize("number", ['"NaN"^^xsd:float', '"NaN"^^xsd:double', '"INF"^^xsd:double', "1e9", "99999999.9"])
def test_pyshacl_refuses_a_number_that_is_none_and_does_not_crash(path: str, number: str) -> None:
    assert not _conforms(path, _BODIES[path].format(number))


@pytest.mark.parametrize("path", _BODIES)
@pytest.mark.parametrize("number", ["0.1", "1e-1", "0", '"0.1"^^xsd:float'])
def test_pyshacl_admits_every_type_of_number(path: str, number: str) -> None:
    assert _conforms(path, _BODIES[path].format(number))


def _conforms(path: str, body: str) -> bool:
    triples = described(tree(), path)
    action = NamedNode(BASE + path)
    (shape,) = [t.object for t in triples if t.subject == action and t.predicate == HYBRIT.consumes]
    assert not isinstance(shape, Literal)
    shapes = graph_of(triples)
    shapes.add((rdflib.BNode(shape.value), rdflib.SH.targetNode, rdflib.URIRef("urn:body")))
    data = rdflib.Graph().parse(data=_PREFIXES + body, format="turtle", publicID="urn:body")
    return bool(pyshacl.validate(data, shacl_graph=shapes, inference="none")[0])
