"""The parts of a message and of an action: what remains of a figure if everything else is left out."""

import asyncio
import contextlib
import multiprocessing
import select
import socket
import tempfile
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from statistics import median

from bench.caches import reads
from bench.synthetic import Robot, name_of, robot, urdf
from bench.table import Row, known
from linked_fleet_agent.wire.codec import decode
from linked_fleet_agent.wire.messages import Description
from linked_fleet_gateway.actions import redis_scripts as scripts
from linked_fleet_gateway.http.websocket import frame_bytes
from linked_fleet_gateway.resources.subscription import Kind, Subscription
from linked_fleet_gateway.resources.things import NO_SUBSCRIPTIONS
from linked_fleet_gateway.resources.tree import Tree
from linked_fleet_gateway.subscriptions.broadcast import Ending, Message
from linked_fleet_gateway.subscriptions.fan_out import FanOut
from linked_fleet_runtime.redis import Connection
from linked_fleet_state.events import Appeared, Described, Framed, Frames
from linked_fleet_state.fleet import Fleet
from linked_fleet_state.invocations import Invocations
from redis_servers import Server, single

ROBOTS, JOINTS = 50, 10
_BASE = "http://127.0.0.1:8000"
_BURSTS = ((1, 20), (25, 500), (500, 10_000))  # readers, and microseconds between two bursts
_MESSAGE = bytes(1400)
_ROUNDS = 20


def rows(seconds: float, robots: int = ROBOTS) -> list[Row]:
    return [*_messages(seconds, robots), *_steps(seconds), *reads()]


# -- a message to one subscriber ------------------------------------------------------------------------------------


def _messages(seconds: float, robots: int) -> Iterator[Row]:
    yield known("one message to one subscriber, all but sending it", "us CPU", asyncio.run(_rendered_us(robots)))
    with _sleepers(_BURSTS[-1][0]) as sockets:
        for size, gap_us in _BURSTS:
            name = f"a ready message written to {size} reader{'s in a row' * (size > 1)} every {gap_us / 1000:g} ms"
            yield known(name, "us", _write_us(sockets, size, gap_us, seconds / len(_BURSTS)))


class _Sink:
    """A stream that accepts everything and sends nothing."""

    framing = staticmethod(frame_bytes)
    messages = 0

    def writable(self) -> bool:
        return True

    def send(self, frame: bytes) -> bool:
        _Sink.messages += 1
        return True

    def write(self, message: Message) -> None:
        self.send(message.frame_with(frame_bytes))

    def end(self, ending: Ending) -> None:
        raise AssertionError(ending)


class _Kept:
    """Stands in for a publisher: keeps the latest frame."""

    frame = b""

    def put(self, frame: bytes) -> None:
        self.frame = frame


async def _rendered_us(robots: int) -> float:
    """Return the time from received frames to framed messages in this process: the median of some rounds."""
    fleet, invocations = Fleet(Frames()), Invocations()
    fan_out = FanOut(lambda base, sees: Tree(fleet, invocations, base, NO_SUBSCRIPTIONS, sees), fleet.next_moved)
    fleet.frames.watched = fan_out.watched_robots
    fleet.frames.reader.open(fan_out.waker())
    crowd = [_appeared(fleet, name_of(number)) for number in range(robots)]
    for each in crowd:
        for joint in range(JOINTS):
            path = f"/{each.name}/joint_{joint}/rotation"
            subscription = Subscription(
                id=path, owner="/", resource=path, kind=Kind.WEBSOCKET, media_type="text/turtle", base=_BASE,
                client="bench", created_ns=0,
            )  # fmt: skip
            fan_out.watch(subscription, _Sink()).schedule_send()
    epoch_ns, found = time.monotonic_ns(), list[float]()
    for _ in range(_ROUNDS):
        for each in crowd:
            each.send(epoch_ns, JOINTS)
            assert fleet.frames.put(each.name, each.publisher.frame, time.time_ns())
        before, begin = _Sink.messages, time.process_time()
        while _Sink.messages - before < robots * JOINTS:  # noqa: ASYNC110 - measures turns of the loop
            await asyncio.sleep(0)
        found.append((time.process_time() - begin) / (_Sink.messages - before) * 1e6)
    return median(found)


