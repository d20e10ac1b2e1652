"""The server's protocol class for HTTP/1.1: uvicorn's on llhttp, with limits of time, size and connections."""

import asyncio
import sys
from asyncio.transports import Transport
from collections.abc import Callable
from http import HTTPStatus
from typing import Any, cast
from urllib.parse import unquote

import httptools
from uvicorn.protocols.http.httptools_impl import HttpToolsProtocol

from linked_fleet_gateway.base.addresses import network_of
from linked_fleet_gateway.http import message_heads
from linked_fleet_gateway.http.answers import Reply
from linked_fleet_gateway.http.arrival import fields_of
from linked_fleet_gateway.http.connection_limits import (
    BODY_S,
    HEAD_S,
    MAX_HEAD_BYTES,
    STALL_S,
    BoundedWriter,
    Deadline,
    Sockets,
)
from linked_fleet_gateway.http.exchange import Exchange, response_bytes
from linked_fleet_gateway.http.message_heads import TOO_MANY_CONNECTIONS, HeadError, error_response
from linked_fleet_gateway.http.websocket_protocol import FAREWELL_S, WebSocketProtocol

HTTP = "linked-fleet.http"
"""Key in ``scope["extensions"]`` of the protocol that serves an application."""
_MOST_UNREAD = 64
"""Most pieces of ``MAX_HEAD_BYTES`` that may wait for responses to earlier requests."""
_IDLE, _HEAD, _BODY, _WHOLE = "idle", "head", "body", "whole"
"""Progress of the latest request: nothing, a part of its head, its head, all of it."""
ReplyNowait = Callable[[Any], Reply | None]


