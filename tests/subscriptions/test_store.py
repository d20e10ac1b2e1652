"""The store on a real server and on a real cluster: what is accepted stays, and one gateway at a time delivers it."""

import asyncio
import logging
import re
import time
import uuid
from collections.abc import Awaitable, Callable, Iterator
from contextlib import AbstractAsyncContextManager, aclosing, suppress
from dataclasses import replace
from typing import Any

import pytest
from redis_servers import Server, Servers, cluster, single
from running import PATIENCE_S

from gateway.ending import end
from gateway.subscriptions.keys import Key, Keys
from gateway.subscriptions.store import Backlog, Entry, Lost, News, Outgoing, Store, StoreUnavailable, TooMany
from gateway.subscriptions.subscription import Delivery, DeliveryState, Depth, Kind, Record, Subscription

LIMIT = 100
OUTGOING = Outgoing("/baxter/right_s1/rotation", "v1", "text/turtle", b"\xff\r\n\x00")
SHORT_S = 0.3  # a lease


@pytest.fixture(scope="module", params=[single, cluster])
def servers(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Servers]:
    with request.param(tmp_path_factory.mktemp("redis")) as running:
        yield running


@pytest.fixture
def namespace() -> str:
    return uuid.uuid4().hex


@pytest.fixture
def store(servers: Servers, namespace: str) -> Callable[..., Store]:
    def make(run: str, **options: float) -> Store:
        return Store(servers.url, namespace, run, **options)

    return make


def a_subscription(**fields: Any) -> Subscription:
    given = {
        "id": str(uuid.uuid4()),
        "owner": "/baxter/right_s1",
        "resource": "/baxter/right_s1/rotation",
        "kind": Kind.CALLBACK,
        "media_type": "text/turtle",
        "base": "http://localhost:8000",
        "client": "192.0.2.7",
        "created_ns": time.time_ns(),
    }
    return Subscription(**{**given, **fields})


async def adopted(store: Store, run: str) -> list[Record]:
    return [record async for record in store.adopt(run)]


async def until(probe: Callable[[], Awaitable[Any]], what: str) -> Any:
    deadline = time.monotonic() + PATIENCE_S
    while not (value := await probe()):
        assert time.monotonic() < deadline, f"never happened: {what}"
        await asyncio.sleep(0.01)
    return value


async def served(store: Store) -> bool:
    try:
        await store.renew()
    except StoreUnavailable:
        return False
    return True


class CrashedError(Exception):
    """The end of a gateway, between two of its commands."""


def crash_after(store: Store, commands: int) -> None:
    """Let the store die after so many commands."""
    left = iter(range(commands))
    redis = store._redis

    def dying(call: Callable[..., Awaitable[Any]]) -> Callable[..., Awaitable[Any]]:
        async def checked(*arguments: Any) -> Any:
            if next(left, None) is None:
                raise CrashedError
            return await call(*arguments)

        return checked

    redis.one, redis.all = dying(redis.one), dying(redis.all)  # type: ignore[method-assign]


def count_trips(store: Store) -> Callable[[], int]:
    """How often the store has gone to a server since."""
    trips = 0
    contact = store._redis._contact

    def counted() -> AbstractAsyncContextManager[None]:
        nonlocal trips
        trips += 1
        return contact()

    store._redis._contact = counted  # type: ignore[method-assign]
    return lambda: trips


# Keys


def test_every_key_is_parsed_as_it_was_built() -> None:
    keys = Keys("site/hall-2")
    id = str(uuid.uuid4())
    for key, parsed in {
        keys.runs: Key("runs"),
        keys.lease("a1"): Key("lease", "a1"),
        keys.held("a1"): Key("held", "a1"),
        keys.record(id): Key("record", id),
        keys.queue(id): Key("queue", id),
        keys.sent(id): Key("sent", id),
        keys.gone(id): Key("gone", id),
        keys.owner("/"): Key("owner", "/"),
        keys.owner("/arm~202/news"): Key("owner", "/arm~202/news"),
        keys.client("2001:db8::1"): Key("client", "2001:db8::1"),
        keys.news: Key("news"),
    }.items():
        assert keys.parse(key) == parsed
    for foreign in ("fleet:news", "site/hall-2", "site/hall-2:", "site/hall-2:subscription:{}", "site/hall-2:news:x"):
        with pytest.raises(ValueError, match="is no key of subscriptions"):
            keys.parse(foreign)


