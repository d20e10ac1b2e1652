"""Resources: an IRI, a description, and names, which are taken from data and never from patterns of URLs."""

from __future__ import annotations

import difflib
import re
from collections.abc import Callable, Iterator, Sequence
from typing import Generic, Protocol, TypeVar
from urllib.parse import quote, unquote

from rdflib.term import Literal, Node, URIRef

from linked_fleet_client.errors import NoSuchThing, Problem
from linked_fleet_client.vocabulary import DCTERMS, HYBRIT, RDF, RDFS, is_web, local_name
from linked_fleet_client.web import Document, Web


class NamedObject(Protocol):
    """An object with ``names``, ordered by rank: identifiers come before descriptions."""

    iri: URIRef

    @property
    def names(self) -> Sequence[str]: ...
    @property
    def name(self) -> str: ...
    def document(self) -> object:
        """Read its own description, which may have more names than the document that lists it."""

    def load_names(self) -> None:
        """Read its own description if no name is known so far."""


T = TypeVar("T", bound=NamedObject)


class Members(Generic[T], Sequence[T]):
    """Things sorted by name, accessible by any of their names.

    Unless ``searches``, names that only the descriptions of the members have are not found.
    """

    def __init__(self, members: Sequence[T], what: str, searches: bool = True) -> None:
        self._searches = searches
        self._members, self._what = sorted(members, key=lambda member: (member.name.casefold(), member.iri)), what

    def __len__(self) -> int:
        return len(self._members)

    def __iter__(self) -> Iterator[T]:
        return iter(self._members)

    def __getitem__(self, name: str | int) -> T:  # type: ignore[override]
        """Return a member by identifier, linking predicate, last segment of its IRI, title, or IRI.

        Raises NoSuchThing.
        """
        if isinstance(name, int):
            return self._members[name]
        found = self.known(name) or self._searched(name)
        if found is None:
            raise no_such_thing(self._what, name, [member.name for member in self._members])
        return found

    def with_loaded_names(self) -> Members[T]:
        """Read the description of each member without a known name, and return the members sorted by name."""
        for member in self._members:
            try:
                member.load_names()
            except Problem:
                continue  # it keeps its IRI as name
        return Members(self._members, self._what, self._searches)

    def known(self, name: str) -> T | None:
        """Return a member by the names that are known without a request."""
        for same in (_exactly, _ignoring_case):
            if found := _best(self._members, name, same):
                return found
        return None

    def _searched(self, name: str) -> T | None:
        for member in self._members if self._searches else ():
            try:
                member.document()
            except Problem:
                continue  # an unreadable member has no more names; others may match
            if any(_ignoring_case(name, each) for each in member.names):
                return member
        return None


def _best(members: Sequence[T], name: str, same: Callable[[str, str], bool]) -> T | None:
    ranked = [
        (rank, member)
        for member in members
        for rank, each in enumerate([str(member.iri), *member.names])
        if same(name, each)
    ]
    if not ranked:
        return None
    best = min(rank for rank, _ in ranked)
    found = list(dict.fromkeys(member.iri for rank, member in ranked if rank == best))
    if len(found) > 1:
        raise NoSuchThing(f"{name!r} is ambiguous: it may be any of {', '.join(found)}", found)
    return next(member for rank, member in ranked if rank == best)


def _exactly(one: str, other: str) -> bool:
    return one == other


def _ignoring_case(one: str, other: str) -> bool:
    return one.casefold() == other.casefold()


def no_such_thing(what: str, name: str, known: Sequence[str]) -> NoSuchThing:
    """Return the error with similar names, or with all if there are few."""
    close = difflib.get_close_matches(name, known, n=5, cutoff=0.5) or (list(known) if len(known) <= 12 else [])
    there = f"; there is {', '.join(close)}" if close else ""
    return NoSuchThing(f"no {what} is called {name!r}{there}", known)


def shown_name(identifiers: Sequence[str], titles: Sequence[str], segment: str, link: str = "") -> str:
    """Return the name for paths: identifier, linking predicate, a title of one word, or the last segment of the IRI.

    That segment may be a meaningless number, so a title that shares no word with it is preferred.
    """
    if identifiers or link:
        return identifiers[0] if identifiers else link
    title = titles[0] if titles else ""
    if not title or (" " in title and segment and segment.casefold() in title.casefold()):
        return segment or title
    return title


