"""A cache of responses to GET: constant parts are assembled once, values and entity tags are new each time.

Responses are cached by path, Accept or the query that replaces it, base URL and the caller's view. They come from
``read_resource`` and belong to resources of a robot, to the list of a small fleet, or to such that never change. A
response is valid while nothing but frames has changed the robot, and while the facts of the resource are equal; that of
the fleet while all is equal that it shows. Requests with fields that ask for more than a representation bypass the
cache.
"""

import logging
import re
import weakref
from itertools import chain
from operator import is_not

from starlette.responses import Response
from starlette.types import Scope

from linked_fleet_gateway.http.arrival import Arrival, arrival_of
from linked_fleet_gateway.http.negotiation import GZIP, accepts_gzip, coded_tag, compress, decompress, is_compressible
from linked_fleet_gateway.http.representation import etag, not_modified
from linked_fleet_gateway.resources.branches import Branches
from linked_fleet_gateway.resources.description import MeasuredDescription
from linked_fleet_gateway.resources.resource import Resource
from linked_fleet_gateway.resources.templates import Rendering
from linked_fleet_gateway.resources.versioning import Source
from linked_fleet_gateway.subscriptions.live import Live
from linked_fleet_identity.rights import View
from linked_fleet_rdf.templates import Document, Template
from linked_fleet_server.exchange import Reply
from linked_fleet_server.message_heads import FieldLines, field_block
from linked_fleet_state.observation import Observation
from linked_fleet_state.robot import Robot

log = logging.getLogger(__name__)

MAX_ENTRIES = 16_384
MAX_BYTES = 24 * 1024 * 1024
"""Limit of bytes of cached contents. The oldest responses are dropped first."""
_ASKS_MORE = frozenset({b"prefer", b"if-match", b"upgrade", b"callback", b"last-event-id"})
_PICKED = re.compile(rb"as=[a-z]{1,16}")
_READ = ("GET", "HEAD")
_LONGEST_ACCEPT = 256
_GZIP_LINE = field_block([GZIP])
Key = tuple[bytes, bytes, str, tuple[View, tuple[str, ...]]]
"""Path, Accept or the query that replaces it, base URL and what the caller may see, restricted branches included."""


class ReadyResponse(Response):
    """A response whose header fields are encoded."""

    def __init__(self, reply: Reply) -> None:
        self.status_code, self.body, self.background = reply.status, reply.content, None
        self.raw_headers = reply.fields


class CachedResponse:
    """The response to GET of one resource. Measured values in it are written by ``rendering``."""

    __slots__ = (
        "_block",
        "_block_of_content",
        "_codable",
        "_coded",
        "_content",
        "_facts",
        "_news",
        "_quiet",
        "_rendering",
        "_shown",
        "_source",
        "_tag",
        "_tag_in_gzip",
        "_template",
        "_values",
        "robot",
        "size",
    )  # fmt: skip

    def __init__(
        self,
        resource: Resource,
        robot: Robot | None,
        written: Document | Rendering,
        fields: FieldLines,
        content_fields: FieldLines,
    ) -> None:
        """Create a response; ``robot`` is None if it belongs to none (``Source.shown``).

        ``fields``: those of every response except ETag; ``content_fields``: those absent from a 304. Of a document that
        a template has made, the values are kept, and not the template, which is dropped when there are too many. Other
        long ones are kept in gzip.
        """
        self._source, self.robot = resource.source, robot
        self._rendering = written if isinstance(written, Rendering) else None
        self._tag = self._tag_in_gzip = b""
        self._codable = False
        self._content: bytes | None = None
        self._coded: bytes | None = None
        """The content in gzip."""
        self._template: weakref.ref[Template] | None = None
        self._values = ""
        """The values of the template, separated by NUL."""
        self.size = 0
        """Approximate size of the cached content in bytes."""
        if isinstance(written, Document):
            self._keep(written, resource.shows_values)
        self._quiet = resource.describe.silent if isinstance(resource.describe, MeasuredDescription) else ()
        self._shown: tuple[Observation, ...] = ()
        """The observations that were written last."""
        self._block = field_block(fields)
        self._block_of_content = self._block + field_block(content_fields)
        self._news = _news(robot)
        self._facts = resource.source.facts() if robot is not None else _facts(resource.source)

    def _keep(self, document: Document, measured: bool) -> None:
        self._set_tag(document.content, measured)
        if not self._codable:
            self._content = document.content
        elif document.template is not None:
            self._template, self._values = weakref.ref(document.template), "\0".join(document.values)
        else:
            self._coded = compress(document.content)
        self.size = len(self._content or self._coded or self._values)

    def is_valid(self, live: Live) -> bool:
        """Return True if the robot still exists and nothing but frames has changed it."""
        robot = self.robot
        if robot is None:
            return _facts(self._source) == self._facts
        return (
            live.fleet.robots.get(robot.name) is robot
            and _news(robot) == self._news
            and self._source.facts() == self._facts
        )

    def reply(self, if_none_match: bytes | None, in_gzip: bool, uncoded: bytes | None = None) -> Reply | None:
        """Return the reply to a request, or 304; None if the content is lost with its template.

        ``if_none_match`` is the client's If-None-Match. ``uncoded``: the content without a coding, if it is there and
        no value in it is measured.
        """
        if self._rendering is not None:
            self._write(self._rendering)
        coded = self._codable and in_gzip
        tag = self._tag_in_gzip if coded else self._tag
        if if_none_match is not None and (
            if_none_match == tag or not_modified(if_none_match.decode("latin-1"), tag.decode())
        ):
            return Reply(304, b"%betag: %b\r\n" % (self._block, tag), b"")
        content = self._coded if coded else uncoded
        if content is None:
            content = self._plain() if uncoded is None else uncoded
            if content is None:
                return None
            if coded:
                content = self._coded = compress(content)
                self.size += len(content)
        coding = _GZIP_LINE if coded else b""
        lines = b"%b%betag: %b\r\ncontent-length: %d\r\n" % (self._block_of_content, coding, tag, len(content))
        return Reply(200, lines, content)

    def _plain(self) -> bytes | None:
        if self._content is not None:
            return self._content
        template = None if self._template is None else self._template()
        if template is not None:
            return template.fill(self._values.split("\0"))
        return None if self._coded is None else decompress(self._coded)

    def _write(self, rendering: Rendering) -> None:
        """Write the values, unless the last written observations are unchanged."""
        observations = self._source.sample()
        shown = (
            (*observations, *chain.from_iterable(sample() for sample in self._quiet)) if self._quiet else observations
        )
        before = self._shown
        if not self._tag or len(before) != len(shown) or any(map(is_not, before, shown)):
            self._content, self._coded = rendering.render_observations(observations), None
            self.size = len(self._content)
            self._set_tag(self._content, measured=True)
            self._shown = shown

    def _set_tag(self, content: bytes, measured: bool) -> None:
        tag = etag(content)
        self._tag, self._codable = tag.encode(), is_compressible(content, measured)
        if self._codable:
            self._tag_in_gzip = coded_tag(tag, "gzip").encode()


