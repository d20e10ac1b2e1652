"""The fleet and its things: one URL, from which everything else is found by links.

Things of the Web of robots are read on access and addressed by their own names.
"""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator, Mapping
from functools import cached_property
from types import TracebackType
from typing import TypeVar

from rdflib.term import Node, URIRef

from linked_fleet_client.action import Action
from linked_fleet_client.errors import NoSuchThing, Problem, Unsupported
from linked_fleet_client.invocation import Invocation
from linked_fleet_client.live import Feed, create_stream
from linked_fleet_client.quantity import Quantity
from linked_fleet_client.reading import Reading, read
from linked_fleet_client.resource import Members, Resource, no_such_thing, steps
from linked_fleet_client.vocabulary import DCTERMS, HYBRIT, LDP, LF, PROV, RDF, RDFS, document_of, is_web, local_name
from linked_fleet_client.web import Bearer, Document, Web

_PARTS = (LDP.contains, DCTERMS.hasPart)
# Types that add nothing to the distinction of things, properties and actions.
_PLAIN = frozenset(
    {HYBRIT.RoboticThing, HYBRIT.Property, HYBRIT.Action, LDP.Container, LDP.BasicContainer, LDP.Resource}
)
_MOST_LINKS = 500
T = TypeVar("T", bound="Resource")


class Observable(Resource):
    """A resource that can be read and watched."""

    def subscribe(
        self, *, depth: URIRef | None = None, interval_s: float | None = None, timeout_s: float | None = None
    ) -> Feed:
        """Return the changes, starting with the present state, by server-sent events or else by polling.

        ``depth`` is an individual of lf:Depth, ``interval_s`` the least time between two messages. With either, a
        subscription is created in the container that the description links. Iteration ends after ``timeout_s`` if
        given.
        """
        deadline = None if timeout_s is None else time.monotonic() + timeout_s
        silence = {} if timeout_s is None else {"silence_s": 5.0}
        stream = None
        if depth is not None or interval_s is not None:
            stream = create_stream(self.web, self._container(), str(self.node), depth, interval_s)
        return Feed(self.web, self.iri, deadline, stream=stream, **silence)

    def _container(self) -> str:
        """Return the subscriptions container of the thing or, for a property, of a thing that it belongs to."""
        for iri in (self.iri, *self.linked_iris(DCTERMS.isPartOf, RDFS.seeAlso)):
            document = self.web.get(iri)
            for found in document.graph.objects(document.iri(iri), HYBRIT.subscriptions):
                return str(found)
        raise Unsupported(f"{self.iri} links no subscriptions container")


class Property(Observable):
    """A parameter or variable of a thing. Every access asks the server, which mostly answers 304."""

    @property
    def reading(self) -> Reading:
        return read(self.read().graph, self.node)

    def reading_in(self, document: Document) -> Reading:
        """Return its values as another description states them, such as that of its thing."""
        return read(document.graph, self.iri)

    @property
    def value(self) -> Quantity:
        """Its single quantity. Raises Unsupported, listing the values, if there is not exactly one."""
        reading = self.reading
        if reading.main is None:
            raise Unsupported(f"{self.name} has no single value but {', '.join(reading.values) or 'statements only'}")
        return reading.main

    @property
    def triples(self) -> list[tuple[Node, Node]]:
        """All predicates and objects, for descriptions of unknown form."""
        return sorted(self.read().graph.predicate_objects(self.node), key=str)


