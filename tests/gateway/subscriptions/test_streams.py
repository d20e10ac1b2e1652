"""The streams of one gateway with a store, a fleet and a fan-out: they stay listed, and leave nothing behind."""

import asyncio
import math
import time
import uuid
from collections.abc import AsyncIterator, Awaitable, Callable, Iterator
from contextlib import asynccontextmanager, closing
from dataclasses import replace
from typing import Any

import pytest

from fake_robots import joint, link, robot
from linked_fleet_agent.wire.codec import encode_state, layout
from linked_fleet_agent.wire.messages import WIRE_VERSION, Description, State
from linked_fleet_base.errors import RedisUnavailable
from linked_fleet_gateway.resources.subscription import Delivery, DeliveryState, Kind, Subscription
from linked_fleet_gateway.resources.tree import Tree
from linked_fleet_gateway.subscriptions import service as service_module
from linked_fleet_gateway.subscriptions import streams as streams_module
from linked_fleet_gateway.subscriptions.broadcast import Ending, Message
from linked_fleet_gateway.subscriptions.fan_out import FanOut
from linked_fleet_gateway.subscriptions.service import Subscriptions
from linked_fleet_gateway.subscriptions.store import News, SubscriptionLimitReached, SubscriptionStore
from linked_fleet_gateway.subscriptions.streams import Streams
from linked_fleet_gateway.subscriptions.watcher import Watcher
from linked_fleet_state.events import Appeared, Described, Framed
from linked_fleet_state.fleet import Fleet
from linked_fleet_state.invocations import Invocations
from linked_fleet_webhooks.network import Network
from redis_servers import Servers, single
from running import PATIENCE_S

pytestmark = pytest.mark.virtual
OWNER, PATH = "/r/elbow", "/r/elbow/rotation"
LIMIT = 3


class Outlet:
    """A connection on which everything is sent at once."""

    def __init__(self) -> None:
        self.messages: list[Message] = []
        self.ending: Ending | None = None

    def writable(self) -> bool:
        return self.ending is None

    def write(self, message: Message) -> None:
        self.messages.append(message)

    def end(self, ending: Ending) -> None:
        self.ending = ending


class Watched(FanOut):
    @property
    def idle(self) -> bool:
        return not (self._dirty or self._scans or self._runnable)


class Toy:
    """A fleet with one robot, and the fan-out that watches it."""

    def __init__(self) -> None:
        self.fleet, self._sequence = Fleet(), 0
        invocations = Invocations()
        self.fan_out = Watched(lambda base, sees: Tree(self.fleet, invocations, base, visible_robots=sees))
        self.fleet.apply(Appeared("r", 1), 1)
        self.fleet.apply(
            Described(
                Description(
                    version=WIRE_VERSION, robot="r", incarnation=1, title="R", joints=("elbow",), rate_hz=50,
                    urdf=robot(link("base"), link("tip"), joint("elbow", "revolute", "base", "tip")),
                    layout=layout(1, False), capabilities=(),
                )
            ),
            1,
        )  # fmt: skip
        self.move()

    def move(self) -> None:
        self._sequence += 1
        nan, n = (math.nan,), self._sequence
        state = State(
            incarnation=1, sequence=n, monotonic_ns=n, wall_ns=1000 + n,
            positions=(n / 1000,), velocities=nan, efforts=nan,
        )  # fmt: skip
        self.fleet.apply(Framed("r", encode_state(state)), 1)
        self.fan_out.mark_moved("r")


class Cut(SubscriptionStore):
    """A store whose answers are lost after execution, while ``cut`` is set."""

    cut = False

    async def add(self, *arguments: object, **options: object) -> None:
        await super().add(*arguments, **options)  # type: ignore[arg-type]
        if self.cut:
            raise RedisUnavailable("the answer was lost")


