"""Subscriptions to changes: server-sent events with resumption, or polling if the server has no events."""

import contextlib
import re
import secrets
import socket
import time
from collections.abc import Generator, Iterable, Iterator
from dataclasses import dataclass
from decimal import Decimal
from functools import cached_property

import httpx
from rdflib import Graph
from rdflib.term import BNode, Literal, Node, URIRef

from linked_fleet_client.errors import BadAnswer, Unreachable, problem
from linked_fleet_client.reading import Reading, read
from linked_fleet_client.retry import parse_retry_after
from linked_fleet_client.vocabulary import HYBRIT, LF, RDF, document_of
from linked_fleet_client.web import MAX_BODY_BYTES, Document, Web, parse_rdf

SILENCE_S = 45.0
"""Longest silence of an event stream before it is reopened; servers send comments more often."""
POLL_S = 1.0
_NAP_S = 0.2
_FIRST_PAUSE_S, _LEAST_PAUSE_S, _LONGEST_PAUSE_S = 0.5, 0.1, 30.0
_EVENTS = "text/event-stream"
# Statuses that mean "not available as events" rather than "not available".
_NO_EVENTS = frozenset({400, 405, 406, 409, 415})
# A server that has just started may not know yet a resource that it served before, so 404 is final only after several
# attempts.
_GONE, _GONE_TRIES = 404, 6
_LATER = frozenset({429, 500, 502, 503, 504})


@dataclass(frozen=True)
class Event:
    """One server-sent event (WHATWG HTML, 9.2); ``retry_s`` is the reconnection time."""

    data: str
    id: str | None = None
    retry_s: float | None = None


@dataclass(frozen=True)
class Change:
    """The new state of ``resource`` as a complete description.

    ``missed`` says that some changes in between were lost.
    """

    resource: URIRef
    document: Document
    version: str | None = None
    missed: bool = False

    @cached_property
    def reading(self) -> Reading:
        """The values of the resource itself."""
        return read(self.document.graph, self.resource)

    def reading_of(self, prop: Node) -> Reading:
        """Return the values of a property that the description includes."""
        return read(self.document.graph, prop)


class Feed:
    """Iterates over the changes of one resource, starting with its present state, until the server ends the stream.

    ``deadline`` is monotonic; iteration ends at most ``silence_s`` after it. ``stream`` is the URL of the events, by
    default the resource itself.
    """

    def __init__(
        self,
        web: Web,
        iri: str,
        deadline: float | None = None,
        silence_s: float = SILENCE_S,
        stream: str | None = None,
    ) -> None:
        self.web, self.iri, self.deadline = web, iri, deadline
        self.url = document_of(stream or iri)
        self.last_id: str | None = None
        self._versions: dict[URIRef, str] = {}
        self._retry_s, self._silence_s = _FIRST_PAUSE_S, silence_s
        self._failures, self._later_s = 0, 0.0
        self._events, self._open = True, False
        self._closed = False
        self._response: httpx.Response | None = None

    def close(self) -> None:
        """End an iteration that may be waiting for the server in another thread."""
        self._closed = True
        stream = self._response.extensions.get("network_stream") if self._response is not None else None
        connection = stream.get_extra_info("socket") if stream is not None else None
        if isinstance(connection, socket.socket):
            with contextlib.suppress(OSError):  # already closed
                socket.socket.shutdown(connection, socket.SHUT_RDWR)

    def __iter__(self) -> Iterator[Change]:
        while self._events and not self._late():
            try:
                over = yield from self._streamed()
            except Unreachable as error:
                over = False
                if self._open and isinstance(error.__cause__, httpx.ReadTimeout):
                    continue  # silence is no failure: a broken connection looks like one without news
                self._failures += 1
            if over:
                return
            if self._events:
                self._pause()
        yield from self._polled()

    def _streamed(self) -> Generator[Change, None, bool]:
        """Read one connection; the generator's return value says if it was the last."""
        headers = {"accept": f"{_EVENTS}, text/turtle;q=0.9", "cache-control": "no-cache"}
        headers |= {"last-event-id": self.last_id} if self.last_id else {}
        self._open = False
        with self.web.stream(self.url, headers, self._remaining_s()) as response:
            self._response = response
            media_type = response.headers.get("content-type", "").partition(";")[0].strip().lower()
            if response.status_code == 204 or self._closed:
                return True
            if response.status_code in _LATER:
                self._later_s = parse_retry_after(response.headers.get("retry-after")) or 0.0
                raise Unreachable(f"{self.url} answers {response.status_code}")
            if response.status_code in _NO_EVENTS or (response.is_success and media_type != _EVENTS):
                self._events = False
                return False
            if response.status_code == _GONE and self._versions and self._failures < _GONE_TRIES:
                raise Unreachable(f"{self.url} is gone for now")
            if not response.is_success:
                raise problem(self.url, response.status_code, response.headers, self.web.read_body(response))
            self._open = True
            for event in events(lines(response.iter_bytes())):
                self._retry_s = event.retry_s if event.retry_s is not None else self._retry_s
                self.last_id = event.id if event.id is not None else self.last_id
                if event.data:
                    self._failures = 0
                    yield self._change(event)
                if self._late():
                    return True
        return False

    def _change(self, event: Event) -> Change:
        document = Document(self.url, parse_rdf(event.data, "text/turtle", self.url))
        resource = next((URIRef(str(each)) for each in document.graph.subjects(LF.version)), document.iri(self.iri))
        version = str(document.graph.value(resource, LF.version) or event.id or "") or None
        before = document.graph.value(resource, LF.previousVersion)
        seen = self._versions.get(resource)
        if version:
            self._versions[resource] = version
        return Change(resource, document, version, bool(before is not None and seen and str(before) != seen))

    def _polled(self) -> Iterator[Change]:
        seen: int | None = None
        pause_s = POLL_S / 16
        while not self._late():
            try:
                document = self.web.get(self.iri)
            except Unreachable:
                self._failures += 1
                self._pause()
                continue
            self._failures = 0
            if document.digest != seen:
                seen = document.digest
                yield Change(document.iri(self.iri), document, document.etag)
            self._sleep(pause_s)
            pause_s = min(2 * pause_s, POLL_S)

    def _pause(self) -> None:
        """Sleep, longer after each failure in a row, with jitter so that clients do not return together, and as long as
        the server wants, within bounds.
        """
        pause_s = max(self._retry_s, _LEAST_PAUSE_S) * 2.0 ** min(self._failures, 10)
        pause_s = min(pause_s, _LONGEST_PAUSE_S) * (0.5 + secrets.randbelow(1000) / 2000)
        wanted_s, self._later_s = self._later_s, 0.0
        self._sleep(max(pause_s, min(wanted_s, _LONGEST_PAUSE_S)))

    def _sleep(self, pause_s: float) -> None:
        until = time.monotonic() + pause_s
        while not self._late() and (left_s := until - time.monotonic()) > 0:
            time.sleep(min(self._at_most(left_s), _NAP_S))

    def _late(self) -> bool:
        return self._closed or (self.deadline is not None and time.monotonic() >= self.deadline)

    def _at_most(self, pause_s: float) -> float:
        return pause_s if self.deadline is None else max(0.0, min(pause_s, self.deadline - time.monotonic()))

    def _remaining_s(self) -> float:
        return max(0.05, self._at_most(self._silence_s))


