"""Runs of gateways: one at a time holds a subscription, and those of a dead run go to exactly one other."""

import asyncio
from collections.abc import Iterator
from contextlib import aclosing, suppress
from dataclasses import replace
from typing import Any

import pytest

from linked_fleet_gateway.resources.subscription import Delivery, DeliveryState, Kind, Record, Subscription
from linked_fleet_gateway.subscriptions.redis_scripts import Keys
from linked_fleet_gateway.subscriptions.store import (
    News,
    SubscriptionLimitReached,
    SubscriptionNotHeld,
    SubscriptionStore,
)
from redis_backends import Backend, opened
from store_samples import (
    LEASE_S,
    LIMIT,
    CrashedError,
    a_subscription,
    adopted,
    count_trips,
    crash_after,
    held,
    known,
    listed,
)

NEWS = Keys().news


@pytest.fixture
def a(server: Backend) -> Iterator[SubscriptionStore]:
    yield from opened(server, SubscriptionStore(server.url, "fleet", "a", LEASE_S))


@pytest.fixture
def b(server: Backend) -> Iterator[SubscriptionStore]:
    yield from opened(server, SubscriptionStore(server.url, "fleet", "b", LEASE_S))


@pytest.fixture
def c(server: Backend) -> Iterator[SubscriptionStore]:
    yield from opened(server, SubscriptionStore(server.url, "fleet", "c", LEASE_S))


@pytest.fixture
def stream() -> Subscription:
    return a_subscription(kind=Kind.STREAM)


async def ids_held(store: SubscriptionStore) -> set[str]:
    """Return the ids in the list of a run, including those that other runs hold."""
    return set(await store._runs.held_subscriptions(store._run))


# Adoption


@pytest.mark.parametrize("commands", range(14))
async def test_adoption_survives_the_death_of_the_adopter(
    commands: int, a: SubscriptionStore, b: SubscriptionStore, c: SubscriptionStore
) -> None:
    first, stream, last = a_subscription(), a_subscription(kind=Kind.WEBSOCKET), a_subscription()
    for one in (first, stream, last):
        await a.add(one, Delivery(), LIMIT)
    crash_after(b, commands)
    with suppress(CrashedError):
        await adopted(b, "a")
    while dead := await c.dead_runs():
        for run in dead:
            await adopted(c, run)
    assert await listed(c) == [first, last]
    assert {one.id for one in await held(c)} == {first.id, last.id}
    assert await c.get_record(stream.id) is None


async def test_many_are_adopted_in_few_steps_each_given_as_soon_as_it_is_won(
    a: SubscriptionStore, b: SubscriptionStore, c: SubscriptionStore
) -> None:
    made = [a_subscription() for _ in range(200)]
    streams = [a_subscription(kind=Kind.WEBSOCKET) for _ in range(100)]
    await asyncio.gather(*(a.add(one, Delivery(), LIMIT) for one in (*streams, *made)))
    await b.renew_lease()
    await c.renew_lease()
    async with aclosing(b.take_over("a")) as adopting:
        assert (await anext(adopting)).holder == "b"
        assert len(await b.held_records()) < len(made)
        assert await c.get_record(streams[0].id) is not None
    kept = await held(b)
    trips = count_trips(c)
    won = await adopted(c, "a")
    assert trips() < 30
    assert sorted(one.id for one in (*kept, *won)) == sorted(one.id for one in made)
    assert await c.dead_runs() == []
    assert await listed(c) == made
    assert await c.get_record(streams[0].id) is None


async def test_a_run_goes_on_renewing_its_lease_while_it_adopts(
    a: SubscriptionStore, b: SubscriptionStore, c: SubscriptionStore
) -> None:
    for _ in range(20):  # more at once wait for a busy server longer than the store does
        await asyncio.gather(*(a.add(a_subscription(), Delivery(), LIMIT) for _ in range(20)))
    renewals, adopting = 0, True

    async def renew() -> None:
        nonlocal renewals
        while adopting:
            await b.renew_lease()
            renewals += 1

    renewing = asyncio.create_task(renew())
    before = [renewals async for _ in b.take_over("a")]
    adopting = False
    await renewing
    assert len(before) == 400
    assert len(set(before)) >= 400 // 64  # its turn comes between any two parts that are taken over, 64 each
    assert await c.dead_runs() == []


