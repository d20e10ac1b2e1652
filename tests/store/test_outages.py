"""Redis is unavailable: every store says so in bounded time and recovers by itself, and accepted data is kept."""

import asyncio
import time
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import AsyncExitStack, asynccontextmanager, suppress
from dataclasses import replace
from typing import Any

import pytest

from linked_fleet_base.errors import RedisUnavailable
from linked_fleet_gateway.actions.store import ActionStore
from linked_fleet_gateway.extensions.rules.rule import RuleRecord
from linked_fleet_gateway.extensions.rules.store import RuleStore
from linked_fleet_gateway.extensions.sessions.service import EndedSessions, SessionKey
from linked_fleet_gateway.extensions.world.service import stored_objects
from linked_fleet_gateway.resources.subscription import Delivery
from linked_fleet_gateway.subscriptions.store import LEASE_S, SubscriptionStore
from redis_backends import Backend, Memory
from store_samples import LIMIT, OUTGOING, a_rule, a_subscription, an_invocation, ended, held, listed, served

Call = Callable[[], Awaitable[object]]


def subscriptions(url: str, stack: AsyncExitStack) -> tuple[Call, ...]:
    a = SubscriptionStore(url, "fleet", "a")
    stack.push_async_exit(a)
    one = a_subscription()
    return (
        a.renew_lease, a.announce_end, a.dead_runs, a.held_records, lambda: a.records_of_owner("/"),
        lambda: a.add(one, Delivery(), 1),
        lambda: a.get_record(one.id), lambda: a.remove(one.id), lambda: a.resume(one.id),
        lambda: a.store_delivery_state(one.id, Delivery()),
        lambda: a.store_delivery_states({one.id: Delivery()}), lambda: a.read_backlog(one.id),
        lambda: anext(a.take_over("b")),
        lambda: a.advance_queue(one.id, None, OUTGOING, Delivery()),
    )  # fmt: skip


def actions(url: str, stack: AsyncExitStack) -> tuple[Call, ...]:
    a = ActionStore(url, "fleet", "a")
    stack.push_async_exit(a)
    one = an_invocation()
    return (
        lambda: a.create(one), lambda: a.check_lease("r", "t"), lambda: a.save(one), lambda: a.delete(one),
        a.load_invocations, lambda: a.read_invocation("r", one.id), lambda: a.take_lease("r", "Ada", 60), lambda:
        a.release_lease("r", "t"), a.read_all_settings, lambda: a.read_lease("r"), lambda: a.read_settings("r"), lambda:
        a.set_setting("r", "title", None, "R"),
    )  # fmt: skip


def rules(url: str, stack: AsyncExitStack) -> tuple[Call, ...]:
    a = RuleStore(url, "fleet", "a")
    stack.push_async_callback(a.close)
    rule = a_rule()
    known = RuleRecord(rule, 1, {}, 0)
    return (
        lambda: a.write(rule, 0, 9), lambda: a.remove(rule), a.load, lambda: a.read(rule.id), a.serve, a.leave,
        a.online_robots, lambda: a.update_online_robots(["r"], ["x"]), lambda: a.rows_held(known),
        lambda: a.store_first_rows(known, ()), lambda: a.advance(known, {}, ()), lambda: a.store_fault(known),
    )  # fmt: skip


def others(url: str, stack: AsyncExitStack) -> tuple[Call, ...]:
    objects, ended, key = stored_objects(url, "fleet"), EndedSessions(url, "fleet"), SessionKey(url, "fleet", "")
    stack.push_async_callback(objects.close)
    stack.push_async_callback(ended.aclose)
    stack.push_async_callback(key.aclose)
    return (
        objects.load, lambda: objects.read("i"), lambda: objects.change("i", "", b"body"),
        ended.ensure_loaded, ended.synchronize, key.get,
    )  # fmt: skip


STORES = pytest.mark.parametrize("store", [subscriptions, actions, rules, others])


@asynccontextmanager
async def calls(server: Backend, store: Callable[[str, AsyncExitStack], tuple[Call, ...]]) -> AsyncIterator[Any]:
    async with AsyncExitStack() as stack:
        yield store(server.url, stack)


@STORES
async def test_a_store_opens_without_a_server_says_so_and_heals(server: Backend, store: Any) -> None:
    server.kill()
    async with calls(server, store) as every:
        for call in every:
            with pytest.raises(RedisUnavailable):
                await call()
        server.start()
        await served(every[0])


