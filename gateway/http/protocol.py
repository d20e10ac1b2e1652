"""The server's two protocol classes: as uvicorn has them, and what a channel to a slow reader needs besides."""

import math
import sys
from asyncio.transports import BaseTransport, Transport
from collections.abc import Callable
from http import HTTPStatus
from typing import Any, cast

import h11
from uvicorn.protocols.http.h11_impl import H11Protocol
from uvicorn.protocols.websockets.websockets_sansio_impl import WebSocketsSansIOProtocol
from websockets.frames import CloseCode, Frame
from websockets.http11 import Request
from websockets.protocol import State

from gateway.http.patience import BODY_S, HEAD_S, MAX_HEAD_BYTES, Deadline
from gateway.http.rates import network_of
from gateway.http.repeats import Repeat, Repeats, repeatable
from gateway.http.slow import STALL_S, Reader
from gateway.http.sockets import Sockets
from gateway.http.tls import unsent
from gateway.subscriptions.message import Ending

HTTP, WEBSOCKET = "linked-fleet.http", "linked-fleet.websocket"
"""Where in ``scope["extensions"]`` an application finds the protocol that serves it."""

_UNREADABLE = (
    b"HTTP/1.1 400 Bad Request\r\nContent-Type: text/plain; charset=utf-8\r\nContent-Length: 30\r\n"
    b"Connection: close\r\n\r\nInvalid HTTP request received."
)

GRACE_S = 10.0
"""For the rest of a conversation that one side has ended."""
_FAREWELL_S = 0.5  # less than the server waits for its connections when it shuts down
_FULL = b"HTTP/1.1 503 Service Unavailable\r\nretry-after: 1\r\ncontent-length: 0\r\nconnection: close\r\n\r\n"


