"""Several gateways with one robot, which the test plays, and one memory; and what receivers saw of their callbacks."""

import contextlib
import json
from collections.abc import Iterator, Sequence
from pathlib import Path

import httpx
import rdflib
import zenoh

from actor import Actor, stage
from browser import HYBRIT, LF, ROS, Browser, Page
from graphs import read
from receivers import CallbackReceiver, Seen
from running import Process, eventually, free_port, process
from small_fleet import presence
from subscribers import angle_in, members
from virtual.loop import current

STEPS = 1000
"""Of the joint in a radian: each is far above the resolution of observation."""
LOOPBACK = "127.0.0.0/8"
_TURTLE = {"content-type": "text/turtle"}


class Hub:
    """A Zenoh router in the test, and at it a robot with one joint: whichever gateway dies, these two stay."""

    def __init__(self, session: zenoh.Session, endpoint: str) -> None:
        self.session, self.endpoint = session, endpoint
        self.steps = 0
        self._actor = Actor(session, "toy").appear()

    @property
    def angle(self) -> float:
        """Where the joint is."""
        return self.steps / STEPS

    def step(self) -> None:
        """Send one frame, with a position that was never there before."""
        self.steps += 1
        self.repeat()

    def repeat(self) -> None:
        self._actor.put("state", self._actor.frame([self.angle]))


@contextlib.contextmanager
def hub() -> Iterator[Hub]:
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    if current() is not None:
        with stage(endpoint) as session:
            yield Hub(session, endpoint)
        return
    config = zenoh.Config()
    settings = {
        "mode": "router",
        "listen/endpoints": [endpoint],
        "scouting/multicast/enabled": False,
        "transport/shared_memory/enabled": False,
    }
    for name, value in settings.items():
        config.insert_json5(name, json.dumps(value))
    session = zenoh.open(config)
    try:
        yield Hub(session, endpoint)
    finally:
        session.close()


class Gateway:
    """One of several, seen by a client; everything by links."""

    def __init__(self, process: Process, browser: Browser) -> None:
        self.process, self.browser = process, browser
        self.joint = self.rotation = self.container = ""

    def meet(self, hub: Hub) -> None:
        """Wait until the robot is there and has a value."""

        def known() -> bool:
            page = presence(self.browser, "toy")
            if page is None or (page.iri, LF.rootLink, None) not in page.graph:
                return False
            hub.repeat()
            return page.one(LF.lastFrame) != LF.unknown

        eventually(known, "the robot")
        joint = self.browser.part("toy", "elbow")
        self.joint, self.rotation = joint.url, str(joint.one(ROS.rotation))
        self.container = str(joint.one(HYBRIT.subscriptions))

    def get(self, url: str) -> httpx.Response:
        return self.browser.http.get(url)

    def subscribe(self, callback: str, more: str = "") -> httpx.Response:
        """POST Figure 4."""
        body = (
            f"@prefix hybrit: <{HYBRIT}> . @prefix lf: <{LF}> . [] a hybrit:Subscription, hybrit:WebCallback ; "
            f'hybrit:onResource <{self.rotation}> ; hybrit:callbackURL "{callback}" {more}.'
        )
        return self.browser.http.post(self.container, content=body, headers=_TURTLE)

    def subscribed(self, callback: str, more: str = "") -> str:
        """The IRI of a new callback."""
        answer = self.subscribe(callback, more)
        assert answer.status_code == 201, answer.text
        return answer.headers["location"]

    def post_stream(self, more: str = "") -> httpx.Response:
        """POST a stream, which a client opens later."""
        body = f"<> a <{HYBRIT.Subscription}> ; <{HYBRIT.onResource}> <{self.rotation}> {more} ."
        return self.browser.http.post(self.container, content=body, headers=_TURTLE)

    def posted_stream(self, more: str = "") -> str:
        """The IRI of a stream that nobody has opened."""
        answer = self.post_stream(more)
        assert answer.status_code == 201, answer.text
        return answer.headers["location"]

    def listed(self) -> set[str]:
        """What the container of the joint lists, as paths: gateways differ in nothing else."""
        return {httpx.URL(iri).path for iri in members(self.browser.page(self.container))}

    def description(self, subscription: str) -> Page:
        """Of a subscription that was perhaps made at another gateway."""
        return self.browser.page(self.here(subscription))

    def here(self, iri: str) -> str:
        """The same resource, served by this gateway."""
        return str(httpx.URL(self.browser.root).copy_with(raw_path=httpx.URL(iri).raw_path))

    def in_state(self, subscription: str, state: rdflib.URIRef) -> Page:
        def probe() -> Page | None:
            page = self.description(subscription)
            return page if page.one(LF.deliveryState) == state else None

        return eventually(probe, f"{state}")


