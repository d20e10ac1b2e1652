"""WebSockets (RFC 6455): subscriptions (paper R0.15), and subprotocols of extensions in both directions.

Frames of a subscription go directly to each subscriber's transport. Subprotocols (``Mount.websocket_handlers``) have
the limits of every WebSocket: ``try_send`` drops messages to a slow reader, a client that reads nothing or answers
no ping is disconnected, and while messages of a client wait nothing more is read from it.
"""

import asyncio
import struct
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import AbstractAsyncContextManager, AbstractContextManager, asynccontextmanager, nullcontext
from dataclasses import dataclass
from typing import Any

from websockets.frames import CloseCode, Opcode

from linked_fleet_base.errors import NotAcceptable
from linked_fleet_gateway.http.request import WebSocket
from linked_fleet_gateway.resources.paths import robot_of
from linked_fleet_gateway.resources.resource import Resource
from linked_fleet_gateway.subscriptions.broadcast import Ending, Feed, Message, Outlet
from linked_fleet_identity.service import Identities
from linked_fleet_rdf.serialise import TEXT_TYPES
from linked_fleet_server.websocket_protocol import WEBSOCKET, WebSocketProtocol


def is_binary(media_type: str) -> bool:
    """Return True if messages in this media type are not text."""
    return media_type not in TEXT_TYPES and not media_type.startswith("text/") and not media_type.endswith("json")


# RFC 6455, 7.4: 1008 is policy, 1012 invites to reconnect, 4000 to 4999 are for private use.
_CODES = {
    Ending.CANCELLED: 1000,
    Ending.FINAL: 1000,
    Ending.UNENTITLED: 1008,
    Ending.GONE: 4404,
    Ending.REPLACED: 4409,
    Ending.SHUTDOWN: 1012,
}

MAX_REASON_BYTES = 123
"""The longest reason of a close frame (RFC 6455, 5.5)."""
_FIN = 0x80
_MEDIUM, _LONG = struct.Struct("!BBH"), struct.Struct("!BBQ")


def frame_bytes(message: Message) -> bytes:
    """Return the message as one frame; Turtle and similar types are text."""
    return frame(Opcode.BINARY if is_binary(message.media_type) else Opcode.TEXT, message.body)


def frame(opcode: Opcode, body: bytes) -> bytes:
    """Return one unmasked frame with a whole message (RFC 6455, 5.2)."""
    first, size = _FIN | opcode, len(body)
    if size < 126:
        return b"%c%c%b" % (first, size, body)
    if size < 1 << 16:
        return _MEDIUM.pack(first, 126, size) + body
    return _LONG.pack(first, 127, size) + body


class WebSocketOutlet:
    """The end of a channel at one connection."""

    def __init__(self, protocol: WebSocketProtocol) -> None:
        self._protocol = protocol
        self.framing = frame_bytes
        self.send, self.writable = protocol.writer.send, protocol.writer.writable

    def write(self, message: Message) -> None:
        self.send(message.frame_with(frame_bytes))

    def end(self, ending: Ending) -> None:
        self._protocol.close(_CODES[ending], ending.value)


async def serve_websocket(
    websocket: WebSocket,
    subprotocol: str | None,
    headers: list[tuple[bytes, bytes]],
    start: Callable[[Outlet], Awaitable[Feed]],
) -> None:
    """Open the connection and feed it until either side closes it; the caller cleans up."""
    protocol: WebSocketProtocol = websocket.scope["extensions"][WEBSOCKET]
    try:
        await websocket.accept(subprotocol, headers)
    except OSError:  # already closed
        return
    try:
        feed = await start(WebSocketOutlet(protocol))
        protocol.on_drained = feed.schedule_send
        if protocol.is_open:
            protocol.writer.begin_stream()
        feed.schedule_send()
        while (await websocket.receive())["type"] != "websocket.disconnect":
            pass
    finally:
        protocol.on_drained = None
        protocol.close(CloseCode.INTERNAL_ERROR, "the gateway failed")  # unless it is closing already, as expected


class ConnectionEnded(Exception):  # noqa: N818 - not an error
    """The connection has ended."""