@pytest.mark.parametrize(
    "client",
    [
        "2001:db8::1",
        "fe80::1%eth0",
        "",
        "unknown",
        "192.0.2.1, 10.0.0.1",
        "{runs}",
        "}{",
        "%7Bruns%7D",
        "7}:queue",
        "x\r\nDEL fleet:news\r\n",
        "\0\x1b[2J",
        "später",
        "*?[a]",
        "\udcff",
        "a" * 9000,
    ],
)
def test_whatever_a_client_is_called_its_key_is_plain_and_its_own(client: str) -> None:
    keys = Keys("fleet")
    key = keys.client(client)
    assert keys.parse(key) == Key("client", client)
    assert re.fullmatch(r"fleet:client:[A-Za-z0-9%:._~-]*", key)


@pytest.mark.parametrize("namespace", ["", "a:b", "{a}", "a b"])
def test_a_namespace_that_would_make_keys_ambiguous_is_refused(namespace: str) -> None:
    with pytest.raises(ValueError, match="is not a plain key"):
        Keys(namespace)


# Subscriptions


def test_a_subscription_is_read_as_it_was_accepted(store: Callable[..., Store]) -> None:
    whole = a_subscription(
        depth=Depth.SUBTREE, interval_s=0.25, deadband=1e-3, callback="https://x/", secret="whsec_YQ"
    )
    delivery = Delivery(DeliveryState.AWAITING_CONSENT, 17, 503, 3, "It said: “später”.", True, 0.5)

    async def run() -> None:
        async with store("a") as a, store("b") as b:
            await a.add(whole, delivery, LIMIT)
            record = await b.record(whole.id)
            assert record is not None
            assert (record.subscription, record.delivery, record.holder) == (whole, delivery, "a")
            assert await b.record("none") is None
            await a.note(whole.id, Delivery())
            assert [one.delivery for one in await b.of(whole.owner)] == [Delivery()]

    asyncio.run(run())


def test_a_container_lists_its_own_of_all_gateways_oldest_first(store: Callable[..., Store]) -> None:
    async def run() -> None:
        async with store("a") as a, store("b") as b:
            await a.renew()
            made = [a_subscription(created_ns=number, kind=kind) for number, kind in enumerate(Kind)]
            for number, one in enumerate(reversed(made)):
                await (a, b)[number % 2].add(one, Delivery(), LIMIT)
            await b.renew()
            await a.add(a_subscription(owner="/"), Delivery(), LIMIT)
            assert [record.subscription for record in await a.of("/baxter/right_s1")] == made
            assert await a.of("/baxter") == []

    asyncio.run(run())


def test_a_client_has_no_more_than_its_limit_and_a_refusal_stores_nothing(
    servers: Servers, namespace: str, store: Callable[..., Store]
) -> None:
    async def run() -> None:
        async with store("a") as a, store("b") as b:
            asked = [a_subscription() for _ in range(20)]
            results = await asyncio.gather(
                *((a, b)[number % 2].add(one, Delivery(), 5) for number, one in enumerate(asked)),
                return_exceptions=True,
            )
            accepted = [one for one, result in zip(asked, results, strict=True) if result is None]
            assert len(accepted) == 5
            assert {type(result) for result in results} == {type(None), TooMany}, results
            assert len(await a.of("/baxter/right_s1")) == len(await a.held()) + len(await b.held()) == 5
            await b.add(a_subscription(client="192.0.2.8"), Delivery(), 5)  # another client's count is its own
            await a.remove(accepted[0].id)
            await a.add(a_subscription(), Delivery(), 5)
            for record in await a.of("/baxter/right_s1"):
                await a.remove(record.subscription.id)
            await a.leave()
            await b.leave()
            assert servers.lasting_keys(f"{namespace}:*") == [Keys(namespace).news]

    asyncio.run(run())