class HttpProtocol(H11Protocol):
    """HTTP/1.1 that an application can get hold of: ASGI alone neither aborts a connection nor tells of a shutdown.

    Who does not say in time what it wants is cut off, and of ``sockets`` takes a place that others can have. What is
    known of ``repeats`` is answered at once.
    """

    stall_s = STALL_S
    head_s, body_s = HEAD_S, BODY_S
    on_drained: Callable[[], None] | None = None
    """Called when what waited has nearly all been taken."""
    on_shutdown: Callable[[], None] | None = None
    ending = False
    """Whether the server shuts down: what begins now has not been told."""
    reader: Reader

    def __init__(
        self, *arguments: Any, sockets: Sockets | None = None, repeats: Repeats | None = None, **named: Any
    ) -> None:
        super().__init__(*arguments, **named)
        self._repeats = repeats
        self._said: bytes | None = None
        self._repeated_s = -math.inf
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
        self._said = data if repeatable(data) and self._is_free() else None
        if self._said is not None and self._repeat(self._said):
            return
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

    def _is_free(self) -> bool:
        """Whether nothing is under way or waits, so that what comes now is the beginning of a request."""
        between = self.conn.our_state is h11.IDLE and self.conn.their_state is h11.IDLE
        return between and not (self.ending or self.flow.write_paused or self.conn.trailing_data[0])

    def _repeat(self, said: bytes) -> bool:
        """Answer what was answered before, past the state machine, which has then seen neither."""
        if self._repeats is None or self.transport.is_closing():
            return False
        answer = self._repeats.answer(said, self._address, self.server_state.default_headers)
        if answer is None:
            return False
        self.transport.write(answer)
        self.server_state.total_requests += 1
        self._repeated_s = self.loop.time()
        self._sockets.busy(self)
        self._sockets.idle(self, self.transport.abort)
        return True

    def remember(self, repeat: Repeat) -> None:
        """Keep what is being answered, if the client has said nothing but this one request."""
        whole = self.conn.their_state is h11.DONE and not self.conn.trailing_data[0]
        if self._repeats is not None and self._said is not None and whole:
            self._repeats.keep(self._said, repeat)

    def timeout_keep_alive_handler(self) -> None:
        left_s = self._repeated_s + self.timeout_keep_alive - self.loop.time()
        if left_s > 0:
            self.timeout_keep_alive_task = self.loop.call_later(left_s, self.timeout_keep_alive_handler)
        else:
            super().timeout_keep_alive_handler()

    def on_response_complete(self) -> None:
        self._said = None  # of the next request that has been sent already
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
        self._refuse(HTTPStatus(status), msg)

    def _await_request(self) -> None:
        """Bound the time for what the client has still to say, if it has."""
        state = self.conn.their_state
        switched = self.transport.get_protocol() is not self  # a WebSocket now, of which h11 expects a body still
        if switched or self.transport.is_closing() or state not in (h11.IDLE, h11.SEND_BODY):
            self._deadline.clear()
            self._sockets.busy(self)
            return
        self._sockets.idle(self, self.transport.abort)
        # By the request before it: that of one is never that of the next.
        what = (state, self._begun, id(self.cycle))
        self._deadline.set(what, self.head_s if state is h11.IDLE else self.body_s)

    def _give_up(self) -> None:
        left_s = self._repeated_s + self.head_s - self.loop.time()
        if left_s > 0 and self._is_free():
            self._deadline.again(left_s)
            return
        unsaid = self.conn.our_state is h11.SEND_RESPONSE or (self.conn.our_state is h11.IDLE and self._begun)
        if not unsaid or self.transport.is_closing():
            self.transport.abort()
            return
        self._refuse(HTTPStatus.REQUEST_TIMEOUT, "The request was not whole in time.")
        self.loop.call_later(_FAREWELL_S, self.transport.abort)

    def _refuse(self, status: HTTPStatus, text: str) -> None:
        """Of what was asked before it too, if that has no answer yet: whoever is at that hears that nobody waits."""
        answerable = self.conn.our_state in (h11.IDLE, h11.SEND_RESPONSE)
        if self.cycle is not None:
            self.cycle.disconnected = True
            self.cycle.message_event.set()
        if not answerable:
            self.transport.close()
            return
        head = self.conn.our_state is h11.SEND_RESPONSE and self.scope["method"] == "HEAD"
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
            self.loop.call_later(_FAREWELL_S, self.transport.abort)  # its reader may have stalled


