"""Things, their properties, and what they link, such as containers.

Things of the Web of robots are read on access and addressed by their own names.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import Any, TypeVar

from rdflib import Graph
from rdflib.term import Node, URIRef

from linked_fleet_client.action import DRY_RUN, Action
from linked_fleet_client.control import DURATION_S, Control
from linked_fleet_client.errors import BadAnswer, InvalidInput, NoSuchThing, Problem, Unsupported
from linked_fleet_client.live import Feed, create_stream
from linked_fleet_client.quantity import Quantity
from linked_fleet_client.reading import Reading, read
from linked_fleet_client.resource import Members, Resource, no_such_thing, steps
from linked_fleet_client.vocabulary import DCTERMS, HYBRIT, LDP, LF, RDF, RDFS, document_of, is_web, local_name
from linked_fleet_client.web import Answer, Document, origin

_PARTS = (LDP.contains, DCTERMS.hasPart)
# Types that add nothing to the distinction of things, properties and actions.
_PLAIN = frozenset(
    {HYBRIT.RoboticThing, HYBRIT.Property, HYBRIT.Action, LDP.Container, LDP.BasicContainer, LDP.Resource}
)
_NO_COLLECTIONS = frozenset(
    {*_PARTS, HYBRIT.property, HYBRIT.action, HYBRIT.blueprint, HYBRIT.consumes, LDP.constrainedBy, DCTERMS.isPartOf}
    | {RDF.type, RDFS.seeAlso, LF.vocabulary}
)
_METHOD_NOT_ALLOWED = 405
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
    def collections(self) -> Members[Collection]:
        """The other resources that it links, such as the rules and the world of a fleet."""
        document = self.read()
        graph, node = document.graph, self.node
        found = [each for predicate, each in graph.predicate_objects(node) if predicate not in _NO_COLLECTIONS]
        known = {*self._typed(document, HYBRIT.property, HYBRIT.Property), *graph.objects(node, HYBRIT.action)}
        known |= {each for predicate in _PARTS for each in graph.objects(node, predicate)}
        iris = [URIRef(str(each)) for each in found if is_web(each) and each not in known]
        here = [iri for iri in iris if origin(iri) == origin(document.url)]  # others are mostly terms of vocabularies
        return Members(self._members(Collection, here, document), "linked resource", searches=False)

    def control(self, holder: str, duration_s: float = DURATION_S) -> Control:
        """Return control of the robot as a context manager: ``with robot.control("me"):``.

        The lease is taken at the beginning, renewed while the block runs, and given back at its end. Meanwhile the lock
        token goes with the robot's actions that this client invokes. ``holder`` is who others read has control;
        ``duration_s`` is how long the lease lasts when this client vanishes.
        """
        self.read()
        leases = self.linked_iris(LF.lease)
        if not leases:
            raise Unsupported(f"{self.name} links no control lease, as a robot does")
        return Control(self, leases[0], holder, duration_s)

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
        """Return the part of that name, else what it links by that name, such as the rules of a fleet."""
        found: Thing = _first((lambda: self.parts, lambda: self.collections), "part", name)
        return found

    def __getattr__(self, name: str) -> Any:
        """Return the action, part, present value of the property, or linked resource of that name, for short programs.

        ``robot.gripper.grasp(force=20)`` and ``robot.gripper.width`` do what ``actions``, ``properties`` and ``[]`` do.
        """
        if name.startswith("_"):
            raise AttributeError(name)
        try:
            found = self.member(name)
        except NoSuchThing as error:
            raise AttributeError(str(error)) from error
        if not isinstance(found, Property):
            return found
        reading = found.reading
        return reading.main or reading.values.get(local_name(LF.value))

    def __dir__(self) -> Iterable[str]:
        """Return its attributes and what it has, for completion."""
        own = [*self.parts, *self.properties, *self.actions]
        return [*super().__dir__(), *(each.name for each in own if each.name.isidentifier())]

    def __contains__(self, name: object) -> bool:
        """Return True if a part or a linked resource has that name."""
        try:
            return self[str(name.iri if isinstance(name, Resource) else name)] is not None
        except NoSuchThing:
            return False

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
        """Return the part of that name, else the property, the action, or what it links by that name.

        Names that need a request come last.
        """
        groups = (lambda: self.parts, lambda: self.properties, lambda: self.actions, lambda: self.collections)
        found: Thing | Property | Action = _first(groups, "part, property or action", name)
        return found

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


def _first(groups: Sequence[Callable[[], Members[Any]]], what: str, name: str) -> Any:
    """Return the member of the first group that knows the name, else of the first that finds it by requests."""
    read: list[Members[Any]] = []
    for group_of in groups:
        read.append(group_of())
        if found := read[-1].known(name):
            return found
    known: list[str] = []
    for group in read:
        try:
            return group[name]
        except NoSuchThing as error:
            known += error.known
    raise no_such_thing(what, name, known)


MEDIA_TYPES = {".json": "application/json", ".ttl": "text/turtle", ".xml": "application/vnd.behaviortree+xml"}


def body_of(said: Graph | Mapping[str, Any] | Path) -> tuple[bytes, str]:
    """Return the bytes and the media type of a description. Raises InvalidInput for a file of another kind."""
    if isinstance(said, Graph):
        return said.serialize(format="turtle").encode(), "text/turtle"
    if isinstance(said, Mapping):
        return json.dumps(dict(said)).encode(), "application/json"
    if said.suffix not in MEDIA_TYPES:
        raise InvalidInput([f"{said} has none of the endings {', '.join(MEDIA_TYPES)}, which tell what is in it"])
    try:
        return said.read_bytes(), MEDIA_TYPES[said.suffix]
    except OSError as error:
        raise InvalidInput([f"{said} cannot be read: {error.strerror}"]) from error


class Collection(Thing):
    """A resource that a thing links, such as its rules. Members are parts; an LDP container also takes new ones."""

    def add(self, member: Graph | Mapping[str, Any] | Path) -> Thing:
        """Add a member and return it.

        Its description is a graph about ``<>``, its JSON with the names of the shape, or a file of one of the two.
        Raises Problem with the messages of the shape, and Unsupported if this takes no members.
        """
        return self._made(self._sent("POST", document_of(self.iri), member).location())

    def _made(self, iri: str) -> Thing:
        return Thing(self.web, iri, self)

    def check(self, member: Graph | Mapping[str, Any] | Path) -> None:
        """Check a member without adding it. Raises Problem as ``add``, and Unsupported.

        Raises BadAnswer if the server does not confirm that it has added nothing.
        """
        answer = self._sent("POST", document_of(self.iri), member, {"prefer": DRY_RUN})
        if DRY_RUN not in answer.headers.get("preference-applied", "").lower():
            raise BadAnswer(f"{self.iri} does not confirm that it has only checked the member: it may have been added")

    def replace(self, member: str | Thing, by: Graph | Mapping[str, Any] | Path) -> None:
        """Replace a member, given by any of its names. Raises Problem as ``add``, NoSuchThing, and Unsupported."""
        self._sent("PUT", document_of(self._found(member).iri), by)

    def _sent(
        self, method: str, url: str, said: Graph | Mapping[str, Any] | Path, fields: Mapping[str, str] | None = None
    ) -> Answer:
        body, media_type = body_of(said)
        return self._changed(method, url, body, {"content-type": media_type, **(fields or {})})

    def remove(self, member: str | Thing) -> None:
        """Remove a member, given by any of its names. Raises NoSuchThing, and Unsupported if it cannot be removed."""
        self._changed("DELETE", document_of(self._found(member).iri), None, {})

    def _found(self, member: str | Thing) -> Thing:
        return self.parts[member] if isinstance(member, str) else member

    def _changed(self, method: str, url: str, body: bytes | None, headers: Mapping[str, str]) -> Answer:
        try:
            return self.web.send(method, url, body, headers)
        except Problem as problem:
            if problem.status != _METHOD_NOT_ALLOWED:
                raise
            raise Unsupported(f"{url} does not take {method}: {problem}") from problem

    def _link(self) -> str:
        """Return the local name of the predicate by which the owner links it."""
        if self.owner is None or self._listing is None:
            return ""
        predicates = self._listing.graph.predicates(self._listing.iri(self.owner.iri), self.iri)
        return local_name(min(map(str, predicates), default=""))


def _presence(term: Node | None) -> str | None:
    return None if term is None else local_name(str(term))


def kind_of(resource: Resource) -> str:
    """Return its types as text; ``RoboticThing`` if it has no more specific one."""
    words = sorted({local_name(str(each)) for each in resource.types - _PLAIN})
    return ", ".join(words or sorted({local_name(str(each)) for each in resource.types}))
