"""Rules on a real server and on a real cluster: what starts to hold is claimed once, whoever evaluates it."""

import asyncio
import contextlib
import uuid
from collections.abc import AsyncIterator, Callable, Iterator
from dataclasses import replace

import pytest
from redis_servers import Servers, cluster, single

from gateway.rules.rule import Firing, FiringState, Rule
from gateway.rules.store import KEPT, Changed, Full, Lost, RuleStore

Stores = Callable[[str], RuleStore]
HOSTILE = 'x"}\r\nFLUSHALL\r\n\0 running später'


@pytest.fixture(scope="module", params=[single, cluster])
def servers(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Servers]:
    with request.param(tmp_path_factory.mktemp("redis")) as running:
        yield running


@pytest.fixture
def stores(servers: Servers) -> Stores:
    namespace = uuid.uuid4().hex
    return lambda run: RuleStore(servers.url, namespace, run)


def a_rule(**fields: object) -> Rule:
    given = {"id": str(uuid.uuid4()), "title": HOSTILE, "condition": "SELECT", "invokes": "/r/actions/stop",
             "base": "http://fleet", "client": HOSTILE, "created_ns": 1, "interval_s": 0.0}  # fmt: skip
    return Rule(**{**given, **fields})  # type: ignore[arg-type]


def began(*keys: str) -> dict[str, Firing]:
    return {key: Firing(1, {"x": HOSTILE}) for key in keys}


@contextlib.asynccontextmanager
async def opened(stores: Stores, *runs: str) -> AsyncIterator[list[RuleStore]]:
    made = [stores(run) for run in runs]
    try:
        yield made
    finally:
        for each in made:
            await each.close()


def test_a_rule_is_read_as_it_was_written_until_it_is_removed(stores: Stores) -> None:
    async def scenario() -> None:
        async with opened(stores, "a", "b") as (one, other):
            rule = a_rule()
            await one.write(rule, 0, 9)
            (known,) = (await other.load()).values()
            assert (known.rule, known.revision) == (rule, 1)
            await other.write(replace(rule, enabled=False), 1, 9)
            with pytest.raises(Changed):
                await one.write(rule, 1, 9)
            with pytest.raises(Changed):
                await one.remove(rule, 1)
            assert await one.remove(rule, 2) and not await one.remove(rule)
            with pytest.raises(Changed):
                await one.remove(rule, 2)
            assert await other.load() == {}
            with pytest.raises(Changed):
                await other.write(rule, 2, 9)

    asyncio.run(scenario())


def test_a_client_has_so_many_rules(stores: Stores) -> None:
    async def scenario() -> None:
        async with opened(stores, "a") as (store,):
            rules = [a_rule() for _ in range(3)]
            for rule in rules[:2]:
                await store.write(rule, 0, 2)
            with pytest.raises(Full):
                await store.write(rules[2], 0, 2)
            await store.write(a_rule(client="another"), 0, 2)
            await store.remove(rules[0])
            await store.write(rules[2], 0, 2)

    asyncio.run(scenario())


def test_one_run_serves_until_it_leaves(stores: Stores) -> None:
    async def scenario() -> None:
        async with opened(stores, "a", "b") as (one, other):
            rule = a_rule()
            await one.write(rule, 0, 9)
            (known,) = (await one.load()).values()
            assert await one.serve() and not await other.serve() and await one.serve()
            await one.begin(known, ())
            await one.leave()
            assert await other.serve()
            with pytest.raises(Lost):
                await one.advance(known, began("row"), ())
            assert await other.recall(known) == set()
            assert await other.advance(known, began("row"), ()) == [1]

    asyncio.run(scenario())


def test_what_holds_is_remembered_and_what_was_begun_is_unknown_to_the_next(stores: Stores) -> None:
    async def scenario() -> None:
        async with opened(stores, "a", "b") as (one, other):
            rule = a_rule()
            await one.write(rule, 0, 9)
            await one.serve()
            (known,) = (await one.load()).values()
            assert await one.recall(known) is None
            await one.begin(known, ["held", "gone"])
            assert await one.advance(known, began("first", "second"), ["gone"]) == [1, 2]
            await one.finish(rule, 1, Firing(1, {}, FiringState.FAILED, reason=HOSTILE))
            await one.leave()
            await other.serve()
            assert await other.recall(known) == {"held", "first", "second"}
            (known,) = (await other.load()).values()
            assert [each.state for each in known.firings.values()] == [FiringState.FAILED, FiringState.UNKNOWN]
            assert known.firings[2].bindings == {"x": HOSTILE}
            await other.write(replace(rule, title="anew"), 1, 9)
            with pytest.raises(Changed):
                await other.advance(known, began("late"), ())
            assert await other.recall(replace(known, revision=2)) is None

    asyncio.run(scenario())


def test_what_comes_too_early_is_suppressed_and_counted(stores: Stores) -> None:
    async def scenario() -> None:
        async with opened(stores, "a") as (store,):
            rule = a_rule(interval_s=3600.0)
            await store.write(rule, 0, 9)
            await store.serve()
            (known,) = (await store.load()).values()
            await store.begin(known, ())
            many = [f"row{n:02}" for n in range(18)]
            assert await store.advance(known, began(*many), ()) == list(range(1, 17))  # at once, as far as may be
            assert await store.advance(known, began("early"), many) == []
            assert await store.advance(known, began("again"), ["early"]) == []
            (known,) = (await store.load()).values()
            assert known.suppressed == 4
            assert [n for n, each in known.firings.items() if each.state is FiringState.SUPPRESSED] == [17]

    asyncio.run(scenario())


def test_so_many_firings_are_kept(stores: Stores) -> None:
    async def scenario() -> None:
        async with opened(stores, "a") as (store,):
            rule = a_rule()
            await store.write(rule, 0, 9)
            await store.serve()
            (known,) = (await store.load()).values()
            await store.begin(known, ())
            for number in range(KEPT + 5):
                await store.advance(known, began(str(number)), ())
            (known,) = (await store.load()).values()
            assert list(known.firings) == list(range(6, KEPT + 6))
            await store.finish(rule, 1, Firing(1, {}))  # it is forgotten already
            assert 1 not in (await store.load())[rule.id].firings

    asyncio.run(scenario())


def test_others_hear_of_what_was_done(stores: Stores) -> None:
    async def scenario() -> None:
        async with opened(stores, "a", "b") as (one, other):
            await other.load()
            rule = a_rule()
            await one.write(rule, 0, 9)
            async for id in other.news():
                assert id == rule.id
                break

    asyncio.run(scenario())
