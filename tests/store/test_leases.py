"""Leases and settings of robots, and messages between gateways about them and about invocations."""

import asyncio
import uuid
from collections.abc import Iterator
from contextlib import asynccontextmanager
from dataclasses import replace
from typing import Any

import pytest

from linked_fleet_base.errors import RedisUnavailable
from linked_fleet_gateway.actions.redis_scripts import Keys
from linked_fleet_gateway.actions.store import ActionStore, LeaseHeld, News
from linked_fleet_state.invocation import Priority
from linked_fleet_state.invocations import FLEET
from redis_backends import Backend, opened
from running import PATIENCE_S
from store_samples import an_invocation, ended, served, until

HOSTILE = ["arm 2/left", "@fleet", "{@fleet}", "}{", "..", "später", "x\r\nFLUSHALL\r\n", "\0", "*", "a" * 128]


@pytest.fixture
def a(server: Backend) -> Iterator[ActionStore]:
    yield from opened(server, ActionStore(server.url, "fleet", "a"))


@pytest.fixture
def b(server: Backend) -> Iterator[ActionStore]:
    yield from opened(server, ActionStore(server.url, "fleet", "b"))


class Listener:
    """Records the news that a store receives."""

    def __init__(self, store: ActionStore) -> None:
        self._heard: asyncio.Queue[News | None] = asyncio.Queue()
        self._store = store

    async def next(self, count: int) -> list[News | None]:
        async with asyncio.timeout(PATIENCE_S):
            return [await self._heard.get() for _ in range(count)]

    async def listen(self) -> None:
        async for news in self._store.news():
            self._heard.put_nowait(news)


@asynccontextmanager
async def listening(store: ActionStore) -> Any:
    listener = Listener(store)
    await store.load_invocations()  # the first contact
    task = asyncio.create_task(listener.listen())
    try:
        yield listener
    finally:
        task.cancel()
        await asyncio.wait([task])


@pytest.fixture
def heard(server: Backend, b: ActionStore) -> Iterator[Listener]:
    """Record the news that ``b`` receives."""
    yield from opened(server, listening(b))


# Leases


async def test_only_the_holder_of_the_token_acts_on_a_leased_robot(a: ActionStore, b: ActionStore) -> None:
    lease, token = await a.take_lease("r", "Ada", 60)
    assert (lease.robot, lease.holder, lease.duration_s) == ("r", "Ada", 60)
    assert lease.expires_ns - lease.taken_ns == 60 * 10**9
    assert token.startswith("urn:uuid:") and lease.id not in token
    assert await b.read_lease("r") == lease
    for wrong in ("", "urn:uuid:0", lease.id):
        refused = an_invocation()
        with pytest.raises(LeaseHeld, match="Ada has the lease of r") as caught:
            await b.create(refused, lease_token=wrong, idempotency_key="k", request_digest="d")
        assert caught.value.lease == lease
        with pytest.raises(LeaseHeld):
            await b.check_lease("r", wrong)
        assert await b.read_invocation("r", refused.id) is None
    await b.check_lease("r", token)
    assert await b.create(an_invocation(), lease_token=token, idempotency_key="k", request_digest="d") is None
    assert await b.create(an_invocation(), ignore_lease=True) is None  # whoever has the lease
    assert await b.create(an_invocation(robot="x"), lease_token=token) is None  # free for all
    assert await b.create(an_invocation(robot=FLEET)) is None


async def test_one_of_many_clients_gets_the_lease(a: ActionStore, b: ActionStore) -> None:
    taken = await asyncio.gather(
        *((a, b)[number % 2].take_lease("r", str(number), 60) for number in range(20)), return_exceptions=True
    )
    (won,) = [one for one in taken if isinstance(one, tuple)]
    assert [one.lease for one in taken if isinstance(one, LeaseHeld)] == [won[0]] * 19


