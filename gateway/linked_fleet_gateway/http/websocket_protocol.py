"""The server's protocol class for WebSockets: uvicorn's, with support for slow readers."""

from asyncio.transports import BaseTransport
from collections.abc import Callable
from typing import Any, cast

from uvicorn.protocols.websockets.websockets_sansio_impl import WebSocketsSansIOProtocol
from websockets.frames import CloseCode, Frame
from websockets.http11 import Request
from websockets.protocol import State

from linked_fleet_gateway.http.connection_limits import STALL_S, BoundedWriter
from linked_fleet_gateway.subscriptions.broadcast import Ending

WEBSOCKET = "linked-fleet.websocket"
"""Key in ``scope["extensions"]`` of the protocol that serves an application."""
GRACE_S = 10.0
"""Time for the rest of a conversation that one side has ended, in seconds."""
FAREWELL_S = 0.5  # less than the server waits for its connections at shutdown
_NO_TEXT = "a text message must be UTF-8"
_UNREADABLE = (
    b"HTTP/1.1 400 Bad Request\r\nContent-Type: text/plain; charset=utf-8\r\nContent-Length: 30\r\n"
    b"Connection: close\r\n\r\nInvalid HTTP request received."
)


class WebSocketProtocol(WebSocketsSansIOProtocol):
    """A WebSocket that sends ready-made frames, and that an inactive peer cannot keep open.

    It accepts messages only after ``accept_messages``. Frames of a server are not masked (RFC 6455, 5.1), so that one
    framed buffer serves every connection. Unfragmented data frames go to the ``writer``, bypassing the state machine of
    ``conn``, which keeps no state about them. Everything else passes through it, and no frames are sent once the
    closing handshake has begun (5.5.1).
    """

    stall_s = STALL_S
    grace_s = GRACE_S
    on_drained: Callable[[], None] | None = None
    """Called when most of the buffered bytes have been sent."""
    on_lost: Callable[[], None] | None = None
    writer: BoundedWriter
    _failed = False
    _listening = False

    def accept_messages(self, max_bytes: int) -> None:
        """Accept messages of at most ``max_bytes`` from now on, one at a time.

        Nothing more is read until a message is received.
        """
        self._listening = True
        self.conn.max_message_size = max_bytes

    @property
    def is_open(self) -> bool:
        return self.conn.state is State.OPEN and not self.transport.is_closing()

    def close(self, code: int, reason: str) -> None:
        """Start the closing handshake (RFC 6455, 7.1.2)."""
        if self.is_open:
            self.conn.send_close(code, reason)
            self._leave(code, reason)

    def abort(self) -> None:
        self.transport.abort()

    # What uvicorn calls

    async def send(self, message: Any) -> None:
        over = message["type"] == "websocket.http.response.body" and self.conn.eof_sent
        if not over:  # ended by data after the handshake request, before that was answered
            await super().send(message)
        if message["type"] == "websocket.http.response.body" and not message.get("more_body", False):
            self.handshake_complete = True  # refused, but answered: uvicorn would log an error

    def connection_made(self, transport: BaseTransport) -> None:
        super().connection_made(transport)
        self.writer = BoundedWriter(self.transport, self.stall_s)

    def connection_lost(self, exc: Exception | None) -> None:
        super().connection_lost(exc)
        self.writer.stop()
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
        if not self.is_open:
            self.writer.end_stream()

    def handle_text(self, event: Frame) -> None:
        if self._listening:
            super().handle_text(event)
            return
        try:
            bytes(event.data).decode() if event.fin else ""
        except UnicodeDecodeError:
            self._refuse(CloseCode.INVALID_DATA, _NO_TEXT)
        else:
            self._refuse(CloseCode.UNSUPPORTED_DATA, "this channel only sends")

    def handle_bytes(self, event: Frame) -> None:
        if self._listening:
            super().handle_bytes(event)
        else:
            self._refuse(CloseCode.UNSUPPORTED_DATA, "this channel only sends")

    def handle_cont(self, event: Frame) -> None:
        """Handle a continuation frame; ignore it if the message was refused with its first frame."""
        if self._listening and not self._failed:
            super().handle_cont(event)

    def send_receive_event_to_app(self) -> None:
        try:
            b"".join(self.frames).decode() if self.curr_msg_data_type == "text" else ""
        except UnicodeDecodeError:
            self._refuse(CloseCode.INVALID_DATA, _NO_TEXT)
        else:
            super().send_receive_event_to_app()

    def handle_ping(self) -> None:
        if not self._failed:  # failed by an earlier frame in the same data: nothing more can be written
            super().handle_ping()

    def handle_close(self, event: Frame) -> None:
        super().handle_close(event)
        self._abort_later()  # a closed transport waits for its reader, possibly for ever

    def handle_parser_exception(self) -> None:
        """Fail the connection (RFC 6455, 7.1.7); called again for further data of the peer."""
        if self._failed:
            return
        self._failed = True
        if not self.handshake_complete and self.handshake_initiated:
            self.transport.abort()  # frames before our handshake response
            return
        self.handshake_complete = True
        self._leave(CloseCode.ABNORMAL_CLOSURE, "")
        # Only our side: unread bytes would turn a close into a reset, and our close frame would be lost.
        if self.transport.can_write_eof():
            self.transport.write_eof()

    def eof_received(self) -> None:
        self.queue.put_nowait({"type": "websocket.disconnect", "code": CloseCode.ABNORMAL_CLOSURE})
        self._abort_later()

    def keepalive_timeout(self) -> None:
        if self.writer.has_unsent_bytes():  # the ping may be among the buffered bytes
            self.stop_keepalive()
            self.schedule_ping()
            return
        self.writer.end_stream()
        super().keepalive_timeout()
        self._abort_later()

    def shutdown(self) -> None:
        if not self.handshake_complete:
            super().shutdown()
            return
        self.grace_s = min(self.grace_s, FAREWELL_S)
        self.close(CloseCode.SERVICE_RESTART, Ending.SHUTDOWN.value)
        self._abort_later()

    def _refuse(self, code: int, reason: str) -> None:
        """Fail at once: uvicorn reads nothing while messages are unread, so pings would not be answered."""
        if self.conn.state is State.OPEN:
            self.conn.fail(code, reason)
        self.handle_parser_exception()

    def _leave(self, code: int, reason: str) -> None:
        self.writer.end_stream()
        self.queue.put_nowait({"type": "websocket.disconnect", "code": code, "reason": reason})
        self.stop_keepalive()
        unread = self.conn.handshake_exc is not None and not self.handshake_initiated
        # The parser answers some unreadable handshakes with 431, and others not at all.
        self.transport.write(b"".join(self.conn.data_to_send()) or (_UNREADABLE if unread else b""))
        self.close_sent = True
        self._abort_later()

    def _abort_later(self) -> None:
        if self.close_timer is not None:
            self.close_timer.cancel()
        if not self.disconnected:
            self.close_timer = self.loop.call_later(self.grace_s, self.transport.abort)
