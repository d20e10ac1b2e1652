"""A connection of a WebSocket (RFC 6455): the handshake, ASGI, pings and the end; frames are those of websockets."""

import asyncio
import logging
import secrets
from collections.abc import Callable
from http import HTTPStatus
from typing import Any

import uvicorn
from starlette.types import Message, Scope
from websockets.datastructures import Headers
from websockets.frames import CloseCode, Frame, Opcode
from websockets.http11 import Request
from websockets.protocol import State
from websockets.server import ServerProtocol

from linked_fleet_server.connection import Connection, ServerState
from linked_fleet_server.message_heads import FIELDS, error_response, field_block, status_line

log = logging.getLogger(__name__)
WEBSOCKET = "linked-fleet.websocket"
"""Key in ``scope["extensions"]`` of the protocol that serves an application."""
GRACE_S = 10.0
"""Time for the rest of a conversation that one side has ended, in seconds."""
CLOSE_S = 0.5  # less than the server waits for its connections at shutdown
"""Time for the last bytes to a client when the server ends or gives it up, in seconds."""
_HANDSHAKE, _OPEN, _ENDED = "handshake", "open", "ended"
"""No response yet; messages in both directions; refused, closing or closed."""
_DATA = (Opcode.TEXT, Opcode.BINARY, Opcode.CONT)


class DisconnectedError(OSError):
    """A message cannot be sent, because the WebSocket has ended."""

    def __init__(self) -> None:
        super().__init__("The WebSocket has ended.")


