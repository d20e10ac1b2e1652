"""Rules: each row that starts to hold is claimed once, whichever gateway evaluates it."""

import asyncio
from collections.abc import Iterator, Sequence
from contextlib import aclosing, suppress
from dataclasses import replace
from itertools import count
from typing import Any

import pytest

from linked_fleet_base.errors import RedisUnavailable
from linked_fleet_gateway.extensions.rules import store as store_module
from linked_fleet_gateway.extensions.rules.rule import Firing, FiringState, Rule, RuleRecord
from linked_fleet_gateway.extensions.rules.store import Changed, FleetFull, Full, Lost, RuleStore
from redis_backends import Backend, opened
from store_samples import HOSTILE, a_rule, closing


@pytest.fixture
def a(server: Backend) -> Iterator[RuleStore]:
    yield from opened(server, closing(RuleStore(server.url, "fleet", "a")))


@pytest.fixture
def b(server: Backend) -> Iterator[RuleStore]:
    yield from opened(server, closing(RuleStore(server.url, "fleet", "b")))


def began(*keys: str) -> dict[str, Firing]:
    return {key: Firing(1, {"x": HOSTILE}) for key in keys}


async def read(store: RuleStore) -> RuleRecord:
    """Return the only rule."""
    (known,) = (await store.load()).values()
    return known


async def evaluated(store: RuleStore, rule: Rule, *holding: str) -> RuleRecord:
    """Write a rule, and evaluate it for the first time."""
    await store.write(rule, 0, 9)
    await store.serve()
    known = await read(store)
    assert await store.rows_held(known) is None
    await store.store_first_rows(known, holding)
    return known


