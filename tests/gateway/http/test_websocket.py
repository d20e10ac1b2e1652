"""RFC 6455 in the gateway's channel: it only sends, and no slow, dead or hostile reader costs much."""

import asyncio
import base64
import itertools
import socket
import struct
from asyncio.transports import BaseTransport
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import NoReturn

import pytest
from starlette.types import Receive, Scope, Send
from starlette.websockets import WebSocket
from websockets.asyncio.client import ClientConnection
from websockets.asyncio.client import connect as client
from websockets.exceptions import ConnectionClosed
from websockets.frames import Frame, Opcode

from linked_fleet_gateway.http.websocket import frame_bytes, serve_websocket
from linked_fleet_gateway.subscriptions.broadcast import Ending, Message, Outlet
from linked_fleet_server.connection_limits import HIGH_WATER_BYTES, MAX_HEAD_BYTES, BoundedWriter
from linked_fleet_server.websocket_protocol import WEBSOCKET, WebSocketProtocol
from serving import Channel, connect, fill, serving, until

pytestmark = pytest.mark.virtual
TURTLE = Message("/a", "1", "text/turtle", '<> <urn:p> "ü" .\n'.encode(), "1~tag")
LARGE = 20_000


class Impatient(WebSocketProtocol):
    stall_s = 0.1
    grace_s = 0.1


class App(Channel):
    """Serves every request as a subscription, and records the protocols."""

    def __init__(self, *first: Message) -> None:
        super().__init__(*first)
        self.protocols: list[WebSocketProtocol] = []
        self.returned = 0

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] == "http":
            await send({"type": "http.response.start", "status": 200, "headers": [(b"content-length", b"5")]})
            await send({"type": "http.response.body", "body": b"plain"})
            return
        self.protocols.append(scope["extensions"][WEBSOCKET])
        wanted = scope["subprotocols"][0] if scope["subprotocols"] else None
        try:
            await serve_websocket(WebSocket(scope, receive, send), wanted, [(b"link", b"<x>; rel=y")], self.start)
        finally:
            self.returned += 1


@asynccontextmanager
async def subscribed(app: App, **options: object) -> AsyncIterator[ClientConnection]:
    async with serving(app) as (_, port), client(f"ws://127.0.0.1:{port}/a", **options) as websocket:
        yield websocket


def handshake(**extra: str) -> bytes:
    fields = {"Host": "x", "Upgrade": "websocket", "Connection": "Upgrade", "Sec-WebSocket-Version": "13",
              "Sec-WebSocket-Key": base64.b64encode(bytes(16)).decode(), **extra}  # fmt: skip
    return "".join(
        ["GET /a HTTP/1.1\r\n", *(f"{name}: {value}\r\n" for name, value in fields.items()), "\r\n"]
    ).encode()


def masked(opcode: Opcode, data: bytes, fin: bool = True) -> bytes:
    return Frame(opcode, data, fin).serialize(mask=True)


def messages(count: int, size: int = LARGE) -> list[Message]:
    return [
        Message("/a", str(number), "text/turtle", b"%09d" % number + b"x" * size, f"{number}~tag")
        for number in range(count)
    ]


async def test_first_message_and_fields() -> None:
    async with subscribed(App(TURTLE), subprotocols=["lf.turtle", "lf.jsonld"]) as websocket:
        assert await websocket.recv() == TURTLE.body.decode()
        assert websocket.subprotocol == "lf.turtle"
        assert websocket.response is not None
        assert websocket.response.headers["link"] == "<x>; rel=y"
        assert "sec-websocket-extensions" not in websocket.response.headers


async def test_agents_frames_are_binary() -> None:
    body = b"\x00\xff"
    async with subscribed(App(Message("/a", "1", "application/vnd.linked-fleet.frame", body, "1~tag"))) as websocket:
        assert await websocket.recv() == body


@pytest.mark.parametrize("size", [0, 125, 126, 65535, 65536])
async def test_every_length_of_a_frame(size: int) -> None:
    async with subscribed(App(Message("/a", "1", "text/turtle", b"x" * size, "1~tag"))) as websocket:
        assert await websocket.recv() == "x" * size


async def test_framed_once_for_all() -> None:
    written: list[bytes] = []

    class Noted(BoundedWriter):
        def send(self, data: bytes) -> bool:
            written.append(data)
            return super().send(data)

    class Noting(WebSocketProtocol):
        def connection_made(self, transport: BaseTransport) -> None:
            super().connection_made(transport)
            self.writer = Noted(self.transport, self.stall_s)

    app = App()
    async with serving(app, ws=Noting) as (_, port):
        clients = [await client(f"ws://127.0.0.1:{port}/") for _ in range(5)]
        await until(lambda: len(app.outlets) == 5)
        app.publish(TURTLE)
        assert [await one.recv() for one in clients] == [TURTLE.body.decode()] * 5
        for one in clients:
            await one.close()
    assert len(written) == 5
    assert all(data is TURTLE.frame_with(frame_bytes) for data in written)


