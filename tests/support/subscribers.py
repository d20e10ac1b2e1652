"""Subscribers that know only the standards, and a robot played by the test for them to watch."""

import contextlib
import itertools
import math
import time
from collections.abc import Iterator
from dataclasses import dataclass
from types import TracebackType

import httpx
import rdflib
from pyoxigraph import RdfFormat
from rdflib import URIRef
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.http11 import Response

from browser import DCTERMS, HYBRIT, LDP, LF, ROS, SPATIAL, VOM, Browser, Page
from connections import http_client, websocket
from event_source import EventSource
from fake_robots import FakeRobot, joint, link, open_session, robot
from graphs import read
from running import eventually, process
from small_fleet import Place, presence

PATIENCE_S = 15.0
EVENTS = "text/event-stream"
FORMATS = {
    "text/turtle": RdfFormat.TURTLE,
    "application/ld+json": RdfFormat.JSON_LD,
    "application/n-triples": RdfFormat.N_TRIPLES,
    "application/rdf+xml": RdfFormat.RDF_XML,
}
ARM = robot(
    link("base"), link("upper"), link("tip"),
    joint("shoulder", "revolute", "base", "upper"), joint("elbow", "revolute", "upper", "tip"),
)  # fmt: skip
_robots = itertools.count(1)


def graph_of(body: bytes, media_type: str, base: str) -> rdflib.Graph:
    """Parse ``body`` strictly as ``media_type``."""
    return read(body, base, FORMATS[media_type])


@dataclass(frozen=True)
class Said:
    """A message in RDF."""

    body: bytes
    graph: rdflib.Graph

    @property
    def iri(self) -> URIRef:
        """The resource that the message is about."""
        (subject,) = self.graph.subjects(LF.version)
        return URIRef(str(subject))

    @property
    def version(self) -> str:
        return str(self.graph.value(self.iri, LF.version))

    @property
    def event_id(self) -> str:
        return str(self.graph.value(self.iri, LF.eventId))

    @property
    def previous(self) -> str | None:
        found = self.graph.value(self.iri, LF.previousVersion)
        return None if found is None else str(found)

    @property
    def state(self) -> rdflib.Graph:
        """The graph that a GET would return."""
        return without_versions(self.graph)

    @property
    def angle(self) -> float:
        """The position in a message about a rotation."""
        return angle_in(self.graph, self.iri)


def without_versions(graph: rdflib.Graph) -> rdflib.Graph:
    found = rdflib.Graph()
    found += [t for t in graph if t[1] not in (LF.version, LF.previousVersion, LF.eventId)]
    return found


def angle_in(graph: rdflib.Graph, iri: URIRef) -> float:
    """Return the angle; NaN if it is unknown, as to a gateway that has just begun."""
    value = graph.value(graph.value(iri, SPATIAL.rotationAngle), VOM.numericalValue)
    return math.nan if value == LF.unknown else float(str(value))


def said(body: bytes | str, media_type: str, base: str) -> Said:
    content = body.encode() if isinstance(body, str) else body
    return Said(content, graph_of(content, media_type, base))


class Socket:
    """A WebSocket on a resource; ``subprotocol`` as sent by browsers, ``accept`` as sent by other clients."""

    def __init__(
        self,
        url: str,
        accept: str | None = None,
        subprotocol: str | None = None,
        last: str | None = None,
        **fields: str,
    ):
        self.url = url
        self._open = contextlib.ExitStack()
        opening = websocket(url, {"Accept": accept, "Last-Event-ID": last, **fields}, subprotocol)
        self.connection = self._open.enter_context(opening)

    def __enter__(self) -> "Socket":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        self._open.close()

    @property
    def description(self) -> str:
        """The URL that describes the subscription."""
        assert self.connection.response is not None
        return self.connection.response.headers["link"].partition(">")[0].removeprefix("<")

    def raw(self, patience_s: float = PATIENCE_S) -> bytes | str:
        """Raises TimeoutError if nothing arrives in time."""
        return self.connection.recv(timeout=patience_s)

    def next(self, media_type: str = "text/turtle", patience_s: float = PATIENCE_S) -> Said:
        body = self.raw(patience_s)
        assert isinstance(body, str)  # RDF comes in text frames
        return said(body, media_type, self.url)

    def until_closed(self) -> tuple[int, str]:
        """Return code and reason of the close, after reading everything before it."""
        try:
            while True:
                self.raw()
        except ConnectionClosed as end:
            assert end.rcvd is not None
            return end.rcvd.code, end.rcvd.reason


def refused(url: str, accept: str | None = None, subprotocol: str | None = None, **fields: str) -> Response:
    """Return the response to a WebSocket handshake that is refused."""
    try:
        Socket(url, accept, subprotocol, **fields).close()
    except InvalidStatus as error:
        return error.response
    raise AssertionError(f"{url} was opened")


