"""Streams that move between gateways, and what clients, receivers and gateways leave behind when they go."""

import contextlib
import socket
import struct
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from rdflib import URIRef

from browser import LF
from gateway_group import Gateway, Hub, gateway, gateways, hub
from linked_fleet_gateway.resources.subscription import Kind, Subscription
from linked_fleet_gateway.subscriptions.service import RECONCILE_S
from linked_fleet_gateway.subscriptions.store import SubscriptionStore
from redis_servers import Servers, single
from running import Process, eventually
from subscribers import EVENTS, Events, Socket, events, refused

pytestmark = pytest.mark.virtual
LIMIT = 20
_RESET = struct.pack("ii", 1, 0)
_FORGOTTEN = ("never retrieved", "was destroyed", "without completing")
_UNWELCOME = (*_FORGOTTEN, "Traceback", "Exception", "ERROR")


@pytest.fixture(scope="module")
def stage() -> Iterator[Hub]:
    with hub() as stage:
        yield stage


@pytest.fixture(scope="module")
def memory(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Servers]:
    with single(tmp_path_factory.mktemp("redis")) as servers:
        yield servers


@pytest.fixture(scope="module")
def two(stage: Hub, memory: Servers) -> Iterator[list[Gateway]]:
    with gateways(stage, memory.url) as found:
        yield found
        for each in found:
            assert each.process.stop() == 0
            calm(each.process)


@pytest.fixture
def pair(two: list[Gateway]) -> tuple[Gateway, Gateway]:
    one, other = two
    for each in two:
        eventually(lambda each=each: not each.listed(), "an empty container")
    return one, other


def calm(process: Process, unwelcome: tuple[str, ...] = _UNWELCOME) -> None:
    """Check that its log has no unexpected errors."""
    found = [line for line in process.lines if any(word in line for word in unwelcome)]
    assert not found, process.output


def shown(gateway: Gateway, iri: str) -> tuple[bool, URIRef]:
    """Return whether the container lists the subscription, and its state."""
    page = gateway.description(iri)
    return page.response.url.path in gateway.listed(), page.one(LF.deliveryState)


def all_show(gateways: tuple[Gateway, ...], iri: str, kind: URIRef | None, state: URIRef) -> None:
    for each in gateways:
        eventually(lambda each=each: shown(each, iri) == (True, state), f"{iri}, {state}")
        if kind is not None:
            assert kind in each.description(iri).types


# -- a stream that was made by POST ---------------------------------------------------------------------------------


def test_a_stream_made_here_and_opened_there_goes_on(stage: Hub, pair: tuple[Gateway, Gateway]) -> None:
    """For longer than gateways take to reconcile; deleting it through any gateway ends it."""
    one, other = pair
    iris = one.posted_stream(), one.posted_stream()
    with Socket(other.here(iris[0])) as socket, events(other.here(iris[1])) as stream:
        assert socket.next().angle == stream.next().angle == stage.angle
        end_s = time.monotonic() + 2 * RECONCILE_S + 1
        while time.monotonic() < end_s:  # a missing subscription is handled when it is missing for the second time
            stage.step()
            assert socket.next().angle == stream.next().angle == stage.angle
            for iri, kind in zip(iris, (LF.WebSocketStream, LF.EventStream), strict=True):
                all_show(pair, iri, kind, LF.active)
            time.sleep(2)  # as long as nothing happens
        for iri in iris:
            assert one.browser.http.delete(one.here(iri)).status_code == 204
        assert socket.until_closed()[0] == 1000
        assert stream.ended()
        assert stream.last_event_id == "cancelled"
    for each in pair:
        assert each.listed() == set()


def test_a_stream_that_is_opened_at_one_and_then_at_the_other_goes_over(
    stage: Hub, pair: tuple[Gateway, Gateway]
) -> None:
    """A stream moves between two gateways. The former holder is notified, and closing there does not take it back."""
    one, other = pair
    iri = one.posted_stream()
    with Socket(one.here(iri)) as first:
        before = first
        first.next()
        for each in (other, one, other, other, one):
            now = Socket(each.here(iri))
            assert before.until_closed()[0] == 4409
            before.close()
            before = now
            now.next()
            stage.step()
            while now.next().angle != stage.angle:
                pass
            all_show(pair, iri, LF.WebSocketStream, LF.active)
        before.close()
        all_show(pair, iri, None, LF.waiting)
        with Socket(other.here(iri)) as last:
            assert last.next().angle == stage.angle
            all_show(pair, iri, LF.WebSocketStream, LF.active)
            assert one.browser.http.delete(one.here(iri)).status_code == 204
            assert last.until_closed()[0] == 1000


def test_an_event_stream_that_goes_over_ends_for_good(stage: Hub, pair: tuple[Gateway, Gateway]) -> None:
    """Otherwise two pages with an EventSource each would take it from each other for ever."""
    one, other = pair
    iri = one.posted_stream()
    with events(one.here(iri)) as first, contextlib.ExitStack() as stack:
        first.next()
        second = stack.enter_context(events(other.here(iri)))
        assert first.ended()
        assert first.last_event_id == "cancelled"
        back = {"accept": EVENTS, "last-event-id": first.last_event_id}
        assert one.browser.http.get(one.here(iri), headers=back).status_code == 204
        second.next()
        for _ in range(5):
            stage.step()
            while second.next().angle != stage.angle:
                pass
        all_show(pair, iri, LF.EventStream, LF.active)
        with Socket(one.here(iri)) as third:  # by another protocol, and back at the first gateway
            assert second.ended()
            assert second.last_event_id == "cancelled"
            assert third.next().angle == stage.angle
            all_show(pair, iri, LF.WebSocketStream, LF.active)
    all_show(pair, iri, None, LF.waiting)
    assert other.browser.http.delete(other.here(iri)).status_code == 204


