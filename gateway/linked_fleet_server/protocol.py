"""A connection of HTTP/1.1 (RFC 9112): its requests in order, with limits of time, size and number of connections."""

import asyncio
import logging
import sys
from asyncio.transports import BaseTransport
from collections import deque
from collections.abc import Callable
from functools import partial
from http import HTTPStatus
from typing import Any
from urllib.parse import unquote

import uvicorn
from starlette.types import Scope

from linked_fleet_server.addresses import network_of
from linked_fleet_server.connection import Connection, ServerState, address
from linked_fleet_server.connection_limits import BODY_S, HEAD_S, MAX_HEAD_BYTES, Deadline, Sockets
from linked_fleet_server.exchange import Exchange, Reply, response_bytes
from linked_fleet_server.message_heads import (
    FIELDS,
    TOO_MANY_CONNECTIONS,
    HeadError,
    error_response,
    split_pieces,
)
from linked_fleet_server.request_reader import RequestReader
from linked_fleet_server.websocket_protocol import CLOSE_S

log = logging.getLogger(__name__)
HTTP = "linked-fleet.http"
"""Key in ``scope["extensions"]`` of the protocol that serves an application."""
_MOST_UNREAD = 64
"""Most pieces of ``MAX_HEAD_BYTES`` that may wait for responses to earlier requests."""
_ASGI = {"version": "3.0", "spec_version": "2.3"}
ReplyNowait = Callable[[Scope], Reply | None]