class StreamEnded(AssertionError):  # noqa: N818 - it is an outcome
    """The stream has ended."""


class Events:
    """An event stream, read as an EventSource reads it."""

    def __init__(self, response: httpx.Response) -> None:
        self.response = response
        self.url = str(response.url)
        self._source = EventSource()
        self._pieces = response.iter_raw()

    @property
    def description(self) -> str:
        return self.response.headers["link"].partition(">")[0].removeprefix("<")

    @property
    def last_event_id(self) -> str:
        """The id of the last event that was received, even if it is not yet taken by ``next``."""
        return self._source.last_event_id

    @property
    def comments(self) -> int:
        return self._source.comments

    def next(self, media_type: str = "text/turtle") -> Said:
        data = self._event()
        if data is None:
            raise StreamEnded("the stream has ended")
        return said(data, media_type, self.url)

    def ended(self) -> bool:
        """Take another event; return True if the stream ends without one."""
        return self._event() is None

    def _event(self) -> str | None:
        """Return the data of the next event, or None if the stream ends. Heartbeats do not prolong the wait."""
        deadline_s = time.monotonic() + PATIENCE_S
        while not self._source.events:
            assert time.monotonic() < deadline_s, f"no event within {PATIENCE_S} s"
            piece = next(self._pieces, None)
            if piece is None:
                return None
            self._source.feed(piece.decode())
        return self._source.events.pop(0)[1]


@contextlib.contextmanager
def events(url: str, accept: str = EVENTS, last: str | None = None) -> Iterator[Events]:
    """Open an event stream on a connection of its own."""
    fields = {"accept": accept} | ({} if last is None else {"last-event-id": last})
    with (
        http_client(timeout=PATIENCE_S) as http,
        http.stream("GET", url, headers=fields) as response,
    ):
        assert response.status_code == 200, response.read()
        assert response.headers["content-type"] == EVENTS
        yield Events(response)


class TwoJointRobot:
    """A robot with two joints that does only what the test says."""

    def __init__(self, actor: FakeRobot, browser: Browser) -> None:
        self.actor, self.browser = actor, browser

    @property
    def page(self) -> Page:
        return self.browser.robot(self.actor.name)

    def part(self, title: str = "elbow") -> Page:
        return self.browser.part(self.actor.name, title)

    def rotation(self, joint: str = "elbow") -> str:
        return str(self.part(joint).one(ROS.rotation))

    def pose(self, elbow: float, shoulder: float = 0.0) -> None:
        """Send one frame."""
        self.actor.put("state", self.actor.frame((shoulder, elbow)))

    def subscriptions(self, thing: str = "elbow") -> Page:
        """Return the page of the part's container of subscriptions."""
        return self.browser.page(str(self.part(thing).one(HYBRIT.subscriptions)))


@dataclass(frozen=True)
class ObservedFleet:
    """A gateway for one test, with robots that the test plays."""

    place: Place
    browser: Browser

    @property
    def root(self) -> str:
        return self.browser.root

    @contextlib.contextmanager
    def toy(self, elbow: float = 0.0, shoulder: float = 0.0) -> Iterator[TwoJointRobot]:
        """Run a robot that is online, described and has sent one frame; its agent ends regularly."""
        name = f"toy{next(_robots)}"
        with open_session(self.place.zenoh) as session:
            actor = FakeRobot(session, name)
            actor.appear(actor.description(ARM, ("shoulder", "elbow")))
            toy = TwoJointRobot(actor, self.browser)
            self._has(name, lambda page: (page.iri, LF.rootLink, None) in page.graph)
            toy.pose(elbow, shoulder)
            self._has(name, lambda page: page.one(LF.lastFrame) != LF.unknown)
            yield toy

    def _has(self, name: str, condition: object) -> None:
        def probe() -> bool:
            page = presence(self.browser, name)
            return page is not None and bool(condition(page))  # type: ignore[operator]

        eventually(probe, f"{name} as it should be")


@contextlib.contextmanager
def observed_fleet(place: Place, *flags: str) -> Iterator[ObservedFleet]:
    with process(*place.command(), *flags) as gateway, contextlib.closing(Browser(place.root)) as browser:
        gateway.said("serving")
        yield ObservedFleet(place, browser)


def members(container: Page) -> set[str]:
    return {str(member) for member in container.graph.objects(container.iri, LDP.contains)}


def emptied(browser: Browser, container: str) -> None:
    """Wait until a container is empty: the end of a connection is noticed a moment later."""
    eventually(lambda: not members(browser.page(container)), f"{container} empty")


def identifier(page: Page) -> str:
    return str(page.graph.value(page.iri, DCTERMS.identifier))
