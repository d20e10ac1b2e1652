"""Clients that send slowly, too much, or in crowds are disconnected, and others are served meanwhile."""

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from functools import partial

import pytest
from starlette.requests import ClientDisconnect, Request
from starlette.responses import Response
from starlette.types import ASGIApp, Receive, Scope, Send

from linked_fleet_server.connection_limits import MAX_HEAD_BYTES, Sockets
from linked_fleet_server.protocol import HttpProtocol
from serving import connect, serving, until

pytestmark = pytest.mark.virtual
_GET = b"GET / HTTP/1.1\r\nHost: test\r\n\r\n"
_POST = b"POST / HTTP/1.1\r\nHost: test\r\nContent-Length: 1000\r\n\r\n"


class Hasty(HttpProtocol):
    """A protocol with small limits, so that tests are short; their effects are the same."""

    head_s = body_s = 0.3


async def echo(scope: Scope, receive: Receive, send: Send) -> None:
    """Respond when the body is complete."""
    try:
        body = await Request(scope, receive).body()
    except ClientDisconnect:
        return
    await Response(body)(scope, receive, send)


async def drip(writer: asyncio.StreamWriter, piece: bytes) -> None:
    """Send a piece repeatedly until the connection is closed."""
    try:
        while True:
            writer.write(piece)
            await writer.drain()
            await asyncio.sleep(0.01)
    except ConnectionError:
        return


@pytest.mark.parametrize(
    ("begin", "piece", "answer"),
    [
        (b"GET / HTTP/1.1\r\nHost: test\r\n", b"X: y\r\n", b"408"),
        (b"G", b"E", b"408"),
        (_POST, b"y", b"408"),
        (_POST.replace(b"POST", b"HEAD"), b"y", b"408"),
        (b"POST / HTTP/1.1\r\nHost: test\r\nTransfer-Encoding: chunked\r\n\r\n", b"1\r\ny\r\n", b"408"),
        (b"", b"", b""),
    ],
)
async def test_slow_requests_are_disconnected_and_delay_nobody(begin: bytes, piece: bytes, answer: bytes) -> None:
    async with serving(echo, http=Hasty) as (server, port):
        reader, writer = await connect(port, begin)
        dripping = asyncio.create_task(drip(writer, piece)) if piece else None
        other, sender = await connect(port, _GET)
        assert (await other.readuntil(b"\r\n\r\n")).startswith(b"HTTP/1.1 200")
        sender.close()
        said = b""
        try:
            while more := await reader.read(1000):
                said += more
        except ConnectionResetError:  # after the response
            pass
        assert said.split(b" ")[1:2] == ([answer] if answer else [])
        await until(lambda: not server.server_state.connections)
        await until(lambda: not server.server_state.tasks)
        writer.close()
        if dripping is not None:
            dripping.cancel()


async def test_a_body_that_goes_on_after_the_answer_is_cut_off() -> None:
    """The response needs no body, but the connection would stay open as long as more of it comes."""
    async with serving(Response(b"done"), http=Hasty) as (server, port):
        reader, writer = await connect(port, _POST.replace(b"1000", b"100000"))
        assert (await reader.readuntil(b"done")).startswith(b"HTTP/1.1 200")
        dripping = asyncio.create_task(drip(writer, b"y"))
        await until(lambda: not server.server_state.connections)
        dripping.cancel()
        writer.close()


async def test_a_connection_is_idle_after_a_body_that_ends_after_the_answer() -> None:
    sockets = Sockets(1, 1)
    http = partial(Hasty, sockets=sockets)
    async with serving(Response(b"done"), http=http) as (server, port):  # type: ignore[arg-type]
        reader, writer = await connect(port, _POST)
        await reader.readuntil(b"done")
        writer.write(b"y" * 1000)
        await until(lambda: not server.server_state.connections)
        writer.close()


async def test_an_answer_may_take_longer_to_read_than_the_next_request_may_take_to_begin() -> None:
    body = bytes(1 << 20)
    async with serving(Response(body), http=Hasty) as (_, port):
        begin = asyncio.get_running_loop().time()
        reader, writer = await connect(port, _GET, receive_buffer=8192)
        await reader.readuntil(b"\r\n\r\n")
        left = len(body)
        while left:
            piece = await reader.read(4096)
            assert piece, f"cut off {left} bytes before the end"
            left -= len(piece)
            if left < len(body) // 2 and asyncio.get_running_loop().time() < begin + 5 * Hasty.head_s:
                await asyncio.sleep(Hasty.head_s / 10)  # as on a slow line
        writer.close()


