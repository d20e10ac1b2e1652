"""Several gateways with a robot played by the test and one Redis, and the deliveries that receivers got from them."""

import contextlib
from collections.abc import Iterator, Sequence
from pathlib import Path

import httpx
import rdflib
import zenoh

from browser import HYBRIT, LF, ROS, Browser, Page
from fake_robots import FakeRobot, open_session, real_session
from graphs import read
from receivers import CallbackReceiver, Seen
from redis_servers import Servers, single
from running import Process, eventually, free_port, process
from small_fleet import live, presence
from subscribers import angle_in, members
from virtual.loop import current

STEPS = 1000
"""Steps of the joint per radian; each is far above the resolution of observation."""
LOOPBACK = "127.0.0.0/8"
_TURTLE = {"content-type": "text/turtle"}


class Hub:
    """A Zenoh router in the test, with a robot of one joint; both outlive any gateway."""

    def __init__(self, session: zenoh.Session, endpoint: str) -> None:
        self.session, self.endpoint = session, endpoint
        self.steps = 0
        self._actor = FakeRobot(session, "toy").confirm_stops().appear()

    @property
    def angle(self) -> float:
        """The present position of the joint in rad."""
        return self.steps / STEPS

    def step(self) -> None:
        """Send one frame, with a new position."""
        self.steps += 1
        self.repeat()

    def repeat(self) -> None:
        self._actor.put("state", self._actor.frame([self.angle]))


@contextlib.contextmanager
def hub() -> Iterator[Hub]:
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    if current() is not None:
        with open_session(endpoint) as session:
            yield Hub(session, endpoint)
        return
    with real_session({"mode": "router", "listen/endpoints": [endpoint]}) as session:
        yield Hub(session, endpoint)


class Gateway:
    """One of several gateways, as a client sees it; everything is found by links."""

    def __init__(self, process: Process, browser: Browser) -> None:
        self.process, self.browser = process, browser
        self.joint = self.rotation = self.container = ""

    def meet(self, hub: Hub) -> None:
        """Wait until the robot is listed and has a value."""

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
        """POST the subscription of the paper's Figure 4."""
        body = (
            f"@prefix hybrit: <{HYBRIT}> . @prefix lf: <{LF}> . [] a hybrit:Subscription, hybrit:WebCallback ; "
            f'hybrit:onResource <{self.rotation}> ; hybrit:callbackURL "{callback}" {more}.'
        )
        return self.browser.http.post(self.container, content=body, headers=_TURTLE)

    def subscribed(self, callback: str, more: str = "") -> str:
        """Create a callback and return its IRI."""
        answer = self.subscribe(callback, more)
        assert answer.status_code == 201, answer.text
        return answer.headers["location"]

    def post_stream(self, more: str = "") -> httpx.Response:
        """POST a stream, which a client opens later."""
        body = f"<> a <{HYBRIT.Subscription}> ; <{HYBRIT.onResource}> <{self.rotation}> {more} ."
        return self.browser.http.post(self.container, content=body, headers=_TURTLE)

    def posted_stream(self, more: str = "") -> str:
        """Create a stream that nobody has opened, and return its IRI."""
        answer = self.post_stream(more)
        assert answer.status_code == 201, answer.text
        return answer.headers["location"]

    def listed(self) -> set[str]:
        """Return the paths in the container of the joint, which are the same at all gateways."""
        return {httpx.URL(iri).path for iri in members(self.browser.page(self.container))}

    def description(self, subscription: str) -> Page:
        """Return the page of a subscription, which another gateway may have created."""
        return self.browser.page(self.here(subscription))

    def here(self, iri: str) -> str:
        """Return the IRI of the same resource at this gateway."""
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
    """Run a gateway at the hub, and wait until it knows the robot."""
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
def two_with_an_arm(folder: Path) -> Iterator[tuple[Servers, Gateway, Gateway]]:
    """Run a store in the folder, and two gateways that share it and see the robot ``ur5``."""
    with single(folder) as memory, hub() as centre, contextlib.ExitStack() as stack:
        stack.enter_context(process("-m", "linked_fleet_agent", "--robot=ur5", "--connect", centre.endpoint))
        one, other = stack.enter_context(gateways(centre, memory.url))
        for each in (one, other):
            live(each.browser, "ur5")
        yield memory, one, other


@contextlib.contextmanager
def gateways(hub: Hub, redis_url: str, count: int = 2, flags: Sequence[str] = ()) -> Iterator[list[Gateway]]:
    """Run gateways that start at the same time."""
    ports = [free_port() for _ in range(count)]
    shared = ("--zenoh-connect", hub.endpoint, "--redis-url", redis_url, "--callback-allow", LOOPBACK, *flags)
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
    """Remove requests that were broken off because their gateway was killed; their receiver has no message."""
    return [seen for seen in log if len(seen.body) == int(seen.headers["content-length"])]


def deliveries(log: Sequence[Seen]) -> list[Seen]:
    """Return the deliveries without repeats, after checking that none is missing and order and content are right.

    A repeat has an id that was seen before, and exactly the same content; all others are numbered from 1 without gaps.
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
    """Return the number of a delivery within its subscription."""
    return int(seen.headers["linked-fleet-delivery"])


def angle(seen: Seen) -> float:
    """Return the position of the joint in a delivery."""
    resource = seen.headers["link"].partition(">")[0].removeprefix("<")
    return angle_in(read(seen.body, resource), rdflib.URIRef(resource))


def present(gateway: Gateway) -> float:
    """Return the position of the joint in a GET."""
    page = gateway.browser.page(gateway.rotation)
    return angle_in(page.graph, page.iri)


def arrived(receiver: CallbackReceiver, path: str, value: float) -> None:
    """Wait until the last delivery to a path has ``value``."""

    def probe() -> bool:
        log = complete(receiver.log(path, "POST"))
        return bool(log) and angle(log[-1]) == value

    eventually(probe, f"{value} at {path}")
