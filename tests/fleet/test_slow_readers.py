"""R0.12 to R0.16 under load: slow readers cost the gateway little, delay nobody, and get the final value."""

import contextlib
import selectors
import socket
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Self

import pytest
import zenoh

from browser import HYBRIT, LF, ROS, SPATIAL, Browser
from fake_robots import FakeRobot, joint, link, open_session, robot
from linked_fleet_server.connection_limits import HIGH_WATER_BYTES
from receivers import Answer, receiving
from running import PATIENCE_S, Process, eventually
from small_fleet import Place, live, number, property_page

pytestmark = [pytest.mark.processes, pytest.mark.test_all]

READERS = 50
JOINTS = tuple(f"j{number}" for number in range(20))
ARM = robot(
    link("l0"), *(link(f"l{n + 1}") for n in range(len(JOINTS))),
    *(joint(name, "revolute", f"l{n}", f"l{n + 1}") for n, name in enumerate(JOINTS)),
)  # fmt: skip
FINAL, NEXT = 0.98765, 0.56789
FLOOD_BYTES = 12 * 1024 * 1024
"""Bytes that each reader gets while one does not read; a queue for that one would hold as many."""
GROWTH_KIB = 6 * 1024
"""Permitted growth of the gateway: allocator noise, and half of what a queue would hold."""
KERNEL_BYTES = 192 * 1024
"""Bytes in the kernel: the receive buffer, 16 KiB that the gateway buffers, and one more segment."""
RECEIVE_BUFFER = 4096
TEXT, PING, PONG, MASKED = 0x81, 0x89, 0x8A, 0x80


class Reader:
    """One subscriber on a raw socket, which can stop reading."""

    def __init__(self, url: str, receive_buffer: int = 0) -> None:
        authority, _, path = url.removeprefix("http://").partition("/")
        host, _, port = authority.partition(":")
        self.sock = socket.socket()
        if receive_buffer:
            self.sock.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, receive_buffer)
        self.sock.settimeout(PATIENCE_S)
        self.sock.connect((host, int(port)))
        self.sock.sendall(f"GET /{path} HTTP/1.1\r\nHost: {authority}\r\n{self.FIELDS}\r\n".encode())
        self.count = self.bytes = 0
        self.last = b""
        self._rest = b""
        while b"\r\n\r\n" not in self._rest:
            self._rest += self.sock.recv(4096)
        head, _, self._rest = self._rest.partition(b"\r\n\r\n")
        assert head.startswith(self.ANSWER), head

    FIELDS, ANSWER = "", b""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.sock.close()

    def read(self) -> None:
        """Receive what has arrived; blocks if there is nothing."""
        data = self.sock.recv(1 << 18)
        assert data, "the gateway closed the connection"
        self.bytes += len(data)
        data, start = self._rest + data, 0
        while (found := self.cut(data, start)) is not None:
            message, start = found
            if message:
                self.last = message
                self.count += 1
        self._rest = data[start:]

    def cut(self, data: bytes, start: int) -> tuple[bytes, int] | None:
        """Return the message at ``start`` (empty if it is none for the subscriber) and its end; None if incomplete."""
        raise NotImplementedError

    def shows(self, value: float) -> bool:
        return f'"{value}"'.encode() in self.last


class SocketReader(Reader):
    """RFC 6455."""

    FIELDS = (
        "Connection: Upgrade\r\nUpgrade: websocket\r\nSec-WebSocket-Version: 13\r\n"
        "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n"
    )
    ANSWER = b"HTTP/1.1 101"

    def cut(self, data: bytes, start: int) -> tuple[bytes, int] | None:
        if len(data) < start + 2:
            return None
        first, size, body = data[start], data[start + 1], start + 2
        if wide := {126: 2, 127: 8}.get(size, 0):
            size, body = int.from_bytes(data[body : body + wide]), body + wide
        end = body + size
        if len(data) < end:
            return None
        if first == PING:
            self.sock.sendall(bytes([PONG, MASKED | size]) + bytes(4) + data[body:end])
        else:
            assert first == TEXT, f"a frame that begins with {first:#x}: {data[body:end]!r}"
        return (data[body:end] if first == TEXT else b""), end


