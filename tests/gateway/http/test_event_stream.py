"""WHATWG HTML, 9.2: the stream as an EventSource reads it, and slow, stalled or vanished readers."""

import asyncio
import contextlib
import socket
import struct
from collections.abc import AsyncGenerator

import h11
import httpx
import pytest
from starlette.types import Receive, Scope, Send

from event_source import EventSource
from linked_fleet_gateway.http.event_stream import chunk_bytes, event_bytes, serve_event_stream
from linked_fleet_gateway.subscriptions.broadcast import Ending, Message
from linked_fleet_server.connection_limits import HIGH_WATER_BYTES
from linked_fleet_server.protocol import HTTP, HttpProtocol
from serving import Channel, connect, fill, serving, until

pytestmark = pytest.mark.virtual
TURTLE = Message("/a", "7-1", "text/turtle", '<> <urn:p> "ü" .\n\n<> <urn:q> 1 .\n'.encode(), "7-1~tag")
GET = b"GET /a HTTP/1.1\r\nHost: x\r\n\r\n"
LARGE = 20_000


class App(Channel):
    def __init__(self, *first: Message, heartbeat_s: float = 60.0) -> None:
        super().__init__(*first)
        self.heartbeat_s = heartbeat_s
        self.returned = 0
        self.https: list[HttpProtocol] = []

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["path"] == "/plain":
            await send({"type": "http.response.start", "status": 200, "headers": [(b"content-length", b"5")]})
            await send({"type": "http.response.body", "body": b"plain"})
            return
        self.https.append(scope["extensions"][HTTP])
        fields = [(b"link", b"<x>; rel=y")]
        try:
            await serve_event_stream(scope, receive, send, fields, self.start, heartbeat_s=self.heartbeat_s)
        finally:
            self.returned += 1


async def reading(port: int, source: EventSource) -> AsyncGenerator[httpx.Response]:
    """Yield after the head and after each chunk."""
    async with httpx.AsyncClient() as http, http.stream("GET", f"http://127.0.0.1:{port}/a") as response:
        yield response
        async for text in response.aiter_text():
            source.feed(text)
            yield response


def messages(count: int) -> list[Message]:
    return [_message(number, b"%09d\n" % number + b"x" * LARGE) for number in range(count)]


def _message(number: int, body: bytes) -> Message:
    return Message("/a", str(number), "text/turtle", body, f"{number}~tag")


@pytest.mark.parametrize(
    ("body", "data"),
    [
        (b"one", "one"),
        (b"", ""),
        (b"a\nb\n", "a\nb\n"),
        (b"a\r\nb\rc\n\nd", "a\nb\nc\n\nd"),
        (b"\r\n", "\n"),
        (b" indented", " indented"),
        (b"a\n\nid: forged\ndata: forged\r\rdata: forged", "a\n\nid: forged\ndata: forged\n\ndata: forged"),
        (b": no comment", ": no comment"),
        ("Zeile\u2028Zeile\u0085\x0b\x0c".encode(), "Zeile\u2028Zeile\u0085\x0b\x0c"),
    ],
)
def test_framing(body: bytes, data: str) -> None:
    """9.2.5: nothing in a body breaks out of its event; its line ends come back as line feeds."""
    source = EventSource()
    message = _message(7, body)
    source.feed(message.frame_with(event_bytes).decode())
    size, _, rest = message.frame_with(chunk_bytes).partition(b"\r\n")
    assert (rest[: int(size, 16)], rest[int(size, 16) :]) == (message.frame_with(event_bytes), b"\r\n")
    assert source.events == [("7~tag", data)]
    assert source.last_event_id == "7~tag"
    assert message.frame_with(event_bytes) is message.frame_with(event_bytes)


async def test_stream_as_an_event_source_reads_it() -> None:
    app, source = App(TURTLE), EventSource()
    async with serving(app) as (_, port):
        chunks = reading(port, source)
        response = await anext(chunks)
        assert response.status_code == 200
        assert response.headers["content-type"] == "text/event-stream"
        assert response.headers["cache-control"] == "no-store, no-transform"
        assert response.headers["link"] == "<x>; rel=y"
        while not source.events:
            await anext(chunks)
        assert source.retry == 2000
        for number in range(3):
            app.publish(_message(number, b"%d" % number))
        while len(source.events) < 4:
            await anext(chunks)
        assert source.events == [
            ("7-1~tag", TURTLE.body.decode()), ("0~tag", "0"), ("1~tag", "1"), ("2~tag", "2"),
        ]  # fmt: skip
        await chunks.aclose()
        await until(lambda: app.returned)
        assert not app.outlets[0].writable()