class HttpProtocol(Connection):
    """HTTP/1.1 with access for the application, because ASGI can neither abort a connection nor announce a shutdown.

    A client that does not send its request in time is disconnected. Idle connections give their places in ``sockets``
    to others.
    """

    head_s, body_s = HEAD_S, BODY_S
    on_shutdown: Callable[[], None] | None = None
    stop_on_half_close = False
    """True while a response is not worth completing for a client that has closed its side."""
    is_shutting_down = False
    """True during shutdown: applications that start now have missed the notification."""

    def __init__(
        self,
        *,
        config: uvicorn.Config,
        server_state: ServerState,
        app_state: object = None,
        _loop: object = None,
        sockets: Sockets | None = None,
        reply_nowait: ReplyNowait = lambda _: None,
    ) -> None:
        """Create a connection for uvicorn, which passes the first four arguments.

        ``reply_nowait`` answers what needs no waiting; the ASGI application answers everything else.
        """
        super().__init__(server_state)
        self._config, self._reply_nowait = config, reply_nowait
        self._may_reply_nowait = False
        self._sockets = Sockets(sys.maxsize, sys.maxsize) if sockets is None else sockets
        self._deadline = Deadline(self._time_out)
        self._reader = RequestReader(self)
        self._scope: Scope = {}
        """The members that the scopes of all requests share."""
        self._requests = 0
        """Number of heads read."""
        self._exchanges: deque[Exchange] = deque()
        """Requests without a complete response. The first is being answered."""
        self._receiving: Exchange | None = None
        """The latest request, whose body is read."""
        self._unread: list[bytes] = []
        """Bytes that arrived before earlier requests were answered."""
        self._upgraded = False
        """True once the connection belongs to a WebSocket."""

    def connection_made(self, transport: BaseTransport) -> None:
        super().connection_made(transport)
        client = address(transport, "peername")
        self._scope = {
            "type": "http", "asgi": _ASGI, "root_path": "",
            "scheme": "https" if transport.get_extra_info("sslcontext") else "http",
            "client": client, "server": address(transport, "sockname"),
        }  # fmt: skip
        if self._sockets.register(self, network_of(client[0]) if client else ""):
            self._await_request()
        else:
            self.transport.write(TOO_MANY_CONNECTIONS)
            self.transport.close()

    def connection_lost(self, exc: Exception | None) -> None:
        super().connection_lost(exc)
        for each in self._exchanges:
            each.disconnect()
        self._exchanges.clear()
        self._unread.clear()
        self._receiving = None
        self._release()
        self._sockets.unregister(self)

    def eof_received(self) -> bool | None:
        """Answer earlier requests after the client has closed its side of the connection. True keeps our side open."""
        # TLS has no such half-close, and a client that closes during a response, such as a stream, has gone.
        if self._scope["scheme"] == "https" or self.stop_on_half_close or not self._exchanges:
            return None
        if self._reads() or (len(self._exchanges) == 1 and self._exchanges[0].response_started):
            return None
        self._exchanges[-1].keep_alive = False
        return True

    def _release(self) -> None:
        """Stop the timer and the parser, which would keep the connection in memory."""
        self._deadline.close()
        self._reader.close()

    # -- what comes ---------------------------------------------------------------------------------------------------

    def data_received(self, data: bytes) -> None:
        self._may_reply_nowait = True  # one, or many requests in these bytes would be answered in one turn of the loop
        if self._unread or self._is_full():
            self._hold(data)
            return
        if len(data) <= MAX_HEAD_BYTES:
            self._feed(data)
        else:
            self._feed_pieces(split_pieces(data))
        self._await_request()

    def _is_full(self) -> bool:
        """Return True if no more requests are read, because one waits for the response to another."""
        return len(self._exchanges) > 1

    def _hold(self, data: bytes) -> None:
        """Keep bytes until earlier requests are answered. An application that awaits a body reads on."""
        self._unread += split_pieces(data)
        self.pause_reading()
        if len(self._unread) > _MOST_UNREAD:
            self.transport.abort()

    def _feed_pieces(self, pieces: list[bytes]) -> None:
        """Parse the bytes piece by piece, because larger pieces would bypass the limit of heads."""
        while pieces:
            if self._upgraded:
                self.transport.abort()  # the client has not waited for the response to the handshake
                return
            if self._is_full():  # a client that pipelines requests waits for the responses
                self._unread = pieces
                self.pause_reading()
                return
            self._feed(pieces.pop(0))

    def _feed(self, data: bytes) -> None:
        if self.transport.is_closing():
            return
        try:
            rest = self._reader.feed(data)
        except HeadError as error:
            self._refuse(error.status, error.reason)
            return
        if rest is not None:
            self._open_websocket(rest)

    # -- what the reader calls ----------------------------------------------------------------------------------------

    def may_upgrade(self) -> bool:
        """Return True if a request could open a WebSocket now."""
        return not self._exchanges and not self.transport.is_closing()

    def on_request(self) -> None:
        """Answer a request, or let it wait for the responses to earlier ones."""
        self._receiving = None
        if self.transport.is_closing():  # an earlier request was the last one (RFC 9112, 9.6)
            return
        self._requests += 1
        scope, reader = self._create_scope(), self._reader
        if self._may_reply_nowait and not (self._exchanges or reader.has_body or self.writing_paused):
            self._may_reply_nowait = False
            if self._answer_nowait(scope):
                return
        expects = reader.version != "1.0" and reader.fields.get(b"expect", b"").lower() == b"100-continue"
        self._receiving = exchange = Exchange(
            self, scope, keep_alive=reader.keep_alive, expects_continue=expects, on_complete=self._on_complete
        )
        self._exchanges.append(exchange)
        if self._is_full():
            self.pause_reading()
        else:
            self._start(exchange)

    def on_content(self, data: bytes) -> None:
        """Pass on a part of the body."""
        if self._receiving is not None:
            self._receiving.feed(data)

    def on_request_end(self) -> None:
        """Tell the application that the body is complete."""
        if self._receiving is not None:
            self._receiving.end_body()

    def _create_scope(self) -> Scope:
        reader = self._reader
        raw_path, _, query = reader.target.partition(b"?")
        path = raw_path.decode("ascii")
        return {
            **self._scope,
            "method": reader.method, "http_version": reader.version,
            "path": unquote(path) if "%" in path else path, "raw_path": raw_path, "query_string": query,
            "headers": reader.headers, FIELDS: reader.fields,
            "state": {}, "extensions": {HTTP: self},
        }  # fmt: skip

    # -- what goes ----------------------------------------------------------------------------------------------------

    def _answer_nowait(self, scope: Scope) -> bool:
        """Write the response if it is ready."""
        try:
            reply = self._reply_nowait(scope)
        except Exception:
            log.exception("A response without waiting has failed. The application answers.")
            return False
        if reply is None:
            return False
        self._sockets.mark_busy(self)
        keep_alive = self._reader.keep_alive
        defaults = self.state.default_headers
        self.writer.write(response_bytes(reply, defaults, scope["method"], keep_alive=keep_alive))
        if not keep_alive:
            self.transport.close()
        return True

    def _start(self, exchange: Exchange) -> None:
        self.start_task(exchange.run(self._config.loaded_app))

    def _on_complete(self) -> None:
        """Go on after a complete response."""
        self._exchanges.popleft()
        if self.transport.is_closing():
            return
        if self._exchanges:
            self._start(self._exchanges[0])
        if self._unread and not self._is_full():
            pieces, self._unread = self._unread, []
            self._feed_pieces(pieces)
        if not self._unread and not self._is_full():
            self.resume_reading()
        self._await_request()

    def _open_websocket(self, rest: bytes) -> None:
        """Give the connection to a WebSocket. A client that sends more before its handshake is answered loses it."""
        if rest:
            self.transport.abort()
            return
        self._upgraded = True
        self._release()
        self.writer.stop()
        self._sockets.mark_busy(self)
        self.state.connections.discard(self)
        create: Any = self._config.ws_protocol_class
        protocol = create(config=self._config, server_state=self.state)
        protocol.on_lost = partial(self._sockets.unregister, self)
        self.transport.set_protocol(protocol)
        protocol.connection_made(self.transport)
        protocol.open(self._create_scope())

    # -- bounds -------------------------------------------------------------------------------------------------------

    def _reads(self) -> bool:
        """Return True if a part of a request has arrived."""
        return self._reader.in_body or self._reader.in_head

    def _await_request(self) -> None:
        """Set the deadline for the rest of the request, if there is one."""
        if self._upgraded or self.transport.is_closing():
            return
        reader = self._reader
        in_body = reader.in_body
        if self._exchanges and not in_body:
            self._deadline.clear()
            self._sockets.mark_busy(self)
            return
        self._sockets.mark_idle(self, self._close_idle)
        # Named by the requests before it, so that the deadline of one request is never that of the next.
        key = (in_body, reader.in_head, self._requests)
        self._deadline.set(key, self.body_s if in_body else self.head_s)

    def _close_idle(self) -> bool:
        """Close an idle connection for another client, unless its last response is still being sent."""
        if self.writer.has_unsent_bytes():
            return False
        self.transport.abort()
        return True

    def _time_out(self) -> None:
        """Disconnect a client that has not sent its request in time, with a response if it has begun one."""
        if self.writer.has_unsent_bytes():
            self._deadline.extend(self.head_s)
            return
        answerable = self._reader.in_head or (self._reader.in_body and self._exchanges)
        if not answerable or self.transport.is_closing():
            self.transport.abort()
            return
        self._refuse(HTTPStatus.REQUEST_TIMEOUT, "The request was not whole in time.")
        asyncio.get_running_loop().call_later(CLOSE_S, self.transport.abort)

    def _refuse(self, status: HTTPStatus, text: str) -> None:
        """Answer and close. An earlier request without a response gets none: its handler sees a disconnect."""
        if self.transport.is_closing():
            return
        in_body = self._reader.in_body
        latest = self._receiving if in_body else None
        begun = next(iter(self._exchanges), latest)
        for each in self._exchanges:
            each.disconnect()
        if begun is None or not begun.response_started:
            self.transport.write(error_response(status, text, not (in_body and self._reader.method == "HEAD")))
        self.transport.close()

    def shutdown(self) -> None:
        """Close the connection after the responses to the requests that have arrived."""
        if self._exchanges:
            self._exchanges[-1].keep_alive = False
        else:
            self.transport.close()
        self.is_shutting_down = True
        if self.on_shutdown is not None:
            self.on_shutdown()
            asyncio.get_running_loop().call_later(CLOSE_S, self.transport.abort)  # its reader may have stalled
