"""Parsers of Turtle, Link fields and link sets. All input is untrusted."""

import contextlib
import json
import logging
import re
from collections import Counter
from collections.abc import Iterator

import rdflib
from rdflib import RDF, BNode, URIRef
from rdflib.term import Node

from linked_fleet_client.conform.web import Answer, absolute
from linked_fleet_client.graphs import load

TURTLE = "text/turtle"
LINKSET = "application/linkset+json"
HYBRIT = rdflib.Namespace("https://hybr-it-projekt.de/ns/hybr-it#")
LDP = rdflib.Namespace("http://www.w3.org/ns/ldp#")
HTTP = rdflib.Namespace("http://www.w3.org/2011/http#")
DCTERMS, RDFS, SH = rdflib.DCTERMS, rdflib.RDFS, rdflib.SH

_TERMS = ("RoboticThing", "subscriptions")
_LINK = re.compile(r"<([^<>]*)>([^<]*)")
_LOCAL = re.compile(r"[^#/]*$")
_REL = re.compile(r';\s*rel\s*=\s*(?:"([^"]*)"|([^\s;,"]+))', re.IGNORECASE)


@contextlib.contextmanager
def untrusted_input() -> Iterator[None]:
    """Configure rdflib for untrusted input: it does not expand a decimal of 1e999999999, and does not log ill-typed
    literals.
    """
    log = logging.getLogger("rdflib")
    before = rdflib.NORMALIZE_LITERALS, log.level
    rdflib.NORMALIZE_LITERALS = False
    log.setLevel(logging.CRITICAL)
    try:
        yield
    finally:
        rdflib.NORMALIZE_LITERALS = before[0]
        log.setLevel(before[1])


def turtle_graph(answer: Answer) -> tuple[rdflib.Graph, str]:
    """Return the graph of a Turtle answer; an empty graph and the reason if there is none."""
    if not answer.successful:
        return rdflib.Graph(), str(answer)
    if answer.media_type != TURTLE:
        return rdflib.Graph(), f"GET {answer.url}: is {answer.media_type or 'of no media type'}, not Turtle"
    graph, fault = parse_turtle(answer.body, answer.url)
    return graph, f"GET {answer.url}: {fault}" if fault else ""


def parse_turtle(body: bytes, base: str) -> tuple[rdflib.Graph, str]:
    """Return the graph of a Turtle document, or an empty graph and the error."""
    try:
        return load(body.decode("utf-8"), "turtle", base), ""
    except (SyntaxError, ValueError) as error:
        reason = " ".join(str(error).split("\n")[:3])
        return rdflib.Graph(), f"does not parse as Turtle: {type(error).__name__} {reason}"


def link_targets(answer: Answer, relation: str) -> list[str]:
    """Return the absolute targets of the Link fields with this relation (RFC 8288)."""
    found = []
    for target, parameters in _LINK.findall(answer.header("link")):
        relations = [(quoted or plain).lower().split() for quoted, plain in _REL.findall(parameters)]
        if relations and relation in relations[0]:
            found.append(absolute(answer.url, target))
    return [url for url in found if url]


def linkset_targets(answer: Answer, relation: str) -> list[str]:
    """Return the absolute targets with this relation in a link set (RFC 9264); none if it is not a link set."""
    try:
        contexts = json.loads(answer.body)["linkset"] if answer.media_type == LINKSET else []
        targets = [target["href"] for context in contexts for target in context.get(relation, ())]
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError):
        return []
    return [absolute(answer.url, target) for target in targets if isinstance(target, str)]


def types(graph: rdflib.Graph, node: Node) -> frozenset[Node]:
    return frozenset(graph.objects(node, RDF.type))


def linked_iris(graph: rdflib.Graph) -> Iterator[tuple[URIRef, Node]]:
    """Yield the IRIs in a graph with the predicate that leads to them, without terms of vocabularies."""
    for subject, predicate, value in graph:
        if isinstance(subject, URIRef):
            yield subject, RDF.subject
        if isinstance(value, URIRef) and predicate not in (RDF.type, HTTP.requestURI):
            yield value, predicate


def hybrit(graph: rdflib.Graph) -> rdflib.Namespace:
    """Return the namespace of the model's terms, which the paper leaves open: that of the authors, unless the graph
    uses only another one.
    """
    terms = [str(term) for term in (*graph.predicates(), *graph.objects(None, RDF.type)) if not isinstance(term, BNode)]
    if any(term.startswith(HYBRIT) for term in terms):
        return HYBRIT
    spaces = Counter(_LOCAL.sub("", term) for term in terms if term.endswith(_TERMS))
    return rdflib.Namespace(spaces.most_common(1)[0][0]) if spaces else HYBRIT