@pytest.mark.parametrize(
    ("ending", "last"),
    [
        (Ending.CANCELLED, "cancelled"),
        (Ending.GONE, "cancelled"),
        (Ending.FINAL, "cancelled"),
        (Ending.REPLACED, "cancelled"),
        (Ending.SHUTDOWN, "7-1~tag"),
    ],
)
async def test_endings(ending: Ending, last: str) -> None:
    """The id that the client presents when it reconnects tells whether it may; pending messages are still sent."""
    app, source = App(TURTLE), EventSource()
    async with serving(app) as (_, port):
        chunks = reading(port, source)
        await anext(chunks)
        await until(lambda: app.outlets)
        app.outlets[0].end(ending)
        app.outlets[0].end(Ending.CANCELLED)
        app.outlets[0].write(TURTLE)
        async for _ in chunks:
            pass
        assert source.events == [("7-1~tag", TURTLE.body.decode())]
        assert source.last_event_id == last
        assert (source.retry < 2000) == (ending is Ending.SHUTDOWN)
        await until(lambda: app.returned)


async def test_bytes_on_the_wire_are_the_stream_in_http() -> None:
    """RFC 9112, 7.1: an independent parser finds one whole body, and a reusable connection."""
    app, sent = App(TURTLE), [_message(number, b"x" * number) for number in range(300)]
    async with serving(app) as (_, port):
        reader, writer = await connect(port, GET)
        await until(lambda: app.outlets)
        for message in sent:
            app.outlets[0].write(message)
        app.outlets[0].end(Ending.CANCELLED)
        client = h11.Connection(h11.CLIENT)
        client.send(h11.Request(method="GET", target="/a", headers=[("host", "x")]))
        client.send(h11.EndOfMessage())
        body = b""
        while not isinstance(event := client.next_event(), h11.EndOfMessage):
            if event is h11.NEED_DATA:
                client.receive_data(await reader.read(65536))
            elif isinstance(event, h11.Data):
                body += event.data
        events = b"".join(map(event_bytes, [TURTLE, *sent]))
        assert body == b": linked fleet\nretry: 2000\n" + events + b"id: cancelled\n\n"
        assert client.states == {h11.CLIENT: h11.DONE, h11.SERVER: h11.DONE}
        writer.transport.abort()


async def test_http_1_0_has_no_chunks() -> None:
    app = App(TURTLE, heartbeat_s=0.01)
    async with serving(app) as (_, port):
        reader, writer = await connect(port, GET.replace(b"HTTP/1.1", b"HTTP/1.0"))
        assert b"chunked" not in await reader.readuntil(b"\r\n\r\n")
        opening = b": linked fleet\nretry: 2000\n"
        assert await reader.readexactly(len(opening)) == opening
        assert await reader.readexactly(len(event_bytes(TURTLE))) == event_bytes(TURTLE)
        assert await reader.readexactly(2) == b":\n"
        app.outlets[0].end(Ending.CANCELLED)
        assert (await reader.read()).replace(b":\n", b"") == b"id: cancelled\n\n"
        writer.transport.abort()


async def test_connection_is_kept_after_the_end() -> None:
    app = App(TURTLE)
    async with serving(app) as (_, port):
        reader, writer = await connect(port, GET + GET.replace(b"/a", b"/plain"))
        await until(lambda: app.outlets)
        app.outlets[0].end(Ending.CANCELLED)
        assert b"id: cancelled\n\n" in await reader.readuntil(b"\r\n0\r\n\r\n")
        assert (await reader.readuntil(b"plain")).startswith(b"HTTP/1.1 200")
        writer.transport.abort()


async def test_heartbeat_leaves_the_last_event_id_alone() -> None:
    app, source = App(heartbeat_s=0.01), EventSource()
    source.last_event_id = "from an earlier connection"
    async with serving(app) as (_, port):
        chunks = reading(port, source)
        while source.comments < 5:
            await anext(chunks)
        assert (source.last_event_id, source.events) == ("from an earlier connection", [])
        app.publish(TURTLE)
        while not source.events:
            await anext(chunks)
        assert source.events == [("7-1~tag", TURTLE.body.decode())]
        await chunks.aclose()


