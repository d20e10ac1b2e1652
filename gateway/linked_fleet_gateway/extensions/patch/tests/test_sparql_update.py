"""Updates of one small graph: like pyoxigraph, but only a part of SPARQL."""

import pytest
from pyoxigraph import CanonicalizationAlgorithm, Dataset, Quad, RdfFormat, Store, Triple, parse

from linked_fleet_base.errors import BadRequest, FleetError, PayloadTooLarge, UnprocessableContent
from linked_fleet_gateway.extensions.patch.sparql_update import MAX_OPERATIONS, MAX_STEPS, apply_update, parse_update

_BASE = "http://fleet.example/r/title"
_PREFIXES = "PREFIX ex: <http://example.org/> PREFIX xsd: <http://www.w3.org/2001/XMLSchema#> "
_GRAPH = """@prefix ex: <http://example.org/> . <> ex:value "Arm" ; ex:at [ ex:x 1 ; ex:y 2.5 ; ex:unit ex:m ] ;
  ex:by ex:ada, ex:bob . ex:ada ex:name "Ada"@en ; ex:knows ex:bob . ex:bob ex:name "Bob" ; ex:knows ex:ada ."""


def _graph(turtle: str = _GRAPH) -> list[Triple]:
    return [quad.triple for quad in parse(turtle, format=RdfFormat.TURTLE, base_iri=_BASE)]


def _after(update: str, triples: list[Triple]) -> list[Triple]:
    return apply_update(triples, parse_update(_PREFIXES + update, _BASE))


def _canonical(triples: list[Triple]) -> Dataset:
    dataset = Dataset(Quad(*triple) for triple in triples)
    dataset.canonicalize(CanonicalizationAlgorithm.UNSTABLE)
    return dataset


@pytest.mark.parametrize(
    "update",
    [
        'DELETE DATA { <> ex:value "Arm" } ; INSERT DATA { <> ex:value "Left arm" }',
        'DELETE { <> ex:value ?old } INSERT { <> ex:value "Left arm" } WHERE { <> ex:value ?old }',
        "DELETE { ?at ex:x ?x } INSERT { ?at ex:x 3 . } WHERE { <> ex:at ?at . ?at ex:x ?x }",
        "DELETE { ?at ex:x ?x } INSERT { ?at ex:x 3 } WHERE { <> ex:at [ ex:x ?x ] . ?at ex:y 2.5 }",
        "DELETE WHERE { <> ex:by ?who . ?who ex:name ?name }",
        "INSERT { ?b ex:met ?a . ?a ex:note [ ex:text 'so', 'it is' ] } WHERE { ?a ex:knows ?b }",
        "INSERT { _:n ex:of ?a } WHERE { <> ex:by ?a }",
        'INSERT DATA { <> ex:list ( 1 "two" ex:three ) ; a ex:Thing . [] ex:p true, -4, "x"^^xsd:token, "y"@de }',
        "DELETE { ?s ?p ?o } WHERE { ?s ?p ?o . ?o ex:knows ?s }",
        "DELETE { ?s ?p ?o } WHERE { ?s ?p ?o }",
        'insert data { <> ex:value "}" } ; # and a comment }\n delete data { <> ex:value "Arm" } ;',
        "DELETE DATA { <> ex:value 'nothing of the kind' }",
        "INSERT DATA { }",
        "INSERT { ?x ex:p ?x } WHERE { ?x ex:p ?x }",
        'DELETE { ?s ex:name "Bob" } INSERT { ?s ex:name "Bert" } WHERE { ?s ex:name "Bob" }',
        "BASE <http://example.org/> INSERT DATA { <ada> <p> <> }",
    ],
)
def test_an_update_does_what_sparql_says(update: str) -> None:
    """The result equals that of pyoxigraph's store, up to the labels of blank nodes."""
    store = Store()
    store.extend(Quad(*triple) for triple in _graph())
    store.update(_PREFIXES + update, base_iri=_BASE)
    assert _canonical(_after(update, _graph())) == _canonical([quad.triple for quad in store])