class Thing(Observable):
    """Anything with parts, properties and actions, such as a fleet, a robot or a joint."""

    @property
    def presence(self) -> str | None:
        """``online``, ``offline`` or another term of the vocabulary; None if not stated. Asks the server."""
        graph = self.read().graph
        return _presence(graph.value(self.node, LF.presence))

    def presence_in(self, document: Document) -> str | None:
        """Return its presence as another description states it, such as that of its fleet."""
        return _presence(document.graph.value(self.iri, LF.presence))

    @property
    def parts(self) -> Members[Thing]:
        """The things that it contains or consists of."""
        document = self.read()
        found = self.linked_iris(*_PARTS)
        found += [URIRef(str(each)) for each in document.graph.subjects(DCTERMS.isPartOf, self.node) if is_web(each)]
        return Members(self._members(Thing, found or self._related(document), document), "part")

    @property
    def properties(self) -> Members[Property]:
        return self.properties_in(self.read())

    def properties_in(self, document: Document) -> Members[Property]:
        """Return its properties as a received description states them, such as one in a message."""
        found = self._typed(document, HYBRIT.property, HYBRIT.Property)
        return Members(self._members(Property, found, document), "property")

    @property
    def actions(self) -> Members[Action]:
        document = self.read()
        return Members(self._members(Action, self._typed(document, HYBRIT.action, HYBRIT.Action), document), "action")

    def __getitem__(self, name: str) -> Thing:
        return self.parts[name]

    def __iter__(self) -> Iterator[Thing]:
        return iter(self.parts)

    def at(self, path: str) -> Thing | Property | Action:
        """Return the object at a path of names with slashes; the last may name a property or an action."""
        here: Thing | Property | Action = self
        for name in steps(path):
            if not isinstance(here, Thing):
                raise NoSuchThing(f"{here.name} has no parts, so no {name!r}")
            here = here.member(name)
        return here

    def member(self, name: str) -> Thing | Property | Action:
        """Return the part of that name, else the property, else the action. Names that need a request come last."""
        groups = (self.parts, self.properties, self.actions)
        for group in groups:
            if found := group.known(name):
                return found
        known: list[str] = []
        for group in groups:
            try:
                return group[name]
            except NoSuchThing as error:
                known += error.known
        raise no_such_thing("part, property or action", name, known)

    def walk(self, limit: int = 10_000) -> Iterator[Thing]:
        """Yield itself and all its parts, breadth first, each once and at most ``limit``."""
        pending, seen = [self], {self.iri}
        while pending:
            thing = pending.pop(0)
            yield thing
            for part in thing.parts:
                if part.iri not in seen and len(seen) < limit:
                    seen.add(part.iri)
                    pending.append(part)

    def _typed(self, document: Document, predicate: URIRef, type_: URIRef) -> list[URIRef]:
        """Return the objects of the predicate, and other linked objects that state that type."""
        graph, node = document.graph, document.iri(self.iri)
        found = [*graph.objects(node, predicate)]
        found += [each for each in graph.objects(node) if (each, RDF.type, type_) in graph]
        return [URIRef(str(each)) for each in found if is_web(each)]

    def _members(self, kind: type[T], iris: Iterable[URIRef], document: Document) -> list[T]:
        wanted = [iri for iri in dict.fromkeys(iris) if iri not in (document.iri(self.iri), self.iri)]
        return [kind(self.web, iri, self, document) for iri in wanted]

    def _related(self, document: Document) -> list[URIRef]:
        """Return the things that the Link field relates it to, if the description names no parts."""
        graph = document.graph
        named = {document_of(str(each)) for each in graph.objects(self.node)} | self._above()
        found = []
        for target, relation in document.links[:_MOST_LINKS]:
            if relation in ("related", "item") and target not in named and is_web(URIRef(target)):
                found += [URIRef(target)] if self._is_thing(target) else []
        return found

    def _is_thing(self, iri: str) -> bool:
        try:
            document = self.web.get(iri)
        except Problem:
            return False  # a link that cannot be read, or not by this caller, is no part
        return (document.iri(iri), RDF.type, HYBRIT.RoboticThing) in document.graph

    def _above(self) -> set[str]:
        here: Resource | None = self
        found = set()
        while here is not None:
            found.add(document_of(here.iri))
            here = here.owner
        return found

    @cached_property
    def kind(self) -> str:
        return kind_of(self)


def _presence(term: Node | None) -> str | None:
    return None if term is None else local_name(str(term))


def kind_of(resource: Resource) -> str:
    """Return its types as text; ``RoboticThing`` if it has no more specific one."""
    words = sorted({local_name(str(each)) for each in resource.types - _PLAIN})
    return ", ".join(words or sorted({local_name(str(each)) for each in resource.types}))


class Fleet(Thing):
    """The thing at ``url``, usually a fleet, and the connections to its server.

    ``timeout_s`` bounds each connection attempt and each period without data. ``headers`` are sent with every request,
    also to other servers that links lead to, so they must not hold secrets. ``token`` is the bearer token of the
    caller; it is sent to the server of ``url`` only.
    """

    def __init__(
        self, url: str, timeout_s: float = 10.0, headers: Mapping[str, str] | None = None, token: str = ""
    ) -> None:
        super().__init__(Web(timeout_s, headers or {}, Bearer(token, url) if token else None), url)

    def __enter__(self) -> Fleet:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self.close()

    def close(self) -> None:
        self.web.close()

    def get(self, iri: str) -> Thing | Property | Action | Invocation:
        """Return the object at an IRI according to its types; a Thing if none of them is known."""
        document = self.web.get(iri)
        types = set(document.graph.objects(document.iri(iri), RDF.type))
        if HYBRIT.Action in types:
            return Action(self.web, iri, self)
        if types & {LF.Invocation, PROV.Activity}:
            return Invocation(self.web, iri, Action)
        return (Property if HYBRIT.Property in types else Thing)(self.web, URIRef(iri), self)