def test_adding_again_changes_nothing_but_what_is_said(store: Callable[..., Store]) -> None:
    async def run() -> None:
        async with store("a") as a:
            one = a_subscription()
            await a.add(one, Delivery(), 1)
            first = await a.advance(one.id, None, OUTGOING, Delivery())
            await a.add(one, Delivery(failures=1), 1)
            assert (await a.backlog(one.id)).entries == [first]
            second = await a.advance(one.id, first, OUTGOING, Delivery())
            assert second is not None
            assert second.number == 2

    asyncio.run(run())


@pytest.mark.parametrize("commands", range(5))
def test_what_a_crash_left_half_added_is_invisible_and_reclaimed(
    commands: int, servers: Servers, namespace: str, store: Callable[..., Store]
) -> None:
    async def run() -> None:
        async with store("a") as a, store("b") as b:
            one = a_subscription()
            crash_after(a, commands)
            with pytest.raises(CrashedError):
                await a.add(one, Delivery(), LIMIT)
            assert await b.record(one.id) is None
            assert await b.of(one.owner) == []
            for run in ["a", *await b.dead_runs()]:
                assert await adopted(b, run) == []
            assert await b.dead_runs() == []
            assert servers.lasting_keys(f"{namespace}:*") == []

    asyncio.run(run())


@pytest.mark.parametrize("commands", range(1, 4))
def test_what_a_crash_left_half_removed_is_reclaimed_by_its_holder(
    commands: int, servers: Servers, namespace: str, store: Callable[..., Store]
) -> None:
    async def run() -> None:
        async with store("a") as a, store("b") as b:
            one = a_subscription()
            await a.add(one, Delivery(), LIMIT)
            crash_after(b, commands)
            with pytest.raises(CrashedError):
                await b.remove(one.id)
            assert await a.record(one.id) is None
            assert await a.held() == []
            await a.leave()
            assert servers.lasting_keys(f"{namespace}:*") == []

    asyncio.run(run())


def test_an_add_whose_first_steps_others_cleared_away_is_whole_in_the_end(store: Callable[..., Store]) -> None:
    """A gateway so slow that it counts as dead while it adds."""

    async def run() -> None:
        async with store("slow") as slow, store("b") as b:
            one = a_subscription()
            commit = slow._redis.run

            async def late(script: str, keys: tuple[str, ...], *arguments: Any) -> Any:
                if len(keys) == 3:
                    slow._redis.run = commit  # type: ignore[method-assign]
                    assert await adopted(b, "slow") == []
                    assert await b.dead_runs() == []
                return await commit(script, keys, *arguments)

            slow._redis.run = late  # type: ignore[method-assign]
            await slow.add(one, Delivery(), LIMIT)
            assert [record.subscription for record in await b.of(one.owner)] == [one]
            assert [record.subscription for record in await slow.held()] == [one]
            assert await b.dead_runs() == ["slow"]
            assert [record.subscription for record in await adopted(b, "slow")] == [one]

    asyncio.run(run())


# Streams that are opened through another gateway


@pytest.fixture
def stream() -> Subscription:
    return a_subscription(kind=Kind.STREAM)


async def ids_held(store: Store) -> set[str]:
    """What the list of a run names, whoever is the holder."""
    return set(await store._runs.held(store._run))


def test_a_stream_goes_over_to_the_gateway_that_adds_it_and_the_other_hears_of_it(
    servers: Servers, namespace: str, store: Callable[..., Store], stream: Subscription
) -> None:
    async def run() -> None:
        async with store("a") as a, store("b") as b, store("c") as c, aclosing(a.news()) as news:
            for one in (a, b, c):
                await one.renew()
            await a.add(stream, Delivery(DeliveryState.WAITING), 1)
            opened, delivery = replace(stream, kind=Kind.WEBSOCKET), Delivery(last_ns=5)
            await b.add(opened, delivery, 1)
            assert await c.of(stream.owner) == [Record(opened, delivery, "b")]
            assert (await ids_held(a), await ids_held(b)) == (set(), {stream.id})
            assert await anext(news) == News("replaced", stream.id, "a")
            # What the first may still do when its connection closes leaves the stream with the other.
            with pytest.raises(Lost):
                await a.add(stream, Delivery(DeliveryState.WAITING), 1, take=False)
            assert await a.note_all({stream.id: Delivery()}) == {stream.id}
            assert await a.remove(stream.id, own=True) is None
            assert await a.held() == []
            await a.leave()
            assert await c.dead_runs() == []
            assert await adopted(c, "a") == []
            assert await c.of(stream.owner) == await b.held() == [Record(opened, delivery, "b")]
            await b.leave()
            assert await c.of(stream.owner) == []
            assert await adopted(c, "b") == []
            await c.leave()
            assert servers.lasting_keys(f"{namespace}:*") == [Keys(namespace).news]

    asyncio.run(run())