def _appeared(fleet: Fleet, name: str) -> Robot:
    each = robot(name, JOINTS, urdf(JOINTS))
    each.publisher = _Kept()
    each.send(time.monotonic_ns(), JOINTS)
    for event in (
        Appeared(name, each.run),
        Described(decode(each.description, Description)),
        Framed(name, each.publisher.frame),
    ):
        fleet.apply(event, time.time_ns())
    return each


@contextlib.contextmanager
def _sleepers(count: int) -> Iterator[Sequence[socket.socket]]:
    """Connect readers in one process that sleeps when there is nothing to read."""
    with socket.create_server(("127.0.0.1", 0), backlog=count) as server:
        port = server.getsockname()[1]
        child = multiprocessing.get_context("spawn").Process(target=_read, args=(port, count), daemon=True)
        child.start()
        sockets = [server.accept()[0] for _ in range(count)]
        try:
            yield sockets
        finally:
            for each in sockets:
                each.close()
            child.join()


def _read(port: int, count: int) -> None:
    poll, sockets, room = select.epoll(), dict[int, socket.socket](), bytearray(1 << 18)
    for _ in range(count):
        each = socket.create_connection(("127.0.0.1", port))
        sockets[each.fileno()] = each
        poll.register(each.fileno(), select.EPOLLIN)
    while sockets:
        for number, _ in poll.poll():
            if not sockets[number].recv_into(room):  # like bench/readers.py
                sockets.pop(number).close()


def _write_us(sockets: Sequence[socket.socket], size: int, gap_us: int, seconds: float) -> float:
    took_s, written, end = 0.0, 0, time.perf_counter() + seconds
    while time.perf_counter() < end:
        for first in range(0, len(sockets), size):
            pause = time.perf_counter() + gap_us / 1e6
            while time.perf_counter() < pause:
                pass  # simulates a busy gateway
            begin = time.perf_counter()
            for each in sockets[first : first + size]:
                each.send(_MESSAGE)
            took_s += time.perf_counter() - begin
            written += size
    return took_s / written * 1e6


# -- an action ------------------------------------------------------------------------------------------------------


def _steps(seconds: float) -> Iterator[Row]:
    """Measure a look-up in Redis: through the client, and as bytes on a socket."""
    with tempfile.TemporaryDirectory() as folder, single(Path(folder)) as servers:
        (server,) = servers.nodes
        bare = _bare_ms(server, seconds / 2)
        client = asyncio.run(_client_ms(server, seconds / 2))
    yield known("a step in Redis, as bytes on a socket, p50", "ms", bare)
    yield known("a step in Redis, by its client, p50", "ms", client, "as bytes on a socket", bare)


def _bare_ms(server: Server, seconds: float) -> float:
    words = (b"EVAL", scripts.HELD.encode(), b"1", b"lease")
    asked = b"*%d\r\n" % len(words) + b"".join(b"$%d\r\n%b\r\n" % (len(word), word) for word in words)
    took, end = list[float](), time.monotonic() + seconds
    with socket.create_connection(("127.0.0.1", server.port)) as connection:
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        while time.monotonic() < end:
            begin = time.perf_counter()
            connection.sendall(asked)
            connection.recv(1 << 16)
            took.append((time.perf_counter() - begin) * 1e3)
    return median(took)


async def _client_ms(server: Server, seconds: float) -> float:
    connection, took, end = Connection(server.url, "news"), list[float](), time.monotonic() + seconds
    while time.monotonic() < end:
        begin = time.perf_counter()
        await connection.run_script(scripts.HELD, ("lease",))
        took.append((time.perf_counter() - begin) * 1e3)
    await connection.close()
    return median(took)
