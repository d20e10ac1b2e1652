"""One request and its response: ``receive`` and ``send`` of ASGI, and the framing of the response."""

import asyncio
import logging
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from http import HTTPStatus

from starlette.types import ASGIApp, Message, Scope

from linked_fleet_server.connection import Connection
from linked_fleet_server.message_heads import (
    FieldLines,
    error_response,
    field_block,
    read_block,
    status_line,
)

log = logging.getLogger(__name__)
_NO_CONTENT = (204, 304)
_CLOSE = (b"connection", b"close")
_CONTINUE = b"HTTP/1.1 100 Continue\r\n\r\n"
_MOST_UNREAD = 64 * 1024
"""Bytes of a body that may wait for the application before reading is paused."""


@dataclass(slots=True)
class Reply:
    """Status, lines of header fields and content of a response."""

    status: int
    block: bytes
    content: bytes

    @property
    def fields(self) -> list[tuple[bytes, bytes]]:
        return read_block(self.block)


class DefaultFields:
    """The lines of the fields of all responses, of which the server makes another list each second."""

    def __init__(self) -> None:
        self._kept: tuple[FieldLines, bytes] = ((), b"")

    def block(self, fields: FieldLines) -> bytes:
        kept, block = self._kept
        if fields is not kept:
            self._kept = fields, block = fields, field_block(fields)
        return block


_defaults = DefaultFields()


def response_bytes(reply: Reply, defaults: FieldLines, method: str, *, keep_alive: bool) -> bytes:
    """Return the bytes of a complete response; ``defaults``: the fields of all responses, in a list that stays."""
    fields = _defaults.block(defaults) if keep_alive else field_block([*defaults, _CLOSE])
    content = b"" if method == "HEAD" else reply.content
    return b"%b%b%b\r\n%b" % (status_line(reply.status), reply.block, fields, content)


class Exchange:
    """Writes head and content at once, and frames responses to HTTP/1.0 too (RFC 9112, 6.3).

    ``on_complete`` is called when the response is complete and the connection may be used again.
    """

    def __init__(
        self,
        connection: Connection,
        scope: Scope,
        *,
        keep_alive: bool,
        expects_continue: bool,
        on_complete: Callable[[], None],
    ) -> None:
        self.keep_alive = keep_alive
        self.response_started = self.response_complete = False
        self._connection, self._scope, self._on_complete = connection, scope, on_complete
        self._expects_continue = expects_continue
        self._disconnected = False
        self._body = bytearray()
        self._more_body = True
        self._news = asyncio.Event()
        self._head = b""
        """Bytes of the head that are not yet written."""
        self._chunked = self._to_end = False
        """The framing of the content: in chunks, or until the connection ends; by Content-Length otherwise."""
        self._left = 0
        """Bytes of the content that have not been sent, if it has a length."""

    # -- what the connection calls ------------------------------------------------------------------------------------

    def feed(self, data: bytes) -> None:
        """Add to the body. Nobody reads the rest of one whose response is complete."""
        if self.response_complete:
            return
        self._body += data
        if len(self._body) > _MOST_UNREAD:
            self._connection.pause_reading()
        self._news.set()

    def end_body(self) -> None:
        self._more_body = False
        self._news.set()

    def disconnect(self) -> None:
        """Tell the application that nobody reads its response."""
        self._disconnected = True
        self._news.set()

    async def run(self, application: ASGIApp) -> None:
        """Have the application answer. If it fails the response is 500, or incomplete if it has begun."""
        try:
            await application(self._scope, self.receive, self.send)
            if not self._is_over():
                log.error("The application has returned without a complete response.")
        except Exception:
            log.exception("The application has failed.")
        finally:
            if not self._is_over():
                self._fail()

    def _fail(self) -> None:
        transport = self._connection.transport
        if not self.response_started and not transport.is_closing():
            self.response_started = True
            content = self._scope["method"] != "HEAD"
            transport.write(error_response(HTTPStatus.INTERNAL_SERVER_ERROR, "Internal Server Error", content))
        transport.close()

    def _is_over(self) -> bool:
        return self.response_complete or self._disconnected

    # -- what the application calls -----------------------------------------------------------------------------------

    async def receive(self) -> Message:
        """Return the next part of the body, or the end of the connection."""
        connection = self._connection
        if self._expects_continue and not connection.transport.is_closing():
            self._expects_continue = False
            connection.transport.write(_CONTINUE)
        if not self._is_over():
            connection.resume_reading()
            await self._news.wait()
            self._news.clear()
        if self._is_over():
            return {"type": "http.disconnect"}
        body, self._body = bytes(self._body), bytearray()
        return {"type": "http.request", "body": body, "more_body": self._more_body}

    async def send(self, message: Message) -> None:
        """Handle an ASGI message. Raises RuntimeError if it is out of order or differs from Content-Length."""
        if self._connection.writing_paused:
            await self._connection.drain()
        if self._disconnected:
            return
        kind = message["type"]
        if kind == "http.response.start" and not self.response_started:
            self._begin(message["status"], message.get("headers", ()))
        elif kind == "http.response.body" and self.response_started and not self.response_complete:
            self._write(message.get("body", b""), message.get("more_body", False))
        else:
            raise RuntimeError(f"The ASGI message {kind!r} is out of turn.")

    def _begin(self, status: int, headers: Iterable[tuple[bytes, bytes]]) -> None:
        self.response_started = True
        self._expects_continue = False
        length: int | None = None
        fields = [*self._connection.state.default_headers, *headers]
        for name, value in fields:
            if name == b"content-length":
                length = int(value)
            elif name == b"connection" and b"close" in value.lower():
                self.keep_alive = False
        empty = self._scope["method"] == "HEAD" or status in _NO_CONTENT
        if length is None and not empty:
            self._to_end = self._scope["http_version"] == "1.0"
            self._chunked = not self._to_end
            if self._to_end:
                self.keep_alive = False
            else:
                fields.append((b"transfer-encoding", b"chunked"))
        self._left = 0 if empty or length is None else length
        if not self.keep_alive:
            fields.append(_CLOSE)
        self._head = status_line(status) + field_block(fields) + b"\r\n"

    def _write(self, body: bytes, more: bool) -> None:
        if data := self._head + self._framed(body, more):
            self._head = b""
            self._connection.writer.write(data)
        if not more:
            self.response_complete = True
            self._news.set()
            if not self.keep_alive:
                self._connection.transport.close()
            self._on_complete()

    def _framed(self, body: bytes, more: bool) -> bytes:
        if self._scope["method"] == "HEAD":
            return b""
        if self._chunked:
            chunk = b"%x\r\n%b\r\n" % (len(body), body) if body else b""
            return chunk if more else chunk + b"0\r\n\r\n"
        if not self._to_end:
            self._left -= len(body)
            if self._left < 0 or (self._left and not more):
                raise RuntimeError("The content is not as long as its Content-Length.")
        return body