def test_a_callback_stays_with_the_gateway_that_holds_it(store: Callable[..., Store]) -> None:
    async def run() -> None:
        async with store("a") as a, store("b") as b:
            one = a_subscription()
            await a.renew()
            await a.add(one, Delivery(), LIMIT)
            await b.add(one, Delivery(failures=1), LIMIT)
            assert await a.held() == [Record(one, Delivery(), "a")]
            assert (await ids_held(a), await ids_held(b)) == ({one.id}, set())

    asyncio.run(run())


def test_a_stream_may_go_there_and_back_at_once(store: Callable[..., Store], stream: Subscription) -> None:
    async def run() -> None:
        async with store("a") as a, store("b") as b:
            for _ in range(20):
                await asyncio.gather(*(one.add(stream, Delivery(), LIMIT) for one in (a, b, a, b, a, b)))
                record = await a.record(stream.id)
                assert record is not None
                assert stream.id in await ids_held({"a": a, "b": b}[record.holder])

    asyncio.run(run())


@pytest.mark.parametrize("commands", range(13))
def test_a_crash_while_a_stream_goes_over_leaves_it_with_one_or_the_other(
    commands: int, servers: Servers, namespace: str, store: Callable[..., Store], stream: Subscription
) -> None:
    async def run() -> None:
        async with store("a") as a, store("b") as b, store("c") as c:
            await a.add(stream, Delivery(), LIMIT)
            await a.renew()
            crash_after(b, commands)
            with suppress(CrashedError):
                await b.add(stream, Delivery(), LIMIT)
            record = await c.record(stream.id)
            assert record is not None
            for run in {"b", *await c.dead_runs()}:
                assert await adopted(c, run) == []
            assert await c.of(stream.owner) == [record][: record.holder == "a"]
            assert await a.held() == [record][: record.holder == "a"]
            await a.leave()
            for run in await c.dead_runs():
                assert await adopted(c, run) == []
            assert {*servers.lasting_keys(f"{namespace}:*")} <= {Keys(namespace).news}

    asyncio.run(run())


def test_a_stream_that_is_opened_again_is_not_cleared_away_with_the_gateway_that_had_it(
    store: Callable[..., Store], stream: Subscription
) -> None:
    async def run() -> None:
        async with store("a") as a, store("b") as b, store("c") as c:
            await a.add(stream, Delivery(), LIMIT)
            read = c._records

            async def late(ids: Any) -> Any:
                records = await read(ids)
                c._records = read  # type: ignore[method-assign]
                await b.renew()
                await b.add(stream, Delivery(), LIMIT)
                return records

            c._records = late  # type: ignore[method-assign]
            assert await adopted(c, "a") == []
            assert await c.of(stream.owner) == await b.held() == [Record(stream, Delivery(), "b")]

    asyncio.run(run())


def test_a_stream_that_is_opened_while_its_holder_removes_it_is_whole(
    store: Callable[..., Store], stream: Subscription
) -> None:
    async def run() -> None:
        async with store("a") as a, store("b") as b:
            await a.add(stream, Delivery(), LIMIT)
            clear, adding = a._clear, []

            async def late(*arguments: Any) -> None:
                adding.append(asyncio.create_task(b.add(stream, Delivery(), LIMIT)))
                await asyncio.sleep(0.1)
                await clear(*arguments)

            a._clear = late  # type: ignore[method-assign]
            await a.remove(stream.id)
            await asyncio.gather(*adding)
            await b.renew()
            assert await a.of(stream.owner) == await b.held() == [Record(stream, Delivery(), "b")]

    asyncio.run(run())


# Deliveries