async def test_an_unread_response_is_given_up() -> None:
    class Impatient(Hasty):
        stall_s = 0.1

    async with serving(Response(bytes(1 << 20)), http=Impatient) as (server, port):
        reader, writer = await connect(port, _GET, receive_buffer=8192)
        await reader.readuntil(b"\r\n\r\n")
        await until(lambda: not server.server_state.connections)
        writer.close()


async def test_a_reader_of_one_long_response_after_another_is_not_given_up() -> None:
    """A later response may be longer than what was unread of an earlier one: that is no stall."""

    class Impatient(Hasty):
        stall_s = 1.0
        head_s = 10.0

    async def sized(scope: Scope, receive: Receive, send: Send) -> None:
        await Response(bytes(int(scope["path"][1:])))(scope, receive, send)

    async with serving(sized, http=Impatient) as (_, port):
        reader, writer = await connect(port, _GET.replace(b"/ ", b"/500000 "), receive_buffer=8192)
        await reader.readuntil(b"\r\n\r\n")
        await reader.readexactly(500_000)
        length = 4_000_000
        writer.write(_GET.replace(b"/ ", b"/%d " % length))
        await reader.readuntil(b"\r\n\r\n")
        begin = asyncio.get_running_loop().time()
        for _ in range(length // 4000):
            await reader.readexactly(4000)
            if asyncio.get_running_loop().time() < begin + 2 * Impatient.stall_s:
                await asyncio.sleep(Impatient.stall_s / 50)  # as on a slow line
        writer.close()


async def test_a_silent_websocket_has_no_request_deadline() -> None:
    """A WebSocket client need not send anything; h11 would wait for a body of its handshake that never comes."""

    async def late(scope: Scope, receive: Receive, send: Send) -> None:
        await receive()
        await send({"type": "websocket.accept"})
        await asyncio.sleep(3 * Hasty.body_s)
        await send({"type": "websocket.send", "text": "late"})
        await send({"type": "websocket.close"})

    async with serving(late, http=Hasty) as (server, port):
        key = b"Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\nSec-WebSocket-Version: 13\r\n\r\n"
        opening = b"GET / HTTP/1.1\r\nHost: test\r\nConnection: Upgrade\r\nUpgrade: websocket\r\n"
        reader, writer = await connect(port, opening + key)
        assert (await reader.readuntil(b"\r\n\r\n")).startswith(b"HTTP/1.1 101")
        assert await reader.readexactly(6) == b"\x81\x04late"
        writer.close()
        await until(lambda: not server.server_state.connections)


async def test_requests_in_time_are_served_however_they_are_split() -> None:
    """A deadline applies to one request: many on one connection may take longer."""

    class Patient(HttpProtocol):  # with a margin for a busy machine
        head_s = body_s = 2.0

    async with serving(echo, http=Patient) as (_, port):
        reader, writer = await connect(port, b"")
        end_s = asyncio.get_running_loop().time() + 1.5 * Patient.head_s
        while asyncio.get_running_loop().time() < end_s:
            for piece in (_POST[:9], _POST[9:], b"x" * 400, b"y" * 600):
                writer.write(piece)
                await asyncio.sleep(0.01)
            answer = await reader.readuntil(b"\r\n\r\n")
            assert answer.startswith(b"HTTP/1.1 200")
            assert await reader.readexactly(1000) == b"x" * 400 + b"y" * 600
        writer.close()


@pytest.mark.parametrize("size", [MAX_HEAD_BYTES * 3, 200_000])
async def test_long_header_blocks_are_refused_also_when_they_come_at_once(size: int) -> None:
    async with serving(echo) as (_, port):
        fields = b"".join(b"x%d: y\r\n" % number for number in range(size // 8))
        reader, writer = await connect(port, b"GET / HTTP/1.1\r\nHost: test\r\n" + fields + b"\r\n")
        assert (await reader.readuntil(b"\r\n")).startswith(b"HTTP/1.1 431")
        writer.close()


@asynccontextmanager
async def _crowded(most: int, of_one: int, app: ASGIApp = echo) -> AsyncIterator[tuple[Sockets, int]]:
    """Serve with limits of connections, in all and of one client; yield the connections and the port."""
    sockets = Sockets(most, of_one)
    async with serving(app, http=partial(HttpProtocol, sockets=sockets)) as (_, port):  # type: ignore[arg-type]
        yield sockets, port
        await until(lambda: not len(sockets))


@pytest.mark.parametrize(("most", "of_one"), [(3, 100), (100, 3)])
async def test_idle_connections_are_closed_for_new_ones(most: int, of_one: int) -> None:
    """Beyond the limit the oldest idle connection is closed, and active clients are served."""
    async with _crowded(most, of_one) as (sockets, port):
        idle = []
        for number in range(3):
            idle.append(await connect(port, b"GET / HT"))
            await until(lambda number=number: len(sockets) == number + 1)
        writers = [writer for _, writer in idle]
        for number in range(3):
            reader, writer = await connect(port, _GET)
            assert (await reader.readuntil(b"\r\n\r\n")).startswith(b"HTTP/1.1 200")
            with pytest.raises((asyncio.IncompleteReadError, ConnectionResetError)):
                await idle[number][0].readexactly(1)
            assert len(sockets) == 3
            writers.append(writer)
        for writer in writers:
            writer.close()


async def test_a_connection_beyond_busy_ones_is_refused() -> None:
    waiting, done = 0, asyncio.Event()

    async def app(scope: Scope, receive: Receive, send: Send) -> None:
        nonlocal waiting
        waiting += 1
        await done.wait()
        await Response(b"")(scope, receive, send)

    async with _crowded(2, 2, app) as (_, port):
        at_work = [await connect(port, _GET) for _ in range(2)]
        await until(lambda: waiting == 2)
        reader, refused = await connect(port, b"")
        assert (await reader.readuntil(b"\r\n")).startswith(b"HTTP/1.1 503")
        refused.close()
        done.set()
        for reader, _ in at_work:
            assert (await reader.readuntil(b"\r\n")).startswith(b"HTTP/1.1 200")
        reader, served = await connect(port, _GET)
        assert (await reader.readuntil(b"\r\n")).startswith(b"HTTP/1.1 200")
        for writer in (served, *(writer for _, writer in at_work)):
            writer.close()


async def test_an_answer_that_is_still_read_keeps_its_place() -> None:
    body = bytes(1 << 20)
    async with _crowded(1, 1, Response(body)) as (_, port):
        reader, writer = await connect(port, _GET, receive_buffer=8192)
        await reader.readuntil(b"\r\n\r\n")
        other, refused = await connect(port, b"")
        assert (await other.readuntil(b"\r\n")).startswith(b"HTTP/1.1 503")
        refused.close()
        assert await reader.readexactly(len(body)) == body
        other, served = await connect(port, _GET)
        assert (await other.readuntil(b"\r\n")).startswith(b"HTTP/1.1 200")
        for each in (writer, served):
            each.close()


def test_places() -> None:
    """The limit of one client does not affect others, and closing twice frees one place."""
    sockets, gone = Sockets(3, 2), list[str]()
    assert sockets.register("a1", "a")
    assert sockets.register("a2", "a")
    assert not sockets.register("a3", "a")
    assert sockets.register("b1", "b")
    assert not sockets.register("c1", "c")
    sockets.mark_idle("b1", lambda: False)
    assert not sockets.register("c1", "c")
    sockets.mark_busy("b1")
    sockets.mark_idle("b1", lambda: not gone.append("b1"))  # type: ignore[func-returns-value]
    assert not sockets.register("a3", "a")
    assert sockets.register("c1", "c")
    assert gone == ["b1"]
    sockets.mark_idle("a2", lambda: not gone.append("a2"))  # type: ignore[func-returns-value]
    sockets.mark_busy("a2")
    assert not sockets.register("a3", "a")
    sockets.unregister("a1")
    sockets.unregister("a1")
    assert len(sockets) == 2
    assert sockets.register("a3", "a")
    assert not sockets.register("a4", "a")


async def test_a_crowd_of_requests_at_once_waits_outside_and_is_answered() -> None:
    """Of megabytes of pipelined requests a few are parsed, and the rest stays with the client."""
    count = 100_000
    go = asyncio.Event()
    held = list[HttpProtocol]()

    class Watched(HttpProtocol):
        def __init__(self, *arguments: object, **named: object) -> None:
            super().__init__(*arguments, **named)
            held.append(self)

    async def wait(scope: Scope, receive: Receive, send: Send) -> None:
        await go.wait()
        await Response(b"x")(scope, receive, send)

    async with serving(wait, http=Watched) as (_, port):
        reader, writer = await connect(port, b"")
        writer.write(_GET * count)
        await until(lambda: bool(held and held[0]._exchanges))
        go.set()
        for _ in range(1000):
            assert (await reader.readuntil(b"\r\n\r\nx")).startswith(b"HTTP/1.1 200")
            assert sum(map(len, held[0]._unread)) + len(_GET) * len(held[0]._exchanges) <= 1 << 20
        writer.transport.abort()
