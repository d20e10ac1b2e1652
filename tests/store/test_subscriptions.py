"""Subscriptions: accepted ones are read back unchanged, listed, counted, numbered, and gone when removed."""

import asyncio
from collections.abc import AsyncIterator, Iterator
from contextlib import aclosing

import pytest

from linked_fleet_gateway.resources.subscription import Delivery, DeliveryState, Depth, Kind
from linked_fleet_gateway.subscriptions.redis_scripts import Keys
from linked_fleet_gateway.subscriptions.store import (
    Backlog,
    News,
    SubscriptionLimitReached,
    SubscriptionNotHeld,
    SubscriptionStore,
)
from redis_backends import Backend, opened
from store_samples import (
    LIMIT,
    OUTGOING,
    CrashedError,
    a_subscription,
    adopted,
    count_trips,
    crash_after,
    held,
    known,
    listed,
    served,
)

NEWS = Keys().news


@pytest.fixture
def a(server: Backend) -> Iterator[SubscriptionStore]:
    yield from opened(server, SubscriptionStore(server.url, "fleet", "a"))


@pytest.fixture
def b(server: Backend) -> Iterator[SubscriptionStore]:
    yield from opened(server, SubscriptionStore(server.url, "fleet", "b"))


# Records and lists


async def test_a_subscription_is_read_as_it_was_accepted(a: SubscriptionStore, b: SubscriptionStore) -> None:
    whole = a_subscription(
        depth=Depth.SUBTREE, interval_s=0.25, deadband=1e-3, callback="https://x/", secret="whsec_YQ"
    )
    delivery = Delivery(DeliveryState.AWAITING_CONSENT, 17, 503, 3, "It said: “später”.", True, 0.5)
    await a.add(whole, delivery, LIMIT)
    record = await known(b, whole.id)
    assert (record.subscription, record.delivery, record.holder) == (whole, delivery, "a")
    assert await b.get_record("none") is None
    await a.store_delivery_state(whole.id, Delivery())
    assert [one.delivery for one in await b.records_of_owner(whole.owner)] == [Delivery()]


async def test_a_container_lists_its_own_of_all_gateways_oldest_first(
    a: SubscriptionStore, b: SubscriptionStore
) -> None:
    await a.renew_lease()
    made = [a_subscription(kind=kind) for kind in Kind]
    for number, one in enumerate(reversed(made)):
        await (a, b)[number % 2].add(one, Delivery(), LIMIT)
    await b.renew_lease()
    await a.add(a_subscription(owner="/"), Delivery(), LIMIT)
    assert await listed(a) == made
    assert await listed(a, "/baxter") == []


async def test_a_long_container_is_listed_in_few_steps(a: SubscriptionStore) -> None:
    made = [a_subscription(kind=list(Kind)[number % 4]) for number in range(300)]
    await asyncio.gather(*(a.add(one, Delivery(), LIMIT) for one in made))
    await a.renew_lease()  # streams are listed while the lease lasts
    trips = count_trips(a)
    assert await listed(a) == made
    assert trips() == 2 + 2  # parts of 256


async def test_a_client_has_no_more_than_its_limit_and_a_refusal_stores_nothing(
    server: Backend, a: SubscriptionStore, b: SubscriptionStore
) -> None:
    asked = [a_subscription() for _ in range(20)]
    results = await asyncio.gather(
        *((a, b)[number % 2].add(one, Delivery(), 5) for number, one in enumerate(asked)), return_exceptions=True
    )
    accepted = [one for one, result in zip(asked, results, strict=True) if result is None]
    assert len(accepted) == 5
    assert {type(result) for result in results} == {type(None), SubscriptionLimitReached}, results
    assert len(await listed(a)) == len(await a.held_records()) + len(await b.held_records()) == 5
    await b.add(a_subscription(client="192.0.2.8"), Delivery(), 5)  # another client is counted separately
    await a.remove(accepted[0].id)
    await a.add(a_subscription(), Delivery(), 5)
    for one in await listed(a):
        await a.remove(one.id)
    await a.announce_end()
    await b.announce_end()
    assert server.lasting_keys() == [NEWS]


async def test_adding_again_changes_nothing_but_what_is_said(a: SubscriptionStore) -> None:
    one = a_subscription()
    await a.add(one, Delivery(), 1)
    first = await a.advance_queue(one.id, None, OUTGOING, Delivery())
    await a.add(one, Delivery(failures=1), 1)
    assert (await known(a, one.id)).delivery.failures == 1
    assert (await a.read_backlog(one.id)).entries == [first]
    second = await a.advance_queue(one.id, first, OUTGOING, Delivery())
    assert second is not None and second.number == 2