class EventReader(Reader):
    """Parses server-sent events just far enough to separate them; chunk lengths appear between lines."""

    FIELDS = "Accept: text/event-stream\r\n"
    ANSWER = b"HTTP/1.1 200"

    def cut(self, data: bytes, start: int) -> tuple[bytes, int] | None:
        end = data.find(b"\n\n", start)
        if end < 0:
            return None
        event = data[start:end]
        return (event if b"\ndata: " in event else b""), end + 2


class Mover:
    """A robot of 20 joints, the first of which moves with every frame."""

    def __init__(self, session: zenoh.Session, name: str) -> None:
        self.actor = FakeRobot(session, name)
        self.actor.appear(self.actor.description(ARM, JOINTS))
        self.frames = 0
        self._over = threading.Event()

    def pose(self, value: float) -> None:
        self.actor.put("state", self.actor.frame((value, *(0.0,) * (len(JOINTS) - 1))))

    @contextlib.contextmanager
    def moving(self) -> Iterator[None]:
        """Send frames at some 500 Hz until the end of the block, the last with the final value."""

        def run() -> None:
            while not self._over.wait(0.002):
                self.frames += 1
                self.pose(self.frames % 9000 / 10_000)
            self.pose(FINAL)

        self._over.clear()
        thread = threading.Thread(target=run)
        thread.start()
        try:
            yield
        finally:
            self._over.set()
            thread.join()


class Stage:
    """A gateway, the moving robot and another one."""

    def __init__(self, gateway: Process, browser: Browser, session: zenoh.Session) -> None:
        self.browser, self.pid = browser, gateway._child.pid
        self.mover, self.other = Mover(session, "mover"), FakeRobot(session, "other").appear()
        self.other_angle = 0.0
        for name, nudge in (("mover", lambda: self.mover.pose(0.0)), ("other", self.turn_other)):
            eventually(lambda name=name: self._described(name), f"{name} described")
            nudge()
            live(browser, name)
        self.joint_state = str(browser.robot("mover").one(LF.jointState))
        self.rotation = str(browser.part("other", "elbow").one(ROS.rotation))

    def _described(self, name: str) -> bool:
        with contextlib.suppress(AssertionError):
            page = self.browser.robot(name)
            return (page.iri, LF.rootLink, None) in page.graph
        return False

    def turn_other(self) -> None:
        self.other_angle = round(self.other_angle + 0.001, 3)
        self.other.put("state", self.other.frame((self.other_angle,)))

    def others_are_served(self) -> None:
        """Check that a change of the other robot arrives by WebSocket, and that a GET shows it."""
        with SocketReader(self.rotation) as watcher:
            for _ in range(5):
                self.turn_other()
                while not watcher.shows(self.other_angle):
                    watcher.read()
                page = property_page(self.browser, "other", "elbow", ROS.rotation)
                assert number(page, SPATIAL.rotationAngle) == self.other_angle

    def rss_kib(self) -> int:
        status = Path(f"/proc/{self.pid}/status").read_text()
        return int(status.partition("VmRSS:")[2].split()[0])


@pytest.fixture
def scene(tmp_path: Path) -> Iterator[Stage]:
    place = Place(tmp_path)
    with place.gateway() as (gateway, browser), open_session(place.zenoh) as session:
        yield Stage(gateway, browser, session)
        assert "Traceback" not in gateway.output, gateway.output


@contextlib.contextmanager
def reading(readers: list[Reader]) -> Iterator[Callable[[Callable[[Reader], bool], str], None]]:
    """Let all of them read continuously; yield a function that waits until a condition holds for each."""
    over, failures = threading.Event(), []

    def run() -> None:
        with selectors.DefaultSelector() as selector:
            for reader in readers:
                selector.register(reader.sock, selectors.EVENT_READ, reader)
            try:
                while not over.is_set():
                    for key, _ in selector.select(0.05):
                        key.data.read()
            except Exception as error:  # noqa: BLE001 - raised in the test's own thread
                failures.append(error)

    def wait(condition: Callable[[Reader], bool], what: str) -> None:
        eventually(lambda: failures or all(condition(reader) for reader in readers), what)
        assert not failures, failures

    thread = threading.Thread(target=run)
    thread.start()
    try:
        yield wait
    finally:
        over.set()
        thread.join()
        for reader in readers:
            reader.sock.close()