def test_deliveries_are_numbered_without_gaps_and_kept_in_order(store: Callable[..., Store]) -> None:
    async def run() -> None:
        async with store("a") as a:
            one = a_subscription()
            await a.add(one, Delivery(), LIMIT)
            assert await a.backlog(one.id) == Backlog([], {})
            entries = []
            for number in range(1, 21):
                outgoing = replace(OUTGOING, path=f"/{number % 3}", version=f"v{number}", body=bytes([number]) * 9)
                entry = await a.advance(one.id, None, outgoing, Delivery(last_ns=number))
                assert entry is not None
                assert entry == Entry(
                    entry.entry_id, number, outgoing.path, outgoing.version, "text/turtle", outgoing.body
                )
                entries.append(entry)
            assert await a.backlog(one.id) == Backlog(entries, {"/0": "v18", "/1": "v19", "/2": "v20"})
            assert await a.advance(one.id, entries[0], None, Delivery(last_status=204)) is None
            assert (await a.backlog(one.id)).entries == entries[1:]
            record = await a.record(one.id)
            assert record is not None
            assert record.delivery == Delivery(last_status=204)

    asyncio.run(run())


def test_what_was_sent_is_remembered_until_its_resource_is_no_more(store: Callable[..., Store]) -> None:
    async def run() -> None:
        async with store("a") as a:
            one = a_subscription()
            await a.add(one, Delivery(), LIMIT)
            entries = [await a.advance(one.id, None, replace(OUTGOING, path=f"/{n}"), Delivery()) for n in range(4)]
            assert await a.advance(one.id, entries[0], None, Delivery(), ["/1", "/none"]) is None
            assert await a.backlog(one.id) == Backlog(entries[1:], {"/0": "v1", "/2": "v1", "/3": "v1"})
            last = await a.advance(one.id, entries[1], replace(OUTGOING, path="/2"), Delivery(), ["/2", "/3"])
            assert await a.backlog(one.id) == Backlog([*entries[2:], last], {"/0": "v1"})
            await a.advance(one.id, last, None, Delivery(), [f"/{n}" for n in range(10_000)])
            assert await a.backlog(one.id) == Backlog(entries[2:], {})

    asyncio.run(run())


def test_the_backlog_of_a_dead_gateway_is_delivered_by_another_which_alone_may(store: Callable[..., Store]) -> None:
    async def run() -> None:
        async with store("a") as a, store("b") as b:
            one = a_subscription()
            await a.add(one, Delivery(), LIMIT)
            begun = [await a.advance(one.id, None, replace(OUTGOING, version=f"v{n}"), Delivery()) for n in range(3)]
            with pytest.raises(Lost):
                await b.backlog(one.id)
            assert [record.holder for record in await adopted(b, "a")] == ["b"]
            with pytest.raises(Lost):
                await a.advance(one.id, begun[0], OUTGOING, Delivery())
            with pytest.raises(Lost):
                await a.backlog(one.id)
            with pytest.raises(Lost):
                await a.note(one.id, Delivery(failures=9))
            assert await b.backlog(one.id) == Backlog(begun, {OUTGOING.path: "v2"})
            fourth = await b.advance(one.id, begun[0], OUTGOING, Delivery())
            assert fourth is not None
            assert fourth.number == 4
            assert (await b.backlog(one.id)).entries == [*begun[1:], fourth]
            record = await b.record(one.id)
            assert record is not None
            assert (record.holder, record.delivery) == ("b", Delivery())
            assert await a.held() == []

    asyncio.run(run())


def test_what_is_noted_of_many_says_which_are_lost(store: Callable[..., Store]) -> None:
    async def run() -> None:
        async with store("a") as a, store("b") as b:
            mine, others, gone = [a_subscription(created_ns=number) for number in range(3)]
            await a.add(mine, Delivery(), LIMIT)
            await b.add(others, Delivery(), LIMIT)
            noted = {one.id: Delivery(last_ns=7) for one in (gone, mine, others)}
            assert await a.note_all(noted) == {gone.id, others.id}
            assert await a.note_all({}) == set()
            assert [record.delivery.last_ns for record in await a.of(mine.owner)] == [7, None]

    asyncio.run(run())


