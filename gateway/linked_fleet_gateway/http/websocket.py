"""A subscription over WebSocket (RFC 6455; paper R0.15): frames go directly to each subscriber's transport."""

import struct
from collections.abc import Awaitable, Callable

from websockets.frames import CloseCode, Opcode

from linked_fleet_gateway.http.request import WebSocket
from linked_fleet_gateway.http.websocket_protocol import WEBSOCKET, WebSocketProtocol
from linked_fleet_gateway.rdf.serialise import TEXT_TYPES
from linked_fleet_gateway.subscriptions.message import Ending, Feed, Message, Outlet


def is_binary(media_type: str) -> bool:
    """Return True if messages in this media type are not text."""
    return media_type not in TEXT_TYPES and not media_type.startswith("text/") and not media_type.endswith("json")


# RFC 6455, 7.4: 1008 is policy, 1012 invites to reconnect, 4000 to 4999 are for private use.
_CODES = {
    Ending.CANCELLED: 1000,
    Ending.UNENTITLED: 1008,
    Ending.GONE: 4404,
    Ending.REPLACED: 4409,
    Ending.SHUTDOWN: 1012,
}

_FIN = 0x80
_MEDIUM, _LONG = struct.Struct("!BBH"), struct.Struct("!BBQ")


def framed(message: Message) -> bytes:
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
        self.framing = framed
        self.send, self.writable = protocol.writer.send, protocol.writer.writable

    def write(self, message: Message) -> None:
        self.send(message.framed(framed))

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
        protocol.on_drained = feed.ready
        if protocol.open:
            protocol.writer.begin()
        feed.ready()
        while (await websocket.receive())["type"] != "websocket.disconnect":
            pass
    finally:
        protocol.on_drained = None
        protocol.close(CloseCode.INTERNAL_ERROR, "the gateway failed")  # unless it is closing already, as expected