async def test_an_add_whose_first_steps_others_cleared_away_is_whole_in_the_end(
    a: SubscriptionStore, b: SubscriptionStore
) -> None:
    """A gateway so slow that it counts as dead while it adds."""
    one, commit = a_subscription(), a._redis.run_script

    async def late(script: str, keys: tuple[str, ...], *arguments: Any) -> Any:
        if len(keys) == 3:
            a._redis.run_script = commit  # type: ignore[method-assign]
            assert await adopted(b, "a") == []
            assert await b.dead_runs() == []
        return await commit(script, keys, *arguments)

    a._redis.run_script = late  # type: ignore[method-assign]
    await a.add(one, Delivery(), LIMIT)
    assert await listed(b) == await held(a) == [one]
    assert await b.dead_runs() == ["a"]
    assert await adopted(b, "a") == [one]


async def test_subscriptions_of_an_ended_gateway_are_adopted_at_once(
    a: SubscriptionStore, b: SubscriptionStore
) -> None:
    one = a_subscription()
    await a.renew_lease()
    await a.add(one, Delivery(), LIMIT)
    assert await b.dead_runs() == []
    await a.announce_end()
    assert await b.dead_runs() == ["a"]
    assert await adopted(b, "a") == [one]
    assert await b.dead_runs() == []


def test_streams_vanish_with_the_lease_of_their_gateway_and_callbacks_stay(
    server: Backend, a: SubscriptionStore, b: SubscriptionStore
) -> None:
    stream, callback = a_subscription(kind=Kind.EVENT_STREAM), a_subscription()

    async def begin() -> None:
        await b.renew_lease()
        await a.renew_lease()
        for one in (stream, callback):
            await a.add(one, Delivery(), LIMIT)
        assert await listed(b) == [stream, callback]
        assert await b.dead_runs() == []
        assert await adopted(b, "a") == []

    async def take_over() -> None:
        await b.renew_lease()
        assert await b.dead_runs() == ["a"]
        assert await listed(b) == [callback]
        assert await adopted(b, "a") == [callback]
        assert await b.get_record(stream.id) is None
        await a.renew_lease()  # it was not dead: its stream is registered again
        assert await held(a) == []
        await a.add(stream, Delivery(), LIMIT)
        assert await listed(b) == [stream, callback]

    server.run(begin())
    server.pass_time(LEASE_S + 1)
    server.run(take_over())


# Streams that are opened through another gateway


async def test_adding_a_stream_takes_it_over_and_tells_its_holder(
    server: Backend, a: SubscriptionStore, b: SubscriptionStore, c: SubscriptionStore, stream: Subscription
) -> None:
    async with aclosing(a.news()) as news:
        for one in (a, b, c):
            await one.renew_lease()
        await a.add(stream, Delivery(DeliveryState.WAITING), 1)
        opened, delivery = replace(stream, kind=Kind.WEBSOCKET), Delivery(last_ns=5)
        await b.add(opened, delivery, 1)
        there = [Record(opened, delivery, "b")]
        assert await c.records_of_owner(stream.owner) == there
        assert (await ids_held(a), await ids_held(b)) == (set(), {stream.id})
        assert await anext(news) == News("replaced", stream.id, "a")
        # Whatever the first does when its connection closes leaves the stream with the other.
        with pytest.raises(SubscriptionNotHeld):
            await a.add(stream, Delivery(DeliveryState.WAITING), 1, take_over=False)
        assert await a.store_delivery_states({stream.id: Delivery()}) == {stream.id}
        assert await a.remove(stream.id, only_if_held=True) is None
        assert await held(a) == []
        await a.announce_end()
        assert await c.dead_runs() == []
        assert await adopted(c, "a") == []
        assert await c.records_of_owner(stream.owner) == await b.held_records() == there
        await b.announce_end()
        assert await c.records_of_owner(stream.owner) == []
        assert await adopted(c, "b") == []
        await c.announce_end()
        assert server.lasting_keys() == [NEWS]


async def test_a_stream_may_go_there_and_back_at_once(
    a: SubscriptionStore, b: SubscriptionStore, stream: Subscription
) -> None:
    for _ in range(20):
        await asyncio.gather(*(one.add(stream, Delivery(), LIMIT) for one in (a, b, a, b, a, b)))
        holder = (await known(a, stream.id)).holder
        assert stream.id in await ids_held({"a": a, "b": b}[holder])