@pytest.mark.parametrize(
    "update",
    [
        "LOAD <http://example.org/>",
        "CLEAR ALL",
        "CLEAR DEFAULT",
        "DROP GRAPH ex:g",
        "CREATE GRAPH ex:g",
        "COPY DEFAULT TO ex:g",
        "WITH ex:g DELETE { ?s ?p ?o } WHERE { ?s ?p ?o }",
        "DELETE { ?s ?p ?o } USING ex:g WHERE { ?s ?p ?o }",
        "DELETE { GRAPH ex:g { ?s ?p ?o } } WHERE { ?s ?p ?o }",
        "INSERT DATA { GRAPH ex:g { <> ex:p 1 } }",
        "INSERT { <> ex:p ?x } WHERE { SERVICE <http://example.org/> { ?x ?p ?o } }",
        "INSERT { <> ex:p ?x } WHERE { ?x ?p ?o FILTER regex(str(?o), '(a+)+$') }",
        "INSERT { <> ex:p ?x } WHERE { ?x ex:a/ex:b ?o }",
        "INSERT { <> ex:p ?x } WHERE { ?x ex:knows+ ?o }",
        "INSERT { <> ex:p ?x } WHERE { { ?x ?p ?o } UNION { ?o ?p ?x } }",
        "INSERT { <> ex:p ?x } WHERE { OPTIONAL { ?x ?p ?o } }",
        "INSERT { <> ex:p ?x } WHERE { BIND (1 AS ?x) }",
        "INSERT { <> ex:p ?x } WHERE { VALUES ?x { 1 } }",
        "INSERT { <> ex:p ?x } WHERE { SELECT ?x { ?x ?p ?o } }",
        "INSERT { <> ex:p ?x } WHERE { @prefix ex: <http://example.org/> . ?x ex:p 1 }",
        "SELECT * WHERE { ?s ?p ?o }",
        "INSERT DATA { <> ex:p ?x }",
        "INSERT { <> ex:p ?x } WHERE { <> ex:p ?y }",
        "DELETE DATA { <> ex:at [] }",
        "DELETE { <> ex:at [] } WHERE { <> ex:at ?x }",
        "DELETE WHERE { <> ex:at [ ex:x ?x ] }",
        "INSERT DATA { <> ex:p 'x'^^?t }",
        "INSERT { <> ex:p 'x'^^?t } WHERE { <> ex:p ?t }",
        "INSERT DATA { <> ex:p <<( <> ex:p 1 )>> }",
        "INSERT DATA { <> ex:p 1",
        "INSERT DATA <> ex:p 1",
        "INSERT DATA { <> ex:p 1 } INSERT DATA { <> ex:p 2 }",
        "INSERT DATA { <> other:p 1 }",
        "INSERT",
        "",
        "PREFIX",
    ],
)
def test_other_update_operations_are_refused(update: str) -> None:
    """400: no other graph, no other server, and nothing that could take long."""
    with pytest.raises(BadRequest):
        _after(update, _graph())


@pytest.mark.parametrize("made", ["?o ex:p 1", "<> ?o 1"])
def test_a_statement_that_is_none_is_refused(made: str) -> None:
    """422 for a literal as subject or predicate, which SPARQL would silently leave out."""
    with pytest.raises(UnprocessableContent):
        _after(f"INSERT {{ {made} }} WHERE {{ <> ex:value ?o }}", _graph())


@pytest.mark.parametrize(
    "update",
    [
        "INSERT { <> ex:p ?a } WHERE { ?a ?b ?c . ?d ?e ?f . ?g ?h ?i . ?j ?k ?l }",
        "INSERT { ?a ex:p ?d } WHERE { ?a ?b ?c . ?d ?e ?f }",
        ";".join(["INSERT { ?a ex:x ?b } WHERE { ?a ex:x ?b }"] * MAX_OPERATIONS),
        ";".join(["INSERT DATA { <> ex:p 1 }"] * (MAX_OPERATIONS + 1)),
        "INSERT { " + "?a ex:p ex:q . " * 500 + "} WHERE { ?a ex:x ?b }",
        "INSERT DATA { <> ex:p " + ", ".join(map(str, range(999))) + "} ; INSERT DATA { <> ex:q 1, 2, 3 }",
        "".join(f"PREFIX p{each}: <http://example.org/{each}> " for each in range(200)) + "INSERT DATA { <> ex:p 1 }",
        "INSERT DATA { <> ex:p '" + "x" * 40_000 + "' }",
        "INSERT DATA { <> ex:p " + "[ ex:p " * 100 + "1" + " ]" * 100 + " }",
    ],
)
def test_an_update_is_bounded(update: str) -> None:
    """Steps, operations, prefixes, triples, bytes and depth: an update beyond a limit is refused before execution."""
    many = _graph("@prefix ex: <http://example.org/> . " + " ".join(f"ex:s{i} ex:x {i} ." for i in range(900)))
    assert len(many) ** 2 > MAX_STEPS
    with pytest.raises((BadRequest, PayloadTooLarge, UnprocessableContent)) as caught:
        _after(update, many)
    assert isinstance(caught.value, FleetError) and caught.value.detail
