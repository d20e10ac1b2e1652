"""A server with the gateway's protocol classes around an application of the test.

Connections are in memory in files marked ``virtual``, and on loopback in others.
"""

import asyncio
import socket
from collections.abc import AsyncIterator, Callable, Coroutine, Iterator
from contextlib import asynccontextmanager, contextmanager
from typing import Any

import uvicorn
import uvloop
from starlette.types import ASGIApp

from linked_fleet_gateway.subscriptions.broadcast import Message, Outlet
from linked_fleet_server.protocol import HttpProtocol
from linked_fleet_server.websocket_protocol import WebSocketProtocol
from virtual.loop import VirtualLoop
from virtual.tcp import KERNEL_BYTES, Listener


def run_on_sockets(test: Callable[[], Coroutine[Any, Any, None]]) -> None:
    """Run a coroutine function on the event loop that the gateway uses."""

    async def main() -> None:
        async with asyncio.timeout(30):
            await test()

    uvloop.run(main())


async def until(condition: Callable[[], Any]) -> None:
    while not condition():  # noqa: ASYNC110 - few of these conditions could set an event
        await asyncio.sleep(0.002)


@asynccontextmanager
async def serving(
    app: ASGIApp,
    http: type[HttpProtocol] = HttpProtocol,
    ws: type[WebSocketProtocol] = WebSocketProtocol,
    **options: Any,
) -> AsyncIterator[tuple[uvicorn.Server, int]]:
    """Yield the server and its port. The kernel buffers little, so that sent data soon waits in the process."""
    options = {"ws_ping_interval": None, "ws_max_size": 4096, **options}
    config = uvicorn.Config(
        app, lifespan="off", log_config=None, access_log=False, http=http, ws=ws,
        timeout_graceful_shutdown=2, **options,
    )  # fmt: skip
    server = _Server(config)
    listener: Any = _listener()
    task = asyncio.create_task(server.serve([listener]))
    await until(lambda: server.started)
    try:
        yield server, listener.getsockname()[1]
    finally:
        server.should_exit = True
        await task
        listener.close()


class _Server(uvicorn.Server):
    """A server without signal handlers."""

    @contextmanager
    def capture_signals(self) -> Iterator[None]:
        yield


def _listener() -> Listener | socket.socket:
    loop = asyncio.get_running_loop()
    if isinstance(loop, VirtualLoop):
        return Listener(loop.internet)
    listener = socket.socket(socket.AF_INET, socket.SOCK_STREAM, socket.IPPROTO_TCP)
    listener.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 8192)
    listener.bind(("127.0.0.1", 0))
    listener.listen()
    return listener


async def connect(
    port: int, request: bytes, receive_buffer: int = 0
) -> tuple[asyncio.StreamReader, asyncio.StreamWriter]:
    """Open a raw connection and send the request."""
    reader = asyncio.StreamReader(limit=4096)
    protocol = asyncio.StreamReaderProtocol(reader)
    internet, room = running_loop().internet, receive_buffer or KERNEL_BYTES
    transport, _ = await internet.connect(lambda: protocol, "127.0.0.1", port, room)
    writer = asyncio.StreamWriter(transport, protocol, reader, running_loop())
    writer.write(request)
    return reader, writer


async def fill(outlet: Outlet, message: Message) -> None:
    """Write until the outlet is full. The kernel accepts data in small steps, even if the reader reads nothing."""
    while outlet.writable():
        outlet.write(message)
        await asyncio.sleep(0.002)


def running_loop() -> VirtualLoop:
    loop = asyncio.get_running_loop()
    assert isinstance(loop, VirtualLoop)
    return loop


class Channel:
    """A stand-in for a subscription: starts outlets, and sends messages to those that are writable."""

    def __init__(self, *first: Message) -> None:
        self.first = first
        self.outlets: list[Outlet] = []
        self.readies: dict[Outlet, int] = {}
        self.over: list[Outlet] = []

    async def start(self, outlet: Outlet) -> "_Feed":
        self.outlets.append(outlet)
        self.readies[outlet] = 0
        return _Feed(self, outlet)

    def publish(self, message: Message) -> list[Outlet]:
        """Send a message and return the outlets that took it."""
        takers = [outlet for outlet in self.outlets if outlet.writable()]
        for outlet in takers:
            outlet.write(message)
        return takers


class _Feed:
    def __init__(self, channel: Channel, outlet: Outlet) -> None:
        self.channel, self.outlet = channel, outlet

    def schedule_send(self) -> None:
        self.channel.readies[self.outlet] += 1
        if self.channel.readies[self.outlet] == 1:
            for message in self.channel.first:
                self.outlet.write(message)
