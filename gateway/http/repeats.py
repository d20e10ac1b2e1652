"""Requests for measured values that were asked before in the same words, answered by the protocol itself.

Who follows a value by GET sends the same bytes each time. The first of them takes the whole way: it is parsed, who asks
is found out, a representation is negotiated. What came of it is kept under the bytes, and for the next ones all that is
left is to look whether it still holds, and to put the present value into its place.
"""

import re
import time
import uuid
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from gateway.fleet.observation import Observation
from gateway.http.conditional import etag, not_modified
from gateway.http.rates import Rates
from gateway.resources.property import Seen
from gateway.resources.resource import Resource
from gateway.resources.template import Rendering
from gateway.runtime.counters import Requests

MAX_KEPT = 2048
_MAX_HEAD_BYTES = 2048
# What else a request says can make a difference of which nothing is known here.
_HARMLESS = frozenset(
    (b"host", b"user-agent", b"accept", b"accept-encoding", b"accept-language", b"authorization", b"cache-control",
     b"if-none-match", b"pragma")
)  # fmt: skip
_LINES = {200: b"HTTP/1.1 200 OK\r\n", 304: b"HTTP/1.1 304 Not Modified\r\n"}
_PRESENT = (b"etag", b"content-length")
_FIELD = re.compile(rb"[\x20-\x7e\x80-\xff]*")


@dataclass
class Repeat:
    """One request that is kept. ``client`` is who asks, if that is not the address; ``holds``: whether he still may."""

    resource: Resource
    rendering: Rendering
    client: str | None
    if_none_match: str | None
    holds: Callable[[], bool]
    heads: dict[int, bytes] = field(default_factory=dict)
    """By status, the fields that are the same each time."""
    _facts: Any = None
    _observations: tuple[Observation, ...] | None = None
    _answer: tuple[int, bytes, bytes] = (0, b"", b"")

    def __post_init__(self) -> None:
        self._facts = self.resource.source.facts()

    def answered(self, status: int, headers: Sequence[tuple[bytes, bytes]]) -> bool:
        """Take over what the whole way has answered; whether it is something to keep."""
        if status not in _LINES or any(not _FIELD.fullmatch(value) for _, value in headers):
            return False
        self.heads[status] = b"".join(
            b"%b: %b\r\n" % (name, value) for name, value in headers if name.lower() not in _PRESENT
        )
        self._observations = None
        return True

    def present(self) -> tuple[int, bytes, bytes] | None:
        """Status, fields and body of the answer as it is now; None when only the whole way knows it."""
        source = self.resource.source
        if source.robot is not None:
            source.robot.look()
        if source.facts() != self._facts or not self.holds():
            return None
        observations = source.look()
        if observations != self._observations:
            self._render(observations)
        return self._answer if self._answer[0] in self.heads else None

    def _render(self, observations: tuple[Observation, ...]) -> None:
        body = self.rendering.body(Seen.of(observations))
        tag = etag(body)
        status = 304 if not_modified(self.if_none_match, tag) else 200
        fields = b"%betag: %b\r\n" % (self.heads.get(status, b""), tag.encode())
        if status == 304:
            self._answer = status, fields, b""
        else:
            self._answer = status, b"%bcontent-length: %d\r\n" % (fields, len(body)), body
        self._observations = observations


class Repeats:
    """All that are kept, by the bytes of their requests; the oldest goes when there are too many."""

    def __init__(self, rates: Rates, requests: Requests) -> None:
        self._rates, self._requests = rates, requests
        self._kept: dict[bytes, Repeat] = {}

    def keep(self, head: bytes, repeat: Repeat) -> None:
        self._kept.pop(head, None)
        while len(self._kept) >= MAX_KEPT:
            del self._kept[next(iter(self._kept))]
        self._kept[head] = repeat

    def known(self, head: bytes) -> Repeat | None:
        return self._kept.get(head)

    def answer(self, head: bytes, address: str, headers: Sequence[tuple[bytes, bytes]]) -> bytes | None:
        """The whole answer, with ``headers`` of the server; None if there is none to be had here.

        It counts and is counted as any other: ``address`` is that of a client who has no name.
        """
        repeat = self._kept.get(head)
        if repeat is None:
            return None
        begun_s = time.monotonic()
        found = repeat.present()
        if found is None:
            del self._kept[head]
            return None
        if self._rates.take(repeat.client or address):
            return None
        status, fields, body = found
        self._requests.add("GET", status, time.monotonic() - begun_s)
        server = b"".join([b"%b: %b\r\n" % each for each in headers])
        id = uuid.uuid4().hex.encode()
        return b"%b%b%bx-request-id: %b\r\n\r\n%b" % (_LINES[status], server, fields, id, body)


def repeatable(head: bytes) -> bool:
    """Whether ``head``, all that the client has sent, may be the whole of a request that is worth keeping."""
    return head.startswith(b"GET ") and len(head) <= _MAX_HEAD_BYTES and head.endswith(b"\r\n\r\n")


def is_plain(scope: Mapping[str, Any]) -> bool:
    """Whether a request says nothing but what it asks for, who asks, and what is known of the answer already."""
    fields: list[tuple[bytes, bytes]] = scope["headers"]
    plain = all(name in _HARMLESS or (name, value.lower()) == (b"connection", b"keep-alive") for name, value in fields)
    return plain and scope["method"] == "GET" and scope["http_version"] == "1.1"