async def test_ping_is_answered_while_the_application_is_busy() -> None:
    """5.5.3: the same payload comes back, whatever the application does."""

    class Busy(App):
        async def start(self, outlet: Outlet) -> NoReturn:
            await asyncio.Event().wait()
            raise AssertionError

    async with serving(Busy()) as (_, port):
        reader, writer = await connect(port, handshake())
        await reader.readuntil(b"\r\n\r\n")
        for payload in (b"", b"payload", b"x" * 125):
            writer.write(masked(Opcode.PING, payload))
            pong = Frame(Opcode.PONG, payload).serialize(mask=False)
            assert await reader.readexactly(len(pong)) == pong
        writer.transport.abort()


@pytest.mark.parametrize(("code", "reason"), [(1000, "done"), (1001, ""), (4999, "ours")])
async def test_the_clients_close_is_echoed(code: int, reason: str) -> None:
    app = App(TURTLE)
    async with subscribed(app) as websocket:
        await websocket.recv()
        await websocket.close(code, reason)
        assert (websocket.protocol.close_rcvd.code, websocket.protocol.close_rcvd.reason) == (code, reason)
        await until(lambda: app.returned)
        assert not app.outlets[0].writable()
        app.outlets[0].write(TURTLE)
        app.outlets[0].end(Ending.CANCELLED)


TEXT, BINARY, CONT, PING, CLOSE = Opcode.TEXT, Opcode.BINARY, Opcode.CONT, Opcode.PING, Opcode.CLOSE


@pytest.mark.parametrize(
    ("sent", "code"),
    [
        (masked(TEXT, b"hello"), 1003),
        (masked(TEXT, b""), 1003),
        (masked(BINARY, b"\x00\xff"), 1003),
        (masked(TEXT, b"hel", fin=False), 1003),
        (masked(TEXT, b"hel", fin=False) + masked(PING, b"") + masked(CONT, b"lo"), 1003),
        (masked(BINARY, b"", fin=False) + masked(CONT, b"", fin=False) * 1000, 1003),
        (masked(TEXT, b"x" * 4096), 1003),
        (masked(TEXT, b"x" * 4097), 1009),
        (masked(BINARY, b"x" * 1_000_000), 1009),
        (masked(TEXT, b"x" * 4000, fin=False) + masked(CONT, b"x" * 97), 1009),
        (struct.pack("!BBQ", 0x82, 0xFF, 2**62), 1009),
        (masked(TEXT, b"\xff"), 1007),
        (masked(CLOSE, struct.pack("!H", 1000) + b"\xff"), 1007),
        (Frame(TEXT, b"unmasked").serialize(mask=False), 1002),
        (masked(CONT, b"of what?"), 1002),
        (b"\x83\x80\0\0\0\0", 1002),  # an unknown opcode
        (b"\xc1\x80\0\0\0\0", 1002),  # compressed, though no extension was negotiated
        (b"\x09\x80\0\0\0\0", 1002),  # a fragmented ping
        (b"\x89\xfe\0\x7e" + bytes(130), 1002),  # a ping of 126 bytes
        (masked(CLOSE, b"\x03"), 1002),  # half a code
        (masked(CLOSE, struct.pack("!H", 1005)), 1002),  # a code that must not be sent
        (masked(TEXT, b"hello") + Frame(TEXT, b"unmasked").serialize(mask=False), 1002),
    ],
    ids=map(str, itertools.count()),  # masks are random, but test names must not be
)
async def test_invalid_client_frames_close_the_connection(sent: bytes, code: int) -> None:
    """7.4.1; the close frame arrives although the server reads nothing more, and nothing follows it."""
    app = App(TURTLE)
    async with serving(app, ws=Impatient) as (_, port):
        reader, writer = await connect(port, handshake())
        await reader.readuntil(b"\r\n\r\n")
        await reader.readexactly(len(TURTLE.frame_with(frame_bytes)))
        writer.write(sent)
        head = await reader.readexactly(2)
        if head[0] == 0x8A:  # the pong
            head = await reader.readexactly(2)
        closing = await reader.readexactly(head[1])
        assert (head[0], int.from_bytes(closing[:2])) == (0x88, code)
        assert code != 1003 or closing[2:] == b"this channel only sends"
        assert await reader.read() == b""
        await until(lambda: app.returned)
        writer.close()


