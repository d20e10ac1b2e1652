"""Requests in the bytes of a connection (RFC 9112): httptools, with limits and what it does not know. No I/O."""

from http import HTTPStatus
from typing import Any, Protocol

import httptools

from linked_fleet_server.connection_limits import MAX_HEAD_BYTES
from linked_fleet_server.message_heads import (
    FRAMING,
    HeadError,
    RequestLineReader,
    check_transfer_coding,
    has_body,
    join_fields,
    opens_websocket,
)

_IDLE, _HEAD, _BODY = "idle", "head", "body"
"""The part of a request that the next bytes belong to: a new request, the head of one, its body."""


class Handler(Protocol):
    """The receiver of requests. It reads the head from the ``RequestReader``."""

    def may_upgrade(self) -> bool:
        """Return True if a request could open a WebSocket now."""

    def on_request(self) -> None:
        """Handle a request whose head is complete."""

    def on_content(self, data: bytes) -> None:
        """Handle a part of its body."""

    def on_request_end(self) -> None:
        """Handle the end of its body."""


class RequestReader:
    """Reads one request after the other. Attributes without underscore are of the latest one."""

    method = version = ""
    target = b""
    """The target as it was sent: it may be * or a whole URL (RFC 9112, 3.2)."""
    headers: list[tuple[bytes, bytes]]
    fields: dict[bytes, bytes]
    """Header fields by name in lower case; several lines are joined (RFC 9110, 5.3)."""
    has_body = opens_websocket = False
    keep_alive = True
    """False for the last request of the connection; what follows it is ignored (RFC 9112, 9.6)."""

    def __init__(self, handler: Handler) -> None:
        self._handler: Any = handler
        self._parser: Any = httptools.HttpRequestParser(self)
        self._phase = _IDLE
        self._line = RequestLineReader()
        self._url = b""
        self._head_bytes = 0
        self._upgrade = False
        """True while a body follows that the parser leaves out, because its head has Upgrade."""
        self._parses_again = False
        """True while the framing fields of such a head are parsed again."""

    def close(self) -> None:
        """Release parser and handler, whose references to each other would keep them in memory."""
        self._parser = self._handler = None

    @property
    def in_body(self) -> bool:
        return self._phase is _BODY

    @property
    def in_head(self) -> bool:
        """True if a part of a head has arrived."""
        return self._phase is _HEAD or self._line.has_partial_line

    def feed(self, data: bytes) -> bytes | None:
        """Read bytes. Raises HeadError.

        Return the bytes after the head of a request that opens a WebSocket; None if there is none.
        """
        if self._phase is _IDLE:
            data = self._line.read(data) if self.keep_alive else b""
            if not data:
                return None
        if self._phase is not _BODY:
            self._head_bytes += len(data)
        try:
            self._parser.feed_data(data)
        except httptools.HttpParserUpgrade as upgrade:
            rest = data[upgrade.args[0] :]
            return rest if self.opens_websocket else self._ignore_upgrade(rest)
        except httptools.HttpParserCallbackError as error:
            raise error.__context__ or error from None
        except httptools.HttpParserError as error:
            if self._phase is _IDLE and not self.keep_alive:
                return None
            raise HeadError(HTTPStatus.BAD_REQUEST, f"The request is not HTTP/1.1: {error}.") from error
        if self._phase is not _BODY and self._head_bytes > MAX_HEAD_BYTES:
            reason = f"A head has at most {MAX_HEAD_BYTES} bytes."
            raise HeadError(HTTPStatus.REQUEST_HEADER_FIELDS_TOO_LARGE, reason)
        return None

    def _ignore_upgrade(self, rest: bytes) -> bytes | None:
        """Continue as after any other request (RFC 9110, 7.8). The parser leaves out a body after Upgrade."""
        if self._upgrade:
            self._upgrade = False
            framing = [name + b": " + value for name, value in self.headers if name in FRAMING]
            self._parser = httptools.HttpRequestParser(self)
            self._parses_again = True
            self._parser.feed_data(b"\r\n".join([b"PUT / HTTP/1.1", *framing, b"", b""]))
            self._parses_again = False
        return self.feed(rest) if rest else None

    # -- what the parser calls ----------------------------------------------------------------------------------------

    def on_message_begin(self) -> None:
        if not self._parses_again:
            self._phase, self._url, self.headers = _HEAD, b"", []

    def on_url(self, url: bytes) -> None:
        self._url += url

    def on_header(self, name: bytes, value: bytes) -> None:
        if self._phase is _HEAD:  # neither trailers, which nobody asked for, nor a head that is parsed again
            self.headers.append((name.lower(), value))

    def on_headers_complete(self) -> None:
        if self._parses_again:
            return
        parser, line = self._parser, self._line
        self._phase, self._head_bytes = _BODY, 0
        self.version = version = parser.get_http_version()
        self.method, self.target = (line.method or parser.get_method()).decode("ascii"), line.target or self._url
        line.clear()
        self.fields = fields = join_fields(self.headers)
        check_transfer_coding(fields, version)
        self.has_body = has_body(fields)
        self.keep_alive = version != "1.0" and parser.should_keep_alive()
        self.opens_websocket = self._upgrade = False
        if parser.should_upgrade():
            opens = not self.has_body and opens_websocket(self.method, version, fields)
            self.opens_websocket, self._upgrade = opens and self._handler.may_upgrade(), self.has_body
        if not self.opens_websocket:
            self._handler.on_request()

    def on_body(self, body: bytes) -> None:
        self._handler.on_content(body)

    def on_message_complete(self) -> None:
        if self._upgrade:
            return
        self._phase = _IDLE
        if not self.opens_websocket:
            self._handler.on_request_end()