@contextlib.contextmanager
def gateway(
    hub: Hub, *flags: str, port: int | None = None, state: Path | None = None, allow: str = LOOPBACK
) -> Iterator[Gateway]:
    """A gateway at the hub that has met its robot."""
    port = port or free_port()
    place = () if state is None else ("--state-dir", str(state))
    allowed = ("--callback-allow", allow) if allow else ()
    command = (
        "-m",
        "linked_fleet_gateway",
        "--port",
        str(port),
        "--zenoh-connect",
        hub.endpoint,
        *place,
        *allowed,
        *flags,
    )
    root = f"http://127.0.0.1:{port}/"
    with process(*command) as running, contextlib.closing(Browser(root)) as browser:
        running.said("serving")
        one = Gateway(running, browser)
        one.meet(hub)
        yield one


@contextlib.contextmanager
def gateways(hub: Hub, redis_url: str, count: int = 2) -> Iterator[list[Gateway]]:
    """They start at the same time."""
    ports = [free_port() for _ in range(count)]
    shared = ("--zenoh-connect", hub.endpoint, "--redis-url", redis_url, "--callback-allow", LOOPBACK)
    with contextlib.ExitStack() as stack:
        started = [
            stack.enter_context(process("-m", "linked_fleet_gateway", "--port", str(port), *shared)) for port in ports
        ]
        found = []
        for port, running in zip(ports, started, strict=True):
            running.said("serving")
            browser = stack.enter_context(contextlib.closing(Browser(f"http://127.0.0.1:{port}/")))
            found.append(Gateway(running, browser))
            found[-1].meet(hub)
        yield found


# -- what receivers saw ---------------------------------------------------------------------------------------------


def complete(log: Sequence[Seen]) -> list[Seen]:
    """Without requests that broke off because their gateway was killed; their receiver has no message."""
    return [seen for seen in log if len(seen.body) == int(seen.headers["content-length"])]


def deliveries(log: Sequence[Seen]) -> list[Seen]:
    """The log without repeats, after a proof that nothing is missing, and that order and content are right.

    A repeat has an id that was there before; what is left is numbered from 1 without gaps, and a repeat says exactly
    what was said the first time.
    """
    first: dict[str, Seen] = {}
    for seen in complete(log):
        told = first.setdefault(seen.headers["webhook-id"], seen)
        assert told.body == seen.body, f"{number(seen)} was\n{told}\nand then\n{seen}"
        for name in ("linked-fleet-delivery", "linked-fleet-version", "link", "content-type"):
            assert told.headers[name] == seen.headers[name]
    assert [number(seen) for seen in first.values()] == list(range(1, len(first) + 1))
    return list(first.values())


def number(seen: Seen) -> int:
    """Of a delivery: it counts those of one subscription."""
    return int(seen.headers["linked-fleet-delivery"])


def angle(seen: Seen) -> float:
    """What a delivery says about the joint."""
    resource = seen.headers["link"].partition(">")[0].removeprefix("<")
    return angle_in(read(seen.body, resource), rdflib.URIRef(resource))


def present(gateway: Gateway) -> float:
    """What a GET says about the joint."""
    page = gateway.browser.page(gateway.rotation)
    return angle_in(page.graph, page.iri)


def arrived(receiver: CallbackReceiver, path: str, value: float) -> None:
    """Wait until the last delivery to a path says ``value``."""

    def probe() -> bool:
        log = complete(receiver.log(path, "POST"))
        return bool(log) and angle(log[-1]) == value

    eventually(probe, f"{value} at {path}")
