"""A client at the far end of a network: ``python -m bench.far 1|2|3 HOST PORT AUTHORITY SECONDS PATH...``.

With that version of HTTP it reads all paths at once on a new connection, five times, then follows them as event streams
for SECONDS. It prints its results as one line of JSON. ``AUTHORITY``: the trusted certificate.
"""

import asyncio
import json
import re
import ssl
import sys
import time
from collections.abc import AsyncIterator, Callable, Sequence
from contextlib import AbstractAsyncContextManager, asynccontextmanager
from functools import partial
from typing import Any, Protocol

import h2.events
import httpx
from aioquic.asyncio.client import connect
from aioquic.asyncio.protocol import QuicConnectionProtocol
from aioquic.h3.connection import H3_ALPN, H3Connection
from aioquic.h3.events import DataReceived, HeadersReceived
from aioquic.quic.configuration import QuicConfiguration
from aioquic.quic.events import QuicEvent
from h2.connection import H2Connection
from h2.events import ResponseReceived, StreamEnded

NAME = "fleet.localhost"
"""Name of the front in its certificate; its address is given separately."""
TURTLE, EVENTS = "text/turtle", "text/event-stream"
_VALUE = re.compile(rb'numericalValue "([^"]+)"')
_REPEATS = 5
_WINDOW = 1 << 24


class Client(Protocol):
    def stream(self, path: str, accept: str) -> AsyncIterator[bytes]:
        """Yield the response piece by piece."""
        ...


class Http1:
    """Uses as many connections as there are concurrent requests."""

    def __init__(self, http: httpx.AsyncClient, host: str, port: int) -> None:
        self._http, self._root, self._authority = http, f"https://{host}:{port}", f"{NAME}:{port}"

    async def stream(self, path: str, accept: str) -> AsyncIterator[bytes]:
        fields, server = {"accept": accept, "host": self._authority}, {"sni_hostname": NAME}
        async with self._http.stream("GET", self._root + path, headers=fields, extensions=server) as answer:
            answer.raise_for_status()
            async for piece in answer.aiter_raw():
                yield piece


class Streams:
    """Queues of response bodies that share one connection, by stream number; None marks the end of a body."""

    def __init__(self) -> None:
        self._queues: dict[int, asyncio.Queue[bytes | None]] = {}

    def took(self, number: int, piece: bytes | None) -> None:
        self._queues[number].put_nowait(piece)

    async def of(self, number: int) -> AsyncIterator[bytes]:
        queue = self._queues[number] = asyncio.Queue()
        while (piece := await queue.get()) is not None:
            yield piece


def _fields(authority: str, path: str, accept: str) -> list[tuple[bytes, bytes]]:
    asked = {":method": "GET", ":scheme": "https", ":authority": authority, ":path": path, "accept": accept}
    return [(name.encode(), value.encode()) for name, value in asked.items()]


class Http2(asyncio.Protocol):
    """One connection."""

    def __init__(self, authority: str) -> None:
        self._authority, self._h2, self._streams = authority, H2Connection(), Streams()

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        assert isinstance(transport, asyncio.Transport)
        self._transport = transport
        self._h2.initiate_connection()
        self._h2.increment_flow_control_window(_WINDOW)
        transport.write(self._h2.data_to_send())

    def data_received(self, data: bytes) -> None:
        for said in self._h2.receive_data(data):
            if isinstance(said, ResponseReceived):
                assert dict(said.headers)[b":status"] == b"200", said.headers
            if isinstance(said, h2.events.DataReceived):
                self._h2.acknowledge_received_data(said.flow_controlled_length, said.stream_id)
                self._streams.took(said.stream_id, said.data)
            if isinstance(said, StreamEnded):
                self._streams.took(said.stream_id, None)
        self._transport.write(self._h2.data_to_send())

    async def stream(self, path: str, accept: str) -> AsyncIterator[bytes]:
        number = self._h2.get_next_available_stream_id()
        self._h2.send_headers(number, _fields(self._authority, path, accept), end_stream=True)
        self._transport.write(self._h2.data_to_send())
        async for piece in self._streams.of(number):
            yield piece


