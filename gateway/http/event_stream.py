"""A subscription as a stream of server-sent events (WHATWG HTML, 9.2)."""

import asyncio
import random
import re
from collections.abc import Awaitable, Callable

from starlette.types import Receive, Scope, Send

from gateway.http.protocol import HTTP, HttpProtocol
from gateway.http.slow import HIGH_WATER_BYTES
from gateway.subscriptions.message import Ending, Feed, Message, Outlet

CANCELLED_ID = "cancelled"
"""The last event id of a stream that is over: presented as ``Last-Event-ID`` it is to be answered with 204."""

HEARTBEAT_S = 15.0
_LINE_ENDS = re.compile(rb"\r\n|\n|\r")
# Of a comment the line alone: the blank line of a block would set the client's last event id to what this connection
# has sent, nothing yet if the client resumed with the present version (9.2.6).
_HEARTBEAT = b":\n"
_OPENING = b": linked fleet\nretry: 2000\n"
_RETURN = b"retry: %d\n"
_RETURN_MS = (100, 1000)  # not all clients of a gateway that ends at the same moment
_FINAL = b"id: " + CANCELLED_ID.encode() + b"\n\n"  # without data it sets the id and dispatches no event
_HEADERS = [
    (b"content-type", b"text/event-stream"),
    (b"cache-control", b"no-store"),
    (b"x-accel-buffering", b"no"),  # nginx would collect the events
]


def framed(message: Message) -> bytes:
    """One event (9.2.5). Each line of the body is a field of its own, so that nothing breaks out of ``data``."""
    data = b"\ndata: ".join(_LINE_ENDS.split(message.body))
    return b"id: %b\ndata: %b\n\n" % (message.version.encode(), data)


class EventStreamOutlet:
    """Events on their way to one client. Those given to the server count until nearly all have left."""

    def __init__(self) -> None:
        self._waiting: list[bytes] = []
        self._unsent = 0
        self._ended = False
        self._wake = asyncio.Event()

    @property
    def ended(self) -> bool:
        """Whether nothing comes any more, except what waits."""
        return self._ended

    def writable(self) -> bool:
        return not self._ended and self._unsent < HIGH_WATER_BYTES

    def write(self, message: Message) -> None:
        if not self._ended:
            self._append(message.framed(framed))

    def end(self, ending: Ending) -> None:
        """The last block is what keeps an EventSource from coming back; after a shutdown it shall come back, and soon.

        One that was replaced shall not, or two pages would take the subscription from each other for ever.
        """
        if not self._ended:
            soon = _RETURN % random.randint(*_RETURN_MS)  # noqa: S311 (jitter is no secret)
            self._append(soon if ending is Ending.SHUTDOWN else _FINAL)
        self.stop()

    def stop(self) -> None:
        """Nobody is there any more, or nothing to say."""
        self._ended = True
        self._wake.set()

    async def next(self, heartbeat_s: float) -> bytes:
        """All that waits, joined; a comment when nothing has come for that long; nothing when it has ended."""
        try:
            async with asyncio.timeout(heartbeat_s):
                await self._wake.wait()
        except TimeoutError:
            self._append(_HEARTBEAT)
        batch = b"".join(self._waiting)
        self._waiting.clear()
        if not self._ended:
            self._wake.clear()
        return batch

    def left(self, size: int) -> bool:
        """Notes that so many bytes have left; whether that made room where there was none."""
        full = not self.writable()
        self._unsent -= size
        return full and self.writable()

    def _append(self, frame: bytes) -> None:
        self._waiting.append(frame)
        self._unsent += len(frame)
        self._wake.set()


async def serve_event_stream(
    scope: Scope,
    receive: Receive,
    send: Send,
    headers: list[tuple[bytes, bytes]],
    start: Callable[[Outlet], Awaitable[Feed]],
    *,
    heartbeat_s: float = HEARTBEAT_S,
) -> None:
    """Answer with the stream until it ends or the client is gone; what is left to do is the caller's."""
    outlet = EventStreamOutlet()
    http: HttpProtocol | None = scope.get("extensions", {}).get(HTTP)
    if http is not None and not http.transport.is_closing():
        http.on_shutdown = lambda: outlet.end(Ending.SHUTDOWN)
        if http.ending:
            outlet.end(Ending.SHUTDOWN)
        # The server's own buffer is to be a small part of what waits; what it lets wait counts in the outlet.
        http.transport.set_write_buffer_limits(high=HIGH_WATER_BYTES // 4)
    listener = asyncio.create_task(_listen(receive, outlet))
    try:
        await send({"type": "http.response.start", "status": 200, "headers": [*_HEADERS, *headers]})
        await send({"type": "http.response.body", "body": _OPENING, "more_body": True})
        feed = await start(outlet)
        feed.ready()
        await _pump(outlet, feed, send, http, heartbeat_s)
        await send({"type": "http.response.body", "body": b"", "more_body": False})
    finally:
        outlet.stop()
        listener.cancel()
        if http is not None:
            http.on_shutdown = None


async def _pump(
    outlet: EventStreamOutlet, feed: Feed, send: Send, http: HttpProtocol | None, heartbeat_s: float
) -> None:
    while batch := await outlet.next(heartbeat_s):
        await send({"type": "http.response.body", "body": batch, "more_body": True})
        if http is not None:
            http.watch.wrote(len(batch))
        # The server returns from a send as soon as it has the bytes; from the next one, when most of them have left.
        await send({"type": "http.response.body", "body": b"", "more_body": True})
        if outlet.left(len(batch)):
            feed.ready()


async def _listen(receive: Receive, outlet: EventStreamOutlet) -> None:
    while (await receive())["type"] != "http.disconnect":
        pass
    outlet.stop()