def test_a_stream_that_is_closed_here_and_opened_there_at_once(stage: Hub, pair: tuple[Gateway, Gateway]) -> None:
    """In both orders of notification, the closing gateway must not take the stream from the opening one."""
    one, other = pair
    iri = one.posted_stream()
    for each in 10 * (one, other):
        with Socket(each.here(iri)) as socket:
            socket.next()
            stage.step()
            while socket.next().angle != stage.angle:
                pass
    with Socket(other.here(iri)) as socket:
        socket.next()
        all_show(pair, iri, LF.WebSocketStream, LF.active)
    assert one.browser.http.delete(one.here(iri)).status_code == 204


@pytest.mark.parametrize("kind", [Kind.WEBSOCKET, Kind.EVENT_STREAM])
def test_a_stream_that_is_deleted_while_another_gateway_opens_it_stays_deleted(
    memory: Servers, pair: tuple[Gateway, Gateway], monkeypatch: pytest.MonkeyPatch, kind: Kind
) -> None:
    """That gateway has read its record but does not hold it yet, so it gets no news of the deletion."""
    one, other = pair
    iri, add = one.posted_stream(), SubscriptionStore.add

    async def late(self: SubscriptionStore, subscription: Subscription, *arguments: Any, **options: Any) -> None:
        async with SubscriptionStore(memory.url, "fleet", "third") as third:
            assert await third.remove(subscription.id) is not None
        await add(self, subscription, *arguments, **options)

    with monkeypatch.context() as patched:
        patched.setattr(SubscriptionStore, "add", late)
        if kind is Kind.WEBSOCKET:
            assert refused(other.here(iri)).status_code == 404
        else:
            with other.browser.http.stream("GET", other.here(iri), headers={"accept": EVENTS}) as answer:
                assert answer.status_code == 404
    for each in pair:
        assert each.get(each.here(iri)).status_code == 404
        assert each.listed() == set()


# -- clients that go before they have an answer ---------------------------------------------------------------------


def rude(url: str, *fields: str, wait: bool = False) -> None:
    """Send a request, and reset the connection at once or with the first byte of the response."""
    _, _, rest = url.partition("://")
    authority, _, path = rest.partition("/")
    host, _, port = authority.partition(":")
    head = (f"GET /{path} HTTP/1.1", f"Host: {authority}", *fields)
    with socket.create_connection((host, int(port))) as connection:
        connection.sendall("".join(f"{line}\r\n" for line in (*head, "")).encode())
        if wait:
            connection.recv(1)
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, _RESET)


_WEBSOCKET = (
    "Connection: Upgrade",
    "Upgrade: websocket",
    "Sec-WebSocket-Version: 13",
    "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==",
)


def swarm(url: str, count: int) -> None:
    for index in range(count):
        for fields in (_WEBSOCKET, (f"Accept: {EVENTS}",)):
            rude(url, *fields, wait=index % 4 == 3)


def unused(at: Gateway) -> None:
    """Check that the container is empty, and that the maximum number of streams can be opened."""
    eventually(lambda: at.listed() == set(), "an empty container")
    with contextlib.ExitStack() as stack:

        def room() -> bool:
            return at.get(at.container).status_code == 200 and Socket(at.rotation).close() is None

        def as_many_as_ever() -> bool:
            made = [
                answer.headers["location"] for answer in (at.post_stream() for _ in range(LIMIT)) if answer.is_success
            ]
            for iri in made:
                assert at.browser.http.delete(iri).status_code == 204
            return len(made) == LIMIT

        eventually(room, "room for a stream")
        # A stream opened and deleted by a vanished client counts for a moment after the list is empty.
        eventually(as_many_as_ever, "room for as many as ever")
        eventually(lambda: at.listed() == set(), "an empty container")
        kept: list[Socket | Events] = []
        for _ in range(LIMIT // 2):
            kept += stack.enter_context(Socket(at.rotation)), stack.enter_context(events(at.rotation))
        for each in kept:
            each.next()
        assert at.browser.http.get(at.rotation, headers={"accept": EVENTS}).status_code == 429
        assert len(at.listed()) == LIMIT
    eventually(lambda: at.listed() == set(), "an empty container")


def test_clients_that_reset_their_connection_leave_nothing(stage: Hub, tmp_path: Path) -> None:
    """Streams of their own and one created by POST, before or just when they are answered; no error is logged."""
    limit = ("--subscriptions-per-client", str(LIMIT))
    with gateway(stage, *limit, state=tmp_path) as at:
        swarm(at.rotation, 20)
        unused(at)
        iri = at.posted_stream()
        swarm(iri, 8)
        all_show((at,), iri, None, LF.waiting)
        with Socket(iri) as socket:
            assert socket.next().angle == stage.angle
            assert at.listed() == {at.get(iri).url.path}
            assert at.browser.http.delete(iri).status_code == 204
        unused(at)
        assert at.process.stop() == 0
        calm(at.process)


def test_clients_that_come_and_go_while_redis_hangs_leave_nothing(stage: Hub, tmp_path: Path) -> None:
    limit = ("--subscriptions-per-client", str(LIMIT))
    with single(tmp_path / "redis") as servers, gateway(stage, *limit, "--redis-url", servers.url) as at:
        (node,) = servers.nodes
        node.pause()
        swarm(at.rotation, 5)
        assert at.post_stream().status_code == 503
        node.resume()
        eventually(lambda: at.get(at.container).status_code == 200, "Redis again")
        unused(at)
        assert at.process.stop() == 0
        calm(at.process)