@STORES
@pytest.mark.parametrize("server", ["memory"], indirect=True)
async def test_a_server_that_hangs_is_waited_for_no_longer_than_three_seconds(server: Memory, store: Any) -> None:
    async with calls(server, store) as every:
        server.redis.hang()
        for call in every:
            begun_s = time.monotonic()
            with pytest.raises(RedisUnavailable):
                await call()
            assert time.monotonic() - begun_s <= 3.0 + 1e-6
        server.redis.release()
        await served(every[0])


@STORES
@pytest.mark.parametrize("server", ["memory"], indirect=True)
@pytest.mark.parametrize("error", ["LOADING x", "MISCONF x", "READONLY x", "OOM x", "MASTERDOWN x", "WRONGTYPE x"])
async def test_a_server_that_does_not_serve_now_is_away(server: Memory, store: Any, error: str) -> None:
    async with calls(server, store) as every:
        server.redis.error = error
        for call in every:
            with pytest.raises(RedisUnavailable):
                await call()
        server.redis.error = ""
        await served(every[0])


async def test_subscriptions_that_were_accepted_survive_kill_9_of_the_server(server: Backend) -> None:
    async with SubscriptionStore(server.url, "fleet", "a") as a:
        made = [a_subscription() for _ in range(20)]
        for one in made:
            await a.add(one, Delivery(), LIMIT)
        entry = await a.advance_queue(made[0].id, None, OUTGOING, Delivery())
        server.kill()
        with pytest.raises(RedisUnavailable):
            await a.get_record(made[0].id)
        server.start()
        await served(a.renew_lease)
        assert await listed(a) == made
        assert (await a.read_backlog(made[0].id)).entries == [entry]


async def test_actions_that_were_accepted_survive_kill_9_of_the_server(server: Backend) -> None:
    async with ActionStore(server.url, "fleet", "a") as a:
        made = [an_invocation(created_ns=number) for number in range(20)]
        for one in made:
            await a.create(one, idempotency_key=one.id, request_digest="d")
        made[0] = ended(made[0])
        await a.save(made[0])
        lease, token = await a.take_lease("r", "Ada", 600)
        await a.set_setting("r", "title", None, "R")
        server.kill()
        with pytest.raises(RedisUnavailable):
            await a.load_invocations()
        server.start()
        await served(a.load_invocations)
        assert await a.load_invocations() == made
        held = await a.read_lease("r")  # which may have stood still meanwhile
        assert held is not None and held.expires_ns >= lease.expires_ns
        assert replace(held, expires_ns=lease.expires_ns) == lease
        assert await a.read_all_settings() == {"r": {"title": "R"}}
        assert (
            await a.create(an_invocation(), lease_token=token, idempotency_key=made[5].id, request_digest="d")
            == made[5].id
        )


@pytest.mark.parametrize("server", ["memory"], indirect=True)
async def test_nobody_is_dead_for_half_a_lease_after_an_outage_in_which_nobody_could_renew(server: Memory) -> None:
    async with SubscriptionStore(server.url, "fleet", "a") as a, SubscriptionStore(server.url, "fleet", "b") as b:
        await b.renew_lease()
        server.kill()
        await asyncio.sleep(2 * LEASE_S)
        with pytest.raises(RedisUnavailable):
            await a.dead_runs()
        server.start()
        assert await a.dead_runs() == []
        await asyncio.sleep(LEASE_S / 2 - 0.1)
        assert await a.dead_runs() == []
        await asyncio.sleep(0.2)
        assert await a.dead_runs() == ["b"]


@pytest.mark.parametrize("server", ["memory"], indirect=True)
async def test_a_step_of_which_the_answer_was_lost_may_be_repeated(server: Memory) -> None:
    """Whatever the step was, it was executed, and repeating it changes nothing."""
    subscription, invocation = a_subscription(), an_invocation()
    async with SubscriptionStore(server.url, "fleet", "a") as a, ActionStore(server.url, "fleet", "a") as b:
        for step in (
            lambda: a.add(subscription, Delivery(), 1),
            lambda: b.create(invocation, idempotency_key="k", request_digest="d"),
            lambda: b.save(ended(invocation)),
            lambda: a.remove(subscription.id),
        ):
            for nth in range(1, 9):
                server.redis.fail_after_executing(nth)
                with suppress(RedisUnavailable):
                    await step()
            server.redis.fail_after_executing(0)
            await step()
        assert await b.load_invocations() == [ended(invocation)]
        assert await held(a) == []
        await a.announce_end()
    assert not [key for key in server.lasting_keys() if "subscription" in key or "client" in key]
