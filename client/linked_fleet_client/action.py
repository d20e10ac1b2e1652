"""Actions: their input, and their execution."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Protocol, runtime_checkable

from rdflib import Graph
from rdflib.term import Literal, Node, URIRef

from linked_fleet_client.control import control_of
from linked_fleet_client.errors import BadAnswer, NoSuchThing, Unsupported
from linked_fleet_client.form import FormField, build, form_fields
from linked_fleet_client.invocation import Invocation
from linked_fleet_client.reading import Reading, read
from linked_fleet_client.resource import Resource
from linked_fleet_client.retry import Repeat
from linked_fleet_client.shape import Shape, conjunction, read_shape
from linked_fleet_client.stream import Stream
from linked_fleet_client.validation import validate
from linked_fleet_client.vocabulary import HTTP, HYBRIT, LF, RDF, RDFS, SH, document_of, is_web, local_name
from linked_fleet_client.web import Answer, parse_rdf

_METHODS = ("POST", "PUT", "PATCH", "DELETE")
_MOST_SHAPES = 20
_MOST_JUDGED = 500  # number of triples; pySHACL takes a second for as many
DRY_RUN = "dry-run"
_STOPS = frozenset({LF.Hold, LF.StopRobot, LF.StopAll, LF.CancelInvocation})
_STOP_NAMES = ("stop", "cancel")  # in other vocabularies


@runtime_checkable
class Place(Protocol):
    """An object whose parts can be found by name."""

    def at(self, path: str) -> Resource: ...


class Action(Resource):
    """An action as its description states it. Calling it executes it."""

    @property
    def fields(self) -> tuple[FormField, ...]:
        """The fields of the input shape; empty if the action takes no input."""
        shapes, nodes = self._consumed()
        return form_fields(_one(shapes, nodes))

    @property
    def comment(self) -> str:
        """The comment of the action."""
        found = self._said(RDFS.comment)
        return found[0] if found else ""

    @property
    def can_rehearse(self) -> bool:
        """True if the action supports a rehearsal, in which nothing moves."""
        stated = self.read().graph.value(self.node, LF.dryRun)
        return isinstance(stated, Literal) and stated.toPython() is True

    @property
    def stops(self) -> bool:
        """True if it stops something: such an action needs no control, and is sent again at once."""
        kinds = set(self.document().graph.objects(self.node, RDF.type))
        return bool(kinds & _STOPS) or any(name.casefold().startswith(_STOP_NAMES) for name in self.names)

    def build(self, /, **given: Any) -> Graph:
        """Return the request body with values by field name. Raises InvalidInput with all errors."""
        shapes, nodes = self._consumed()
        return build(_one(shapes, nodes), given, self._find)

    def validate(self, body: Graph) -> None:
        """Validate the body against the served shapes. Raises InvalidInput with a message for each violation."""
        shapes, nodes = self._consumed()
        for node in nodes:
            validate(body, shapes, node)

    def __call__(
        self, body: Graph | Mapping[str, Any] | None = None, /, *, idempotency_key: str | None = None, **given: Any
    ) -> Invocation:
        """Execute the action once.

        ``body`` is a graph that is sent as it is, or a mapping of values by field name, like the keyword arguments.
        """
        ready = self._ready(body, given)
        headers = {"idempotency-key": idempotency_key} if idempotency_key else {}
        answer = self._send(ready, headers)
        return Invocation(self.web, answer.location() if "location" in answer.headers else "", Action)

    def rehearse(self, body: Graph | Mapping[str, Any] | None = None, /, **given: Any) -> Reading:
        """Rehearse the action. Raises Unsupported if its description does not offer a rehearsal.

        A server that ignores the preference would execute the action, so nothing is sent unless the description offers
        it.
        """
        if not self.can_rehearse:
            raise Unsupported(f"{self.name} cannot be rehearsed: its description has no lf:dryRun true")
        answer = self._send(self._ready(body, given), {"prefer": DRY_RUN})
        applied = answer.headers.get("preference-applied", "").lower()
        if DRY_RUN not in [each.strip() for each in applied.split(",")]:
            raise BadAnswer(
                f"{self.name} was to be rehearsed only, but the server does not confirm that: it may have been executed"
            )
        return _rehearsed(answer)

    def stream(self) -> Stream:
        """Return a stream of further inputs, to be opened by ``with``. Raises Unsupported if the action takes none."""
        protocol = self.read().graph.value(self.node, LF.streamProtocol)
        if protocol is None:
            raise Unsupported(f"{self.name} is no stream: its description has no lf:streamProtocol")
        return Stream(self.web, str(self.iri), str(protocol), control_of(self))

    def _ready(self, said: Graph | Mapping[str, Any] | None, given: Mapping[str, Any]) -> Graph | None:
        """Return the body, validated by the present shape; None for an action without input.

        A long body that was built here is left to the server, because its values were checked while building.
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
        fields = {**typed, **headers}
        if self.stops:
            return self.web.send(method, url, content, fields, Repeat.STOP)
        control = control_of(self)
        return (self.web if control is None else control).send(method, url, content, fields)

    def binding(self) -> tuple[str, str]:
        """Return method and URL of the binding; without one, the method that OPTIONS allows at the action's IRI."""
        graph, found = self.document().graph, []
        for request in graph.objects(self.node, HYBRIT.binding):
            method = graph.value(request, HTTP.mthd) or graph.value(request, HTTP.methodName)
            target = graph.value(request, HTTP.requestURI) or graph.value(request, HTTP.absoluteURI)
            if method is not None and target is not None:
                found.append((local_name(str(method)).upper(), str(target)))
        offered = [each for each in found if each[0] in _METHODS and is_web(URIRef(each[1]))]
        if not found:
            offered = [(method, document_of(self.iri)) for method in self.web.allowed_methods(self.iri)]
            offered = [each for each in offered if each[0] in ("POST", "PUT")]
        if not offered:
            raise Unsupported(f"{self.name} has no HTTP binding in its description")
        return min(offered, key=lambda each: (_METHODS.index(each[0]), each[1]))

    def _consumed(self) -> tuple[Graph, list[Node]]:
        """Return the graph of shapes and the nodes that the body must meet. Shapes in other documents are fetched."""
        document = self.document()
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
        """Return the IRI of the thing with this name, by a path from the owner of this action or from one of its
        owners.
        """
        here = self.owner
        while here is not None:
            try:
                if isinstance(here, Place):
                    return here.at(name).iri
            except NoSuchThing:
                pass  # perhaps further up
            here = here.owner
        return None


