"""Changed options of a subscription: rights, notifications, and writes by a holder with old options."""

from collections.abc import Iterator
from contextlib import aclosing
from dataclasses import replace
from typing import Any

import pytest

from linked_fleet_gateway.resources.subscription import (
    ChangeableOptions,
    Delivery,
    DeliveryState,
    Depth,
    Kind,
    Record,
    Subscription,
)
from linked_fleet_gateway.subscriptions.store import Backlog, News, SubscriptionStore
from redis_backends import Backend, opened
from store_samples import LIMIT, OUTGOING, a_subscription, adopted, held


@pytest.fixture
def a(server: Backend) -> Iterator[SubscriptionStore]:
    yield from opened(server, SubscriptionStore(server.url, "fleet", "a"))


@pytest.fixture
def b(server: Backend) -> Iterator[SubscriptionStore]:
    yield from opened(server, SubscriptionStore(server.url, "fleet", "b"))


def other(subscription: Subscription, **options: Any) -> ChangeableOptions:
    return replace(subscription.options, **options)


async def test_options_are_changed_under_the_condition_that_they_are_as_they_were_read(
    a: SubscriptionStore, b: SubscriptionStore
) -> None:
    """One of two changes of the same state is refused. Each gateway is notified of each; nothing else differs."""
    async with aclosing(b.news()) as heard:
        one = a_subscription(secret="whsec_1")
        await a.add(one, Delivery(), LIMIT)
        await a.renew_lease()
        options = other(one, interval_s=2.5, deadband=0.1, secret="whsec_2")
        assert await b.change_options(one, options)
        assert not await a.change_options(one, other(one, interval_s=9.0))
        changed = one.with_options(options, 1)
        assert await a.get_record(one.id) == Record(changed, Delivery(), "a")
        assert await a.change_options(changed, other(changed, interval_s=9.0))
        assert [(await anext(heard)), (await anext(heard))] == [News("changed", one.id, "a")] * 2
        (subscription,) = await held(a)
        assert subscription == changed.with_options(other(changed, interval_s=9.0), 2)
        await b.remove(one.id)
        assert not await a.change_options(subscription, options)
        assert await a.get_record(one.id) is None


async def test_writes_of_the_holder_do_not_revert_changes(a: SubscriptionStore, b: SubscriptionStore) -> None:
    """A gateway that does not know it yet opens the stream and records its end, and another takes it over."""
    stream = a_subscription(kind=Kind.STREAM)
    await a.add(stream, Delivery(DeliveryState.WAITING), LIMIT)
    options = other(stream, interval_s=2.5, depth=Depth.SUBTREE)
    assert await a.change_options(stream, options)
    await b.renew_lease()
    opened_there = replace(stream, kind=Kind.WEBSOCKET)
    await b.add(opened_there, Delivery(), LIMIT)
    assert await held(b) == [opened_there.with_options(options, 1)]
    await b.store_delivery_state(stream.id, Delivery(DeliveryState.WAITING), stream)
    assert await held(b) == [stream.with_options(options, 1)]
    await b.announce_end()
    assert await adopted(a, "b") == [stream.with_options(options, 1)]


@pytest.mark.parametrize(
    ("options", "anew"), [({"interval_s": 1.0}, False), ({"media_type": "x/y"}, True), ({"depth": Depth.THIS}, True)]
)
async def test_messages_queued_before_a_change_count_as_sent(
    a: SubscriptionStore, b: SubscriptionStore, options: dict[str, Any], anew: bool
) -> None:
    """Queued messages stay queued with their numbers. A subscriber that starts again gets the present state."""
    one = a_subscription()
    await a.add(one, Delivery(), LIMIT)
    await a.advance_queue(one.id, None, OUTGOING, Delivery())
    assert await b.change_options(one, other(one, **options))
    assert (await a.read_backlog(one.id)).last_versions == ({} if anew else {OUTGOING.path: "v1"})
    await a.advance_queue(one.id, None, replace(OUTGOING, version="v2"), Delivery())
    assert (await a.read_backlog(one.id)).last_versions == ({} if anew else {OUTGOING.path: "v2"})
    await a.advance_queue(one.id, None, replace(OUTGOING, version="v3", revision=1), Delivery())
    backlog = await a.read_backlog(one.id)
    assert backlog.last_versions == {OUTGOING.path: "v3"}
    assert [(entry.number, entry.version) for entry in backlog.entries] == [(1, "v1"), (2, "v2"), (3, "v3")]


async def test_the_number_of_a_delivery_is_given_once(a: SubscriptionStore) -> None:
    """A late command changes nothing after another one has got its number."""
    one = a_subscription()
    await a.add(one, Delivery(), LIMIT)
    first = await a.advance_queue(one.id, None, OUTGOING, Delivery(), number=1)
    assert first is not None
    before = await a.get_record(one.id)
    for number in (0, 1, 3):
        late = replace(OUTGOING, version="v0")
        assert await a.advance_queue(one.id, first, late, Delivery(failures=9), number=number) is None
    assert await a.get_record(one.id) == before
    assert await a.read_backlog(one.id) == Backlog([first], {OUTGOING.path: "v1"}, 1)
    second = await a.advance_queue(one.id, first, OUTGOING, Delivery(), number=2)
    assert second is not None
    assert second.number == 2
