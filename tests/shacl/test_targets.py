"""The focus nodes of a graph's shapes, with pySHACL as oracle."""

import pytest

from linked_fleet_shacl import compile_graph
from shacl_findings import pyshacl_reports, reported, turtle

_BODY = "ex:body a ex:Shape ; ex:q ex:b . ex:b a ex:Under . ex:Under rdfs:subClassOf ex:Shape ."


@pytest.mark.parametrize(
    ("shape", "found"),
    [
        ("a sh:NodeShape , rdfs:Class ; sh:property [ sh:path ex:p ; sh:minCount 1 ]", 2),
        ("a sh:PropertyShape , rdfs:Class ; sh:path ex:p ; sh:minCount 1", 2),
        ("a sh:NodeShape ; sh:property [ sh:path ex:p ; sh:minCount 1 ]", 0),
        ("a rdfs:Class ; sh:property [ sh:path ex:p ; sh:minCount 1 ]", 2),
        ("a rdfs:Class ; rdfs:label 'no shape'", 0),
        ("sh:targetClass ex:Shape ; sh:property [ sh:path ex:p ; sh:minCount 1 ]", 2),
        ("sh:targetNode ex:body , ex:away ; sh:property [ sh:path ex:p ; sh:minCount 1 ]", 2),
        ("sh:targetSubjectsOf ex:q ; sh:property [ sh:path ex:p ; sh:minCount 1 ]", 1),
        ("sh:targetObjectsOf ex:q ; sh:targetClass ex:Under ; sh:property [ sh:path ex:p ; sh:minCount 1 ]", 1),
    ],
)
def test_targets_select_what_pyshacl_selects(shape: str, found: int) -> None:
    """A shape that is a class has its instances as targets; a class alone, or a shape alone, has none."""
    shapes, body = turtle(f"ex:Shape {shape} ."), turtle(_BODY)
    results = reported(compile_graph(shapes), body)
    assert results.total() == found
    assert results == pyshacl_reports(shapes, body)
