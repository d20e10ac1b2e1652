"""R1.8 in the long run: subscriptions that come and go leave nothing behind in the gateway or in Redis."""

import asyncio
import itertools
import re
from collections.abc import AsyncIterator, Awaitable, Callable, Iterator
from contextlib import asynccontextmanager
from pathlib import Path
from urllib.parse import urlsplit

import pytest
import redis
from websockets.frames import Frame, Opcode

from browser import HYBRIT, LDP, ROS, Browser
from fake_robots import FakeRobot, open_session
from linked_fleet_gateway.subscriptions.redis_scripts import Keys
from running import eventually
from small_fleet import Place, live

pytestmark = [pytest.mark.processes, pytest.mark.test_all]

CYCLES, ROUNDS = 1000, 8
AT_ONCE = 20
GROWTH_KIB = 512
"""Growth per round that is no leak: 1,000 leaked connections of one KiB each would be twice that."""

TO_REDIS = 100
"""Limit of connections that the Redis client keeps: the maximum number of concurrent commands."""

Cycle = Callable[[], Awaitable[None]]


class Client:
    """Subscribes and unsubscribes in every way, each time on a new connection."""

    def __init__(self, url: str) -> None:
        parts = urlsplit(url)
        self.authority, self.path = parts.netloc, parts.path
        self.callbacks = 0
        self._numbers = itertools.count()
        self._arrived: dict[str, asyncio.Event] = {}

    @asynccontextmanager
    async def asked(
        self, method: str, path: str, *fields: str
    ) -> AsyncIterator[tuple[asyncio.StreamReader, asyncio.StreamWriter, str]]:
        """Yield a connection with the head of the response; it is cut at the end, unless that happened before."""
        host, port = self.authority.split(":")
        reader, writer = await asyncio.open_connection(host, int(port))
        try:
            writer.write(
                "\r\n".join([f"{method} {path} HTTP/1.1", f"Host: {self.authority}", *fields, "", ""]).encode()
            )
            yield reader, writer, (await reader.readuntil(b"\r\n\r\n")).decode()
        finally:
            writer.transport.abort()

    async def websocket(self) -> None:
        """Every other one closes regularly."""
        key = ("Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==", "Sec-WebSocket-Version: 13")
        asked = self.asked("GET", self.path, "Connection: Upgrade", "Upgrade: websocket", *key)
        async with asked as (reader, writer, head):
            assert " 101 " in head, head
            await reader.readuntil(b"lf:version")
            if next(self._numbers) % 2:
                writer.write(Frame(Opcode.CLOSE, b"\x03\xe8").serialize(mask=True))
                await reader.read()

    async def events(self) -> None:
        async with self.asked("GET", self.path, "Accept: text/event-stream") as (reader, _, head):
            assert " 200 " in head, head
            await reader.readuntil(b"lf:version")

    async def callback(self) -> None:
        """Every other one is deleted at once, the rest after the first delivery."""
        path = f"/{next(self._numbers)}"
        arrived = self._arrived[path] = asyncio.Event()
        callback = f"Callback: http://127.0.0.1:{self.callbacks}{path}"
        async with self.asked("GET", self.path, "Connection: Upgrade", "Upgrade: callback", callback) as (_, _, head):
            assert " 201 " in head, head
        if next(self._numbers) % 4 < 2:
            await arrived.wait()
        found = re.search(r"^location: (.*?)\r$", head, re.M | re.I)
        assert found is not None, head
        async with self.asked("DELETE", urlsplit(found[1]).path, "Connection: close") as (_, _, head):
            assert " 204 " in head, head
        del self._arrived[path]

    async def receive(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """Receive callbacks on one connection."""
        try:
            while True:
                head = (await reader.readuntil(b"\r\n\r\n")).decode()
                length = re.search(r"^content-length: (\d+)", head, re.M | re.I)
                await reader.readexactly(int(length[1]) if length else 0)
                if (arrived := self._arrived.get(head.split()[1])) is not None:
                    arrived.set()
                writer.write(b"HTTP/1.1 204 No Content\r\n\r\n")
        except (asyncio.IncompleteReadError, ConnectionError):
            return
        finally:  # also when cancelled
            writer.transport.abort()

    async def run(self, count: int, way: str = "all") -> None:
        """Run so many cycles, some at once: in one way, or one in ten by callback and the others as streams."""
        mixed = [*[self.websocket, self.events] * 4, self.websocket, self.callback]
        ways: Iterator[Cycle] = itertools.cycle(mixed if way == "all" else [getattr(self, way)])
        cycles = iter([next(ways) for _ in range(count)])

        async def work() -> None:
            for cycle in cycles:
                await cycle()

        async with await asyncio.start_server(self.receive, "127.0.0.1", 0) as server:
            self.callbacks = server.sockets[0].getsockname()[1]
            async with asyncio.TaskGroup() as group:
                for _ in range(AT_ONCE):
                    group.create_task(work())


def _rss_kib(pid: int) -> int:
    status = Path(f"/proc/{pid}/status").read_text()
    return int(status.partition("VmRSS:")[2].split()[0])


def _files(pid: int) -> int:
    return sum(1 for _ in Path(f"/proc/{pid}/fd").iterdir())


def _lasting_keys(state: Path) -> set[str]:
    """Return the keys without an expiry, except those of each run."""
    with redis.Redis(unix_socket_path=str(state / "valkey.sock"), decode_responses=True) as client:
        return {key for key in client.scan_iter() if client.ttl(key) == -1}


def test_r1_8_thousands_of_subscriptions_leave_nothing_behind(tmp_path_factory: pytest.TempPathFactory) -> None:
    """By WebSocket, event stream and callback: memory is flat, containers and Redis are empty, connections closed.

    The allocator fills its gaps in the first rounds, and its usage varies in each. A leak per subscription would show
    in every round, so one round without growth proves that there is none.
    """
    place = Place(tmp_path_factory.mktemp("m"))
    with place.gateway() as (gateway, browser), open_session(place.zenoh) as session:
        pid = gateway._child.pid
        FakeRobot(session, "toy").appear().stand(0.25)
        live(browser, "toy")
        lasting = _lasting_keys(place.state)
        part = browser.part("toy", "elbow")
        rotation, container = str(part.one(ROS.rotation)), str(part.one(HYBRIT.subscriptions))
        client = Client(rotation)

        asyncio.run(client.run(CYCLES))
        emptied(browser, container)
        files, grown = _files(pid), list[int]()
        while not grown or grown[-1] >= GROWTH_KIB:
            assert len(grown) < ROUNDS, f"KiB left by each {CYCLES} subscriptions: {grown}"
            before = _rss_kib(pid)
            asyncio.run(client.run(CYCLES))
            emptied(browser, container)
            grown.append(_rss_kib(pid) - before)
        eventually(lambda: _files(pid) <= files + TO_REDIS, "connections closed")
        left: set[str] = set()

        def nothing_left() -> bool:
            left.clear()
            left.update(
                _lasting_keys(place.state) - lasting - {Keys().runs, Keys().news, "fleet:audit", "fleet:audit:pages"}
            )
            return not left

        eventually(nothing_left, lambda: f"nothing left in Redis of {left}")
        assert "Traceback" not in gateway.output, gateway.output


def emptied(browser: Browser, container: str) -> None:
    eventually(lambda: not list(browser.page(container).graph.objects(None, LDP.contains)), "an empty container")
