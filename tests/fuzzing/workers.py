"""Clients and robots of the soak test: each repeats one kind of request, and remembers the responses."""

import contextlib
import itertools
import threading
from collections.abc import Iterator, Sequence

import httpx
import zenoh
from websockets.exceptions import WebSocketException

from browser import HYBRIT
from commanding import TURTLE, radian
from fake_robots import FakeRobot
from fuzzing.living import obey
from gateway_group import Hub
from receivers import CallbackReceiver
from running import Process, process
from subscribers import Socket, StreamEnded, events

_WELL = (200, 201, 202, 204)
_AWAY = (503, 504)
"""Permitted statuses during a fault; besides, a motion may be refused (409), a resource be gone (404)."""
_KEPT = 5
_GUESTS = 6
_PAUSE_S = 0.5


class Clients:
    """Asks one gateway after another; ``wrong``: responses that no fault excuses."""

    def __init__(self, roots: Sequence[str]) -> None:
        self._roots = itertools.cycle([root.rstrip("/") for root in roots])
        self._http = httpx.Client(timeout=70)
        self.wrong: list[str] = []

    def close(self) -> None:
        self._http.close()

    def ask(self, method: str, path: str, body: str | None = None, **fields: str) -> httpx.Response | None:
        """Return None if nothing listened or the connection broke: the outcome is then unknown."""
        try:
            answer = self._http.request(method, next(self._roots) + path, content=body, headers=fields)
        except httpx.TransportError:
            return None
        if answer.status_code >= 500 and answer.status_code not in _AWAY:
            self.wrong.append(f"{method} {path}: {answer.status_code} {answer.text[:300]}")
        return answer


class Steps:
    """The robot whose joint has another position in every frame."""

    def __init__(self, stage: Hub) -> None:
        self._stage = stage

    def __call__(self, over: threading.Event) -> None:
        self._stage.step()
        over.wait(_PAUSE_S)


class Reads:
    """Reads resources of the tree in each syntax."""

    def __init__(self, clients: Clients, paths: Sequence[str]) -> None:
        self.well = 0
        types = ("text/turtle", "application/ld+json", "text/html", "application/rdf+xml")
        self._clients, self._what = clients, itertools.cycle([(path, each) for path in paths for each in types])

    def __call__(self, over: threading.Event) -> None:
        path, media_type = next(self._what)
        answer = self._clients.ask("GET", path, accept=media_type)
        self.well += answer is not None and answer.status_code == 200
        over.wait(_PAUSE_S / 2)


class Motions:
    """Turns a joint to and fro; ``begun``: the accepted invocations, which must end."""

    def __init__(self, clients: Clients, action: str) -> None:
        self.begun: list[str] = []
        self.asked = self.well = 0
        self._clients, self._action = clients, action

    def __call__(self, over: threading.Event) -> None:
        self.asked += 1
        said = {"idempotency-key": f"turn-{self.asked}", "prefer": "wait=5"}
        answer = self._clients.ask("PUT", self._action, radian(0.2 if self.asked % 2 else -0.2), **TURTLE, **said)
        if answer is not None and answer.status_code in _WELL:
            self.begun.append(httpx.URL(answer.headers["location"]).path)
            self.well += answer.status_code == 204
        elif answer is not None and answer.status_code not in (404, 409, *_AWAY):
            self._clients.wrong.append(f"a motion: {answer.status_code} {answer.text[:300]}")
        over.wait(_PAUSE_S)


class Churn:
    """Creates callbacks and deletes the oldest. ``held``: receiver path by IRI of those that surely exist."""

    def __init__(self, clients: Clients, container: str, rotation: str, receiver: CallbackReceiver) -> None:
        self.held: dict[str, str] = {}
        self.made = self.deleted = 0
        self._clients, self._container, self._receiver = clients, container, receiver
        self._about = f"[] a <{HYBRIT.Subscription}> ; <{HYBRIT.onResource}> <{rotation}> ; <{HYBRIT.callbackURL}>"
        self._numbers = itertools.count()

    def __call__(self, over: threading.Event) -> None:
        if len(self.held) < _KEPT:
            self._make(f"/{next(self._numbers)}")
        else:
            self._delete(next(iter(self.held)))
        over.wait(_PAUSE_S)

    def _make(self, path: str) -> None:
        body = f'{self._about} "{self._receiver.url(path)}" .'
        answer = self._clients.ask("POST", self._container, body, **TURTLE)
        if answer is not None and answer.status_code == 201:
            self.held[httpx.URL(answer.headers["location"]).path] = path
            self.made += 1
        elif answer is not None and answer.status_code not in (404, *_AWAY):
            self._clients.wrong.append(f"a callback: {answer.status_code} {answer.text[:300]}")

    def _delete(self, iri: str) -> None:
        """Delete a callback. Without a response, or with 503, it is unknown whether it still exists."""
        answer = self._clients.ask("DELETE", iri)
        if answer is not None and answer.status_code == 404:
            self._clients.wrong.append(f"an accepted callback is not there: {iri}")
        self.deleted += 1
        del self.held[iri]


class Hops:
    """Opens a stream, reads the present value and closes it; by WebSocket and as events in turn, at each gateway."""

    def __init__(self, roots: Sequence[str], path: str) -> None:
        self.asked = self.heard = 0
        self._roots, self._path = [root.rstrip("/") for root in roots], path

    def __call__(self, over: threading.Event) -> None:
        url = self._roots[self.asked // 2 % len(self._roots)] + self._path
        self.asked += 1
        # Also after a regular close by a gateway that ends before it has sent anything.
        gone = (OSError, WebSocketException, httpx.TransportError, StreamEnded)
        with contextlib.suppress(*gone), Socket(url) if self.asked % 2 else events(url) as stream:
            stream.next()
            self.heard += 1
        over.wait(_PAUSE_S)


class TransientRobots:
    """Robots that appear, stand still, obey and leave, regularly or not."""

    def __init__(self, session: zenoh.Session) -> None:
        self.came = 0
        self._session = session

    def __call__(self, over: threading.Event) -> None:
        actor = FakeRobot(self._session, f"guest{self.came % _GUESTS}")
        obey(actor)
        actor.appear()
        self.came += 1
        for number in range(4):
            over.wait(_PAUSE_S)
            actor.put("state", actor.frame((number / 10,)))
        actor.leave()


@contextlib.contextmanager
def agent(endpoint: str) -> Iterator[Process]:
    """Run the agent of a simulated arm, at a rate that leaves time for the other processes."""
    with process("-m", "linked_fleet_agent", "--robot=ur5", "--rate-hz=25", "--connect", endpoint) as child:
        yield child