def lines(parts: Iterable[bytes]) -> Iterator[str]:
    """Split into lines at CR, LF and CRLF only; other line separators of Unicode are part of the data."""
    waiting = b""
    for part in parts:
        waiting += part
        *whole, waiting = _LINE_ENDS.split(waiting)
        for line in whole:
            yield line.decode(errors="replace")
        if len(waiting) > MAX_BODY_BYTES:
            raise BadAnswer("a line of an event is too long")


# A CR at the end of the received data may be the first half of a CRLF.
_LINE_ENDS = re.compile(rb"\r\n|\n|\r(?!\Z)")


def events(said: Iterable[str]) -> Iterator[Event]:
    """Yield the events in the lines of a stream.

    A comment yields an event without data, so that deadlines are checked.
    """
    data: list[str] = []
    size, identifier, retry_s = 0, None, None
    for line in said:
        size += len(line)
        if size > MAX_BODY_BYTES:
            raise BadAnswer("an event is too large")
        name, _, value = line.partition(":")
        value = value.removeprefix(" ")
        if not line or not name:
            yield Event("\n".join(data) if not line else "", identifier, retry_s)
        if not line:
            data, size = [], 0
        elif name == "data":
            data.append(value)
        elif name == "id" and "\0" not in value:
            identifier = value
        elif name == "retry" and value.isascii() and value.isdigit():
            retry_s = min(int(value[:9]) / 1000, _LONGEST_PAUSE_S)


def create_stream(web: Web, container: str, resource: str, depth: URIRef | None, interval_s: float | None) -> str:
    """Create a subscription by POST to a subscriptions container. Return the IRI of its event stream."""
    node, wanted = BNode(), Graph()
    wanted.add((node, RDF.type, HYBRIT.Subscription))
    wanted.add((node, HYBRIT.onResource, URIRef(resource)))
    if depth is not None:
        wanted.add((node, LF.depth, depth))
    if interval_s is not None:
        wanted.add((node, LF.minimumInterval, Literal(Decimal(repr(interval_s)))))
    body = wanted.serialize(format="turtle").encode()
    answer = web.send("POST", container, body, {"content-type": "text/turtle"})
    return answer.location()