async def test_a_rule_and_its_revision_are_of_one_moment(
    a: RuleStore, b: RuleStore, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Otherwise a write based on that revision would undo an unseen change: commands may be served separately."""
    rule = a_rule(title="1")
    await b.write(rule, 0, 9)
    run_one, revisions = a._redis.execute, count(1)

    async def one(*command: str | bytes | int) -> Any:
        answer = await run_one(*command)
        revision = next(revisions)
        await b.write(replace(rule, title=str(revision + 1)), revision, 9)
        return answer

    async def apart(commands: Sequence[tuple[str | bytes | int, ...]], batch_size: int = 1) -> list[Any]:
        return [await one(*command) for command in commands]

    monkeypatch.setattr(a._redis, "execute", one)
    monkeypatch.setattr(a._redis, "execute_all", apart)
    known = await a.read(rule.id)
    assert known is not None
    assert known.rule.title == str(known.revision)


async def test_others_hear_of_a_change_by_a_gateway_that_dies_right_after_it(a: RuleStore, b: RuleStore) -> None:
    rule = a_rule()
    news = b.news()
    first = asyncio.ensure_future(anext(news))
    await b.load()  # from now on, the position in the stream is known
    execute = a._redis.execute

    async def execute_until_the_death(*command: str | bytes | int) -> Any:
        if command[0] == "XADD":
            raise RedisUnavailable("the gateway has died")
        return await execute(*command)

    a._redis.execute = execute_until_the_death  # type: ignore[method-assign]
    for step in (a.write(rule, 0, 9), a.remove(rule, 1)):
        with suppress(RedisUnavailable):
            await step
    async with asyncio.timeout(5), aclosing(news):
        assert await first == rule.id
        assert await anext(news) == rule.id


async def test_a_rule_is_read_as_it_was_written_until_it_is_removed(a: RuleStore, b: RuleStore) -> None:
    rule = a_rule()
    await a.write(rule, 0, 9)
    known = await read(b)
    assert (known.rule, known.revision) == (rule, 1)
    await b.write(replace(rule, enabled=False), 1, 9)
    for late in (a.write(rule, 1, 9), a.remove(rule, 1)):
        with pytest.raises(Changed):
            await late
    assert await a.remove(rule, 2) and not await a.remove(rule)
    assert await b.load() == {}
    for late in (a.remove(rule, 2), b.write(rule, 2, 9)):
        with pytest.raises(Changed):
            await late


async def test_a_client_and_all_together_have_so_many_rules(a: RuleStore, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(store_module, "MOST", 3)
    rules = [a_rule() for _ in range(3)]
    for rule in rules[:2]:
        await a.write(rule, 0, 2)
    with pytest.raises(Full):
        await a.write(rules[2], 0, 2)
    await a.write(a_rule(client="another"), 0, 2)
    await a.remove(rules[0])
    await a.write(rules[2], 0, 2)
    with pytest.raises(FleetFull):
        await a.write(a_rule(client="a third"), 0, 2)


async def test_one_run_serves_until_it_leaves(a: RuleStore, b: RuleStore) -> None:
    await a.write(a_rule(), 0, 9)
    known = await read(a)
    assert await a.serve() and not await b.serve() and await a.serve()
    await a.store_first_rows(known, ())
    await a.leave()
    assert await b.serve()
    for late in (
        a.advance(known, began("row"), ()),
        a.rows_held(known),
        a.store_first_rows(known, ()),
        a.store_fault(known),
    ):
        with pytest.raises(Lost):
            await late
    assert await b.rows_held(known) == set()
    assert await b.advance(known, began("row"), ()) == [1]


async def test_rows_are_kept_and_unfinished_firings_become_unknown(a: RuleStore, b: RuleStore) -> None:
    rule = a_rule()
    known = await evaluated(a, rule, "held", "gone")
    assert await a.advance(known, began("first", "second"), ["gone"]) == [1, 2]
    await a.finish(rule, 1, Firing(1, {}, FiringState.FAILED, reason=HOSTILE))
    await a.leave()
    await b.serve()
    assert await b.rows_held(known) == {"held", "first", "second"}
    known = await read(b)
    assert [each.state for each in known.firings.values()] == [FiringState.FAILED, FiringState.UNKNOWN]
    assert known.firings[2].bindings == {"x": HOSTILE}
    await b.write(replace(rule, title="anew"), 1, 9)
    with pytest.raises(Changed):
        await b.advance(known, began("late"), ())
    assert await b.rows_held(replace(known, revision=2)) is None


async def test_early_firings_are_suppressed_and_counted(a: RuleStore) -> None:
    known = await evaluated(a, a_rule(interval_s=3600.0))
    many = [f"row{n:02}" for n in range(18)]
    assert await a.advance(known, began(*many), ()) == list(range(1, 17))  # at once, as far as permitted
    assert await a.advance(known, began("early"), many) == []
    assert await a.advance(known, began("again"), ["early"]) == []
    known = await read(a)
    assert known.suppressed == 4
    assert [n for n, each in known.firings.items() if each.state is FiringState.SUPPRESSED] == [17]


async def test_firings_are_kept_up_to_the_limit(a: RuleStore, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(store_module, "KEPT", 5)
    rule = a_rule()
    known = await evaluated(a, rule)
    for number in range(8):
        await a.advance(known, began(str(number)), ())
    assert list((await read(a)).firings) == [4, 5, 6, 7, 8]
    await a.finish(rule, 1, Firing(1, {}))  # it is forgotten already
    assert 1 not in (await read(a)).firings


async def test_news_of_rules_and_faults_reaches_other_gateways(a: RuleStore, b: RuleStore) -> None:
    await b.load()
    rule = a_rule()
    known = await evaluated(a, rule)
    await a.store_fault(replace(known, fault=HOSTILE, suspended="revoked"))
    news = b.news()
    assert [await anext(news) for _ in range(3)] == [rule.id] * 3
    await news.aclose()
    known = await read(b)
    assert (known.fault, known.suspended, known.begun) == (HOSTILE, "revoked", True)


async def test_the_robots_that_were_seen_are_remembered(a: RuleStore, b: RuleStore) -> None:
    await a.update_online_robots(["r", HOSTILE], [])
    await a.update_online_robots([], ["r", "x"])
    assert await b.online_robots() == {HOSTILE}
