"""One execution of an action, from its acceptance to its end."""

from __future__ import annotations

import math
import re
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from datetime import datetime
from typing import Protocol

from rdflib import Graph
from rdflib.term import Literal, Node, URIRef

from linked_fleet_client.errors import StillRunning, Unsupported
from linked_fleet_client.live import Change, Feed
from linked_fleet_client.quantity import Quantity
from linked_fleet_client.reading import Value, date_time, read
from linked_fleet_client.resource import Resource
from linked_fleet_client.retry import Repeat
from linked_fleet_client.vocabulary import HYBRIT, LF, PROV, RDFS, SH, document_of, is_web, local_name
from linked_fleet_client.web import Document, Web

ENDED = frozenset({LF.succeeded, LF.failed, LF.cancelled, LF.preempted})
_SLICE_S = 5.0


class ActionLike(Protocol):
    """The part of an action that an invocation needs."""

    @property
    def names(self) -> Sequence[str]: ...

    def __call__(self) -> object: ...


MakeAction = Callable[[Web, str, Resource, Document | None], ActionLike]


class Invocation(Resource):
    """An execution of an action. Its state is read on access; ``wait`` follows it by events.

    If the server returned no Location, ``has_location`` is False and there is no state.
    """

    def __init__(self, web: Web, iri: str, action: MakeAction) -> None:
        """Create an invocation; ``action`` creates the actions that its description links, such as cancel."""
        super().__init__(web, iri)
        self._action = action

    @property
    def has_location(self) -> bool:
        return bool(self.iri)

    @property
    def state(self) -> str | None:
        """``accepted``, ``running``, ``succeeded``, ``failed``, ``cancelled``, ``preempted``, ``unknown``, or None."""
        if not self.has_location:
            return None
        return _word(self.read().graph.value(self.node, LF.state))

    @property
    def ended(self) -> bool:
        return has_ended(self.read().graph, self.node)

    @property
    def progress(self) -> float | None:
        """Progress from 0 to 1; None if the server does not state it."""
        return progress_in(self.read().graph, self.node)

    @property
    def reason(self) -> str | None:
        """The reason for the end; None if not stated."""
        return _text(self.document().graph.value(self.node, LF.reason))

    @property
    def result(self) -> dict[str, Value]:
        """The result values by their names in the description; empty before the end."""
        return _below(self.document().graph, self.node, LF.result)

    @property
    def output(self) -> dict[str, Value]:
        """The result of the action, by the names in the shape of what it produces; empty before the end."""
        return self._named(LF.output)

    @property
    def feedback(self) -> dict[str, Value]:
        """The last feedback that it gave, likewise."""
        return self._named(LF.feedback)

    def _named(self, predicate: URIRef) -> dict[str, Value]:
        found = _below(self.document().graph, self.node, predicate)
        names = self._names() if found else {}
        return {_renamed(key, names): value for key, value in found.items()}

    def _names(self) -> dict[str, str]:
        """Return the names of members of what the action produces, by the local names of their predicates."""
        action = self.document().graph.value(self.node, RDFS.seeAlso)
        said = self.web.get(str(action)) if is_web(action) else None
        shape = None if said is None else said.graph.value(said.iri(str(action)), HYBRIT.produces)
        graph = self.web.get(str(shape)).graph if is_web(shape) else Graph()
        named = [(graph.value(each, SH.path), name) for each, name in graph.subject_objects(SH.name)]
        return {local_name(str(path)): str(name) for path, name in named if isinstance(path, URIRef)}

    @property
    def target(self) -> dict[str, Value]:
        """The goal values."""
        return _below(self.document().graph, self.node, LF.target)

    @property
    def ended_at(self) -> datetime | None:
        return date_time(self.document().graph.value(self.node, PROV.endedAtTime))

    def changes(self, timeout_s: float = math.inf) -> Iterator[Change]:
        """Yield its states until it has ended, starting with the present one, or until ``timeout_s`` has passed."""
        deadline = None if timeout_s == math.inf else time.monotonic() + timeout_s
        for change in Feed(self.web, self.iri, deadline, _SLICE_S):
            self._document = change.document
            yield change
            if has_ended(change.document.graph, change.resource):
                return

    def wait(self, timeout_s: float = math.inf, on_change: Callable[[Change], object] = lambda _: None) -> str | None:
        """Wait for the end and return the final state. Raises StillRunning if it has not ended within ``timeout_s``."""
        if not self.has_location:
            return None
        for change in self.changes(timeout_s):
            on_change(change)
        if not self.ended:
            within = f" within {timeout_s:g} s" if math.isfinite(timeout_s) else ", as far as the server says"
            raise StillRunning(f"{self.iri} has not ended{within}: it is {self.state}")
        return _word(self.document().graph.value(self.node, LF.state))

    def cancel(self) -> None:
        """Cancel it by the action that its description links or, without one, by DELETE."""
        if not self.has_location:
            raise Unsupported("the server gives no way to cancel: it returned no Location")
        self.read()
        actions = [self._action(self.web, iri, self, self._document) for iri in self.linked_iris(HYBRIT.action)]
        if len(actions) > 1:
            actions = [action for action in actions if any("cancel" in name.casefold() for name in action.names)]
        if actions:
            actions[0]()
        elif self.ended:
            raise Unsupported(f"{self.iri} has ended already: it is {self.state}")
        else:
            self.web.send("DELETE", document_of(self.iri), None, {}, Repeat.STOP)


def has_ended(graph: Graph, node: Node) -> bool:
    """Return True if the state is a final one or, for an unknown state, if a time of its end is stated."""
    return graph.value(node, LF.state) in ENDED or date_time(graph.value(node, PROV.endedAtTime)) is not None


def progress_in(graph: Graph, node: Node) -> float | None:
    """Return the completed share, given as a bare number or with a unit."""
    stated = read(graph, node).values.get(local_name(LF.progress))
    value = stated.number if isinstance(stated, Quantity) else None
    return None if value is None else min(max(value, 0.0), 1.0)


def _below(graph: Graph, node: Node, predicate: URIRef) -> dict[str, Value]:
    found: dict[str, Value] = {}
    name = local_name(predicate)
    for key, value in read(graph, node).values.items():
        if key.startswith((f"{name}.", f"{name}[")) or key == name:
            found[key.removeprefix(name).lstrip(".")] = value
    return found


def _renamed(key: str, names: Mapping[str, str]) -> str:
    """Return the key with the names of members instead of the local names of their predicates."""
    return re.sub(r"[^.\[\]]+", lambda found: names.get(found[0], found[0]), key)


def _word(term: Node | None) -> str | None:
    return None if term is None else local_name(str(term))


def _text(term: Node | None) -> str | None:
    return str(term) if isinstance(term, Literal) else None