class HttpProtocol(HttpToolsProtocol):
    """HTTP/1.1 with access for the application, because ASGI can neither abort a connection nor announce a shutdown.

    A client that does not send its request in time is disconnected. Idle connections give their places in ``sockets``
    to others.
    """

    stall_s = STALL_S
    head_s, body_s = HEAD_S, BODY_S
    on_drained: Callable[[], None] | None = None
    """Called when most of the buffered bytes have been sent."""
    on_shutdown: Callable[[], None] | None = None
    stop_on_half_close = False
    """True while a response is not worth completing for a client that has closed its side."""
    is_shutting_down = False
    """True during shutdown: applications that start now have missed the notification."""
    writer: BoundedWriter
    scope: Any  # uvicorn declares the keys of HTTPScope alone

    def __init__(
        self, *arguments: Any, sockets: Sockets | None = None, reply_nowait: ReplyNowait = lambda _: None, **named: Any
    ) -> None:
        """``reply_nowait`` answers what needs no waiting; the ASGI application answers everything else."""
        super().__init__(*arguments, **named)
        self._reply_nowait, self._may_reply_nowait = reply_nowait, False
        self._reply: Reply | None = None
        self._answered = 0
        """Number of requests answered without waiting."""
        self._address = ""
        self._sockets = Sockets(sys.maxsize, sys.maxsize) if sockets is None else sockets
        self._deadline = Deadline(self._give_up, self.loop)
        self._phase = _IDLE
        self._line = message_heads.RequestLineReader()
        self._head_bytes = 0
        self._unread: list[bytes] = []
        """Bytes that arrived before earlier requests were answered."""
        self._refusal: HeadError | None = None
        self._again = False
        """True while a head is parsed again without its ignored Upgrade."""

    def connection_made(self, transport: Transport) -> None:  # type: ignore[override]  # as uvicorn has it
        super().connection_made(transport)
        self.writer = BoundedWriter(transport, self.stall_s)
        self._address = network_of(self.client[0]) if self.client else ""
        if self._sockets.register(self, self._address):
            self._await_request()
        else:
            transport.write(TOO_MANY_CONNECTIONS)
            transport.close()

    def connection_lost(self, exc: Exception | None) -> None:
        super().connection_lost(exc)
        self.writer.stop()
        self._unread.clear()
        self._deadline.close()
        self._sockets.unregister(self)

    def eof_received(self) -> bool | None:  # type: ignore[override]  # as asyncio has it
        """Answer earlier requests after the client has closed its side of the connection. True keeps our side open."""
        # TLS has no such half-close, and a client that closes during a response, such as a stream, has gone.
        waits = self._phase is _WHOLE and self._is_answering() and (self.pipeline or not self.cycle.response_started)
        if self.scheme == "https" or not waits or self.stop_on_half_close:
            return None
        self.cycle.keep_alive = False
        return True

    # -- what comes ---------------------------------------------------------------------------------------------------

    def data_received(self, data: bytes) -> None:
        self._may_reply_nowait = True  # one, or many requests in these bytes would be answered in one turn of the loop
        if self._unread or self.pipeline:
            self._hold(data)
            return
        if len(data) <= MAX_HEAD_BYTES:
            self._feed(data)
        else:
            self._feed_pieces(message_heads.split_pieces(data))
        if self.transport.get_protocol() is self:
            self._await_request()

    def _hold(self, data: bytes) -> None:
        """Keep bytes until earlier requests are answered. An application that awaits a body reads on."""
        self._unread += message_heads.split_pieces(data)
        self.flow.pause_reading()
        if len(self._unread) > _MOST_UNREAD:
            self.transport.abort()

    def _feed_pieces(self, pieces: list[bytes]) -> None:
        """Parse the bytes piece by piece, because larger pieces would bypass the limit of heads."""
        while pieces:
            if self.transport.is_closing():
                return
            protocol = self.transport.get_protocol()
            if protocol is not self:
                cast(WebSocketProtocol, protocol).data_received(b"".join(pieces))
                return
            if self.pipeline:  # a client that pipelines requests waits for the responses
                self._unread = pieces
                self.flow.pause_reading()
                return
            self._feed(pieces.pop(0))

    def _feed(self, data: bytes) -> None:
        if self.transport.is_closing():
            return
        if self._phase in (_IDLE, _WHOLE) and self._head_bytes == 0:
            try:
                data = self._line.read(data)
            except HeadError as error:
                self._refuse(error.status, error.reason)
                return
            if not data:
                return
        if self._phase is not _BODY:
            self._head_bytes += len(data)
        try:
            self.parser.feed_data(data)
        except httptools.HttpParserUpgrade as upgrade:
            if self._should_upgrade():
                self._deadline.close()
                self._sockets.mark_busy(self)
                self.handle_websocket_upgrade()
                return
            self._ignore_upgrade(data[upgrade.args[0] :])
        except httptools.HttpParserError as error:
            found = self._refusal or HeadError(HTTPStatus.BAD_REQUEST, f"The request is not HTTP/1.1: {error}.")
            self._refuse(found.status, found.reason)
            return
        if self._phase in (_IDLE, _HEAD) and self._head_bytes > MAX_HEAD_BYTES:
            self._refuse(HTTPStatus.REQUEST_HEADER_FIELDS_TOO_LARGE, f"A head has at most {MAX_HEAD_BYTES} bytes.")

    def _ignore_upgrade(self, rest: bytes) -> None:
        """Continue as after any other request. The parser skips a body after a head with Upgrade."""
        if self._phase is _BODY:
            framing = [name + b": " + value for name, value in self.headers if name in message_heads.FRAMING]
            self.parser = httptools.HttpRequestParser(self)
            self._again = True
            self.parser.feed_data(b"\r\n".join([b"PUT / HTTP/1.1", *framing, b"", b""]))
            self._again = False
        if rest:
            self._feed(rest)

    # -- what the parser calls ----------------------------------------------------------------------------------------

    def on_message_begin(self) -> None:
        if self._again:
            return
        super().on_message_begin()
        self.scope["extensions"] = {HTTP: self}
        self._phase = _HEAD

    def on_url(self, url: bytes) -> None:
        if not self._again:
            super().on_url(url)

    def on_header(self, name: bytes, value: bytes) -> None:
        if self._phase is _HEAD:  # neither trailers, which nobody asked for, nor a head that is parsed again
            self.headers.append((name.lower(), value))

    def on_headers_complete(self) -> None:
        if self._again:
            return
        self._phase, self._head_bytes = _BODY, 0
        fields = fields_of(self.scope)
        is_framed = b"content-length" in fields or b"transfer-encoding" in fields
        if is_framed:
            try:
                message_heads.check_transfer_coding(self.headers, self.parser.get_http_version())
            except HeadError as error:
                self._refusal = error
                raise  # ends the parser
        self.expect_100_continue = fields.get(b"expect", b"").lower() == b"100-continue"
        # The target as it was sent: it may be * or a whole URL (RFC 9112, 3.2).
        raw_path, _, query = (self._line.target or self.url).partition(b"?")
        path = raw_path.decode("ascii")
        version = self.parser.get_http_version()
        method = self._line.method or self.parser.get_method()
        self._line.clear()
        self.scope["method"], self.scope["http_version"] = method.decode("ascii"), version
        self.scope["path"] = unquote(path) if "%" in path else path
        self.scope["raw_path"], self.scope["query_string"] = raw_path, query
        if self.parser.should_upgrade() and self._should_upgrade():
            return
        waits = self._is_answering()
        has_body = is_framed and message_heads.has_body(self.headers)
        if self._may_reply_nowait and not waits and not self.flow.write_paused and not has_body:
            self._may_reply_nowait = False
            self._reply = self._reply_nowait(self.scope)
            if self._reply is not None:
                return
        self.cycle = Exchange(
            self.writer, scope=self.scope, transport=self.transport, flow=self.flow,
            logger=self.logger, access_logger=self.access_logger, access_log=False,
            default_headers=self.server_state.default_headers, message_event=asyncio.Event(),
            expect_100_continue=self.expect_100_continue,
            keep_alive=version != "1.0" and self.parser.should_keep_alive(),
            on_response=self.on_response_complete,
        )  # fmt: skip
        if waits:
            self.flow.pause_reading()
            self.pipeline.appendleft((self.cycle, self.app))
        else:
            self._start_asgi_task(self.cycle, self.app)

    def on_message_complete(self) -> None:
        if self._reply is not None:
            self._write_reply(self._reply)
            return
        if not self._again and self.parser.should_upgrade() and self._has_body() and not self._should_upgrade():
            return  # the body is still to come
        self._phase = _WHOLE
        super().on_message_complete()

    def _has_body(self) -> bool:
        fields = fields_of(self.scope)
        return (b"content-length" in fields or b"transfer-encoding" in fields) and message_heads.has_body(self.headers)

    # -- what goes ----------------------------------------------------------------------------------------------------

    def _write_reply(self, reply: Reply) -> None:
        self._reply, self._phase = None, _IDLE
        self._answered += 1
        self._sockets.mark_busy(self)
        self.server_state.total_requests += 1
        keep_alive = self.scope["http_version"] != "1.0" and self.parser.should_keep_alive()
        self.writer.write(response_bytes(reply, self.server_state.default_headers, self.scope["method"], keep_alive))
        if not keep_alive:
            self.transport.close()

    def on_response_complete(self) -> None:
        self.server_state.total_requests += 1
        if self.transport.is_closing():
            return
        if self.pipeline:
            cycle, app = self.pipeline.pop()
            self._start_asgi_task(cycle, app)
        if self._unread and not self.pipeline:
            pieces, self._unread = self._unread, []
            self._feed_pieces(pieces)
        if not self._unread and not self.pipeline:
            self.flow.resume_reading()
        if self._phase is _WHOLE and not self._is_answering():
            self._phase = _IDLE
        self._await_request()

    def handle_websocket_upgrade(self) -> None:
        super().handle_websocket_upgrade()
        protocol = cast(WebSocketProtocol, self.transport.get_protocol())
        protocol.on_lost = lambda: self._sockets.unregister(self)

    def _should_upgrade(self) -> bool:
        """Return True if the request opens a WebSocket. Any other Upgrade is ignored (RFC 9110, 7.8)."""
        opens = message_heads.opens_websocket(self.scope["method"], self.scope["http_version"], self.headers)
        return opens and not self._is_answering() and not self._has_body() and super()._should_upgrade()

    def _is_answering(self) -> bool:
        return self.cycle is not None and not self.cycle.response_complete

    # -- bounds -------------------------------------------------------------------------------------------------------

    def _await_request(self) -> None:
        """Set the deadline for the rest of the request, if there is one."""
        said = self._phase is _WHOLE or (self._phase is not _BODY and self._is_answering())
        if said or self.transport.is_closing():
            self._deadline.clear()
            self._sockets.mark_busy(self)
            return
        self._sockets.mark_idle(self, self._give_way)
        # Named by the requests before it, so that the deadline of one request is never that of the next.
        begun = self._phase is _HEAD or self._line.has_partial_line
        in_body = self._phase is _BODY
        self._deadline.set((in_body, begun, self.cycle, self._answered), self.body_s if in_body else self.head_s)

    def _give_way(self) -> bool:
        """Close an idle connection for another client, unless its last response is still being sent."""
        if self.writer.has_unsent_bytes():
            return False
        self.transport.abort()
        return True

    def _give_up(self) -> None:
        if self.writer.has_unsent_bytes():
            self._deadline.extend(self.head_s)
            return
        unsaid = self._phase is _HEAD or self._line.has_partial_line or (self._phase is _BODY and self._is_answering())
        if not unsaid or self.transport.is_closing():
            self.transport.abort()
            return
        self._refuse(HTTPStatus.REQUEST_TIMEOUT, "The request was not whole in time.")
        self.loop.call_later(FAREWELL_S, self.transport.abort)

    def _refuse(self, status: HTTPStatus, text: str) -> None:
        """Answer and close. An earlier request without a response gets none: its handler sees a disconnect."""
        answered = self._phase is _BODY and self.cycle is not None and self.cycle.response_started
        answerable = not answered and (not self._is_answering() or not self.cycle.response_started)
        if self.cycle is not None:
            self.cycle.disconnected = True
            self.cycle.message_event.set()
        if answerable:
            of_head = self._phase is _BODY and self.parser.get_method() == b"HEAD"
            self.transport.write(error_response(status, text, has_content=not of_head))
        self.transport.close()

    def pause_writing(self) -> None:
        super().pause_writing()
        self.writer.watch()

    def resume_writing(self) -> None:
        super().resume_writing()
        if self.on_drained is not None:
            self.on_drained()

    def shutdown(self) -> None:
        super().shutdown()
        self.is_shutting_down = True
        if self.on_shutdown is not None:
            self.on_shutdown()
            self.loop.call_later(FAREWELL_S, self.transport.abort)  # its reader may have stalled