class Gateway:
    """The parts of a gateway that streams need."""

    def __init__(self, store: Cut, run: str) -> None:
        self.store, self.run, self.toy = store, run, Toy()
        self.streams = Streams(store, run, self.toy.fan_out, LIMIT)

    async def connect(self, subscription: Subscription, kind: Kind = Kind.WEBSOCKET) -> tuple[Watcher, Outlet]:
        """Open a stream and await its first message."""
        opened, outlet = replace(subscription, kind=kind), Outlet()
        await self.streams.register(opened)
        watcher = self.streams.open(opened, outlet, None)
        watcher.schedule_send()
        await until(lambda: bool(outlet.messages), "the first message")
        return watcher, outlet

    async def listed(self) -> set[str]:
        return {record.subscription.id for record in await self.store.records_of_owner(OWNER)}

    async def state(self, subscription: Subscription) -> DeliveryState | None:
        record = await self.store.get_record(subscription.id)
        return None if record is None else record.delivery.state

    async def keep(self) -> bool:
        """Do a gateway's periodic work; return True if nothing is left, not even a partial list."""
        await self.streams.store_missed_changes()
        await self.streams.reconcile({record.subscription.id: record for record in await self.store.held_records()})
        return not await self.listed() and not self.streams._background and not self.streams._expiries

    async def emptied(self) -> None:
        """Check that nothing is listed, and that the client has its whole quota."""

        async def empty() -> bool:
            return not await self.listed()

        await until(empty, "an empty container")
        mine = [stream() for _ in range(LIMIT)]
        for each in mine:
            await self.streams.add_unopened(each)
        with pytest.raises(SubscriptionLimitReached):
            await self.streams.add_unopened(stream())
        assert await self.listed() == {each.id for each in mine}
        for each in mine:
            await self.store.remove(each.id)
            self.streams.end_stream(each.id, Ending.CANCELLED)
        assert not self.streams._coming
        assert not self.streams._unlisted
        assert not self.streams._expiries


@pytest.fixture(scope="module")
def servers(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Servers]:
    with single(tmp_path_factory.mktemp("redis")) as running:
        yield running


@pytest.fixture
def soon(monkeypatch: pytest.MonkeyPatch) -> None:
    """Shorten all waits."""
    monkeypatch.setattr(streams_module, "UNOPENED_S", 0.3)


def stream(kind: Kind = Kind.STREAM) -> Subscription:
    return Subscription(
        id=str(uuid.uuid4()),
        owner=OWNER,
        resource=PATH,
        kind=kind,
        media_type="text/turtle",
        base="http://fleet.example",
        client="192.0.2.7",
        created_ns=time.time_ns(),
    )


async def until(probe: Callable[[], bool | Awaitable[bool]], what: str) -> None:
    deadline = time.monotonic() + PATIENCE_S
    while True:
        found = probe()
        if found if isinstance(found, bool) else await found:
            return
        assert time.monotonic() < deadline, f"never happened: {what}"
        await asyncio.sleep(0.05)


@asynccontextmanager
async def gateways(servers: Servers, count: int = 1) -> AsyncIterator[list[Gateway]]:
    namespace, found = uuid.uuid4().hex, []
    try:
        for _ in range(count):
            run = uuid.uuid4().hex
            found.append(Gateway(Cut(servers.url, namespace, run, lease_s=PATIENCE_S), run))
            await found[-1].store.renew_lease()
        yield found
    finally:
        for each in found:
            await each.streams.aclose()
            await each.store.__aexit__()


# A stream that was made by POST, between its connections


async def test_a_stream_that_is_reopened_stays(servers: Servers, soon: None) -> None:
    """No wait between its connections ends it later: it is still open when later waits have expired."""
    async with gateways(servers) as (at,):
        posted = stream()
        await at.streams.add_unopened(posted)
        for kind in (Kind.WEBSOCKET, Kind.EVENT_STREAM, Kind.WEBSOCKET):
            watcher, _ = await at.connect(posted, kind)
            at.streams.close(replace(posted, kind=kind), watcher, reopenable=True)
        for _ in range(3):  # now each of them waits before it is opened
            watcher, _ = await at.connect(posted)
            at.streams.close(replace(posted, kind=Kind.WEBSOCKET), watcher, reopenable=True)

            async def waiting() -> bool:
                return await at.state(posted) is DeliveryState.WAITING and posted.id in at.streams._expiries

            await until(waiting, "a stream that waits")
        _, outlet = await at.connect(posted)
        control = stream()
        await at.streams.add_unopened(control)

        async def over() -> bool:
            return await at.listed() == {posted.id}

        await until(over, "the end of one that nobody opens")
        await at.streams.store_missed_changes()
        assert await at.listed() == {posted.id}
        assert outlet.ending is None
        count = len(outlet.messages)
        at.toy.move()
        await until(lambda: len(outlet.messages) > count, "another message")