async def test_a_renewal_is_the_same_lease_for_longer(a: ActionStore, b: ActionStore) -> None:
    lease, token = await a.take_lease("r", "Ada", 60)
    renewed, same = await b.take_lease("r", "Ada, or so she says", 120, token)
    assert same == token
    assert renewed == replace(lease, duration_s=120, expires_ns=renewed.expires_ns)
    assert renewed.expires_ns >= lease.expires_ns + 60 * 10**9
    with pytest.raises(LeaseHeld):
        await b.take_lease("r", "Ben", 60, "urn:uuid:guessed")
    assert await a.read_lease("r") == renewed


async def test_a_read_lease_has_its_remaining_time(a: ActionStore, b: ActionStore) -> None:
    lease, token = await a.take_lease("r", "Ada", 60)
    assert lease.left_s == pytest.approx(60, abs=5)

    async def less() -> bool:
        looked = await b.read_lease("r")
        return looked is not None and 0 < looked.left_s < lease.left_s

    await until(less, "time passes")
    renewed, _ = await b.take_lease("r", "Ada", 120, token)
    assert renewed.left_s > lease.left_s


async def test_an_expired_lease_is_anybody_s_and_its_token_worth_nothing(a: ActionStore, b: ActionStore) -> None:
    lease, token = await a.take_lease("r", "Ada", 0.05)

    async def is_free() -> bool:
        return await b.read_lease("r") is None

    await until(is_free, "the lease expires")
    await b.create(an_invocation())
    taken, other = await b.take_lease("r", "Ben", 60)
    assert (taken.holder, await a.read_lease("r")) == ("Ben", taken)
    assert len({lease.id, taken.id}) == len({token, other}) == 2
    for act in (
        a.take_lease("r", "Ada", 60, token),
        a.release_lease("r", token),
        a.create(an_invocation(), lease_token=token),
    ):
        with pytest.raises(LeaseHeld):
            await act
    assert await b.release_lease("r", other)
    assert not await b.release_lease("r", other)
    again, fresh = await a.take_lease("r", "Ada", 60, token)  # free, but an old token is invalid
    assert again.id != lease.id and fresh != token


async def test_redis_does_not_know_a_token(a: ActionStore) -> None:
    _, token = await a.take_lease("r", "Ada", 60)
    fields = await a._redis.execute("HGETALL", Keys().lease("r"))
    assert token.removeprefix("urn:uuid:").encode() not in b" ".join(fields.values())


# Settings


async def test_settings_are_kept_by_robot_until_they_are_taken_back(
    server: Backend, a: ActionStore, b: ActionStore
) -> None:
    await a.set_setting("r", "title", None, "Später\r\n{}")
    await b.set_setting("r", "scale", None, "0.5")
    await a.set_setting(FLEET, "title", None, "")
    assert await b.read_settings("r") == {"title": "Später\r\n{}", "scale": "0.5"}
    assert await a.read_settings("x") == {}
    assert await b.read_all_settings() == {"r": await a.read_settings("r"), FLEET: {"title": ""}}
    await b.set_setting("r", "title", "Später\r\n{}", None)
    assert await a.read_settings("r") == {"scale": "0.5"}
    assert await b.set_setting("r", "scale", "0.5", None)
    assert await b.set_setting("r", "scale", None, None)
    await b.set_setting(FLEET, "title", "", None)
    assert await a.read_all_settings() == {}
    assert {*server.lasting_keys()} <= {Keys().news}


async def test_a_setting_takes_the_place_of_what_was_there_and_of_nothing_else(
    a: ActionStore, b: ActionStore, heard: Listener
) -> None:
    assert await a.set_setting("r", "title", None, "first")
    for present in (None, "", "other", "=first"):
        assert not await a.set_setting("r", "title", present, "late")
        assert not await a.set_setting("r", "title", present, None)
    assert not await a.set_setting("r", "scale", "first", "late")
    assert await b.read_settings("r") == {"title": "first"}
    assert await a.set_setting("r", "title", "first", "second")
    assert await heard.next(2) == [News("settings", "r", "title")] * 2


