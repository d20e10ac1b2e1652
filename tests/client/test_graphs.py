"""Graphs parsed or stored by Oxigraph work with rdflib, the client and pySHACL like those of rdflib itself."""

from collections.abc import Callable

import pytest
from rdflib import XSD, BNode, Graph, Literal, URIRef

from linked_fleet_client.errors import BadAnswer, InvalidInput
from linked_fleet_client.graphs import BIG, load, load_big, load_exactly
from linked_fleet_client.validation import validate
from linked_fleet_client.web import parse_rdf

Loader = Callable[[str, str, str], Graph]
BASE = "http://127.0.0.1/doc"
SHAPE = """@prefix sh: <http://www.w3.org/ns/shacl#> . @prefix xsd: <http://www.w3.org/2001/XMLSchema#> .
<#s> a sh:NodeShape ; sh:or (
    [ sh:property [ sh:path <#mode> ; sh:in ( "soft" "hard" ) ; sh:minCount 1 ] ]
    [ sh:property [ sh:path <#speed> ; sh:datatype xsd:decimal ; sh:maxInclusive 1.50 ; sh:minCount 1 ] ] ) ;
    sh:property [ sh:path <#note> ; sh:datatype xsd:string ; sh:maxCount 1 ] ."""


both = pytest.mark.parametrize("load", [load, load_big])


@both
@pytest.mark.parametrize("syntax", ["turtle", "nt"])
def test_strings_are_plain_and_found_either_way(load: Loader, syntax: str) -> None:
    text = f'<{BASE}> <{BASE}#p> "a"^^<{XSD.string}> .\n<{BASE}> <{BASE}#p> "b"@en .\n'
    graph = load(text, syntax, BASE)
    assert set(graph.objects()) == {Literal("a"), Literal("b", lang="en")}
    assert (None, None, Literal("a")) in graph


@both
def test_blank_nodes_of_two_documents_are_two(load: Loader) -> None:
    """Labels hold within one document, even after merging. What is added later keeps its nodes."""
    one, two = (load("<#a> <#p> _:x .", "turtle", BASE) for _ in range(2))
    merged = Graph()
    merged += one
    merged += two
    one += two
    assert set(one) == set(merged)
    nodes = set(merged.objects())
    assert len(nodes) == 2
    assert all(isinstance(node, BNode) for node in nodes)


def test_blueprints_are_judged_by_what_is_written() -> None:
    text = "<#a> <#p> 1.50 ." + " " * BIG
    assert [[str(value) for value in each(text, "turtle", BASE).objects()] for each in (load_exactly, load)] == [
        ["1.50"],
        ["1.5"],
    ]


@pytest.mark.parametrize(
    "broken", ["<a> <b> <c d> .", "<a> <b> <<( <c> <d> <e> )>> .", "[" * 5000, "<a> <b> <http://[> ."]
)
def test_turtle_beyond_rdf_1_1_is_refused(broken: str) -> None:
    with pytest.raises(BadAnswer, match="is not valid turtle"):
        parse_rdf(broken, "text/turtle", BASE)


@pytest.mark.parametrize(
    ("said", "conforms"),
    [
        ([("mode", Literal("soft"))], True),
        ([("mode", Literal("soft", datatype=XSD.string)), ("note", Literal("x"))], True),
        ([("mode", Literal("loud"))], False),
        ([("speed", Literal("1.5", datatype=XSD.decimal))], True),
        ([("speed", Literal("1.51", datatype=XSD.decimal))], False),
        ([("mode", Literal("hard")), ("note", Literal(3))], False),
    ],
)
@pytest.mark.parametrize("received", [True, False])
@both
def test_pyshacl_judges_all_graphs_alike(
    load: Loader, said: list[tuple[str, Literal]], conforms: bool, received: bool
) -> None:
    """The shape was received; the body was received or built here."""
    shapes, body = load(SHAPE, "turtle", BASE), Graph()
    for name, value in said:
        body.add((BNode("body"), URIRef(f"{BASE}#{name}"), value))
    body = load(body.serialize(format="nt"), "nt", BASE) if received else body
    if conforms:
        validate(body, shapes, URIRef(f"{BASE}#s"))
    else:
        with pytest.raises(InvalidInput):
            validate(body, shapes, URIRef(f"{BASE}#s"))
