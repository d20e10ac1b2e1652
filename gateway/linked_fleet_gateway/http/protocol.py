"""The server's protocol class for HTTP: uvicorn's, with bounds of time and of connections."""

import sys
from asyncio.transports import Transport
from collections.abc import Callable
from http import HTTPStatus
from typing import Any, cast

import h11
from uvicorn.protocols.http.h11_impl import H11Protocol

from linked_fleet_gateway.base.addresses import network_of
from linked_fleet_gateway.http.backpressure import STALL_S, Reader
from linked_fleet_gateway.http.framing import RefusedRequest, ServerConnection
from linked_fleet_gateway.http.sockets import Sockets
from linked_fleet_gateway.http.timeouts import BODY_S, HEAD_S, MAX_HEAD_BYTES, Deadline
from linked_fleet_gateway.http.websocket_protocol import FAREWELL_S, WebSocketProtocol

HTTP = "linked-fleet.http"
"""Where in ``scope["extensions"]`` an application finds the protocol that serves it."""
_FULL = b"HTTP/1.1 503 Service Unavailable\r\nretry-after: 1\r\ncontent-length: 0\r\nconnection: close\r\n\r\n"


class HttpProtocol(H11Protocol):
    """HTTP/1.1 that an application can get hold of: ASGI alone neither aborts a connection nor tells of a shutdown.

    Who does not say in time what it wants is cut off, and of ``sockets`` takes a place that others can have.
    """

    stall_s = STALL_S
    head_s, body_s = HEAD_S, BODY_S
    on_drained: Callable[[], None] | None = None
    """Called when what waited has nearly all been taken."""
    on_shutdown: Callable[[], None] | None = None
    ending = False
    """Whether the server shuts down: what begins now has not been told."""
    reader: Reader

    def __init__(self, *arguments: Any, sockets: Sockets | None = None, **named: Any) -> None:
        super().__init__(*arguments, **named)
        self.conn: ServerConnection = ServerConnection(h11.SERVER, MAX_HEAD_BYTES)
        self._address = ""
        self._sockets = Sockets(sys.maxsize, sys.maxsize) if sockets is None else sockets
        self._deadline = Deadline(self._give_up)
        self._begun = False

    def connection_made(self, transport: Transport) -> None:  # type: ignore[override]  # as uvicorn has it
        super().connection_made(transport)
        self.reader = Reader(transport, self.stall_s)
        self._address = network_of(self.client[0]) if self.client else ""
        if self._sockets.open(self, self._address):
            self._await_request()
        else:
            transport.write(_FULL)
            transport.close()

    def connection_lost(self, exc: Exception | None) -> None:
        super().connection_lost(exc)
        self.reader.stop()
        self._deadline.clear()
        self._sockets.close(self)

    def data_received(self, data: bytes) -> None:
        for first in range(0, len(data), MAX_HEAD_BYTES):  # more at once would be taken however long it is
            protocol = self.transport.get_protocol()
            if self.transport.is_closing():
                return
            if protocol is not self:
                cast(WebSocketProtocol, protocol).data_received(data[first:])
                return
            super().data_received(data[first : first + MAX_HEAD_BYTES])
        self._begun = self.conn.their_state is h11.IDLE
        self._await_request()

    def timeout_keep_alive_handler(self) -> None:
        if self.reader.is_behind():  # on a slow line
            again = self.timeout_keep_alive_handler
            self.timeout_keep_alive_task = self.loop.call_later(self.timeout_keep_alive, again)
        else:
            super().timeout_keep_alive_handler()

    def on_response_complete(self) -> None:
        super().on_response_complete()
        self._begun = False
        self._await_request()

    def handle_websocket_upgrade(self, event: h11.Request) -> None:
        super().handle_websocket_upgrade(event)
        protocol = cast(WebSocketProtocol, self.transport.get_protocol())
        protocol.on_lost = lambda: self._sockets.close(self)

    def send_400_response(self, msg: str) -> None:
        """Called while the error is handled, which may know better than 400."""
        error = sys.exc_info()[1]
        status = error.error_status_hint if isinstance(error, h11.RemoteProtocolError) else 400
        self._refuse(HTTPStatus(status), str(error) if isinstance(error, RefusedRequest) else msg)

    def _await_request(self) -> None:
        """Bound the time for what the client has still to say, if it has."""
        state = self.conn.their_state
        switched = self.transport.get_protocol() is not self  # a WebSocket now, of which h11 expects a body still
        if switched or self.transport.is_closing() or state not in (h11.IDLE, h11.SEND_BODY):
            self._deadline.clear()
            self._sockets.busy(self)
            return
        self._sockets.idle(self, self._give_way)
        # By the request before it: that of one is never that of the next.
        what = (state, self._begun, id(self.cycle))
        self._deadline.set(what, self.head_s if state is h11.IDLE else self.body_s)

    def _give_way(self) -> bool:
        """End for another, unless the last answer is still on its way."""
        if self.reader.is_behind():
            return False
        self.transport.abort()
        return True

    def _give_up(self) -> None:
        if self.reader.is_behind():
            self._deadline.again(self.head_s)
            return
        unsaid = self.conn.our_state is h11.SEND_RESPONSE or (self.conn.our_state is h11.IDLE and self._begun)
        if not unsaid or self.transport.is_closing():
            self.transport.abort()
            return
        self._refuse(HTTPStatus.REQUEST_TIMEOUT, "The request was not whole in time.")
        self.loop.call_later(FAREWELL_S, self.transport.abort)

    def _refuse(self, status: HTTPStatus, text: str) -> None:
        """Of what was asked before it too, if that has no answer yet: whoever is at that hears that nobody waits."""
        answerable = self.conn.our_state in (h11.IDLE, h11.SEND_RESPONSE)
        if self.cycle is not None:
            self.cycle.disconnected = True
            self.cycle.message_event.set()
        if not answerable:
            self.transport.close()
            return
        head = self.conn.our_state is h11.SEND_RESPONSE and self.conn.method == b"HEAD"
        headers = [(b"content-type", b"text/plain; charset=utf-8"), (b"connection", b"close")]
        answer = h11.Response(status_code=status, headers=headers, reason=status.phrase.encode())
        for event in (answer, *([] if head else [h11.Data(data=text.encode())]), h11.EndOfMessage()):
            self.transport.write(self.conn.send(event) or b"")
        self.transport.close()

    def handle_events(self) -> None:
        super().handle_events()
        if self.scope is not None:  # the task of a new request has not run yet
            cast(dict[str, Any], self.scope).setdefault("extensions", {})[HTTP] = self

    def _should_upgrade(self) -> bool:
        """RFC 6455, 4.1. Any other Upgrade is ignored (RFC 9110, 7.8); some uvicorn would never answer."""
        fields = dict(self.headers)
        content = b"transfer-encoding" in fields or fields.get(b"content-length", b"").strip(b"0")
        opening = self.scope["method"] == "GET" and self.scope["http_version"] == "1.1" and not content
        return opening and b"sec-websocket-key" in fields and super()._should_upgrade()

    def pause_writing(self) -> None:
        super().pause_writing()
        self.reader.watch()

    def resume_writing(self) -> None:
        super().resume_writing()
        if self.on_drained is not None:
            self.on_drained()

    def shutdown(self) -> None:
        super().shutdown()
        self.ending = True
        if self.on_shutdown is not None:
            self.on_shutdown()
            self.loop.call_later(FAREWELL_S, self.transport.abort)  # its reader may have stalled
