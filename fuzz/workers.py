"""Clients and robots of the soak: each does one thing again and again, and knows what it was told."""

import contextlib
import itertools
import threading
from collections.abc import Iterator, Sequence

import httpx
import zenoh
from websockets.exceptions import WebSocketException

from actor import Actor
from browser import HYBRIT
from commanding import TURTLE, radian
from fuzz.living import obey
from receivers import CallbackReceiver
from running import Process, process
from several import Hub
from subscribers import Socket, StreamEnded, events

_WELL = (200, 201, 202, 204)
_AWAY = (503, 504)
"""What may be said while something is away; a motion may besides be refused (409), a resource gone (404)."""
_KEPT = 5
_GUESTS = 6
_PAUSE_S = 0.5


class Clients:
    """Asks one gateway after another, once each; ``wrong`` is what no fault excuses."""

    def __init__(self, roots: Sequence[str]) -> None:
        self._roots = itertools.cycle([root.rstrip("/") for root in roots])
        self._http = httpx.Client(timeout=70)
        self.wrong: list[str] = []

    def close(self) -> None:
        self._http.close()

    def ask(self, method: str, path: str, body: str | None = None, **fields: str) -> httpx.Response | None:
        """None when nobody was there or the connection broke: what became of it is not known then."""
        try:
            answer = self._http.request(method, next(self._roots) + path, content=body, headers=fields)
        except httpx.TransportError:
            return None
        if answer.status_code >= 500 and answer.status_code not in _AWAY:
            self.wrong.append(f"{method} {path}: {answer.status_code} {answer.text[:300]}")
        return answer


class Steps:
    """The robot whose joint stands at another place every time."""

    def __init__(self, stage: Hub) -> None:
        self._stage = stage

    def __call__(self, over: threading.Event) -> None:
        self._stage.step()
        over.wait(_PAUSE_S)


class Reads:
    """Reads the tree here and there, in each syntax."""

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
    """Turns a joint to and fro; ``begun`` are the invocations that were accepted, to be ended one day."""

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
    """Makes callbacks and deletes the eldest. ``held``: path at the receiver by IRI, of those that are surely there."""

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
        """It is there until then. Without an answer, or with 503, nobody knows whether it is still."""
        answer = self._clients.ask("DELETE", iri)
        if answer is not None and answer.status_code == 404:
            self._clients.wrong.append(f"an accepted callback is not there: {iri}")
        self.deleted += 1
        del self.held[iri]


class Hops:
    """Opens a stream, hears what is there now and closes it: by WebSocket and as events in turn, at each gateway."""

    def __init__(self, roots: Sequence[str], path: str) -> None:
        self.asked = self.heard = 0
        self._roots, self._path = [root.rstrip("/") for root in roots], path

    def __call__(self, over: threading.Event) -> None:
        url = self._roots[self.asked // 2 % len(self._roots)] + self._path
        self.asked += 1
        # Ended in good order as well, by a gateway that ends before it has said anything.
        gone = (OSError, WebSocketException, httpx.TransportError, StreamEnded)
        with contextlib.suppress(*gone), Socket(url) if self.asked % 2 else events(url) as stream:
            stream.next()
            self.heard += 1
        over.wait(_PAUSE_S)


class Guests:
    """Robots that come, stand, obey and go, in good order or not at all."""

    def __init__(self, session: zenoh.Session) -> None:
        self.came = 0
        self._session = session

    def __call__(self, over: threading.Event) -> None:
        actor = Actor(self._session, f"guest{self.came % _GUESTS}")
        obey(actor)
        actor.appear()
        self.came += 1
        for number in range(4):
            over.wait(_PAUSE_S)
            actor.put("state", actor.frame((number / 10,)))
        actor.leave()


@contextlib.contextmanager
def agent(endpoint: str) -> Iterator[Process]:
    """Of a simulated arm, at a rate that leaves time for the rest."""
    with process("-m", "linked_fleet_agent", "--robot=ur5", "--rate-hz=25", "--connect", endpoint) as child:
        yield child