# Names


async def test_keys_of_robots_with_unusual_names_are_distinct(a: ActionStore, b: ActionStore, heard: Listener) -> None:
    made = {robot: an_invocation(robot=robot, client=robot) for robot in (*HOSTILE, FLEET, "r")}
    for robot, one in made.items():
        assert await a.create(one, idempotency_key="k", request_digest=robot) is None
        lease, _ = await a.take_lease(robot, robot, 60)
        found = await b.read_lease(robot)
        assert found is not None and found.id == lease.id
        assert (found.robot, found.holder) == (robot, robot)
        await a.set_setting(robot, robot, None, robot)
        told = [("invocation", robot, one.id), ("lease", robot, lease.id), ("settings", robot, robot)]
        assert await heard.next(3) == [News(*each) for each in told]
    assert {one.robot: one for one in await b.load_invocations()} == made
    assert await b.read_all_settings() == {robot: {robot: robot} for robot in made}


@pytest.mark.parametrize("robot", ["a" * 129, "\udcff"])
async def test_invalid_names_are_refused(robot: str, a: ActionStore) -> None:
    for act in (
        a.create(an_invocation(robot=robot)),
        a.read_lease(robot),
        a.read_settings(robot),
        a.read_invocation(robot, "i"),
    ):
        with pytest.raises(ValueError, match=r"a name has|surrogates not allowed"):
            await act


# News


async def test_news_reaches_other_gateways_only(a: ActionStore, b: ActionStore, heard: Listener) -> None:
    async with listening(a) as heard_by_a:
        one = an_invocation()
        await a.create(one, idempotency_key="k", request_digest="d")
        assert await a.create(an_invocation(), idempotency_key="k", request_digest="d") == one.id  # nothing new
        await a.save(replace(one, duration_s=30.0))
        await a.save(ended(one))
        assert not await a.save(replace(ended(one), reason="another"))  # too late, nothing is written
        lease, token = await a.take_lease("r", "Ada", 60)
        await a.take_lease("r", "Ada", 60, token)
        await a.release_lease("r", token)
        await a.set_setting("r", "title", None, "R")
        await a.delete(one)
        await a.delete(one)
        await b.set_setting("x", "title", None, "X")
        assert await heard.next(8) == [
            *[News("invocation", "r", one.id)] * 3,
            *[News("lease", "r", lease.id)] * 3,
            News("settings", "r", "title"),
            News("deleted", "r", one.id),
        ]
        assert await heard_by_a.next(1) == [News("settings", "x", "title")]


async def test_after_an_outage_a_listener_is_told_to_read_anew_and_hears_the_rest(
    server: Backend, a: ActionStore, b: ActionStore, heard: Listener
) -> None:
    await a.set_setting("r", "first", None, "1")
    assert await heard.next(1) == [News("settings", "r", "first")]
    server.kill()
    with pytest.raises(RedisUnavailable):
        await b.load_invocations()
    server.start()
    await served(lambda: a.set_setting("r", "second", None, "2"))
    assert await heard.next(2) == [None, News("settings", "r", "second")]


async def test_a_follower_that_starts_in_an_outage_gets_the_news(
    server: Backend, a: ActionStore, b: ActionStore
) -> None:
    server.kill()
    with pytest.raises(RedisUnavailable):
        await a.load_invocations()
    server.start()
    await served(a.load_invocations)
    async with listening(a) as heard_by_a:
        await served(lambda: b.set_setting("r", "title", None, "R"))
        assert await heard_by_a.next(2) == [None, News("settings", "r", "title")]


async def test_a_listener_ends_when_it_is_told_to_even_as_news_come(a: ActionStore, b: ActionStore) -> None:
    for number in range(3):
        async with listening(a) as heard_by_a:
            await b.set_setting("r", str(number), None, "set")
            await heard_by_a.next(1)