def test_nothing_written_late_brings_a_removed_subscription_back(
    servers: Servers, namespace: str, store: Callable[..., Store]
) -> None:
    async def run() -> None:
        async with store("a") as a:
            one = a_subscription()
            await a.add(one, Delivery(), LIMIT)
            removed = await a.remove(one.id)
            assert removed is not None
            assert removed.subscription == one
            assert await a.remove(one.id) is None
            with pytest.raises(Lost):
                await a.note(one.id, Delivery())
            assert await a.note_all({one.id: Delivery(), "other": Delivery()}) == {one.id, "other"}
            assert await a.wake(one.id) is None
            with pytest.raises(Lost):
                await a.advance(one.id, None, OUTGOING, Delivery())
            await a.leave()
            assert servers.lasting_keys(f"{namespace}:*") == []

    asyncio.run(run())


# Runs


def test_of_two_gateways_one_adopts_each_callback(
    servers: Servers, namespace: str, store: Callable[..., Store]
) -> None:
    async def run() -> None:
        async with store("dead") as dead, store("b") as b, store("c") as c:
            made = {a_subscription().id: None for _ in range(30)}
            for id in made:
                await dead.add(a_subscription(id=id), Delivery(), LIMIT)
            await b.renew()
            await c.renew()
            won = await asyncio.gather(*(adopted(one, "dead") for one in (b, c, b)))
            assert sorted(record.subscription.id for part in won for record in part) == sorted(made)
            held = [*await b.held(), *await c.held()]
            assert sorted(record.subscription.id for record in held) == sorted(made)
            assert await b.dead_runs() == []
            for record in held:
                await b.remove(record.subscription.id)
            await b.leave()
            await c.leave()
            assert {*servers.lasting_keys(f"{namespace}:*")} <= {Keys(namespace).news}

    asyncio.run(run())


@pytest.mark.parametrize("commands", range(14))
def test_adoption_survives_the_death_of_the_adopter(commands: int, store: Callable[..., Store]) -> None:
    async def run() -> None:
        async with store("a") as a, store("dying") as dying, store("c") as c:
            callbacks = [a_subscription() for _ in range(2)]
            stream = a_subscription(kind=Kind.WEBSOCKET)
            for one in (callbacks[0], stream, callbacks[1]):
                await a.add(one, Delivery(), LIMIT)
            crash_after(dying, commands)
            with suppress(CrashedError):
                await adopted(dying, "a")
            while dead := await c.dead_runs():
                for run in dead:
                    await adopted(c, run)
            assert [record.subscription for record in await c.of(stream.owner)] == callbacks
            assert {record.subscription.id for record in await c.held()} == {one.id for one in callbacks}
            assert await c.record(stream.id) is None

    asyncio.run(run())


def test_many_are_adopted_in_few_steps_each_given_as_soon_as_it_is_won(store: Callable[..., Store]) -> None:
    async def run() -> None:
        async with store("a") as a, store("b") as b, store("c") as c:
            made = [a_subscription(created_ns=number) for number in range(200)]
            streams = [a_subscription(kind=Kind.WEBSOCKET) for _ in range(100)]
            await asyncio.gather(*(a.add(one, Delivery(), 1000) for one in (*streams, *made)))
            await b.renew()
            await c.renew()
            async with aclosing(b.adopt("a")) as adopting:
                first = await anext(adopting)
                assert first.holder == "b"
                assert len(await b.held()) < len(made)
                assert await c.record(streams[0].id) is not None
            kept = await b.held()
            trips = count_trips(c)
            won = await adopted(c, "a")
            assert trips() < 30
            ids = [record.subscription.id for record in (*kept, *won)]
            assert sorted(ids) == sorted(one.id for one in made)
            assert {record.holder for record in won} == {"c"}
            assert await c.dead_runs() == []
            assert [record.subscription for record in await c.of(made[0].owner)] == made
            assert await c.record(streams[0].id) is None

    asyncio.run(run())