class WebSocketProtocol(WebSocketsSansIOProtocol):
    """A WebSocket that only sends, in frames made elsewhere, and that no peer can keep open by doing nothing.

    Frames of a server are not masked (RFC 6455, 5.1), so one framed buffer serves every connection. They go to the
    ``reader``, past the state machine of ``conn``, which has nothing to remember about an unfragmented data frame. All
    else goes through it, and when the closing handshake begins no more frames do go (5.5.1).
    """

    stall_s = STALL_S
    grace_s = GRACE_S
    on_drained: Callable[[], None] | None = None
    """Called when what waited has nearly all been taken."""
    on_lost: Callable[[], None] | None = None
    reader: Reader
    _failed = False

    @property
    def open(self) -> bool:
        return self.conn.state is State.OPEN and not self.transport.is_closing()

    def close(self, code: int, reason: str) -> None:
        """Start the closing handshake (RFC 6455, 7.1.2)."""
        if self.open:
            self.conn.send_close(code, reason)
            self._leave(code, reason)

    def abort(self) -> None:
        self.transport.abort()

    # What uvicorn calls

    async def send(self, message: Any) -> None:
        over = message["type"] == "websocket.http.response.body" and self.conn.eof_sent
        if not over:  # by what came after the opening, before that was answered
            await super().send(message)
        if message["type"] == "websocket.http.response.body" and not message.get("more_body", False):
            self.handshake_complete = True  # refused, but answered: uvicorn would log an error

    def connection_made(self, transport: BaseTransport) -> None:
        super().connection_made(transport)
        self.reader = Reader(self.transport, self.stall_s)

    def connection_lost(self, exc: Exception | None) -> None:
        super().connection_lost(exc)
        self.reader.stop()
        if self.on_lost is not None:
            self.on_lost()

    def handle_connect(self, event: Request) -> None:
        super().handle_connect(event)
        if not self.close_sent:  # the task has not run yet
            cast(dict[str, Any], self.scope)["extensions"][WEBSOCKET] = self

    def resume_writing(self) -> None:
        super().resume_writing()
        if self.on_drained is not None:
            self.on_drained()

    def data_received(self, data: bytes) -> None:
        self.conn.receive_data(data)
        unread = self.conn.handshake_exc is not None and not self.handshake_initiated
        if self.conn.parser_exc is not None or unread:
            self.handle_parser_exception()
        else:
            self.handle_events()
        if not self.open:
            self.reader.finish()

    def handle_text(self, event: Frame) -> None:
        try:
            bytes(event.data).decode() if event.fin else ""
        except UnicodeDecodeError:
            self._refuse(CloseCode.INVALID_DATA, "a text message must be UTF-8")
        else:
            self._refuse(CloseCode.UNSUPPORTED_DATA, "this channel only sends")

    def handle_bytes(self, event: Frame) -> None:
        self._refuse(CloseCode.UNSUPPORTED_DATA, "this channel only sends")

    def handle_cont(self, event: Frame) -> None:
        """Of a message that was refused with its first frame."""

    def handle_ping(self) -> None:
        if not self._failed:  # by a frame before it, in the same piece: nothing more can be written
            super().handle_ping()

    def handle_close(self, event: Frame) -> None:
        super().handle_close(event)
        self._abort_later()  # a transport that is closed waits for its reader, for ever if need be

    def handle_parser_exception(self) -> None:
        """Fail the connection (RFC 6455, 7.1.7); called again for each piece of what the peer still sends."""
        if self._failed:
            return
        self._failed = True
        if not self.handshake_complete and self.handshake_initiated:
            self.transport.abort()  # frames before our answer to the handshake
            return
        self.handshake_complete = True
        self._leave(CloseCode.ABNORMAL_CLOSURE, "")
        # Only our half: unread bytes would make a reset of a close, and our close frame be lost with it.
        if self.transport.can_write_eof():
            self.transport.write_eof()

    def eof_received(self) -> None:
        self.queue.put_nowait({"type": "websocket.disconnect", "code": CloseCode.ABNORMAL_CLOSURE})
        self._abort_later()

    def keepalive_timeout(self) -> None:
        if unsent(self.transport):  # the ping may wait among the rest: whether the peer still reads, the watch will see
            self.stop_keepalive()
            self.reader.watch()
            self.schedule_ping()
            return
        self.reader.finish()
        super().keepalive_timeout()
        self._abort_later()

    def shutdown(self) -> None:
        if not self.handshake_complete:
            super().shutdown()
            return
        self.grace_s = min(self.grace_s, _FAREWELL_S)
        self.close(CloseCode.SERVICE_RESTART, Ending.SHUTDOWN.value)
        self._abort_later()

    def _refuse(self, code: int, reason: str) -> None:
        """At once and here: while messages lie unread uvicorn reads nothing, so pings would go unanswered."""
        if self.conn.state is State.OPEN:
            self.conn.fail(code, reason)
        self.handle_parser_exception()

    def _leave(self, code: int, reason: str) -> None:
        self.reader.finish()
        self.queue.put_nowait({"type": "websocket.disconnect", "code": code, "reason": reason})
        self.stop_keepalive()
        unread = self.conn.handshake_exc is not None and not self.handshake_initiated
        # Some openings that cannot be read are answered by the parser, with 431, the others by nobody.
        self.transport.write(b"".join(self.conn.data_to_send()) or (_UNREADABLE if unread else b""))
        self.close_sent = True
        self._abort_later()

    def _abort_later(self) -> None:
        if self.close_timer is not None:
            self.close_timer.cancel()
        if not self.disconnected:
            self.close_timer = self.loop.call_later(self.grace_s, self.transport.abort)