class ResponseCache:
    """The response cache of one gateway."""

    def __init__(self, max_entries: int = MAX_ENTRIES, max_bytes: int = MAX_BYTES) -> None:
        self._most, self._most_bytes = max_entries, max_bytes
        self._kept: dict[Key, CachedResponse] = {}
        self._bytes = 0

    def __len__(self) -> int:
        return len(self._kept)

    def find(self, scope: Scope, live: Live) -> Reply | None:
        """Return the reply to a request if its response is cached and valid. An error is logged, and gives None too."""
        try:
            key = _key(scope)
            if key is None or (answer := self._kept.get(key)) is None:
                return None
            fields, size = arrival_of(scope).fields, answer.size
            reply = (
                answer.reply(fields.get(b"if-none-match"), accepts_gzip(fields.get(b"accept-encoding", b"")))
                if answer.is_valid(live)
                else None
            )
            self._bytes += answer.size - size
            if reply is None:
                self._forget(key)
            return reply
        except Exception:  # one description that cannot be written must not fail the request
            log.exception("unforeseen error in the kept answer of %s", scope["path"])
            return None

    @staticmethod
    def is_cacheable(scope: Scope) -> bool:
        """Return True if the response to a request can be cached."""
        return _key(scope) is not None

    def store(self, scope: Scope, answer: CachedResponse) -> None:
        """Cache a response for further requests like this one."""
        key = _key(scope)
        if key is None or answer.size > self._most_bytes:
            return
        self._forget(key)
        self._kept[key] = answer
        self._bytes += answer.size
        while len(self._kept) > self._most or self._bytes > self._most_bytes:
            self._forget(next(iter(self._kept)))

    def forget_robot(self, robot: str) -> None:
        """Drop the responses about a robot that was removed."""
        for key in [key for key, each in self._kept.items() if each.robot is not None and each.robot.name == robot]:
            self._forget(key)

    def _forget(self, key: Key) -> None:
        answer = self._kept.pop(key, None)
        self._bytes -= answer.size if answer is not None else 0


def _key(scope: Scope) -> Key | None:
    """Return the cache key of a request; None if it bypasses the cache."""
    arrival = arrival_of(scope)
    if arrival.is_plain_read is None:
        arrival.is_plain_read = _is_plain_read(scope, arrival)
    if not arrival.is_plain_read:
        return None
    identity = arrival.authenticated.identity
    # The fleet links restricted branches for their readers alone.
    view = identity.visible_robots, _branches(scope).restricted_paths(identity) if scope["raw_path"] == b"/" else ()
    query = scope["query_string"]
    asked = b"?" + query if query else arrival.fields.get(b"accept", b"")
    return scope["raw_path"], asked, arrival.base, view


def _branches(scope: Scope) -> Branches:
    branches: Branches = scope["app"].services.live.branches
    return branches


def _is_plain_read(scope: Scope, arrival: Arrival) -> bool:
    fields = arrival.fields
    return (
        scope["method"] in _READ
        and (not scope["query_string"] or _PICKED.fullmatch(scope["query_string"]) is not None)
        and len(fields.get(b"accept", b"")) <= _LONGEST_ACCEPT
        and not arrival.names_event_stream
        and _ASKS_MORE.isdisjoint(fields)
    )


def _facts(source: Source) -> object:
    return None if source.shown is None else source.shown()


def _news(robot: Robot | None) -> tuple[object, ...]:
    if robot is None:
        return ()
    return robot.incarnation, robot.news, robot.online, robot.description is not None