def _rehearsed(answer: Answer) -> Reading:
    """Return the values in the answer, if there are any."""
    media_type = answer.headers.get("content-type", "")
    if not answer.body or not media_type:
        return Reading({}, ())
    graph = parse_rdf(answer.body.decode(errors="replace"), media_type, answer.url)
    objects = set(graph.objects())
    return read(graph, next((node for node in graph.subjects() if node not in objects), URIRef(answer.url)))


def _one(shapes: Graph, nodes: list[Node]) -> Shape:
    return conjunction(read_shape(shapes, node) for node in nodes)


def _copy(graph: Graph, nodes: list[Node], into: Graph) -> None:
    """Copy the triples about the nodes and about all nodes that they lead to in the same description."""
    pending, seen = list(nodes), set(nodes)
    while pending:
        node = pending.pop()
        for _, predicate, value in graph.triples((node, None, None)):
            into.add((node, predicate, value))
            if value not in seen and not isinstance(value, Literal):
                seen.add(value)
                pending.append(value)


def _missing(shapes: Graph, nodes: list[Node], fetched: set[str]) -> str | None:
    """Return the IRI of a shape that is named but not yet loaded."""
    named = [*nodes, *shapes.objects(None, SH.node)]
    for node in named:
        there = (node, None, None) in shapes
        if isinstance(node, URIRef) and not there and is_web(node) and document_of(node) not in fetched:
            return str(node)
    return None


def _the_shape(shapes: Graph, node: Node) -> Node:
    """Return the node itself or, if it names a document of shapes, the one shape in it that no other refers to."""
    if any((node, predicate, None) in shapes for predicate in (SH.property, SH.node, SH["or"], SH["and"], SH.xone)):
        return node
    named = next(iter(shapes.objects(node, LF.shape)), None)
    if named is not None:
        return named
    candidates = [each for each in shapes.subjects(RDF.type, SH.NodeShape) if each not in set(shapes.objects())]
    return candidates[0] if len(candidates) == 1 else node