async def test_news_during_an_outage_is_delivered_later(a: ActionStore, b: ActionStore, heard: Listener) -> None:
    tell = a._redis.execute_all

    async def away(*_: object) -> Any:
        raise RedisUnavailable("away")

    a._redis.execute_all = away  # type: ignore[method-assign]
    one = an_invocation()
    await a.create(one)
    lease, token = await a.take_lease("r", "Ada", 60)  # its token is not lost
    assert await b.read_invocation("r", one.id) == one
    a._redis.execute_all = tell  # type: ignore[method-assign]
    await a.check_lease("r", token)
    assert await heard.next(2) == [News("invocation", "r", one.id), News("lease", "r", lease.id)]


# Priority


async def test_a_person_takes_the_lease_from_a_program_whose_token_is_worth_nothing_then(
    a: ActionStore, b: ActionStore
) -> None:
    lease, token = await a.take_lease("r", "Planner", 60)
    assert lease.priority == "program"
    taken, proof = await b.take_lease("r", "Ada", 30, priority="person")
    assert (taken.holder, taken.priority, taken.duration_s) == ("Ada", "person", 30)
    assert taken.id != lease.id
    assert await a.read_lease("r") == taken
    for step in (a.take_lease("r", "Planner", 60, token), a.check_lease("r", token), a.release_lease("r", token)):
        with pytest.raises(LeaseHeld) as caught:
            await step
        assert caught.value.lease == taken
    await b.check_lease("r", proof)


@pytest.mark.parametrize(
    ("first", "second"), [("person", "person"), ("person", "program"), ("person", None), ("program", "program")]
)
async def test_nobody_takes_it_from_a_person_and_of_equals_the_first_keeps_it(
    a: ActionStore, b: ActionStore, first: Priority, second: Priority | None
) -> None:
    lease, token = await a.take_lease("r", "Ada", 60, priority=first)
    with pytest.raises(LeaseHeld, match="Ada has the lease"):
        await b.take_lease("r", "Ben", 60, priority=second)
    assert await b.read_lease("r") == lease
    await a.check_lease("r", token)


async def test_a_renewal_keeps_the_priority_unless_it_states_one(a: ActionStore, b: ActionStore) -> None:
    lease, token = await a.take_lease("r", "Ada", 60, priority="person")
    renewed, _ = await a.take_lease("r", "Ada", 60, token)
    assert (renewed.id, renewed.priority) == (lease.id, "person")
    renewed, _ = await a.take_lease("r", "Ada", 60, token, "program")
    assert (renewed.id, renewed.priority) == (lease.id, "program")
    taken, _ = await b.take_lease("r", "Ben", 60, priority="person")
    assert taken.holder == "Ben"


async def test_control_is_handed_over_with_a_token_of_the_next_holder(a: ActionStore, b: ActionStore) -> None:
    """The former token is worth nothing then. The priority of a person stays with one who may have it alone."""
    lease, token = await a.take_lease("r", "Ada", 60, priority="person")
    first, second = uuid.uuid4().urn, uuid.uuid4().urn
    given = await b.hand_over_lease("r", token, first, "Ben", 30, may_be_person=True)
    assert given is not None and given == await a.read_lease("r") and given.id != lease.id
    assert (given.holder, given.priority, given.duration_s) == ("Ben", "person", 30)
    with pytest.raises(LeaseHeld, match="Ben has the lease"):
        await a.hand_over_lease("r", token, second, "Cy", 30, may_be_person=True)
    again = await a.hand_over_lease("r", first, second, "Cy", 30, may_be_person=False)
    assert again is not None and (again.holder, again.priority) == ("Cy", "program")
    await b.check_lease("r", second)
    assert await b.release_lease("r", second)
    assert await b.hand_over_lease("r", second, first, "Ben", 30, may_be_person=True) is None