def test_a_run_goes_on_renewing_its_lease_while_it_adopts(store: Callable[..., Store]) -> None:
    async def run() -> None:
        async with store("a") as a, store("b") as b, store("c") as c:
            for part in range(24):
                await asyncio.gather(*(a.add(a_subscription(client=f"{part % 3}"), Delivery(), 500) for _ in range(50)))
            renewals = 0

            async def renew() -> None:
                nonlocal renewals
                while True:
                    await b.renew()
                    renewals += 1

            renewing = asyncio.create_task(renew())
            found, before = 0, []
            async for _ in b.adopt("a"):
                found += 1
                before.append(renewals)
            await end([renewing])
            assert found == 1200
            # Its turn comes between any two parts that are taken over, 64 each.
            assert len(set(before)) >= 1200 // 64
            assert await c.dead_runs() == []

    asyncio.run(run())


def test_a_long_container_is_listed_in_few_steps(store: Callable[..., Store]) -> None:
    async def run() -> None:
        async with store("a") as a:
            await a.renew()
            made = [a_subscription(created_ns=number, kind=list(Kind)[number % 4]) for number in range(600)]
            await asyncio.gather(*(a.add(one, Delivery(), 1000) for one in made))
            await a.renew()  # streams are listed while the lease lasts
            trips = count_trips(a)
            assert [record.subscription for record in await a.of(made[0].owner)] == made
            assert trips() == 2 + 3  # parts of 256

    asyncio.run(run())


def test_streams_vanish_with_the_lease_of_their_gateway_and_callbacks_stay(store: Callable[..., Store]) -> None:
    async def run() -> None:
        async with store("a", lease_s=SHORT_S) as a, store("b") as b:
            stream, callback = a_subscription(kind=Kind.EVENT_STREAM), a_subscription()
            await b.renew()
            for one in (stream, callback):
                await a.renew()
                await a.add(one, Delivery(), LIMIT)
            await a.renew()
            assert [record.subscription for record in await b.of(stream.owner)] == [stream, callback]
            assert await b.dead_runs() == []
            assert await adopted(b, "a") == []
            await until(b.dead_runs, "the lease lapses")
            assert [record.subscription for record in await b.of(stream.owner)] == [callback]
            assert [record.subscription for record in await adopted(b, "a")] == [callback]
            assert await b.record(stream.id) is None
            await a.renew()  # it was not dead: its stream is registered again
            assert await a.held() == []
            await a.add(stream, Delivery(), LIMIT)
            assert [record.subscription for record in await b.of(stream.owner)] == [stream, callback]

    asyncio.run(run())


def test_a_stream_that_waits_goes_to_the_gateway_that_adopts_it(
    servers: Servers, namespace: str, store: Callable[..., Store], stream: Subscription
) -> None:
    """It is listed there, counts for its client as before, and vanishes when it is removed."""

    async def run() -> None:
        async with store("a") as a, store("b") as b:
            waiting = Delivery(DeliveryState.WAITING, last_ns=7)
            await b.renew()
            await a.renew()
            await a.add(stream, waiting, 1)
            await a.leave()
            assert await adopted(b, "a") == [Record(stream, waiting, "b")]
            assert await b.of(stream.owner) == await b.held() == [Record(stream, waiting, "b")]
            assert (await ids_held(a), await ids_held(b)) == (set(), {stream.id})
            with pytest.raises(TooMany):
                await b.add(a_subscription(), Delivery(), 1)
            await b.remove(stream.id, own=True)
            await b.leave()
            assert {*servers.lasting_keys(f"{namespace}:*")} <= {Keys(namespace).news}

    asyncio.run(run())


def test_what_a_gateway_leaves_is_adopted_at_once(store: Callable[..., Store]) -> None:
    async def run() -> None:
        async with store("a") as a, store("b") as b:
            one = a_subscription()
            await a.renew()
            await a.add(one, Delivery(), LIMIT)
            assert await b.dead_runs() == []
            await a.leave()
            assert await b.dead_runs() == ["a"]
            assert [record.subscription for record in await adopted(b, "a")] == [one]
            assert await b.dead_runs() == []

    asyncio.run(run())


# News