async def test_a_stream_that_is_taken_back_as_the_other_strikes_it_out_is_listed(
    a: SubscriptionStore, b: SubscriptionStore, stream: Subscription
) -> None:
    await b.add(stream, Delivery(), LIMIT)
    let_go, commit, striking_out = a._let_go, b._redis.run_script, list[Any]()

    async def later(*arguments: Any) -> None:
        striking_out.append(arguments)

    async def late(script: str, keys: tuple[str, ...], *arguments: Any) -> Any:
        if len(keys) == 3:
            await let_go(*striking_out.pop())
        return await commit(script, keys, *arguments)

    a._let_go, b._redis.run_script = later, late  # type: ignore[method-assign]
    await a.add(stream, Delivery(), LIMIT)
    await b.add(stream, Delivery(), LIMIT)
    assert await held(b) == [stream]
    assert await ids_held(b) == {stream.id}


async def test_a_known_stream_that_was_deleted_is_not_accepted_and_leaves_nothing(
    a: SubscriptionStore, b: SubscriptionStore, stream: Subscription
) -> None:
    await a.add(stream, Delivery(DeliveryState.WAITING), 1)
    await a.remove(stream.id)
    with pytest.raises(SubscriptionNotHeld):
        await b.add(stream, Delivery(), 1, known=True)
    assert await listed(b) == await held(b) == []
    assert await ids_held(b) == set()
    await b.add(a_subscription(), Delivery(), 1)  # of the same client


@pytest.mark.parametrize("commands", range(13))
async def test_a_crash_while_a_stream_goes_over_leaves_it_with_one_or_the_other(
    commands: int,
    server: Backend,
    a: SubscriptionStore,
    b: SubscriptionStore,
    c: SubscriptionStore,
    stream: Subscription,
) -> None:
    await a.add(stream, Delivery(), LIMIT)
    await a.renew_lease()
    crash_after(b, commands)
    with suppress(CrashedError):
        await b.add(stream, Delivery(), LIMIT)
    record = await known(c, stream.id)
    for run in {"b", *await c.dead_runs()}:
        assert await adopted(c, run) == []
    assert await c.records_of_owner(stream.owner) == await a.held_records() == [record][: record.holder == "a"]
    await a.announce_end()
    for run in await c.dead_runs():
        assert await adopted(c, run) == []
    assert {*server.lasting_keys()} <= {NEWS}


async def test_a_stream_that_is_opened_again_is_not_cleared_away_with_the_gateway_that_had_it(
    a: SubscriptionStore, b: SubscriptionStore, c: SubscriptionStore, stream: Subscription
) -> None:
    await a.add(stream, Delivery(), LIMIT)
    read = c._records

    async def late(ids: Any) -> Any:
        records = await read(ids)
        c._records = read  # type: ignore[method-assign]
        await b.renew_lease()
        await b.add(stream, Delivery(), LIMIT)
        return records

    c._records = late  # type: ignore[method-assign]
    assert await adopted(c, "a") == []
    assert await listed(c) == await held(b) == [stream]


async def test_a_stream_that_is_opened_while_its_holder_removes_it_is_whole(
    a: SubscriptionStore, b: SubscriptionStore, stream: Subscription
) -> None:
    await a.add(stream, Delivery(), LIMIT)
    clear, adding = a._clear, []

    async def late(*arguments: Any) -> None:
        adding.append(asyncio.create_task(b.add(stream, Delivery(), LIMIT)))
        while stream.id not in await ids_held(b):  # noqa: ASYNC110 - in Redis
            await asyncio.sleep(0.01)
        await clear(*arguments)

    a._clear = late  # type: ignore[method-assign]
    await a.remove(stream.id)
    await asyncio.gather(*adding)
    await b.renew_lease()
    assert await listed(a) == await held(b) == [stream]


async def test_a_stream_that_waits_goes_to_the_gateway_that_adopts_it(
    server: Backend, a: SubscriptionStore, b: SubscriptionStore, stream: Subscription
) -> None:
    """It is listed there, counts for its client as before, and vanishes when it is removed."""
    waiting = Delivery(DeliveryState.WAITING, last_ns=7)
    await b.renew_lease()
    await a.renew_lease()
    await a.add(stream, waiting, 1)
    await a.announce_end()
    assert await adopted(b, "a") == [stream]
    assert await b.records_of_owner(stream.owner) == await b.held_records() == [Record(stream, waiting, "b")]
    assert (await ids_held(a), await ids_held(b)) == (set(), {stream.id})
    with pytest.raises(SubscriptionLimitReached):
        await b.add(a_subscription(), Delivery(), 1)
    await b.remove(stream.id, only_if_held=True)
    await b.announce_end()
    assert {*server.lasting_keys()} <= {NEWS}
