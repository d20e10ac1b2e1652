"""Clients that continue while gateways come and go: without a response they ask the next gateway, as a proxy would."""

import contextlib
import itertools
import math
import threading
from collections.abc import Callable, Iterator, Sequence

import httpx
import rdflib
from websockets.exceptions import ConnectionClosed, WebSocketException

from commanding import TURTLE, radian
from gateway_group import Hub
from graphs import read
from parallel import pool
from running import PATIENCE_S, eventually
from subscribers import Said, Socket, StreamEnded, angle_in, events

Work = Callable[[threading.Event], None]
_RESTART = 1012


class Front:
    """Asks one gateway after another until one responds."""

    def __init__(self, roots: Sequence[str]) -> None:
        self._roots = itertools.cycle(roots)
        self._http = httpx.Client(timeout=PATIENCE_S)

    def close(self) -> None:
        self._http.close()

    def root(self) -> str:
        """Return the root of the next gateway."""
        return next(self._roots).removesuffix("/")

    def ask(self, method: str, path: str, body: str | None = None, **fields: str) -> httpx.Response:
        def probe() -> httpx.Response | None:
            url = self.root() + path
            with contextlib.suppress(httpx.TransportError):
                return self._http.request(method, url, content=body, headers=fields)
            return None

        return eventually(probe, "an answer")


@contextlib.contextmanager
def going_on(*works: Work, wake: Callable[[], object]) -> Iterator[None]:
    """Repeat each work beside the test; exceptions are raised at the end. ``wake``: makes waiting works look up."""
    over = threading.Event()

    def repeat(work: Work) -> None:
        while not over.is_set():
            work(over)

    with pool(len(works)) as workers:
        running = [workers.submit(repeat, work) for work in works]
        try:
            yield
        finally:
            over.set()
            wake()
            for each in running:
                each.result()


class Mover:
    """Turns a joint to and fro, waiting for each end, with a new idempotency key for each motion."""

    def __init__(self, front: Front, action: str, **fields: str) -> None:
        self.answered: list[str] = []
        self.asked = 0
        self._front, self._action, self._fields = front, action, TURTLE | fields

    def __call__(self, over: threading.Event) -> None:
        self.asked += 1
        said = {"idempotency-key": f"turn-{self.asked}", "prefer": "wait=10"}
        target = 0.2 if self.asked % 2 else -0.2
        answer = self._front.ask("PUT", self._action, radian(target), **self._fields, **said)
        assert answer.status_code in (202, 204), answer.text
        self.answered.append(httpx.URL(answer.headers["location"]).path)


class Reader:
    """Steps the joint of the hub, and reads until its present value is seen."""

    def __init__(self, front: Front, stage: Hub, rotation: str) -> None:
        self.steps = 0
        self._front, self._stage, self._rotation = front, stage, rotation

    def __call__(self, over: threading.Event) -> None:
        self._stage.step()
        eventually(self._sees, "the present value")
        self.steps += 1

    def _sees(self) -> bool:
        if self._read() == self._stage.angle:
            return True
        self._stage.repeat()  # robots repeat frames all the time: a gateway that has just begun has no value yet
        return False

    def _read(self) -> float:
        answer = self._front.ask("GET", self._rotation, accept="text/turtle")
        assert answer.status_code == 200, answer.text
        graph = read(answer.text, str(answer.url))
        with contextlib.suppress(ValueError):  # unknown
            return angle_in(graph, rdflib.URIRef(str(answer.url)))
        return math.nan


class Follower:
    """A subscriber that reconnects to whichever gateway: records its last value, and how its connections ended."""

    def __init__(self, front: Front, path: str) -> None:
        self.last = 0.0
        self.ends: list[int] = []
        self._front, self._path = front, path

    def hear(self, message: Said) -> None:
        with contextlib.suppress(ValueError):  # unknown
            self.last = message.angle


class SocketFollower(Follower):
    def __call__(self, over: threading.Event) -> None:
        try:
            with Socket(self._front.root() + self._path) as socket:
                while not over.is_set():
                    self.hear(socket.next())
        except ConnectionClosed as end:
            self.ends.append(end.rcvd.code if end.rcvd is not None else 0)
        except (OSError, WebSocketException):  # nothing listens, or no longer
            return


class EventFollower(Follower):
    def __call__(self, over: threading.Event) -> None:
        with contextlib.suppress(httpx.TransportError), events(self._front.root() + self._path) as stream:
            while not over.is_set():
                try:
                    self.hear(stream.next())
                except StreamEnded:  # a regular end
                    assert stream.last_event_id not in ("", "cancelled")
                    self.ends.append(_RESTART)
                    return