def test_a_holder_hears_what_others_did_even_over_an_outage(servers: Servers, store: Callable[..., Store]) -> None:
    async def run() -> None:
        async with store("a") as a, store("b") as b, aclosing(a.news()) as news:
            mine, woken, removed, later = (a_subscription(created_ns=number) for number in range(4))
            await a.renew()
            for one in (mine, woken, removed, later):
                state = Delivery(DeliveryState.SUSPENDED, failures=8, reason="Gone.", consented=True)
                await a.add(one, state, LIMIT)
            await a.remove(mine.id)
            record = await b.wake(woken.id)
            assert record is not None
            assert record.delivery == Delivery(consented=True)
            await b.remove(removed.id)
            await a.wake(later.id)
            assert await anext(news) == News("woken", woken.id, "a")
            assert await anext(news) == News("removed", removed.id, "a")
            assert await anext(news) == News("woken", later.id, "a")
            waiting = asyncio.ensure_future(anext(news))
            await asyncio.to_thread(servers.kill)
            await asyncio.to_thread(servers.start)
            await until(lambda: served(b), "b is served again")
            await b.remove(later.id)
            assert await waiting == News("removed", later.id, "a")

    asyncio.run(run())


def test_a_stream_is_not_woken(store: Callable[..., Store]) -> None:
    async def run() -> None:
        async with store("a") as a:
            one, waiting = a_subscription(kind=Kind.STREAM), Delivery(DeliveryState.WAITING)
            await a.add(one, waiting, LIMIT)
            record = await a.wake(one.id)
            assert record is not None
            assert record.delivery == waiting

    asyncio.run(run())


# Outages


def test_what_was_accepted_survives_kill_9_of_the_server(servers: Servers, store: Callable[..., Store]) -> None:
    async def run() -> None:
        async with store("a") as a:
            made = [a_subscription(created_ns=number) for number in range(20)]
            for one in made:
                await a.add(one, Delivery(), LIMIT)
            entry = await a.advance(made[0].id, None, OUTGOING, Delivery())
            servers.kill()
            with pytest.raises(StoreUnavailable):
                await a.record(made[0].id)
            await asyncio.to_thread(servers.start)
            await until(lambda: served(a), "a is served again")
            assert [record.subscription for record in await a.of(made[0].owner)] == made
            assert (await a.backlog(made[0].id)).entries == [entry]

    asyncio.run(run())


def test_a_store_opens_without_a_server_says_so_in_bounded_time_and_heals(
    servers: Servers, store: Callable[..., Store]
) -> None:
    async def run() -> None:
        servers.kill()
        async with store("a", lease_s=SHORT_S) as a, store("b", lease_s=SHORT_S) as b:
            calls = (a.renew, a.dead_runs, a.held, lambda: a.of("/"), lambda: a.add(a_subscription(), Delivery(), 1))
            for call in calls:
                started = time.monotonic()
                with pytest.raises(StoreUnavailable):
                    await call()
                assert time.monotonic() - started < 10
            await asyncio.to_thread(servers.start)
            await until(lambda: served(a), "a is served")
            await until(lambda: served(b), "b is served")
            await until(a.dead_runs, "the lease of b lapses, and the outage is long enough ago")
            await asyncio.gather(*(a.add(a_subscription(), Delivery(), 1000) for _ in range(300)))
            assert len(await a.of("/baxter/right_s1")) == 300

    asyncio.run(run())


@pytest.mark.parametrize(
    "url", ["http://localhost", "localhost:6379", "", "redis+cluster://", "redis+cluster://a:b@", "redis://a:port"]
)
def test_a_url_that_means_nothing_is_refused(url: str) -> None:
    with pytest.raises(ValueError, match=r"\w"):
        Store(url, "fleet", "a")


def test_a_server_that_may_lose_what_was_accepted_is_complained_of_once(
    tmp_path_factory: pytest.TempPathFactory, caplog: pytest.LogCaptureFixture
) -> None:
    node = Server(tmp_path_factory.mktemp("lossy"), "--appendfsync", "everysec")

    async def run() -> None:
        async with Store(node.url, "fleet", "a") as a:
            await asyncio.gather(*(a.renew() for _ in range(10)))

    try:
        node.start()
        with caplog.at_level(logging.WARNING):
            asyncio.run(run())
    finally:
        node.discard()
    assert [record.getMessage() for record in caplog.records] == [
        "Redis may lose what was accepted, its settings are appendfsync everysec"
    ]