@pytest.mark.parametrize("kind", [SocketReader, EventReader])
def test_one_that_hardly_reads_among_fifty_that_do_not(scene: Stage, kind: type[Reader]) -> None:
    """R0.12, R0.15, R0.16: it costs a bounded number of bytes, and catches up at once when it reads again."""
    slow = kind(scene.joint_state, RECEIVE_BUFFER)
    while not slow.count:
        slow.read()
    with reading([kind(scene.joint_state) for _ in range(READERS)]) as wait, slow:
        with scene.mover.moving():
            wait(lambda reader: reader.bytes > FLOOD_BYTES / 10, "buffers and caches of the usual size")
            before = highest = scene.rss_kib()
            for tenth in range(2, 11):
                slow.read()  # a few KiB: a client that receives nothing for half a minute is disconnected
                wait(lambda reader, tenth=tenth: reader.bytes > FLOOD_BYTES * tenth / 10, "the flood")
                highest = max(highest, scene.rss_kib())
            scene.others_are_served()
        wait(lambda reader: reader.shows(FINAL), "the final value at all who read")
        assert scene.mover.frames > 1000
        assert highest - before < GROWTH_KIB
        size, stale, slow.bytes = len(slow.last), slow.count, 0
        while not slow.shows(FINAL):
            slow.read()
        assert slow.bytes < KERNEL_BYTES + HIGH_WATER_BYTES + 2 * size
        assert slow.count - stale <= slow.bytes // size + 2  # one was begun before, and sizes differ by some digits
        count = slow.count
        scene.mover.pose(NEXT)
        while not slow.shows(NEXT):
            slow.read()
        assert slow.count == count + 1, "something came between the final value and the next one"


def test_a_receiver_that_stalls_among_others_that_do_not(scene: Stage) -> None:
    """R0.13: deliveries to this receiver wait, those to others do not; it has the last value in the end."""
    with receiving() as prompt, receiving() as stalling:
        stalling.default = Answer(stalls=True)
        urls = [prompt.url(f"/{each}") for each in range(10)] + [stalling.url("/stalling")]
        made = [_callback(scene.browser, scene.joint_state, url) for url in urls]
        stalling.wait(1)
        before = scene.rss_kib()
        with scene.mover.moving():
            prompt.wait(1000)
            scene.others_are_served()
            assert scene.rss_kib() - before < GROWTH_KIB
        final = f'"{FINAL}"'.encode()
        for each in range(10):
            eventually(lambda path=f"/{each}": final in prompt.log(path)[-1].body, "the final value at who answers")
        assert not any(final in seen.body for seen in stalling.log())
        stalling.default = Answer()
        stalling.release()
        eventually(lambda: final in stalling.log()[-1].body, "the final value at who stalled")
        deliveries = list(dict.fromkeys(seen.headers["linked-fleet-delivery"] for seen in stalling.log()))
        assert deliveries == [str(n + 1) for n in range(len(deliveries))]
        assert len(deliveries) < 10  # and not one for each value in between
        for url in made:
            assert scene.browser.http.delete(url).status_code == 204
        container = scene.browser.robot("mover").one(HYBRIT.subscriptions)
        assert not list(scene.browser.page(str(container)).graph.objects(None, HYBRIT.callbackURL))


def _callback(browser: Browser, resource: str, url: str) -> str:
    fields = {"connection": "Upgrade", "upgrade": "callback", "callback": url}
    answer = browser.http.get(resource, headers=fields)
    assert answer.status_code == 201, answer.text
    return str(answer.headers["location"])
