"""Actions: what they ask for, and having them done."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Protocol, runtime_checkable

from rdflib import Graph
from rdflib.term import Literal, Node, URIRef

from linked_fleet_client.errors import BadAnswer, NoSuchThing, Unsupported
from linked_fleet_client.form import FormField, asked, build
from linked_fleet_client.invocation import Invocation
from linked_fleet_client.reading import Reading, read
from linked_fleet_client.resource import Resource
from linked_fleet_client.shape import Shape, merged, read_shape
from linked_fleet_client.validation import validate
from linked_fleet_client.vocabulary import HTTP, HYBRIT, LF, RDF, RDFS, SH, document_of, is_web, local_name
from linked_fleet_client.web import Answer, parsed

_METHODS = ("POST", "PUT", "PATCH", "DELETE")
_MOST_SHAPES = 20
_MOST_JUDGED = 500  # triples; pySHACL takes a second for as many
DRY_RUN = "dry-run"


@runtime_checkable
class Place(Protocol):
    """Names that lead to something."""

    def at(self, path: str) -> Resource: ...


class Action(Resource):
    """An action as its description has it. Calling it does it."""

    @property
    def fields(self) -> tuple[FormField, ...]:
        """The form of its shape; empty if it takes nothing."""
        shapes, nodes = self._consumed()
        return asked(_one(shapes, nodes))

    @property
    def comment(self) -> str:
        """The comment of the action."""
        found = self._said(RDFS.comment)
        return found[0] if found else ""

    @property
    def can_rehearse(self) -> bool:
        """True if it can be tried without anything moving."""
        stated = self.read().graph.value(self.node, LF.dryRun)
        return isinstance(stated, Literal) and stated.toPython() is True

    def build(self, /, **given: Any) -> Graph:
        """The body with these values, by the names of the fields; InvalidInput with everything that is wrong."""
        shapes, nodes = self._consumed()
        return build(_one(shapes, nodes), given, self._find)

    def validate(self, body: Graph) -> None:
        """Judge the body by the shape that is served; InvalidInput with a message for each violation."""
        shapes, nodes = self._consumed()
        for node in nodes:
            validate(body, shapes, node)

    def __call__(
        self, body: Graph | Mapping[str, Any] | None = None, /, *, idempotency_key: str | None = None, **given: Any
    ) -> Invocation:
        """Have it done, once. ``body`` is a graph as it is, or values by the names of the fields like ``given``."""
        ready = self._ready(body, given)
        headers = {"idempotency-key": idempotency_key} if idempotency_key else {}
        answer = self._send(ready, headers)
        return Invocation(self.web, answer.location() if "location" in answer.headers else "", Action)

    def rehearse(self, body: Graph | Mapping[str, Any] | None = None, /, **given: Any) -> Reading:
        """Rehearse it; Unsupported if the action does not say that it can be tried.

        A server that does not know the preference would do it: so nothing is sent before the description says so.
        """
        if not self.can_rehearse:
            raise Unsupported(f"{self.name} cannot be tried without being done: its description has no lf:dryRun true")
        answer = self._send(self._ready(body, given), {"prefer": DRY_RUN})
        applied = answer.headers.get("preference-applied", "").lower()
        if DRY_RUN not in [each.strip() for each in applied.split(",")]:
            raise BadAnswer(f"{self.name} was to be tried only, but nothing confirms that: it may have been done")
        return _rehearsed(answer)

    def _ready(self, said: Graph | Mapping[str, Any] | None, given: Mapping[str, Any]) -> Graph | None:
        """The body, judged by the present shape; None for an action that takes nothing.

        A long one that was built here is left to the server: what it is built from has been looked at already.
        """
        self.read()
        shapes, nodes = self._consumed()
        own = isinstance(said, Graph)
        body = said if isinstance(said, Graph) else build(_one(shapes, nodes), {**(said or {}), **given}, self._find)
        for node in nodes if own or len(body) <= _MOST_JUDGED else ():
            validate(body, shapes, node)
        return body if nodes or len(body) else None

    def _send(self, body: Graph | None, headers: Mapping[str, str]) -> Answer:
        method, url = self.binding()
        content = None if body is None else body.serialize(format="turtle").encode()
        typed = {} if content is None else {"content-type": "text/turtle"}
        return self.web.send(method, url, content, {**typed, **headers})

    def binding(self) -> tuple[str, str]:
        """Method and URL of its binding; where none is described, what OPTIONS allows at its own IRI."""
        graph, found = self.learn().graph, []
        for request in graph.objects(self.node, HYBRIT.binding):
            method = graph.value(request, HTTP.mthd) or graph.value(request, HTTP.methodName)
            target = graph.value(request, HTTP.requestURI) or graph.value(request, HTTP.absoluteURI)
            if method is not None and target is not None:
                found.append((local_name(str(method)).upper(), str(target)))
        offered = [each for each in found if each[0] in _METHODS and is_web(URIRef(each[1]))]
        if not found:
            offered = [(method, document_of(self.iri)) for method in self.web.allowed(self.iri)]
            offered = [each for each in offered if each[0] in ("POST", "PUT")]
        if not offered:
            raise Unsupported(f"{self.name} says no way to have it done over HTTP")
        return min(offered, key=lambda each: (_METHODS.index(each[0]), each[1]))

    def _consumed(self) -> tuple[Graph, list[Node]]:
        """The graph of shapes and those that the body must meet. What is linked elsewhere is fetched."""
        document = self.learn()
        nodes = list(document.graph.objects(self.node, HYBRIT.consumes))
        shapes = Graph()
        _copy(document.graph, nodes, shapes)
        fetched: set[str] = {document.url}
        while missing := _missing(shapes, nodes, fetched):
            if len(fetched) > _MOST_SHAPES:
                raise BadAnswer(f"the shape of {self.name} is spread over more than {_MOST_SHAPES} documents")
            url = document_of(missing)
            fetched.add(url)
            shapes += self.web.get(url).graph
        return shapes, [_the_shape(shapes, node) for node in sorted(nodes, key=str)]

    def _find(self, name: str) -> URIRef | None:
        """Return the thing of this name: a path from the thing that has this action, or from one further up."""
        here = self.owner
        while here is not None:
            try:
                if isinstance(here, Place):
                    return here.at(name).iri
            except NoSuchThing:
                pass  # not here; perhaps further up
            here = here.owner
        return None


def _rehearsed(answer: Answer) -> Reading:
    """The values of the answer, as far as it has any."""
    media_type = answer.headers.get("content-type", "")
    if not answer.body or not media_type:
        return Reading({}, ())
    graph = parsed(answer.body.decode(errors="replace"), media_type, answer.url)
    objects = set(graph.objects())
    return read(graph, next((node for node in graph.subjects() if node not in objects), URIRef(answer.url)))


def _one(shapes: Graph, nodes: list[Node]) -> Shape:
    return merged(read_shape(shapes, node) for node in nodes)


def _copy(graph: Graph, nodes: list[Node], into: Graph) -> None:
    """Return the triples about the nodes and about whatever they lead to in the same description."""
    pending, seen = list(nodes), set(nodes)
    while pending:
        node = pending.pop()
        for _, predicate, value in graph.triples((node, None, None)):
            into.add((node, predicate, value))
            if value not in seen and not isinstance(value, Literal):
                seen.add(value)
                pending.append(value)


def _missing(shapes: Graph, nodes: list[Node], fetched: set[str]) -> str | None:
    """A shape that is named and not yet there."""
    named = [*nodes, *shapes.objects(None, SH.node)]
    for node in named:
        there = (node, None, None) in shapes
        if isinstance(node, URIRef) and not there and is_web(node) and document_of(node) not in fetched:
            return str(node)
    return None


def _the_shape(shapes: Graph, node: Node) -> Node:
    """The node itself or, where a document of shapes is named, the only one in it that no other refers to."""
    if any((node, predicate, None) in shapes for predicate in (SH.property, SH.node, SH["or"], SH["and"], SH.xone)):
        return node
    named = next(iter(shapes.objects(node, LF.shape)), None)
    if named is not None:
        return named
    candidates = [each for each in shapes.subjects(RDF.type, SH.NodeShape) if each not in set(shapes.objects())]
    return candidates[0] if len(candidates) == 1 else node