async def test_a_stream_that_is_not_reopened_is_removed(servers: Servers, soon: None) -> None:
    async with gateways(servers) as (at,):
        never, once = stream(), stream()
        for each in (never, once):
            await at.streams.add_unopened(each)
        watcher, _ = await at.connect(once)
        at.streams.close(replace(once, kind=Kind.WEBSOCKET), watcher, reopenable=True)
        await at.emptied()


async def test_a_wait_at_the_gateway_before_does_not_end_it(servers: Servers, soon: None) -> None:
    """A stream is created at one gateway and opened at another. The first does not know that, and its wait expires."""
    async with gateways(servers, 2) as (one, other):
        posted = stream()
        await one.streams.add_unopened(posted)
        _, outlet = await other.connect(posted)
        await until(lambda: not one.streams._expiries, "the end of the wait")
        await until(lambda: not one.streams._background, "what is done then")
        assert await one.listed() == await other.listed() == {posted.id}
        assert outlet.ending is None


async def test_a_late_close_does_not_affect_the_new_connection(servers: Servers, soon: None) -> None:
    async with gateways(servers, 2) as (one, other):
        posted = stream()
        await one.streams.add_unopened(posted)
        watcher, _ = await one.connect(posted)
        _, outlet = await other.connect(posted)
        one.streams.close(replace(posted, kind=Kind.WEBSOCKET), watcher, reopenable=True)
        await until(lambda: not one.streams._background, "what is done then")
        record = await one.store.get_record(posted.id)
        assert record is not None
        assert record.delivery.state is DeliveryState.ACTIVE
        assert {each.subscription.id for each in await other.store.held_records()} == {posted.id}
        assert await one.store.held_records() == []
        assert (outlet.ending, one.streams._expiries) == (None, {})


# What fails half way


async def test_a_client_that_goes_before_its_stream_is_open_leaves_nothing(servers: Servers, soon: None) -> None:
    async with gateways(servers) as (at,):
        posted = stream()
        await at.streams.add_unopened(posted)
        for each, reopenable in ((stream(Kind.WEBSOCKET), False), (replace(posted, kind=Kind.WEBSOCKET), True)):
            await at.streams.register(each)
            assert each.id in at.streams._coming
            at.streams.close(each, None, reopenable=reopenable)
        await at.emptied()


async def test_a_client_with_too_many_leaves_nothing(servers: Servers) -> None:
    async with gateways(servers) as (at,):
        mine = [stream(Kind.WEBSOCKET) for _ in range(LIMIT)]
        watchers = [(await at.connect(each))[0] for each in mine]
        for kind in (Kind.WEBSOCKET, Kind.EVENT_STREAM):
            with pytest.raises(SubscriptionLimitReached):
                await at.streams.register(stream(kind))
        assert await at.listed() == {each.id for each in mine}
        for each, watcher in zip(mine, watchers, strict=True):
            at.streams.close(each, watcher, reopenable=False)
        await at.emptied()


async def test_a_cancelled_registration_leaves_nothing(servers: Servers, soon: None) -> None:
    """At any step of the store; also a stream created by POST, which continues to wait."""
    async with gateways(servers) as (at,):
        for steps in range(0, 60, 6):
            posted = stream()
            await at.streams.add_unopened(posted)
            for each in (stream(Kind.WEBSOCKET), replace(posted, kind=Kind.WEBSOCKET)):
                task = asyncio.create_task(at.streams.register(each))
                for _ in range(steps):
                    await asyncio.sleep(0)
                task.cancel()
                await asyncio.wait([task])
                if not task.cancelled():
                    at.streams.close(each, None, reopenable=each.id == posted.id)
            await until(at.keep, "nothing left")
        await at.emptied()


