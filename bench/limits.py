"""References for the fan-out: servers that only send prepared bytes to all connected clients.

``python limits.py bare|starlette ws|sse RATE SIZE`` prints its port and ends when its input ends. ``bare`` writes one
framed buffer to each transport of uvloop, which is the kernel's part and the least possible in Python; ``starlette``
awaits a ``send_text`` for each WebSocket, and has a queue for each event stream. To ``bench/readers.py`` messages look
like those of the gateway; they have SIZE bytes before framing.
"""

import asyncio
import contextlib
import os
import socket
import sys
import threading
import time
from collections.abc import AsyncIterator, Awaitable, Callable
from typing import Literal, cast

import uvicorn
import uvloop
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import StreamingResponse
from starlette.routing import Route, WebSocketRoute
from starlette.websockets import WebSocket, WebSocketDisconnect
from websockets.frames import Frame, Opcode
from websockets.utils import accept_key

How = Literal["ws", "sse"]
_HIGH_WATER_BYTES = 64 * 1024
_SSE_HEAD = b"HTTP/1.1 200 OK\r\ncontent-type: text/event-stream\r\ntransfer-encoding: chunked\r\n\r\n"
_WS_HEAD = (
    b"HTTP/1.1 101 Switching Protocols\r\nUpgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Accept: %b\r\n\r\n"
)


def body(size: int) -> bytes:
    """Return a message whose value is the present time, CLOCK_MONOTONIC, in seconds."""
    head = b'<> lf:version "1" ; numericalValue "%.9f" .\n' % time.monotonic()
    return head + b"#" * (size - len(head) - 1) + b"\n"


def event(text: bytes) -> bytes:
    return b"data: %b\n\n" % text.replace(b"\n", b"\ndata: ")


def framed(how: How, text: bytes) -> bytes:
    if how == "ws":
        return Frame(Opcode.TEXT, text).serialize(mask=False)
    return b"%x\r\n%b\r\n" % (len(data := event(text)), data)


async def beat(rate_hz: float, act: Callable[[], Awaitable[None]]) -> None:
    """Call ``act`` so many times a second, or less often if it takes longer."""
    loop = asyncio.get_running_loop()
    due = loop.time()
    while True:
        due = max(due + 1 / rate_hz, loop.time() - 1 / rate_hz)
        await asyncio.sleep(max(0.0, due - loop.time()))
        await act()


class Bare(asyncio.Protocol):
    """A connection that accepts any request; the server writes prepared bytes to it afterwards."""

    def __init__(self, how: How, audience: set[asyncio.Transport]) -> None:
        self._how, self._audience, self._asked = how, audience, b""

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        self._transport = cast(asyncio.Transport, transport)

    def data_received(self, data: bytes) -> None:
        self._asked += data
        if b"\r\n\r\n" in self._asked and self._transport not in self._audience:
            key = self._asked.partition(b"Sec-WebSocket-Key: ")[2].partition(b"\r\n")[0].decode()
            self._transport.write(_SSE_HEAD if self._how == "sse" else _WS_HEAD % accept_key(key).encode())
            self._audience.add(self._transport)

    def connection_lost(self, _: Exception | None) -> None:
        self._audience.discard(self._transport)


async def bare(listener: socket.socket, how: How, rate_hz: float, size: int) -> None:
    audience: set[asyncio.Transport] = set()
    await asyncio.get_running_loop().create_server(lambda: Bare(how, audience), sock=listener)

    async def write() -> None:
        frame = framed(how, body(size))
        for transport in audience:
            if transport.get_write_buffer_size() < _HIGH_WATER_BYTES:
                transport.write(frame)

    await beat(rate_hz, write)


def starlette(rate_hz: float, size: int) -> Starlette:
    sockets: set[WebSocket] = set()
    queues: set[asyncio.Queue[bytes]] = set()

    async def websocket(one: WebSocket) -> None:
        await one.accept()
        sockets.add(one)
        with contextlib.suppress(WebSocketDisconnect):
            while True:
                await one.receive_text()
        sockets.discard(one)

    async def stream(_: Request) -> StreamingResponse:
        async def events() -> AsyncIterator[bytes]:
            queues.add(queue := asyncio.Queue(100))
            try:
                while True:
                    yield await queue.get()
            finally:
                queues.discard(queue)

        return StreamingResponse(events(), media_type="text/event-stream")

    async def send() -> None:
        text = body(size)
        for one in list(sockets):
            with contextlib.suppress(WebSocketDisconnect):
                await one.send_text(text.decode())
        data = event(text)
        for queue in queues:
            if not queue.full():
                queue.put_nowait(data)

    @contextlib.asynccontextmanager
    async def lifespan(_: Starlette) -> AsyncIterator[None]:
        sending = asyncio.create_task(beat(rate_hz, send))
        yield
        sending.cancel()

    routes = [WebSocketRoute("/{path:path}", websocket), Route("/{path:path}", stream)]
    return Starlette(routes=routes, lifespan=lifespan)


def main() -> None:
    kind, how, rate_hz, size = sys.argv[1], sys.argv[2], float(sys.argv[3]), int(sys.argv[4])
    assert how in ("ws", "sse")
    threading.Thread(target=_end_with_input, daemon=True).start()
    listener = socket.create_server(("127.0.0.1", 0), backlog=2048)
    print(listener.getsockname()[1], flush=True)
    if kind == "bare":
        uvloop.run(bare(listener, how, rate_hz, size))
    else:
        config = uvicorn.Config(
            starlette(rate_hz, size), loop="uvloop", http="h11", ws="websockets-sansio", ws_per_message_deflate=False,
            ws_ping_interval=None,
            access_log=False, log_level="warning",
        )  # fmt: skip
        uvicorn.Server(config).run([listener])


def _end_with_input() -> None:
    sys.stdin.read()
    os._exit(0)


if __name__ == "__main__":
    main()
