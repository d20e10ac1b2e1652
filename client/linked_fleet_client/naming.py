"""Names of things, taken from data and never from patterns of URLs."""

import difflib
import re
from collections.abc import Callable, Iterator, Sequence
from typing import Generic, Protocol, TypeVar
from urllib.parse import quote, unquote

from rdflib.term import URIRef

from linked_fleet_client.errors import NoSuchThing, Problem


class Named(Protocol):
    """An object with ``names``, ordered by rank: identifiers come before descriptions."""

    iri: URIRef

    @property
    def names(self) -> Sequence[str]: ...
    @property
    def name(self) -> str: ...
    def learn(self) -> object:
        """Read its own description, which may have more names than the document that lists it."""

    def introduce(self) -> None:
        """Read its own description if no name is known so far."""


T = TypeVar("T", bound=Named)


class Members(Generic[T], Sequence[T]):
    """Things sorted by name, accessible by any of their names."""

    def __init__(self, members: Sequence[T], what: str) -> None:
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
            raise no_such(self._what, name, [member.name for member in self._members])
        return found

    def introduced(self) -> "Members[T]":
        """Return the members sorted anew, after reading those without a known name."""
        for member in self._members:
            try:
                member.introduce()
            except Problem:
                continue  # it keeps its IRI as name
        return Members(self._members, self._what)

    def known(self, name: str) -> T | None:
        """Return a member by the names that are known without a request."""
        for same in (_exactly, _whatever_case):
            if found := _best(self._members, name, same):
                return found
        return None

    def _searched(self, name: str) -> T | None:
        for member in self._members:
            try:
                member.learn()
            except Problem:
                continue  # an unreadable member has no more names; others may match
            if any(_whatever_case(name, each) for each in member.names):
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
        raise NoSuchThing(f"{name!r} may be any of {', '.join(found)}", found)
    return next(member for rank, member in ranked if rank == best)


def _exactly(one: str, other: str) -> bool:
    return one == other


def _whatever_case(one: str, other: str) -> bool:
    return one.casefold() == other.casefold()


def no_such(what: str, name: str, known: Sequence[str]) -> NoSuchThing:
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
