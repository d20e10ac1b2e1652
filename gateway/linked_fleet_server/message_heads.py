"""Heads of HTTP/1.1 messages (RFC 9112): of requests as received, of responses as sent.

The request line is adapted to a parser that does not know all of HTTP/1; the head also has the framing of the body.
Heads of responses are bytes of status line and header fields (RFC 9112, 4 and 5). The server's own responses are here
as a whole.
"""

import re
from collections.abc import Iterable, Mapping, Sequence
from http import HTTPStatus
from typing import NamedTuple

from linked_fleet_server.connection_limits import MAX_HEAD_BYTES

_PARSEABLE = re.compile(rb"(?:GET|HEAD|OPTIONS|POST|PUT|PATCH|DELETE) /[\x21-\x7e]* HTTP/1\.[01]\r?\n")
"""Request lines that the parser can get unchanged."""
_REQUEST_LINE = re.compile(rb"([!#$%&'*+\-.^_`|~0-9A-Za-z]+) ([\x21-\x7e]+) HTTP/([0-9])\.([0-9])\r?\n")
_METHODS = frozenset({b"GET", b"HEAD", b"OPTIONS", b"POST", b"PUT", b"PATCH", b"DELETE"})
_ANY_METHOD = b"PUT"
"""Replaces a method that the parser does not know or treats specially, such as CONNECT."""
FRAMING = (b"content-length", b"transfer-encoding")
"""Header fields that determine the length of the body."""
FIELDS = "linked-fleet.fields"
"""Key in a scope of its header fields by name (``join_fields``)."""


class HeadError(Exception):
    """A head that is refused, with status and reason."""

    def __init__(self, status: HTTPStatus, reason: str) -> None:
        super().__init__(reason)
        self.status, self.reason = status, reason


class RequestLine(NamedTuple):
    """``data``: bytes for the parser. ``method``, ``target``: those of the request where ``data`` differs."""

    data: bytes
    method: bytes = b""
    target: bytes = b""


def read_line(data: bytes) -> RequestLine:
    """Read the request line at the beginning of ``data``. Raises HeadError.

    The parser knows neither all methods (RFC 9110, 9.1) nor that HTTP/1.5 is served as HTTP/1.1 (2.5). Targets other
    than paths are left to the application, which explains what is wrong with them.
    """
    match = _REQUEST_LINE.match(data)
    if match is None:
        raise HeadError(HTTPStatus.BAD_REQUEST, "The request line is not one of HTTP/1.1.")
    method, target, major, minor = match.groups()
    if major != b"1":
        raise HeadError(HTTPStatus.HTTP_VERSION_NOT_SUPPORTED, "The major version of HTTP served here is 1.")
    other_method, other_target = b"", b""
    if method not in _METHODS:
        other_method, method = method, _ANY_METHOD
    if not target.startswith(b"/"):
        other_target, target = target, b"/"
    line = b"%b %b HTTP/1.%b\r\n" % (method, target, min(minor, b"1"))
    return RequestLine(line + data[match.end() :], other_method, other_target)


class RequestLineReader:
    """Collects the request line of each request, and keeps method and target for which the parser gets substitutes."""

    def __init__(self) -> None:
        self.method = self.target = b""
        """Method and target of the request if the parser gets substitutes for them; empty otherwise."""
        self._start = b""

    @property
    def has_partial_line(self) -> bool:
        """True if the start of an incomplete line has arrived."""
        return bool(self._start)

    def read(self, data: bytes) -> bytes:
        """Return the bytes to parse, none while the line is incomplete. Raises HeadError."""
        if not self._start and _PARSEABLE.match(data):
            return data
        data = (self._start + data).lstrip(b"\r\n")  # RFC 9112, 2.2
        if b"\n" not in data:
            self._start = data
            if len(data) > MAX_HEAD_BYTES:
                raise HeadError(HTTPStatus.REQUEST_URI_TOO_LONG, f"A head has at most {MAX_HEAD_BYTES} bytes.")
            return b""
        self._start = b""
        data, self.method, self.target = read_line(data)
        return data

    def clear(self) -> None:
        """Forget method and target, once the head has been read."""
        self.method = self.target = b""