@pytest.mark.parametrize("reset", [True, False])
async def test_disconnect(reset: bool) -> None:
    app = App(TURTLE)
    async with serving(app) as (server, port):
        _, writer = await connect(port, GET)
        await until(lambda: app.outlets)
        if reset:
            sock = writer.get_extra_info("socket")
            sock.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        writer.transport.abort()
        await until(lambda: app.returned and not server.server_state.connections)
        app.outlets[0].write(TURTLE)
        app.outlets[0].end(Ending.CANCELLED)


async def test_disconnect_while_another_request_waits_behind_the_stream() -> None:
    app = App(TURTLE)
    async with serving(app) as (server, port):
        _, writer = await connect(port, GET + GET.replace(b"/a", b"/plain"))
        await until(lambda: app.outlets)
        writer.transport.abort()
        await until(lambda: app.returned and not server.server_state.connections)


async def test_a_bad_request_behind_a_stream_writes_nothing_into_it() -> None:
    app = App(TURTLE)
    async with serving(app) as (server, port):
        reader, writer = await connect(port, GET)
        await reader.readuntil(TURTLE.frame_with(chunk_bytes))
        writer.write(GET.replace(b"/a", b"/plain") + b"no request\r\n\r\n")
        with contextlib.suppress(ConnectionError):
            assert await reader.read() == b""
        await until(lambda: app.returned and not server.server_state.connections)
        writer.transport.abort()


async def test_a_stalled_reader_delays_nobody_and_ends_with_the_latest_state() -> None:
    app, source = App(), EventSource()
    async with serving(app) as (_, port):
        slow_reader, slow_writer = await connect(port, GET, receive_buffer=8192)
        await until(lambda: app.outlets)
        (slow,), (http,) = app.outlets, app.https
        chunks = reading(port, source)
        await anext(chunks)
        await until(lambda: len(app.outlets) == 2)
        for message in messages(60):
            app.publish(message)
            while len(source.events) <= int(message.version):
                await anext(chunks)
            assert http.transport.get_write_buffer_size() < HIGH_WATER_BYTES + LARGE + 100
        await fill(slow, message)
        readies = app.readies[slow]
        behind = asyncio.create_task(_read_until(slow_reader, b"latest\n\n\r\n"))
        await until(lambda: app.readies[slow] > readies)
        assert slow.writable()
        slow.write(_message(61, b"latest"))
        await behind
        slow_writer.transport.abort()
        await chunks.aclose()


async def _read_until(reader: asyncio.StreamReader, end: bytes) -> None:
    while not (await reader.read(65536)).endswith(end):
        pass


class Impatient(HttpProtocol):
    stall_s = 0.1


async def _stalled(app: App, port: int) -> asyncio.StreamWriter:
    _, writer = await connect(port, GET, receive_buffer=8192)
    await until(lambda: app.outlets)
    await fill(app.outlets[0], messages(1)[0])
    return writer


@pytest.mark.parametrize("half_closed", [False, True])
async def test_a_stalled_reader_is_disconnected(half_closed: bool) -> None:
    app = App(heartbeat_s=0.01)
    async with serving(app, http=Impatient) as (server, port):
        writer = await _stalled(app, port)
        if half_closed:
            writer.write_eof()
        await until(lambda: app.returned and not server.server_state.connections)
        writer.transport.abort()


async def test_an_unread_plain_response_is_dropped() -> None:
    async def app(scope: Scope, receive: Receive, send: Send) -> None:
        await send({"type": "http.response.start", "status": 200, "headers": []})
        for _ in range(100):
            await send({"type": "http.response.body", "body": bytes(LARGE), "more_body": True})
        await send({"type": "http.response.body", "body": b""})

    async with serving(app, http=Impatient) as (server, port):
        _, writer = await connect(port, GET, receive_buffer=8192)
        await until(lambda: server.server_state.tasks)
        await until(lambda: not server.server_state.connections)
        writer.transport.abort()


async def test_shutdown_ends_streams_and_waits_for_nobody(caplog: pytest.LogCaptureFixture) -> None:
    """Without an id of its own, so that an EventSource reconnects; and without an error in the log."""
    app, source = App(TURTLE), EventSource()
    async with serving(app) as (server, port):
        stalled = await _stalled(app, port)
        chunks = reading(port, source)
        await anext(chunks)
        await until(lambda: len(app.outlets) == 2)
        server.should_exit = True
        async for _ in chunks:
            pass
        assert source.last_event_id == "7-1~tag"
        await until(lambda: app.returned == 2)
        stalled.transport.abort()
    assert not [record for record in caplog.records if record.levelname == "ERROR"]