async def test_nothing_written_late_brings_a_removed_subscription_back(server: Backend, a: SubscriptionStore) -> None:
    one = a_subscription()
    await a.add(one, Delivery(), LIMIT)
    removed = await a.remove(one.id)
    assert removed is not None and removed.subscription == one
    assert await a.remove(one.id) is await a.resume(one.id) is None
    assert await a.store_delivery_states({one.id: Delivery(), "other": Delivery()}) == {one.id, "other"}
    for late in (
        a.store_delivery_state(one.id, Delivery()),
        a.advance_queue(one.id, None, OUTGOING, Delivery()),
        a.read_backlog(one.id),
    ):
        with pytest.raises(SubscriptionNotHeld):
            await late
    await a.announce_end()
    assert server.lasting_keys() == []


# Crashes between two steps


@pytest.mark.parametrize("commands", range(5))
async def test_an_incomplete_addition_is_invisible_and_reclaimed(
    commands: int, server: Backend, a: SubscriptionStore, b: SubscriptionStore
) -> None:
    one = a_subscription()
    crash_after(a, commands)
    with pytest.raises(CrashedError):
        await a.add(one, Delivery(), LIMIT)
    assert await b.get_record(one.id) is None
    assert await listed(b) == []
    for run in ["a", *await b.dead_runs()]:
        assert await adopted(b, run) == []
    assert await b.dead_runs() == []
    assert server.lasting_keys() == []


@pytest.mark.parametrize("commands", range(1, 4))
async def test_an_incomplete_removal_is_reclaimed_by_its_holder(
    commands: int, server: Backend, a: SubscriptionStore, b: SubscriptionStore
) -> None:
    one = a_subscription()
    await a.add(one, Delivery(), LIMIT)
    crash_after(b, commands)
    with pytest.raises(CrashedError):
        await b.remove(one.id)
    assert await a.get_record(one.id) is None
    assert await held(a) == []
    await a.announce_end()
    assert server.lasting_keys() == []


# Deliveries; their order and numbers are in ``test_queue_model.py``


async def test_ten_thousand_resources_may_be_no_more_at_once(a: SubscriptionStore) -> None:
    one = a_subscription()
    await a.add(one, Delivery(), LIMIT)
    entry = await a.advance_queue(one.id, None, OUTGOING, Delivery())
    await a.advance_queue(one.id, entry, None, Delivery(), [OUTGOING.path, *(f"/{n}" for n in range(10_000))])
    assert await a.read_backlog(one.id) == Backlog([], {}, 1)


async def test_noting_many_returns_the_lost_ones(a: SubscriptionStore, b: SubscriptionStore) -> None:
    mine, others, gone = (a_subscription() for _ in range(3))
    await a.add(mine, Delivery(), LIMIT)
    await b.add(others, Delivery(), LIMIT)
    noted = {one.id: Delivery(last_ns=7) for one in (gone, mine, others)}
    assert await a.store_delivery_states(noted) == {gone.id, others.id}
    assert await a.store_delivery_states({}) == set()
    assert [record.delivery.last_ns for record in await a.records_of_owner(mine.owner)] == [7, None]


# News


@pytest.fixture
def news(server: Backend, a: SubscriptionStore) -> Iterator[AsyncIterator[News]]:
    yield from opened(server, aclosing(a.news()))


async def test_a_holder_gets_news_after_an_outage(
    server: Backend, a: SubscriptionStore, b: SubscriptionStore, news: AsyncIterator[News]
) -> None:
    mine, resumed, removed, later = (a_subscription() for _ in range(4))
    await a.renew_lease()
    for one in (mine, resumed, removed, later):
        await a.add(one, Delivery(DeliveryState.SUSPENDED, failures=8, reason="Gone.", consented=True), LIMIT)
    await a.remove(mine.id)
    record = await b.resume(resumed.id)
    assert record is not None and record.delivery == Delivery(consented=True)
    await b.remove(removed.id)
    await a.resume(later.id)
    assert await anext(news) == News("resumed", resumed.id, "a")
    assert await anext(news) == News("removed", removed.id, "a")
    assert await anext(news) == News("resumed", later.id, "a")
    waiting = asyncio.ensure_future(anext(news))
    server.kill()
    server.start()
    await served(b.renew_lease)
    await b.remove(later.id)
    assert await waiting == News("removed", later.id, "a")


async def test_a_stream_is_not_woken(a: SubscriptionStore) -> None:
    one, waiting = a_subscription(kind=Kind.STREAM), Delivery(DeliveryState.WAITING)
    await a.add(one, waiting, LIMIT)
    record = await a.resume(one.id)
    assert record is not None and record.delivery == waiting