async def test_an_answer_of_the_store_that_is_lost_leaves_nothing(servers: Servers) -> None:
    """The client gets RedisUnavailable, and the subscription that was stored anyway is deleted later."""
    async with gateways(servers) as (at,):
        at.store.cut = True
        with pytest.raises(RedisUnavailable):
            await at.streams.add_unopened(stream())
        at.store.cut = False
        await at.streams.store_missed_changes()
        await at.emptied()


async def test_a_stream_that_is_opened_while_answers_are_lost_is_listed_later_and_leaves_nothing(
    servers: Servers,
) -> None:
    async with gateways(servers) as (at,):
        one, gone = stream(Kind.WEBSOCKET), stream(Kind.WEBSOCKET)
        at.store.cut = True
        watcher, outlet = await at.connect(one)
        await at.streams.register(gone)
        at.streams.close(gone, None, reopenable=False)
        at.store.cut = False
        await at.streams.store_missed_changes()
        await until(lambda: not at.streams._background, "what is done when a client goes")
        assert await at.listed() == {one.id}
        assert outlet.ending is None
        at.streams.close(one, watcher, reopenable=False)
        await at.emptied()


async def test_a_posted_stream_that_is_opened_again_after_an_outage_stays_listed(servers: Servers) -> None:
    """Its end could not be stored; when it is opened again there is nothing to store any more."""
    async with gateways(servers) as (at,):
        posted = stream()
        await at.streams.add_unopened(posted)
        watcher, _ = await at.connect(posted)
        for node in servers.nodes:
            node.pause()
        at.streams.close(replace(posted, kind=Kind.WEBSOCKET), watcher, reopenable=True)
        await until(lambda: posted.id in at.streams._ended, "a store that does not answer")
        for node in servers.nodes:
            node.resume()
        _, outlet = await at.connect(posted)
        await at.streams.store_missed_changes()
        assert await at.listed() == {posted.id}
        assert outlet.ending is None
        await at.store.store_delivery_state(posted.id, Delivery())  # it is held here


async def test_a_stream_deleted_while_opening_ends(servers: Servers, soon: None) -> None:
    async with gateways(servers) as (at,):
        posted, outlet = stream(), Outlet()
        await at.streams.add_unopened(posted)
        opened = replace(posted, kind=Kind.WEBSOCKET)
        await at.streams.register(opened)
        await at.store.remove(posted.id)
        at.streams.end_stream(posted.id, Ending.CANCELLED)
        watcher = at.streams.open(opened, outlet, None)
        assert outlet.ending is Ending.CANCELLED
        at.streams.close(opened, watcher, reopenable=True)
        await at.streams.store_missed_changes()
        await at.emptied()


async def test_leftovers_of_a_late_command_are_reconciled(servers: Servers) -> None:
    """A command that was given up is executed after the end was stored: reconciling finds the leftover."""
    async with gateways(servers) as (at,):
        posted = stream()
        await at.streams.add_unopened(posted)
        _, outlet = await at.connect(one := stream(Kind.WEBSOCKET))
        await at.store.add(stray := stream(Kind.WEBSOCKET), Delivery(), LIMIT)
        for _ in range(2):
            assert await at.listed() == {posted.id, one.id, stray.id}
            await at.keep()
        await at.streams.store_missed_changes()
        assert await at.listed() == {posted.id, one.id}
        assert outlet.ending is None


async def test_a_stream_deleted_during_its_close_stays_deleted(servers: Servers) -> None:
    async with gateways(servers) as (at,):
        posted, note = stream(), at.store.store_delivery_state
        await at.streams.add_unopened(posted)
        watcher, _ = await at.connect(posted)

        async def noted_and_deleted(*arguments: Any) -> None:
            await note(*arguments)
            assert await at.store.remove(posted.id) is not None

        at.store.store_delivery_state = noted_and_deleted  # type: ignore[method-assign]
        at.streams.close(replace(posted, kind=Kind.WEBSOCKET), watcher, reopenable=True)
        await until(lambda: not at.streams._background, "what is done then")
        assert await at.listed() == set()