class SubprotocolConnection:
    """An open WebSocket, for the code that serves it."""

    def __init__(self, websocket: WebSocket, protocol: WebSocketProtocol, subprotocol: str) -> None:
        self.websocket, self.subprotocol = websocket, subprotocol
        self._protocol = protocol
        self._room = asyncio.Event()
        self._lost = protocol.on_lost
        protocol.on_drained, protocol.on_lost = self._room.set, self._wake

    @property
    def writable(self) -> bool:
        """True if a message could be sent without much waiting."""
        return self._protocol.writer.writable()

    def try_send(self, frames: bytes) -> bool:
        """Send complete frames, created by ``frame``, if the connection is ``writable``.

        Return True if they were sent.
        """
        return self._protocol.writer.send(frames)

    async def send(self, message: str | bytes) -> None:
        """Send a message that must not be dropped, once the connection is ``writable``. Raises ConnectionEnded."""
        framed = frame(Opcode.TEXT, message.encode()) if isinstance(message, str) else frame(Opcode.BINARY, message)
        while not self.try_send(framed):
            if not self._protocol.is_open:
                raise ConnectionEnded
            self._room.clear()
            await self._room.wait()

    async def receive(self) -> str | bytes:
        """Return the next message, after giving other tasks a turn. Raises ConnectionEnded."""
        await asyncio.sleep(0)  # many messages may be available already
        event = await self.websocket.receive()
        if event["type"] == "websocket.disconnect":
            raise ConnectionEnded
        text: str | None = event.get("text")
        return event["bytes"] if text is None else text

    def close(self, ending: Ending) -> None:
        """Close the connection because its client has lost the right to it."""
        self._protocol.close(CloseCode.POLICY_VIOLATION, ending.value)
        self._room.set()

    def close_with(self, code: int, reason: str) -> None:
        """Close the connection with a code of RFC 6455, 7.4, and a sentence, of which 123 bytes are sent."""
        self._protocol.close(code, reason.encode()[:MAX_REASON_BYTES].decode(errors="ignore"))
        self._room.set()

    def end(self) -> None:
        """Close the connection if it is open, and wake tasks that wait for room."""
        self._protocol.close(CloseCode.INTERNAL_ERROR, "the gateway failed")
        self._protocol.on_drained, self._protocol.on_lost = None, self._lost
        self._room.set()

    def _wake(self) -> None:
        self._room.set()
        if self._lost is not None:
            self._lost()


@dataclass(frozen=True)
class WebSocketHandler:
    """Serves WebSockets in ``subprotocols``.

    ``handle`` also gets the ``remote`` or ``affords`` of the resource, and returns, or raises ConnectionEnded, when the
    connection has ended. ``max_message_bytes`` is the longest message of a client. ``serves`` says if it is for this
    one of the resources whose ``remote`` or ``affords`` have the type. ``open`` is entered before the handshake, and
    left after the connection; the errors that it raises are answered by HTTP, and ``handle`` gets what it yields. It
    reports the request.
    """

    subprotocols: tuple[str, ...]
    handle: Callable[[SubprotocolConnection, Any], Awaitable[None]]
    max_message_bytes: int = 64 * 1024
    serves: Callable[[Any], bool] = lambda value: True
    open: Callable[[WebSocket, Any], AbstractAsyncContextManager[Any]] | None = None


async def serve_subprotocol(websocket: WebSocket, resource: Resource, handler: WebSocketHandler, value: object) -> None:
    """Serve a WebSocket at the resource, including the handshake. Raises NotAcceptable before it."""
    named = [each for each in websocket.scope["subprotocols"] if each in handler.subprotocols]
    if not named:
        raise NotAcceptable(f"Name a subprotocol: {', '.join(handler.subprotocols)}.", offered=())
    protocol: WebSocketProtocol = websocket.scope["extensions"][WEBSOCKET]
    async with (handler.open or _reported)(websocket, value) as opened:
        protocol.accept_messages(handler.max_message_bytes)
        connection = SubprotocolConnection(websocket, protocol, named[0])
        try:
            await websocket.accept(named[0])
            protocol.writer.begin_stream()
            with _guarded(websocket, resource, connection):
                await handler.handle(connection, opened)
        except (ConnectionEnded, OSError):
            pass
        finally:
            connection.end()


@asynccontextmanager
async def _reported(websocket: WebSocket, value: Any) -> AsyncIterator[Any]:
    """Report the connection as a subscription."""
    websocket.report("subscribe", 101)
    try:
        yield value
    finally:
        websocket.report("unsubscribe", None)


def _guarded(
    websocket: WebSocket, resource: Resource, connection: SubprotocolConnection
) -> AbstractContextManager[None]:
    """End the connection when the rights of its client change, because its content depends on all of them."""
    identities: Identities | None = websocket.services.identities
    caller = websocket.caller
    if identities is None or caller.credential is None:
        return nullcontext()
    known, credential = identities.identity_of, caller.credential

    def holds() -> bool:
        now = known(credential)
        return websocket.credentials_valid() and now is not None and now.grants == caller.grants

    return identities.watch_rights(caller, robot_of(resource.path), lambda: connection.close(Ending.UNENTITLED), holds)
