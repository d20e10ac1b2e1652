"""One request and its response: uvicorn's cycle with an optimised writer."""

from collections.abc import Iterable
from typing import Any

from uvicorn.protocols.http.httptools_impl import RequestResponseCycle

from linked_fleet_gateway.http.answers import Reply
from linked_fleet_gateway.http.connection_limits import BoundedWriter
from linked_fleet_gateway.http.message_heads import field_block, status_line

_NO_CONTENT = (204, 304)
CLOSE = (b"connection", b"close")


def response_bytes(reply: Reply, defaults: Iterable[tuple[bytes, bytes]], method: str, keep_alive: bool) -> bytes:
    """Return the bytes of a complete response; ``defaults``: the fields of all responses."""
    fields = field_block(defaults if keep_alive else [*defaults, CLOSE])
    content = b"" if method == "HEAD" else reply.content
    return b"%b%b%b\r\n%b" % (status_line(reply.status), reply.block, fields, content)


class Exchange(RequestResponseCycle):
    """A cycle that writes head and content at once, and frames responses to HTTP/1.0 too (RFC 9112, 6.3)."""

    _head = b""
    """Bytes of the head that are not yet written."""
    _to_end = False
    """True if the content ends with the connection."""

    def __init__(self, writer: BoundedWriter, **named: Any) -> None:
        super().__init__(**named)
        self._writer = writer

    async def send(self, message: Any) -> None:
        """Handle an ASGI message. Raises RuntimeError if it is out of order or differs from Content-Length."""
        if self.disconnected:
            return
        if self.flow.write_paused:
            await self.flow.drain()
            if self.disconnected:
                return
        kind = message["type"]
        if kind == "http.response.start" and not self.response_started:
            self._begin(message["status"], message.get("headers", ()))
        elif kind == "http.response.body" and self.response_started and not self.response_complete:
            self._write(message.get("body", b""), message.get("more_body", False))
        else:
            raise RuntimeError(f"The ASGI message {kind!r} is out of turn.")

    def _begin(self, status: int, headers: Any) -> None:
        self.response_started = True
        self.waiting_for_100_continue = False
        length: int | None = None
        fields = [*self.default_headers, *headers]
        for name, value in fields:
            if name == b"content-length":
                length = int(value)
            elif name == b"connection" and b"close" in value.lower():
                self.keep_alive = False
        empty = self.scope["method"] == "HEAD" or status in _NO_CONTENT
        if length is None and not empty:
            self._to_end = self.scope["http_version"] == "1.0"
            self.chunked_encoding = not self._to_end
            if self._to_end:
                self.keep_alive = False
            else:
                fields.append((b"transfer-encoding", b"chunked"))
        self.expected_content_length = 0 if empty or length is None else length
        if not self.keep_alive:
            fields.append(CLOSE)
        self._head = status_line(status) + field_block(fields) + b"\r\n"

    def _write(self, body: bytes, more: bool) -> None:
        if self.scope["method"] == "HEAD":
            body = b""
        elif self.chunked_encoding:
            body = b"%x\r\n%b\r\n" % (len(body), body) if body else b""
            if not more:
                body += b"0\r\n\r\n"
        elif not self._to_end:
            self.expected_content_length -= len(body)
            if self.expected_content_length < 0 or (self.expected_content_length and not more):
                raise RuntimeError("The content is not as long as its Content-Length.")
        if data := self._head + body if self._head else body:
            self._head = b""
            self._writer.write(data)
        if not more:
            self.response_complete = True
            self.message_event.set()
            if not self.keep_alive:
                self.transport.close()
            self.on_response()
