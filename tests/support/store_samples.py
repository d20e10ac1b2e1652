"""Subscriptions and invocations for the tests of stores, and stores that crash or count their round trips."""

import asyncio
import time
import uuid
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager
from dataclasses import replace
from typing import Any, Protocol, TypeVar

from linked_fleet_base.errors import RedisUnavailable
from linked_fleet_gateway.extensions.rules.rule import Rule
from linked_fleet_gateway.resources.subscription import Kind, Record, Subscription
from linked_fleet_gateway.subscriptions.store import OutgoingMessage, SubscriptionStore
from linked_fleet_state.invocations import Invocation, InvocationState
from running import PATIENCE_S

T = TypeVar("T")
LIMIT = 1000
LEASE_S = 600.0
"""Lease of the gateways in tests: it lapses when a test passes time, not while a busy machine is slow."""
HOSTILE = 'x"}\r\nFLUSHALL\r\n\0 running später'
OUTGOING = OutgoingMessage("/baxter/right_s1/rotation", "v1", "text/turtle", b"\xff\r\n\x00")
_created_ns = iter(range(10**18, 2 * 10**18))


def a_subscription(**fields: Any) -> Subscription:
    """Return a subscription that is younger than the one before."""
    given = {
        "id": str(uuid.uuid4()),
        "owner": "/baxter/right_s1",
        "resource": "/baxter/right_s1/rotation",
        "kind": Kind.CALLBACK,
        "media_type": "text/turtle",
        "base": "http://localhost:8000",
        "client": "192.0.2.7",
        "created_ns": next(_created_ns),
    }
    return Subscription(**{**given, **fields})


def an_invocation(**fields: Any) -> Invocation:
    now_ns = time.time_ns()
    given = {
        "id": str(uuid.uuid4()),
        "robot": "r",
        "action": "/r/elbow/actions/rotate",
        "targets": {"elbow": 1.0},
        "created_ns": now_ns,
        "deadline_ns": now_ns + 10**10,
    }
    return Invocation(**{**given, **fields})


def ended(invocation: Invocation, state: InvocationState = InvocationState.SUCCEEDED) -> Invocation:
    return replace(invocation, state=state, ended_ns=invocation.created_ns)


def a_rule(**fields: Any) -> Rule:
    given = {
        "id": str(uuid.uuid4()),
        "title": HOSTILE,
        "condition": "SELECT",
        "invokes": "/r/actions/stop",
        "base": "http://fleet",
        "client": HOSTILE,
        "created_ns": 1,
        "interval_s": 0.0,
    }
    return Rule(**{**given, **fields})


async def adopted(store: SubscriptionStore, run: str) -> list[Subscription]:
    records = [record async for record in store.take_over(run)]
    assert {record.holder for record in records} <= {store._run}
    return [record.subscription for record in records]


async def held(store: SubscriptionStore) -> list[Subscription]:
    return [record.subscription for record in await store.held_records()]


async def listed(store: SubscriptionStore, owner: str = "/baxter/right_s1") -> list[Subscription]:
    return [record.subscription for record in await store.records_of_owner(owner)]


async def known(store: SubscriptionStore, id: str) -> Record:
    record = await store.get_record(id)
    assert record is not None
    return record


async def until(probe: Callable[[], Awaitable[T]], what: str) -> T:
    """Return the first true value of ``probe``; TimeoutError naming ``what`` if there is none in time."""
    try:
        async with asyncio.timeout(PATIENCE_S):
            while not (value := await probe()):  # noqa: ASYNC110 - in Redis
                await asyncio.sleep(0.01)
            return value
    except TimeoutError as error:
        raise TimeoutError(f"never happened: {what}") from error


async def served(ask: Callable[[], Awaitable[object]]) -> None:
    """Repeat a request until it is answered: a dead connection of a cluster is noticed only when used."""

    async def answered() -> bool:
        try:
            await ask()
        except RedisUnavailable:
            return False
        return True

    await until(answered, "Redis answers again")


class CrashedError(Exception):
    """Stands for the end of a gateway between two of its commands."""


def crash_after(store: SubscriptionStore, commands: int) -> None:
    """Let the store crash after so many commands."""
    left = iter(range(commands))
    redis = store._redis

    def dying(call: Callable[..., Awaitable[Any]]) -> Callable[..., Awaitable[Any]]:
        async def checked(*arguments: Any) -> Any:
            if next(left, None) is None:
                raise CrashedError
            return await call(*arguments)

        return checked

    redis.execute, redis.execute_all = dying(redis.execute), dying(redis.execute_all)  # type: ignore[method-assign]


def count_trips(store: SubscriptionStore) -> Callable[[], int]:
    """Return a function that counts the round trips to a server from now on."""
    trips = 0
    within_bounds = store._redis._within_bounds

    def counted(step: Callable[[], Awaitable[Any]], *slots: asyncio.Semaphore) -> Awaitable[Any]:
        nonlocal trips
        trips += 1
        return within_bounds(step, *slots)

    store._redis._within_bounds = counted  # type: ignore[method-assign, assignment]
    return lambda: trips


class Closable(Protocol):
    async def close(self) -> None: ...


C = TypeVar("C", bound=Closable)


@asynccontextmanager
async def closing(store: C) -> AsyncIterator[C]:
    try:
        yield store
    finally:
        await store.close()
