"""TLS below the gateway's protocol classes: buffered bytes are noticed, certificates are replaced without a restart."""

import asyncio
import logging
import socket
import ssl
import subprocess
from functools import partial
from pathlib import Path
from typing import Any

import pytest
from starlette.types import Receive, Scope, Send
from starlette.websockets import WebSocket
from websockets.asyncio.client import connect as client

from certificates import made
from linked_fleet_gateway.http.event_stream import serve_event_stream
from linked_fleet_gateway.http.websocket import serve_websocket
from linked_fleet_gateway.subscriptions.broadcast import Message
from linked_fleet_runtime.background import supervised
from linked_fleet_server.connection_limits import HIGH_WATER_BYTES, Sockets
from linked_fleet_server.protocol import HTTP, HttpProtocol
from linked_fleet_server.tls import HANDSHAKE_S, Certificate, tls_protocol_factory, unsent_bytes
from linked_fleet_server.websocket_protocol import WEBSOCKET, WebSocketProtocol
from serving import Channel, fill, run_on_sockets, serving, until

LARGE = 20_000
PLENTY = Sockets(1000, 1000)
pytestmark = pytest.mark.processes


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return two key pairs for this machine, from one authority."""
    folder = made(tmp_path_factory.mktemp("tls"), "--router", "127.0.0.1", "--gateway", "127.0.0.1")
    for name in ("used.pem", "used.key"):
        (folder / name).write_bytes((folder / name.replace("used", "router")).read_bytes())
    return folder


@pytest.fixture
def certificate(folder: Path) -> Certificate:
    return Certificate(str(folder / "router.pem"), str(folder / "router.key"))


class App(Channel):
    def __init__(self) -> None:
        super().__init__()
        self.transports: list[asyncio.Transport] = []
        self.schemes: list[str] = []
        self.returned = 0

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        self.schemes.append(scope["scheme"])
        kind = HTTP if scope["type"] == "http" else WEBSOCKET
        self.transports.append(scope["extensions"][kind].transport)
        try:
            if kind == HTTP:
                await serve_event_stream(scope, receive, send, [], self.start)
            else:
                await serve_websocket(WebSocket(scope, receive, send), None, [], self.start)
        finally:
            self.returned += 1


class ImpatientHttp(HttpProtocol):
    stall_s = 0.1


class ImpatientWebSocket(WebSocketProtocol):
    stall_s = 0.1


EVENTS = b"GET /a HTTP/1.1\r\nHost: x\r\nAccept: text/event-stream\r\n\r\n"
UPGRADE = (
    b"GET /a HTTP/1.1\r\nHost: x\r\nUpgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Version: 13\r\n"
    b"Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\n\r\n"
)


def _opened(port: int, folder: Path, request: bytes) -> ssl.SSLSocket:
    """Connect a client that has sent its request and does not read by itself."""
    sock = socket.socket()
    sock.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 8192)
    sock.settimeout(20)
    sock.connect(("127.0.0.1", port))
    secure = ssl.create_default_context(cafile=folder / "ca.pem").wrap_socket(sock, server_hostname="127.0.0.1")
    secure.sendall(request)
    return secure


def _large(number: int) -> Message:
    return Message("/a", str(number), "text/turtle", b"%09d" % number + b"x" * LARGE, "x~tag")


async def _fill(app: App) -> None:
    """Write until the only reader accepts no more for a good while."""
    (outlet,) = app.outlets
    for _ in range(100):
        await fill(outlet, _large(0))
        await asyncio.sleep(0.001)
    await fill(outlet, _large(0))


@pytest.mark.parametrize("request_", [EVENTS, UPGRADE], ids=["events", "websocket"])
def test_a_stalled_reader_over_tls_is_disconnected_at_bounded_cost(
    folder: Path, certificate: Certificate, request_: bytes
) -> None:
    async def test() -> None:
        app = App()
        http = tls_protocol_factory(ImpatientHttp, certificate, PLENTY)
        async with serving(app, http=http, ws=ImpatientWebSocket) as (server, port):
            with await asyncio.to_thread(_opened, port, folder, request_):
                await until(lambda: app.outlets)
                (outlet,), (transport,) = app.outlets, app.transports
                number = highest = 0
                while not (app.returned or transport.is_closing()):
                    if outlet.writable():
                        outlet.write(_large(number := number + 1))
                    highest = max(highest, unsent_bytes(transport))
                    await asyncio.sleep(0.001)
                assert 0 < highest < 2 * (HIGH_WATER_BYTES + LARGE) + 1000
                await until(lambda: not server.server_state.connections)
            assert app.schemes == ["https" if request_ is EVENTS else "wss"]

    run_on_sockets(test)


def test_encrypted_bytes_in_the_buffer_are_counted(folder: Path, certificate: Certificate) -> None:
    """If a reader stalls near the end, nothing is buffered above TLS; it is disconnected nevertheless."""

    async def test() -> None:
        app = App()
        async with serving(
            app, http=tls_protocol_factory(HttpProtocol, certificate, PLENTY), ws=ImpatientWebSocket
        ) as (_, port):
            with await asyncio.to_thread(_opened, port, folder, UPGRADE):
                await until(lambda: app.outlets)
                (outlet,), (transport,) = app.outlets, app.transports
                number = 0
                while not unsent_bytes(transport):
                    outlet.write(_large(number := number + 1))
                    await asyncio.sleep(0.01)
                assert transport.get_write_buffer_size() == 0
                await until(lambda: app.returned)

    run_on_sockets(test)


def test_a_reader_that_catches_up_has_the_latest(folder: Path, certificate: Certificate) -> None:
    async def test() -> None:
        app = App()
        async with serving(app, http=tls_protocol_factory(HttpProtocol, certificate, PLENTY)) as (_, port):
            with await asyncio.to_thread(_opened, port, folder, UPGRADE) as slow:
                await until(lambda: app.outlets)
                (outlet,) = app.outlets
                await _fill(app)
                readies = app.readies[outlet]
                reading = asyncio.create_task(asyncio.to_thread(_read_until, slow, b"latest"))
                await until(lambda: app.readies[outlet] > readies and outlet.writable())
                outlet.write(Message("/a", "x", "text/turtle", b"latest", "x~tag"))
                await reading

    run_on_sockets(test)


def _read_until(sock: ssl.SSLSocket, end: bytes) -> None:
    data = b""
    while not data.endswith(end):
        more = sock.recv(65536)
        assert more
        data = (data + more)[-64:]


def test_fifty_hear_the_same_and_are_told_of_the_end(folder: Path, certificate: Certificate) -> None:
    async def test() -> None:
        app, trusted = App(), ssl.create_default_context(cafile=folder / "ca.pem")
        async with serving(app, http=tls_protocol_factory(HttpProtocol, certificate, PLENTY)) as (server, port):
            sockets = [await client(f"wss://127.0.0.1:{port}/a", ssl=trusted) for _ in range(50)]
            await until(lambda: len(app.outlets) == 50)
            for number in range(20):
                assert len(app.publish(_large(number))) == 50
                assert {(await each.recv())[:9] for each in sockets} == {f"{number:09}"}
            server.should_exit = True
            for each in sockets:
                await each.wait_closed()
            assert {each.close_code for each in sockets} == {1012}

    run_on_sockets(test)


def test_a_certificate_is_replaced_while_it_is_in_use(folder: Path) -> None:
    """New connections use the new one; files that do not match each other change nothing."""
    used = Certificate(str(folder / "used.pem"), str(folder / "used.key"))

    def shown(port: int) -> str:
        with _opened(port, folder, EVENTS) as sock:
            subject: Any = (sock.getpeercert() or {})["subject"]
            (((_, name),),) = subject
            return str(name)

    async def test() -> None:
        async with serving(App(), http=tls_protocol_factory(HttpProtocol, used, PLENTY)) as (_, port):
            assert await asyncio.to_thread(shown, port) == "router"
            for name, expected in (("used.pem", "router"), ("used.key", "gateway")):
                fresh = folder / "fresh"
                fresh.write_bytes((folder / name.replace("used", "gateway")).read_bytes())
                fresh.replace(folder / name)
                used.reload()
                assert await asyncio.to_thread(shown, port) == expected

    run_on_sockets(test)


@pytest.mark.parametrize("kinds", [("ec", "rsa"), ("rsa", "ec")])
def test_a_certificate_is_replaced_by_one_with_a_key_of_another_kind(kinds: tuple[str, str], tmp_path: Path) -> None:
    """A context of OpenSSL keeps one certificate for each kind of key, and would go on to show the old one."""
    old, new = (_self_signed(kind, tmp_path / kind) for kind in kinds)
    pair = tmp_path / "used.pem", tmp_path / "used.key"

    def put(folder: Path) -> None:
        for file in pair:
            file.write_bytes((folder / file.name).read_bytes())

    def shown(port: int) -> str:
        return ssl.get_server_certificate(("127.0.0.1", port), timeout=20)

    async def test() -> None:
        put(old)
        used = Certificate(*map(str, pair))
        async with serving(App(), http=tls_protocol_factory(HttpProtocol, used, PLENTY)) as (_, port):
            assert await asyncio.to_thread(shown, port) == (old / "used.pem").read_text()
            put(new)
            used.reload()
            assert await asyncio.to_thread(shown, port) == (new / "used.pem").read_text()

    run_on_sockets(test)


def _self_signed(kind: str, folder: Path) -> Path:
    folder.mkdir()
    more = ["-pkeyopt", "ec_paramgen_curve:P-256"] if kind == "ec" else []
    subprocess.run(
        ["openssl", "req", "-x509", "-nodes", "-newkey", {"ec": "ec", "rsa": "rsa:2048"}[kind], *more,
         "-subj", f"/CN={kind}", "-days", "1", "-keyout", "used.key", "-out", "used.pem"],
        cwd=folder, check=True, capture_output=True,
    )  # fmt: skip
    return folder


def test_files_that_change_are_noticed(folder: Path, tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    """A new certificate without its key is not used yet."""
    pair = {ending: tmp_path / f"used.{ending}" for ending in ("pem", "key")}

    def put(name: str, ending: str) -> None:
        pair[ending].write_bytes((folder / f"{name}.{ending}").read_bytes())

    async def test() -> None:
        for ending in pair:
            put("router", ending)
        used = Certificate(str(pair["pem"]), str(pair["key"]))
        following = supervised(used.reload_if_changed, "follow", logging.getLogger(__name__), "it fails", 0.01)
        with caplog.at_level("INFO", "linked_fleet_server.tls"):
            put("gateway", "pem")
            await until(lambda: "the certificate in use stays" in caplog.text)
            assert "new connections" not in caplog.text
            put("gateway", "key")
            await until(lambda: "new connections get the certificate" in caplog.text)
        following.cancel()

    run_on_sockets(test)


def test_connections_without_a_handshake_take_places(folder: Path, certificate: Certificate) -> None:
    """The limit closes the connections that have waited longest, like idle ones."""
    places = Sockets(3, 3)

    async def test() -> None:
        http = tls_protocol_factory(partial(HttpProtocol, sockets=places), certificate, places)
        async with serving(App(), http=http) as (_, port):
            silent = [await asyncio.open_connection("127.0.0.1", port) for _ in range(10)]
            try:
                async with asyncio.timeout(HANDSHAKE_S / 2):
                    await until(lambda: sum(reader.at_eof() for reader, _ in silent) == 7)
                with await asyncio.to_thread(_opened, port, folder, EVENTS) as client:
                    assert (await asyncio.to_thread(client.recv, 100)).startswith(b"HTTP/1.1 200")
                    assert len(places) == 3
            finally:
                for _, writer in silent:
                    writer.close()
            await until(lambda: len(places) == 0)

    run_on_sockets(test)


def test_no_old_tls_and_nothing_in_the_clear(folder: Path, certificate: Certificate) -> None:
    async def test() -> None:
        async with serving(App(), http=tls_protocol_factory(HttpProtocol, certificate, PLENTY)) as (server, port):
            old = ssl.create_default_context(cafile=folder / "ca.pem")
            with pytest.warns(DeprecationWarning):
                old.minimum_version = ssl.TLSVersion.TLSv1
                old.maximum_version = ssl.TLSVersion.TLSv1_1
            with pytest.raises(OSError):
                await asyncio.open_connection("127.0.0.1", port, ssl=old, server_hostname="127.0.0.1")
            reader, writer = await asyncio.open_connection("127.0.0.1", port)
            writer.write(EVENTS)
            assert b"HTTP" not in await reader.read()
            writer.close()
            assert not server.server_state.connections

    run_on_sockets(test)
