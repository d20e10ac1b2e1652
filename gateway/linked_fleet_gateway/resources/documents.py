"""Documents of the gateway: vocabulary and JSON-LD context."""

import json
from collections.abc import Iterable, Iterator
from functools import partial

from pyoxigraph import Literal, NamedNode, Triple

from linked_fleet_gateway.resources.description import InSteps
from linked_fleet_gateway.resources.resource import Resource
from linked_fleet_gateway.resources.versioning import Source
from linked_fleet_rdf import shapes
from linked_fleet_rdf.graph import Graph
from linked_fleet_rdf.vocabulary import DCTERMS, LDP, OWL, PREFIXES, RDF, RDFS

VOCABULARY = "/vocabulary"
_DESCRIBES = (RDF.type, RDFS.label, RDFS.comment)


def vocabulary_resource(base: str) -> Resource:
    steps = partial(_vocabulary, base)
    return Resource(VOCABULARY, "Vocabulary", InSteps(steps), source=Source(shown=tuple))


def context_resource() -> Resource:
    content = json.dumps({"@context": PREFIXES}, indent=1).encode()
    document = {"application/ld+json": lambda: content}
    return Resource("/context", "JSON-LD context", None, (LDP.Resource,), documents=document)


def describe_terms(base: str, graph: Graph) -> Iterator[None]:
    """Add all our own terms, and the shapes of bodies that containers accept."""
    iri = NamedNode(base + VOCABULARY)
    graph.a(iri, OWL.Ontology, LDP.RDFSource)
    graph.add(iri, DCTERMS.title, Literal("Terms and shapes of Linked Fleet"))
    graph.add(iri, RDFS.seeAlso, NamedNode(base + "/"))
    for name in (shapes.VOCABULARY, shapes.SUBSCRIPTIONS):
        for triples in shapes.load_turtle(name).values():
            _add(graph, triples)
            yield


def _vocabulary(base: str, graph: Graph) -> Iterator[None]:
    """Add all our own terms, and all shapes that any document names.

    Shapes of request bodies are included completely. Other blueprint shapes are only named and typed: each resource
    links the blueprint with its own shape, and as class targets they would also apply to requests and to things that a
    document only mentions.
    """
    yield from describe_terms(base, graph)
    for node, triples in shapes.load_turtle(shapes.BLUEPRINTS).items():
        if isinstance(node, NamedNode):
            _add(graph, (triple for triple in triples if triple.predicate in _DESCRIBES))
            if node.value.endswith("Input"):
                shapes.add_closure(graph, node)
            yield


def _add(graph: Graph, triples: Iterable[Triple]) -> None:
    for triple in triples:
        graph.add(triple.subject, triple.predicate, triple.object)  # type: ignore[arg-type]
