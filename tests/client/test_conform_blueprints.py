"""The validation of a resource by its blueprint, in the checker of conformance."""

import pytest

from linked_fleet_client.conform.blueprint import Case, validate_case

_PREFIXES = """@prefix sh: <http://www.w3.org/ns/shacl#> .
@prefix rdfs: <http://www.w3.org/2000/01/rdf-schema#> .
@prefix ex: <http://example.org/ns#> .
"""
_SHAPE = "<#shape> a sh:NodeShape ; sh:property [ sh:path ex:size ; sh:minCount 1 ] ."
_BAD, _GOOD = "</a> a ex:Thing .", "</a> a ex:Thing ; ex:size 1 ; ex:near </b> . </c> ex:far </a> ."


def _case(data: str, shapes: str) -> Case:
    url, blueprint = "http://fleet.example/a", "http://fleet.example/blueprint"
    return Case(url, url, (_PREFIXES + data).encode(), blueprint, (_PREFIXES + shapes).encode(), f"{blueprint}#shape")


@pytest.mark.parametrize(
    "target",
    [
        "",
        "<#shape> sh:targetClass ex:Thing .",
        "<#shape> sh:targetNode </a> .",
        "<#shape> sh:targetSubjectsOf ex:near .",
        "<#shape> sh:targetObjectsOf ex:far .",
        "ex:Thing a sh:NodeShape, rdfs:Class ; sh:property [ sh:path ex:size ; sh:minCount 1 ] .",
    ],
)
def test_a_resource_is_validated_by_the_shapes_that_select_it(target: str) -> None:
    """Without a target, the shape that is named as the blueprint is used."""
    assert validate_case(_case(_GOOD, _SHAPE + target)) == (True, "")
    links = _BAD.replace(" .", " ; ex:near </b> . </c> ex:far </a> .")
    conforms, reason = validate_case(_case(links, _SHAPE + target))
    assert conforms is False and reason.startswith("http://example.org/ns#size: ")


@pytest.mark.parametrize(
    ("shapes", "reason"),
    [
        ("ex:a ex:b ex:c .", "no SHACL shapes"),
        ("<#other> a sh:NodeShape ; sh:targetNode </b> .", "no shape of the blueprint is about"),
        (_SHAPE + '<#shape> sh:sparql [ sh:select "SELECT $this {}" ] .', "programs, which are not run"),
        ("<#shape> a sh:NodeShape ; sh:property [ sh:path ex:size ; sh:minCount 1, 2 ] .", "cannot be used"),
    ],
)
def test_unusable_blueprints_decide_nothing(shapes: str, reason: str) -> None:
    conforms, said = validate_case(_case(_GOOD, shapes))
    assert conforms is None and reason in said