def join_fields(headers: Sequence[tuple[bytes, bytes]]) -> dict[bytes, bytes]:
    """Return header fields by name; several lines are joined (RFC 9110, 5.3)."""
    found = dict(headers)
    if len(found) == len(headers):
        return found
    lines: dict[bytes, list[bytes]] = {}
    for name, value in headers:
        lines.setdefault(name, []).append(value)
    return {name: b", ".join(values) for name, values in lines.items()}


def has_body(fields: Mapping[bytes, bytes]) -> bool:
    """Return True if the framing fields announce a body that is not empty."""
    return b"transfer-encoding" in fields or bool(fields.get(b"content-length", b"").strip(b" 0"))


def check_transfer_coding(fields: Mapping[bytes, bytes], version: str) -> None:
    """Raise HeadError for framing that the server does not support, or that HTTP/1.0 does not have (RFC 9112, 6.1)."""
    coding = fields.get(b"transfer-encoding")
    if coding is None:
        return
    if version == "1.0":
        raise HeadError(HTTPStatus.BAD_REQUEST, "HTTP/1.0 has no Transfer-Encoding.")
    if coding.strip().lower() != b"chunked":
        raise HeadError(HTTPStatus.NOT_IMPLEMENTED, "The one Transfer-Encoding known here is chunked.")


def opens_websocket(method: str, version: str, fields: Mapping[bytes, bytes]) -> bool:
    """Return True if the request opens a WebSocket (RFC 6455, 4.1). Any other Upgrade is ignored (RFC 9110, 7.8)."""
    return (
        method == "GET"
        and version == "1.1"
        and b"sec-websocket-key" in fields
        and fields.get(b"upgrade", b"").lower() == b"websocket"
        and b"upgrade" in (each.strip() for each in fields.get(b"connection", b"").lower().split(b","))
    )


def split_pieces(data: bytes) -> list[bytes]:
    """Split bytes into pieces that do not exceed the limit of heads."""
    return [data[at : at + MAX_HEAD_BYTES] for at in range(0, len(data), MAX_HEAD_BYTES)]


FieldLines = Sequence[tuple[bytes, bytes]]
_STATUS_LINES = {each.value: b"HTTP/1.1 %d %b\r\n" % (each.value, each.phrase.encode("ascii")) for each in HTTPStatus}


def status_line(status: int) -> bytes:
    """Return the status line with its line end."""
    return _STATUS_LINES.get(status) or b"HTTP/1.1 %d \r\n" % status


def field_block(fields: Iterable[tuple[bytes, bytes]]) -> bytes:
    """Return the lines of fields.

    RuntimeError for a line end inside one, which would begin another field or response.
    """
    lines = [name + b": " + value for name, value in fields]
    lines.append(b"")
    found = b"\r\n".join(lines)
    ends = len(lines) - 1
    if found.count(b"\n") != ends or found.count(b"\r") != ends or b"\0" in found:
        raise RuntimeError("A header field has a line end inside.")
    return found


def read_block(block: bytes) -> list[tuple[bytes, bytes]]:
    """Return the fields of which ``field_block`` has made the lines."""
    found = []
    for line in block.splitlines():
        name, _, value = line.partition(b": ")
        found.append((name, value))
    return found


TOO_MANY_CONNECTIONS = (
    b"HTTP/1.1 503 Service Unavailable\r\nretry-after: 1\r\ncontent-length: 0\r\nconnection: close\r\n\r\n"
)
"""The response on a connection beyond the limit of connections."""


def error_response(status: HTTPStatus, text: str, has_content: bool = True) -> bytes:
    """Return the response to a request that no application sees; the connection is closed after it."""
    fields = [
        (b"content-type", b"text/plain; charset=utf-8"),
        (b"content-length", b"%d" % len(text.encode())),
        (b"connection", b"close"),
    ]
    return status_line(status) + field_block(fields) + b"\r\n" + (text.encode() if has_content else b"")