@pytest.mark.parametrize(
    ("ending", "code"),
    [(Ending.CANCELLED, 1000), (Ending.GONE, 4404), (Ending.REPLACED, 4409), (Ending.SHUTDOWN, 1012)],
)
async def test_endings(ending: Ending, code: int) -> None:
    app = App(TURTLE)
    async with subscribed(app) as websocket:
        await websocket.recv()
        app.outlets[0].end(ending)
        app.outlets[0].end(ending)
        app.outlets[0].write(TURTLE)
        with pytest.raises(ConnectionClosed) as closed:
            await websocket.recv()
        assert closed.value.rcvd is not None
        assert (closed.value.rcvd.code, closed.value.rcvd.reason) == (code, ending.value)
        await until(lambda: app.returned)


@pytest.mark.parametrize("linger", [True, False])
async def test_abrupt_disconnect(linger: bool) -> None:
    """A reset, and an end of the stream without a close frame."""
    app = App(TURTLE)
    async with serving(app) as (server, port):
        reader, writer = await connect(port, handshake())
        await reader.readuntil(b"\r\n\r\n")
        await until(lambda: app.outlets)
        if linger:
            sock = writer.get_extra_info("socket")
            sock.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        writer.transport.abort()
        await until(lambda: app.returned and not server.server_state.connections)


async def test_a_stalled_reader_delays_nobody_and_ends_with_the_latest_state() -> None:
    app = App()
    async with serving(app) as (_, port):
        reader, writer = await connect(port, handshake(), receive_buffer=8192)
        await reader.readuntil(b"\r\n\r\n")
        await until(lambda: app.outlets)
        (slow,), (protocol,) = app.outlets, app.protocols
        others = [await client(f"ws://127.0.0.1:{port}/") for _ in range(49)]
        await until(lambda: len(app.outlets) == 50)
        for message in messages(60):
            app.publish(message)
            assert [(await one.recv())[:9] for one in others] == [f"{int(message.version):09}"] * 49
            assert protocol.transport.get_write_buffer_size() < HIGH_WATER_BYTES + LARGE + 20
        await fill(slow, message)
        readies = app.readies[slow]
        reading = asyncio.create_task(_last_message(reader, b"latest"))
        await until(lambda: app.readies[slow] > readies)
        assert slow.writable()
        slow.write(Message("/a", "61", "text/turtle", b"latest", "61~tag"))
        await reading
        for one in others:
            await one.close()
        writer.transport.abort()


async def _last_message(reader: asyncio.StreamReader, body: bytes) -> None:
    while not (await reader.read(65536)).endswith(body):
        pass


async def _stalled(app: App, port: int) -> asyncio.StreamWriter:
    """Return a client that stopped reading, with bytes waiting in the process."""
    reader, writer = await connect(port, handshake(), receive_buffer=8192)
    await reader.readuntil(b"\r\n\r\n")
    await until(lambda: app.outlets)
    await fill(app.outlets[0], messages(1)[0])
    return writer


async def test_a_stalled_websocket_is_disconnected() -> None:
    app = App()
    async with serving(app, ws=Impatient) as (server, port):
        writer = await _stalled(app, port)
        await until(lambda: app.returned and not server.server_state.connections)
        writer.transport.abort()


class Short(WebSocketProtocol):
    grace_s = 0.1


@pytest.mark.parametrize("leave", ["server ends", "client closes", "client sends text", "client half-closes"])
async def test_a_stalled_reader_cannot_keep_a_connection_that_is_over(leave: str) -> None:
    app = App()
    async with serving(app, ws=Short) as (server, port):
        writer = await _stalled(app, port)
        if leave == "server ends":
            app.outlets[0].end(Ending.CANCELLED)
        elif leave == "client half-closes":
            writer.write_eof()
        else:
            writer.write(masked(CLOSE, b"") if leave == "client closes" else masked(TEXT, b"x"))
        await until(lambda: app.returned and not server.server_state.connections)
        writer.transport.abort()


async def test_keepalive_spares_slow_readers_and_drops_silent_ones() -> None:
    """A ping behind 64 KiB is not late; a lone one is."""
    app = App()
    async with serving(app, ws_ping_interval=0.02) as (server, port):
        stalled = await _stalled(app, port)
        reader, writer = await connect(port, handshake())
        assert b"\x88\x18\x03\xf3keepalive ping timeout" in await reader.read()
        waiting = app.protocols[0].transport.get_write_buffer_size
        before = waiting()
        await until(lambda: waiting() > before + 3 * len(masked(PING, bytes(4))))
        assert app.protocols[0].is_open
        stalled.transport.abort()
        writer.transport.abort()
        await until(lambda: not server.server_state.connections)