async def test_a_stream_deleted_elsewhere_at_its_close_stays_deleted(servers: Servers) -> None:
    """Through another gateway, unknown to this one."""
    async with gateways(servers) as (at,):
        posted = stream()
        await at.streams.add_unopened(posted)
        watcher, _ = await at.connect(posted)
        await at.store.remove(posted.id)
        at.streams.close(replace(posted, kind=Kind.WEBSOCKET), watcher, reopenable=True)
        await until(lambda: not at.streams._background, "what is done then")
        await at.emptied()


# Other options


async def change(one: Gateway, subscription: Subscription, at: Gateway, **options: Any) -> None:
    """Change through ``one``, after which the gateway ``at`` gets the news."""
    record = await one.store.get_record(subscription.id)
    assert record is not None
    assert await one.store.change_options(record.subscription, replace(record.subscription.options, **options))
    changed = await at.store.get_record(subscription.id)
    assert changed is not None
    at.streams.change_options(changed.subscription)


async def test_an_open_stream_goes_by_other_options_and_so_does_it_when_it_is_opened_again(servers: Servers) -> None:
    """On the same connection, without an end or a repetition; the next gateway gets them from its record."""
    async with gateways(servers, 2) as (one, other):
        posted = stream()
        await one.streams.add_unopened(posted)
        watcher, outlet = await one.connect(posted)
        await change(other, posted, one, interval_s=3600.0)
        one.toy.move()
        await until(lambda: one.toy.fan_out.idle, "the end of all turns")
        assert (len(outlet.messages), outlet.ending) == (1, None)
        await change(other, posted, one, interval_s=0.0)
        await until(lambda: len(outlet.messages) == 2, "what waited")
        await change(other, posted, one, deadband=50.0)
        one.streams.close(replace(posted, kind=Kind.WEBSOCKET), watcher, reopenable=True)
        await until(lambda: not one.streams._background, "what is done then")
        record = await other.store.get_record(posted.id)
        assert record is not None
        assert (record.subscription.deadband, record.subscription.kind) == (50.0, Kind.STREAM)
        watcher, _ = await other.connect(record.subscription)
        assert watcher.subscription.deadband == 50.0


async def test_a_stream_that_is_changed_while_it_is_being_opened_has_the_new_options(servers: Servers) -> None:
    async with gateways(servers) as (at,):
        posted = stream()
        await at.streams.add_unopened(posted)
        opened, outlet = replace(posted, kind=Kind.WEBSOCKET), Outlet()
        await at.streams.register(opened)
        await change(at, posted, at, interval_s=3600.0)
        watcher = at.streams.open(opened, outlet, None)
        assert watcher.subscription.interval_s == 3600.0
        assert watcher.subscription.kind is Kind.WEBSOCKET
        assert at.streams.has_options(watcher.subscription)
        assert not at.streams._changed


async def test_a_change_of_which_no_news_came_is_found_in_a_comparison(
    servers: Servers, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The service compares the streams that this gateway serves with their records."""
    monkeypatch.setattr(service_module, "RECONCILE_S", 0.1)

    async def untold() -> AsyncIterator[News]:
        await asyncio.Event().wait()
        yield News("changed", "", "")

    async with gateways(servers, 2) as (one, other):
        one.store.news = untold  # type: ignore[method-assign]
        network = Network(())
        service = Subscriptions(one.store, one.run, one.toy.fan_out, network, consent_required=False, limit=LIMIT)
        one.streams = service.streams
        with closing(network):
            async with service:
                watcher, _ = await one.connect(stream())
                subscription = watcher.subscription
                assert await other.store.change_options(subscription, replace(subscription.options, deadband=2.0))
                await until(lambda: watcher.subscription.deadband == 2.0, "the comparison")
                assert await service.change_options(watcher.subscription, replace(subscription.options, deadband=3.0))
                assert watcher.subscription.deadband == 3.0
                assert not await service.change_options(subscription, replace(subscription.options, deadband=4.0))