_AWKWARD = re.compile(r"""[\x00-\x20/%"'`$&()<>|;\\*?!#{}\[\]~=\x7f]""")


def steps(path: str) -> list[str]:
    """Split a path into names; ``%2F`` is a slash within a name."""
    return [unquote(step) for step in path.split("/") if step]


def step(name: str) -> str:
    """Return a name escaped for a path, without characters that a shell would interpret."""
    return _AWKWARD.sub(lambda found: quote(found[0], safe=""), name)


_TITLES = (DCTERMS.title, RDFS.label)
_LINKS = frozenset({HYBRIT.property, HYBRIT.action, DCTERMS.hasPart, DCTERMS.isPartOf, RDFS.seeAlso})


class Resource:
    """A resource.

    ``owner`` is where it was found, in the description ``listing``; both are None if requested by IRI.
    """

    def __init__(self, web: Web, iri: str, owner: Resource | None = None, listing: Document | None = None) -> None:
        self.web, self.iri = web, URIRef(iri)
        self.owner, self._listing = owner, listing
        self._document: Document | None = None

    def read(self) -> Document:
        """Return its present description, revalidated by ETag."""
        self._document = self.web.get(self.iri)
        return self._document

    def document(self) -> Document:
        """Return its last read description; read it if there is none."""
        return self._document or self.read()

    def load_names(self) -> None:
        """Read its description if no name is known so far."""
        if not self._said(DCTERMS.identifier, *_TITLES) and not self._link():
            self.document()

    @property
    def known(self) -> bool:
        """True if its own description has been read."""
        return self._document is not None

    @property
    def node(self) -> URIRef:
        """The subject of its description: its IRI, unless a redirect led to another."""
        return self.document().iri(self.iri)

    @property
    def title(self) -> str:
        """Its title in the description, or its name."""
        titles = self._said(*_TITLES)
        if not titles and not self.known:
            self.read()
            titles = self._said(*_TITLES)
        return titles[0] if titles else self.name

    @property
    def types(self) -> set[Node]:
        """All its stated types, from the document that lists it if that states any."""
        listed = set(self._listing.graph.objects(self.iri, RDF.type)) if self._listing else set()
        return listed or set(self.document().graph.objects(self.node, RDF.type))

    @property
    def name(self) -> str:
        """The name to show, from what is known without a request."""
        return shown_name(self._said(DCTERMS.identifier), self._said(*_TITLES), local_name(self.iri), self._link())

    @property
    def names(self) -> Sequence[str]:
        """All its names that are known without a request."""
        said = [*self._said(DCTERMS.identifier), self._link(), local_name(self.iri), *self._said(*_TITLES)]
        return [name for name in dict.fromkeys(said) if name]

    def linked_iris(self, *predicates: URIRef) -> list[URIRef]:
        """Return the HTTP IRIs that these predicates link, from the last read description."""
        graph = self.document().graph
        found = [each for predicate in predicates for each in graph.objects(self.node, predicate)]
        return [URIRef(str(each)) for each in dict.fromkeys(found) if is_web(each)]

    def _said(self, *predicates: URIRef) -> list[str]:
        found: list[Node] = []
        for document in (self._document, self._listing):
            if document is not None:
                node = document.iri(self.iri) if document is self._document else self.iri
                found += [
                    each
                    for predicate in predicates
                    for each in sorted(document.graph.objects(node, predicate), key=str)
                ]
        return list(dict.fromkeys(str(each) for each in found if isinstance(each, Literal)))

    def _link(self) -> str:
        """Return the local name of the predicate by which the owner links it, if that is a specific one."""
        if self.owner is None or self._listing is None:
            return ""
        graph = self._listing.graph
        subject = self._listing.iri(self.owner.iri)
        types = set(graph.objects(self.iri, RDF.type))
        if not (self.iri in graph.objects(subject, HYBRIT.property) or HYBRIT.Property in types):
            return ""
        predicates = sorted(str(each) for each in graph.predicates(subject, self.iri) if each not in _LINKS)
        return local_name(predicates[0]) if predicates else ""

    def __repr__(self) -> str:
        return f"<{type(self).__name__} {self.iri}>"