class WebSocketProtocol(Connection):
    """A WebSocket that sends ready-made frames, and that an inactive peer cannot keep open.

    It accepts messages only after ``accept_messages``. Frames of a server are not masked (RFC 6455, 5.1), so that one
    framed buffer serves every connection. Unfragmented data frames go to the ``writer``, bypassing the state machine of
    websockets, which keeps no state about them. Everything else passes through it, and no frames are sent once the
    closing handshake has begun (5.5.1).
    """

    grace_s = GRACE_S
    on_lost: Callable[[], None] | None = None

    def __init__(self, *, config: uvicorn.Config, server_state: ServerState) -> None:
        super().__init__(server_state)
        self._application: Any = config.loaded_app
        self._ping_s = config.ws_ping_interval
        self._frames = ServerProtocol(state=State.OPEN, max_size=config.ws_max_size)
        self._stage = _HANDSHAKE
        self._events: asyncio.Queue[Message] = asyncio.Queue()
        self._accepted: list[tuple[bytes, bytes]] = []
        """Header fields of the response that accepts the handshake."""
        self._refusal: tuple[int, list[tuple[bytes, bytes]], bytearray] | None = None
        """The response with which the application refuses the handshake, while it is incomplete."""
        self._listening = self._failed = self._lost = False
        self._is_text = False
        self._fragments: list[bytes] = []
        self._ping = b""
        """The payload of the latest ping, until its pong arrives."""
        self._ping_timer: asyncio.TimerHandle | None = None
        self._abort_timer: asyncio.TimerHandle | None = None

    def accept_messages(self, max_bytes: int) -> None:
        """Accept messages of at most ``max_bytes`` from now on, one at a time.

        Nothing more is read until a message is received.
        """
        self._listening = True
        self._frames.max_message_size = max_bytes

    @property
    def is_open(self) -> bool:
        return self._stage is _OPEN and self._frames.state is State.OPEN and not self.transport.is_closing()

    def close(self, code: int, reason: str) -> None:
        """Start the closing handshake (RFC 6455, 7.1.2)."""
        if self.is_open:
            self._frames.send_close(code, reason)
            self._end(code, reason)

    # -- what the transport and the server call -----------------------------------------------------------------------

    def connection_lost(self, exc: Exception | None) -> None:
        super().connection_lost(exc)
        self._stage, self._lost = _ENDED, True
        self._events.put_nowait({"type": "websocket.disconnect", "code": CloseCode.ABNORMAL_CLOSURE})
        for timer in (self._ping_timer, self._abort_timer):
            if timer is not None:
                timer.cancel()
        if self.on_lost is not None:
            self.on_lost()

    def eof_received(self) -> None:
        self._end(CloseCode.ABNORMAL_CLOSURE)

    def shutdown(self) -> None:
        """Close the connection; the client may connect again."""
        self.grace_s = min(self.grace_s, CLOSE_S)
        if self._stage is _HANDSHAKE:
            self._refuse_handshake(HTTPStatus.SERVICE_UNAVAILABLE)
        self.close(CloseCode.SERVICE_RESTART, "the gateway is shutting down")
        self._abort_later()

    def data_received(self, data: bytes) -> None:
        if self._stage is _HANDSHAKE:
            self.transport.abort()  # frames before our response
            return
        if self._failed:
            return
        self._frames.receive_data(data)
        if self._frames.parser_exc is not None:
            self._fail()
            return
        for event in self._frames.events_received():
            self._handle(event)
        self._flush()
        if not self.is_open:
            self.writer.end_stream()

    # -- the handshake ------------------------------------------------------------------------------------------------

    def open(self, scope: Scope) -> None:
        """Have the application answer a handshake, the request with this scope, unless it is invalid."""
        query = scope["query_string"].decode("ascii")
        target = scope["raw_path"].decode("ascii") + (f"?{query}" if query else "")
        fields = Headers((name.decode("latin-1"), value.decode("latin-1")) for name, value in scope["headers"])
        response = self._frames.accept(Request(target, fields))
        if response.status_code != HTTPStatus.SWITCHING_PROTOCOLS:
            self._refuse_handshake(response.status_code, bytes(response.body))
            return
        self._accepted = [
            (name.encode(), value.encode()) for name, value in response.headers.raw_items() if name != "Date"
        ]
        self._events.put_nowait({"type": "websocket.connect"})
        offered = scope[FIELDS].get(b"sec-websocket-protocol", b"").decode("latin-1")
        scope.update(
            type="websocket",
            scheme="wss" if scope["scheme"] == "https" else "ws",
            subprotocols=[each.strip() for each in offered.split(",") if each.strip()],
            extensions={"websocket.http.response": {}, WEBSOCKET: self},
        )
        del scope["method"]
        self.start_task(self._run(scope))

    async def _run(self, scope: Scope) -> None:
        try:
            await self._application(scope, self.receive, self.send)
        except DisconnectedError:
            pass
        except Exception:
            log.exception("The application of a WebSocket has failed.")
        finally:
            if self._stage is _HANDSHAKE:
                self._refuse_handshake(HTTPStatus.INTERNAL_SERVER_ERROR)
            self.close(CloseCode.INTERNAL_ERROR, "the application has ended")

    def _accept(self, fields: list[tuple[bytes, bytes]], subprotocol: str | None) -> None:
        lines = [*self.state.default_headers, *self._accepted, *fields]
        if subprotocol is not None:
            lines.append((b"sec-websocket-protocol", subprotocol.encode("latin-1")))
        self.transport.write(status_line(HTTPStatus.SWITCHING_PROTOCOLS) + field_block(lines) + b"\r\n")
        self._stage = _OPEN
        self._ping_later()

    def _refuse_handshake(self, status: int, content: bytes | None = None) -> None:
        """Refuse with a response in plain text."""
        found = HTTPStatus(status)
        self._leave_handshake(error_response(found, found.phrase if content is None else content.decode()))

    def _refuse_by_application(self) -> None:
        assert self._refusal is not None
        status, fields, content = self._refusal
        lines = [*self.state.default_headers, *fields, (b"connection", b"close")]
        if not any(name.lower() == b"content-length" for name, _ in fields):
            lines.append((b"content-length", b"%d" % len(content)))
        self._leave_handshake(status_line(status) + field_block(lines) + b"\r\n" + content)

    def _leave_handshake(self, response: bytes) -> None:
        if not self.transport.is_closing():
            self.transport.write(response)
        self._failed = True
        self._end(CloseCode.ABNORMAL_CLOSURE)
        self.transport.close()

    # -- what the application calls -----------------------------------------------------------------------------------

    async def receive(self) -> Message:
        """Return the next ASGI message."""
        message = await self._events.get()
        if self._events.empty():
            self.resume_reading()
        return message

    async def send(self, message: Message) -> None:
        """Handle an ASGI message. Raises DisconnectedError, and RuntimeError if it is out of turn."""
        await self.drain()
        kind = message["type"]
        if self._stage is _HANDSHAKE and self._refusal is None:
            self._answer_handshake(kind, message)
        elif kind == "websocket.http.response.body" and self._refusal is not None:
            self._refusal[2].extend(message.get("body", b""))
            if self._stage is _HANDSHAKE and not message.get("more_body", False):
                self._refuse_by_application()
        elif kind == "websocket.close" and self._refusal is None:
            self.close(message.get("code", CloseCode.NORMAL_CLOSURE), message.get("reason") or "")
        elif not self.is_open and self._refusal is None:
            raise DisconnectedError
        elif kind == "websocket.send" and self._refusal is None:
            self._send_data(message)
        else:
            raise RuntimeError(f"The ASGI message {kind!r} is out of turn.")

    def _answer_handshake(self, kind: str, message: Message) -> None:
        if kind == "websocket.accept":
            if self.transport.is_closing():
                raise DisconnectedError
            self._accept(list(message.get("headers", ())), message.get("subprotocol"))
        elif kind == "websocket.http.response.start":
            self._refusal = message["status"], list(message.get("headers", ())), bytearray()
        elif kind == "websocket.close":
            self._refuse_handshake(HTTPStatus.FORBIDDEN, b"")
        else:
            raise RuntimeError(f"The ASGI message {kind!r} is out of turn.")

    def _send_data(self, message: Message) -> None:
        text = message.get("text")
        if text is None:
            self._frames.send_binary(message["bytes"])
        else:
            self._frames.send_text(text.encode())
        self._flush()

    # -- frames -------------------------------------------------------------------------------------------------------

    def _handle(self, event: object) -> None:
        assert isinstance(event, Frame)
        if self._failed:  # by an earlier frame in the same bytes
            return
        if event.opcode in _DATA:
            self._take(event)
        elif event.opcode is Opcode.PONG and event.data == self._ping:
            self._ping = b""
        elif event.opcode is Opcode.CLOSE:
            self._end_by_client()

    def _take(self, event: Frame) -> None:
        """Take a frame of a message of the client. After the end messages are ignored."""
        if self._stage is not _OPEN:
            return
        if event.opcode is not Opcode.CONT:
            self._is_text, self._fragments = event.opcode is Opcode.TEXT, []
        self._fragments.append(bytes(event.data))
        if event.fin or not self._listening:
            self._receive(b"".join(self._fragments), event.fin)

    def _receive(self, content: bytes, whole: bool) -> None:
        """Pass a message on, or fail the connection: its application reads nothing, so it cannot ignore messages."""
        message: Message = {"type": "websocket.receive", "bytes": content}
        if self._is_text and whole:
            try:
                message = {"type": "websocket.receive", "text": content.decode()}
            except UnicodeDecodeError:
                self._fail(CloseCode.INVALID_DATA, "a text message must be UTF-8")
                return
        if not self._listening:
            self._fail(CloseCode.UNSUPPORTED_DATA, "this channel only sends")
            return
        self._fragments = []
        self._events.put_nowait(message)
        self.pause_reading()

    def _flush(self) -> None:
        """Write the frames of websockets: pongs, pings, closes, and messages of ``send``."""
        data = b"".join(self._frames.data_to_send())
        if data and not self._failed and not self.transport.is_closing():
            self.transport.write(data)

    # -- pings --------------------------------------------------------------------------------------------------------

    def _ping_later(self) -> None:
        if self._ping_s:
            self._ping_timer = asyncio.get_running_loop().call_later(self._ping_s, self._check_peer)

    def _check_peer(self) -> None:
        """Send a ping; disconnect a client that has not answered the one before."""
        if not self.is_open:
            return
        if self._ping and not self.writer.has_unsent_bytes():  # otherwise it may be among the unsent bytes
            self._frames.fail(CloseCode.INTERNAL_ERROR, "keepalive ping timeout")
            self._end(CloseCode.ABNORMAL_CLOSURE)
            self.transport.close()
            return
        self._ping = secrets.token_bytes(4)
        self._frames.send_ping(self._ping)
        self._flush()
        self._ping_later()

    # -- the end ------------------------------------------------------------------------------------------------------

    def _end_by_client(self) -> None:
        """Close after the close frame of the client, which websockets answers unless it is the answer to ours."""
        received = self._frames.close_rcvd
        if self._stage is _OPEN and received is not None:
            self._end(received.code, received.reason)
        self.transport.close()
        self._abort_later()  # a closed transport waits for its reader, possibly for ever

    def _fail(self, code: int = CloseCode.PROTOCOL_ERROR, reason: str = "") -> None:
        """Fail the connection (RFC 6455, 7.1.7), if websockets has not done so, and read nothing more."""
        if self._frames.state is State.OPEN:
            self._frames.fail(code, reason)
        self._end(CloseCode.ABNORMAL_CLOSURE)
        self._failed = True
        # Only our side: unread bytes would turn a close into a reset, and our close frame would be lost.
        if self.transport.can_write_eof():
            self.transport.write_eof()

    def _end(self, code: int, reason: str = "") -> None:
        """Send what is left, tell the application, and give the client a while to end its side."""
        self._stage = _ENDED
        self.writer.end_stream()
        self._events.put_nowait({"type": "websocket.disconnect", "code": code, "reason": reason})
        self._flush()
        self.resume_reading()
        self._abort_later()

    def _abort_later(self) -> None:
        if self._abort_timer is not None:
            self._abort_timer.cancel()
        if not self._lost:
            self._abort_timer = asyncio.get_running_loop().call_later(self.grace_s, self.transport.abort)