class Http3(QuicConnectionProtocol):
    """One connection; a lost packet delays only the streams in it."""

    authority: str

    def __init__(self, *arguments: Any, **named: Any) -> None:
        super().__init__(*arguments, **named)
        self._h3, self._streams = H3Connection(self._quic), Streams()

    def quic_event_received(self, event: QuicEvent) -> None:
        for said in self._h3.handle_event(event):
            if isinstance(said, HeadersReceived):
                assert dict(said.headers)[b":status"] == b"200", said.headers
            if isinstance(said, DataReceived):
                self._streams.took(said.stream_id, said.data)
            if isinstance(said, HeadersReceived | DataReceived) and said.stream_ended:
                self._streams.took(said.stream_id, None)

    async def stream(self, path: str, accept: str) -> AsyncIterator[bytes]:
        number = self._quic.get_next_available_stream_id()
        self._h3.send_headers(number, _fields(self.authority, path, accept), end_stream=True)
        self.transmit()
        async for piece in self._streams.of(number):
            yield piece


@asynccontextmanager
async def _http1(host: str, port: int, authority: str) -> AsyncIterator[Client]:
    trusted, limits = ssl.create_default_context(cafile=authority), httpx.Limits(max_connections=None)
    async with httpx.AsyncClient(verify=trusted, limits=limits, timeout=None) as http:  # noqa: S113
        yield Http1(http, host, port)


@asynccontextmanager
async def _http2(host: str, port: int, authority: str) -> AsyncIterator[Client]:
    trusted = ssl.create_default_context(cafile=authority)
    trusted.set_alpn_protocols(["h2"])
    loop = asyncio.get_running_loop()
    transport, client = await loop.create_connection(
        lambda: Http2(f"{NAME}:{port}"), host, port, ssl=trusted, server_hostname=NAME
    )
    try:
        yield client
    finally:
        transport.close()


@asynccontextmanager
async def _http3(host: str, port: int, authority: str) -> AsyncIterator[Client]:
    configuration = QuicConfiguration(is_client=True, alpn_protocols=H3_ALPN, server_name=NAME)
    configuration.load_verify_locations(cafile=authority)
    async with connect(host, port, configuration=configuration, create_protocol=Http3) as client:
        assert isinstance(client, Http3)
        client.authority = f"{NAME}:{port}"
        yield client


_OPEN: dict[str, Callable[[str, int, str], AbstractAsyncContextManager[Client]]] = {
    "1": _http1, "2": _http2, "3": _http3,
}  # fmt: skip


async def _read(client: Client, paths: Sequence[str]) -> None:
    async def whole(path: str) -> None:
        async for _ in client.stream(path, TURTLE):
            pass

    await asyncio.gather(*map(whole, paths))


async def _follow(client: Client, path: str, seen: list[tuple[int, float]]) -> None:
    rest = b""
    async for piece in client.stream(path, EVENTS):
        now_ns = time.monotonic_ns()
        *lines, rest = (rest + piece).split(b"\n")
        seen += [(now_ns, float(value)) for line in lines for value in _VALUE.findall(line)]


async def main() -> None:
    version, host, port, authority, seconds, *paths = sys.argv[1:]
    opened = partial(_OPEN[version], host, int(port), authority)
    read_ms = []
    for _ in range(_REPEATS):
        begin = time.perf_counter()
        async with opened() as client:
            await _read(client, paths)
            read_ms.append((time.perf_counter() - begin) * 1e3)
    seen: list[list[tuple[int, float]]] = [[] for _ in paths]
    async with opened() as client:
        streams = [asyncio.create_task(_follow(client, *each)) for each in zip(paths, seen, strict=True)]
        while not all(seen) and not any(stream.done() for stream in streams):  # noqa: ASYNC110 - of either kind many
            await asyncio.sleep(0.05)
        for each in seen:
            each.clear()
        done, _ = await asyncio.wait(streams, timeout=float(seconds))
        for stream in done:
            stream.result()
        for stream in streams:
            stream.cancel()
        await asyncio.gather(*streams, return_exceptions=True)
    print(json.dumps({"read_ms": read_ms, "seen": seen}), flush=True)


if __name__ == "__main__":
    asyncio.run(main())