async def test_a_client_that_answers_pings_stays() -> None:
    app = App()
    async with serving(app, ws_ping_interval=0.02) as (_, port), client(f"ws://127.0.0.1:{port}/a") as websocket:
        await until(lambda: app.outlets)
        await asyncio.sleep(0.2)
        app.publish(TURTLE)
        assert await websocket.recv() == TURTLE.body.decode()


async def test_shutdown_closes_all_and_waits_for_nobody() -> None:
    """1012, service restart: clients should reconnect; one that does not read is disconnected."""
    app = App()
    async with serving(app) as (server, port):
        stalled = await _stalled(app, port)
        websocket = await client(f"ws://127.0.0.1:{port}/")
        server.should_exit = True
        await until(lambda: app.returned == 2 and not server.server_state.connections)
        with pytest.raises(ConnectionClosed):
            await websocket.recv()
        assert websocket.protocol.close_rcvd.code == 1012
        stalled.transport.abort()


async def test_failure_of_the_subscription_is_said() -> None:
    class Failing(App):
        async def start(self, outlet: Outlet) -> NoReturn:
            raise LookupError("no such thing")

    app = Failing()
    async with subscribed(app) as websocket:
        with pytest.raises(ConnectionClosed):
            await websocket.recv()
        assert websocket.protocol.close_rcvd.code == 1011


@pytest.mark.parametrize(
    ("request_", "answer"),
    [
        (handshake(**{"X": "y" * MAX_HEAD_BYTES * 2}), b"431"),
        (handshake(**{"X": "y" * (MAX_HEAD_BYTES // 2)}), b"101"),
        (handshake(**{"Sec-WebSocket-Version": "12"}), b"400"),
        (handshake(**{"Sec-WebSocket-Key": "short"}), b"400"),
        (handshake().replace(b"GET", b"POST"), b"200"),
        (handshake().replace(b"HTTP/1.1", b"HTTP/1.0"), b"200"),
        (handshake(**{"Content-Length": "3"}) + b"abc", b"200"),
        (handshake().replace(b"Sec-WebSocket-Key", b"X-Key"), b"200"),
    ],
)
async def test_bad_handshakes_are_answered(request_: bytes, answer: bytes) -> None:
    """4.2.2, and RFC 9110, 7.8: an invalid opening handshake is an ordinary request."""
    async with serving(App()) as (_, port):
        reader, writer = await connect(port, request_)
        assert (await reader.readline()).split()[1] == answer
        writer.transport.abort()


async def test_frames_before_the_answer() -> None:
    """4.1: a client waits for the response; one that does not loses the connection and harms nothing."""
    entered, proceed = asyncio.Event(), asyncio.Event()

    async def app(scope: Scope, receive: Receive, send: Send) -> None:
        entered.set()
        await proceed.wait()
        await serve_websocket(WebSocket(scope, receive, send), None, [], channel.start)

    channel = Channel(TURTLE)
    async with serving(app) as (server, port):
        reader, writer = await connect(port, handshake())
        await entered.wait()
        writer.write(masked(TEXT, b"early"))
        with pytest.raises(ConnectionError):
            assert await reader.read() == b""
            raise ConnectionResetError
        proceed.set()
        await until(lambda: not server.server_state.tasks and not server.server_state.connections)
        assert not channel.outlets
        writer.transport.abort()


async def test_frames_with_the_handshake() -> None:
    """4.1: a client that does not wait for the response loses the connection, and its frames are not dropped."""
    app = App()
    async with serving(app) as (server, port):
        reader, writer = await connect(port, handshake() + masked(TEXT, b"early"))
        with pytest.raises(ConnectionError):
            await reader.read()
        await until(lambda: not server.server_state.connections)
        assert not app.protocols
        writer.transport.abort()


@pytest.mark.parametrize("failure", [LookupError("no such thing"), None])
async def test_an_application_that_does_not_answer_the_handshake(failure: Exception | None) -> None:
    async def app(scope: Scope, receive: Receive, send: Send) -> None:
        if failure is not None:
            raise failure

    async with serving(app) as (server, port):
        reader, writer = await connect(port, handshake())
        assert (await reader.read()).startswith(b"HTTP/1.1 500")
        await until(lambda: not server.server_state.connections)
        writer.transport.abort()


async def test_shutdown_during_the_handshake() -> None:
    entered = asyncio.Event()

    async def app(scope: Scope, receive: Receive, send: Send) -> None:
        entered.set()
        assert (await receive())["type"] == "websocket.connect"
        assert (await receive())["type"] == "websocket.disconnect"
        await send({"type": "websocket.accept"})

    async with serving(app) as (server, port):
        reader, writer = await connect(port, handshake())
        await entered.wait()
        server.should_exit = True
        assert (await reader.read()).startswith(b"HTTP/1.1 503")
        writer.transport.abort()
