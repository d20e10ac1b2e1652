"""A subscription as a stream of server-sent events (WHATWG HTML, 9.2)."""

import asyncio
import random
import re
from collections.abc import Awaitable, Callable

from starlette.types import Receive, Scope, Send

from linked_fleet_gateway.subscriptions.broadcast import Ending, Feed, Message, Outlet
from linked_fleet_server.connection_limits import BoundedWriter
from linked_fleet_server.protocol import HTTP, HttpProtocol

CANCELLED_ID = "cancelled"
"""Last event id of a cancelled stream: a request with it as ``Last-Event-ID`` gets 204."""

HEARTBEAT_S = 15.0
"""Longest silence of a stream, in seconds."""
_LINE_ENDS = re.compile(rb"\r\n|\n|\r")
# Only the line of a comment: the blank line of a block would set the client's last event id to the last one of this
# connection, which is empty if the client has resumed with the present version (9.2.6).
_HEARTBEAT, _HEARTBEAT_CHUNK = b":\n", b"2\r\n:\n\r\n"
OPENING = b": linked fleet\nretry: 2000\n"
_RETURN = b"retry: %d\n"
_RETURN_MS = (100, 1000)  # spreads the return of clients when a gateway ends
_FINAL = b"id: " + CANCELLED_ID.encode() + b"\n\n"  # without data it sets the id but dispatches no event
CACHE_CONTROL = b"no-store, no-transform"
"""A proxy that compressed the stream would hold the events back (RFC 9111, 5.2.2.6)."""
STREAM_FIELDS = [
    (b"content-type", b"text/event-stream"),
    (b"cache-control", CACHE_CONTROL),
    (b"x-accel-buffering", b"no"),  # nginx would buffer the events
]


def comment(text: str = "") -> bytes:
    """Return a comment of one line, which clients ignore."""
    return b": %b\n" % text.encode() if text else _HEARTBEAT


def event_bytes(message: Message) -> bytes:
    """Return one event (9.2.5). Each line of the body is a field, so that nothing can escape from ``data``."""
    data = b"\ndata: ".join(_LINE_ENDS.split(message.body))
    return b"id: %b\ndata: %b\n\n" % (message.event_id.encode(), data)


def chunk_bytes(message: Message) -> bytes:
    """Return the event as a chunk of a body (RFC 9112, 7.1)."""
    data = event_bytes(message)
    return b"%x\r\n%b\r\n" % (len(data), data)


class EventStreamOutlet:
    """Writes events directly to the client's transport, bypassing the server, for which the body does not change state.

    The server itself writes the opening and the final block. ``chunked`` is the framing of HTTP/1.1 bodies without
    known length.
    """

    def __init__(self, writer: BoundedWriter, *, chunked: bool) -> None:
        self.final_block = b""
        self.ended = asyncio.Event()
        """Set when no more events follow."""
        self.framing = chunk_bytes if chunked else event_bytes
        self.send, self.writable = writer.send, writer.writable
        self._writer, self._chunked = writer, chunked
        self._beat: asyncio.TimerHandle | None = None

    def write(self, message: Message) -> None:
        self.send(message.frame_with(self.framing))

    def end(self, ending: Ending) -> None:
        """End the stream. The final block stops an EventSource from reconnecting, except after a shutdown.

        A replaced stream must not reconnect, because two pages would take the subscription from each other for ever.
        """
        if not self.ended.is_set():
            soon = _RETURN % random.randint(*_RETURN_MS)  # noqa: S311 (jitter is no secret)
            self.final_block = soon if ending is Ending.SHUTDOWN else _FINAL
        self.stop()

    def stop(self) -> None:
        """Stop sending, because the client is gone or there is nothing to say."""
        self.ended.set()
        self._writer.end_stream()
        if self._beat is not None:
            self._beat.cancel()

    def send_keepalive(self, every_s: float, written: int = -1) -> None:
        """Send a comment if nothing was written during the second half of ``every_s``."""
        before = self._writer.bytes_written
        if before == written:
            self.send(_HEARTBEAT_CHUNK if self._chunked else _HEARTBEAT)
        self._beat = asyncio.get_running_loop().call_later(every_s / 2, self.send_keepalive, every_s, before)


async def serve_event_stream(
    scope: Scope,
    receive: Receive,
    send: Send,
    headers: list[tuple[bytes, bytes]],
    start: Callable[[Outlet], Awaitable[Feed]],
    *,
    heartbeat_s: float = HEARTBEAT_S,
) -> None:
    """Answer with the stream until it ends or the client is gone; the caller cleans up."""
    http: HttpProtocol = scope["extensions"][HTTP]
    outlet = EventStreamOutlet(http.writer, chunked=scope["http_version"] == "1.1")
    http.on_shutdown = lambda: outlet.end(Ending.SHUTDOWN)
    if http.is_shutting_down:
        outlet.end(Ending.SHUTDOWN)
    listener = asyncio.create_task(_listen(receive, outlet))
    try:
        await send({"type": "http.response.start", "status": 200, "headers": [*STREAM_FIELDS, *headers]})
        await send({"type": "http.response.body", "body": OPENING, "more_body": True})
        feed = await start(outlet)
        _follow(http, outlet, feed, heartbeat_s)
        await outlet.ended.wait()
        await send({"type": "http.response.body", "body": outlet.final_block, "more_body": False})
    finally:
        outlet.stop()
        listener.cancel()
        http.on_shutdown = http.on_drained = None


def _follow(http: HttpProtocol, outlet: EventStreamOutlet, feed: Feed, heartbeat_s: float) -> None:
    if outlet.ended.is_set() or http.transport.is_closing():
        return
    http.on_drained = feed.schedule_send
    http.writer.begin_stream()
    outlet.send_keepalive(heartbeat_s)
    feed.schedule_send()


async def _listen(receive: Receive, outlet: EventStreamOutlet) -> None:
    while (await receive())["type"] != "http.disconnect":
        pass
    outlet.stop()
