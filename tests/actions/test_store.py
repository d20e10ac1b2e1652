"""The store of actions on a real server and on a real cluster: one gateway decides at a time, and all come to know."""

import asyncio
import logging
import time
import uuid
from collections.abc import Awaitable, Callable, Iterator
from dataclasses import replace
from typing import Any, Self

import pytest
from redis_servers import Servers, cluster, single
from running import PATIENCE_S

from gateway.actions.keys import Keys
from gateway.actions.store import ActionStore, KeyReused, LeaseHeld, LeaseOver, News, StoreUnavailable
from gateway.fleet.invocations import FLEET, MAX_TERMINAL, Invocation, InvocationState

SHORT_S = 0.3
HOSTILE = ["arm 2/left", "@fleet", "{@fleet}", "}{", "..", "später", "x\r\nFLUSHALL\r\n", "\0", "*", "a" * 128]

Stores = Callable[..., ActionStore]


@pytest.fixture(scope="module", params=[single, cluster])
def servers(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Servers]:
    with request.param(tmp_path_factory.mktemp("redis")) as running:
        yield running


@pytest.fixture
def namespace() -> str:
    return uuid.uuid4().hex


@pytest.fixture
def store(servers: Servers, namespace: str) -> Stores:
    def make(run: str, **options: float) -> ActionStore:
        return ActionStore(servers.url, namespace, run, **options)

    return make


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


async def until(probe: Callable[[], Awaitable[Any]], what: str) -> Any:
    deadline = time.monotonic() + PATIENCE_S
    while not (value := await probe()):
        assert time.monotonic() < deadline, f"never happened: {what}"
        await asyncio.sleep(0.01)
    return value


async def done(act: Awaitable[Any]) -> bool:
    """Whether it was served; a connection of a cluster is known to be dead only when it is used."""
    try:
        await act
    except StoreUnavailable:
        return False
    return True


class Listener:
    """All that a store is told, as it comes."""

    def __init__(self, store: ActionStore) -> None:
        self._store = store
        self._heard: list[News] = []

    async def __aenter__(self) -> Self:
        await self._store.load()  # the first contact
        self._task = asyncio.create_task(self._listen())
        return self

    async def __aexit__(self, *_: object) -> None:
        self._task.cancel()
        await asyncio.wait([self._task])

    async def _listen(self) -> None:
        async for news in self._store.news():
            self._heard.append(news)

    async def next(self, count: int) -> list[News]:
        async def enough() -> bool:
            assert not self._task.done(), self._task
            return len(self._heard) >= count

        await until(enough, f"{count} news, only {self._heard}")
        told, self._heard = self._heard[:count], self._heard[count:]
        return told


async def is_free(store: ActionStore) -> bool:
    return await store.lease("r") is None


# Invocations


def test_an_invocation_is_read_as_it_was_written_by_whichever_gateway(store: Stores) -> None:
    whole = an_invocation(
        client="später\0", body='<a> <b> "c" .\n', duration_s=0.25, preempts=("x",), facts={"residual_m": 1e-9}
    )

    async def run() -> None:
        async with store("a") as a, store("b") as b:
            assert await b.load() == []
            assert await a.open(whole) is None
            assert await b.read("r", whole.id) == whole
            assert await b.read("r", "none") is await b.read("x", whole.id) is None
            running = replace(whole, state=InvocationState.RUNNING, progress=0.5)
            assert await b.save(running)
            assert await a.read("r", whole.id) == running
            assert await a.load() == [running]

    asyncio.run(run())


def test_those_of_all_robots_and_of_the_fleet_are_loaded_oldest_first(store: Stores) -> None:
    async def run() -> None:
        async with store("a") as a, store("b") as b:
            made = [
                an_invocation(robot=robot, created_ns=number) for number, robot in enumerate(["r", "x", FLEET, "r"])
            ]
            for number, one in enumerate(reversed(made)):
                await (a, b)[number % 2].open(one)
            assert await a.load() == await b.load() == made

    asyncio.run(run())


def test_the_first_end_is_the_end(store: Stores) -> None:
    async def run() -> None:
        async with store("a") as a, store("b") as b:
            one = an_invocation()
            await a.open(one)
            ends = [ended(one, InvocationState.SUCCEEDED), ended(one, InvocationState.CANCELLED)]
            saved = await asyncio.gather(a.save(ends[0]), b.save(ends[1]))
            assert sorted(saved) == [False, True]
            assert await b.save(ends[saved.index(True)])  # whoever heard nothing the first time asks once more
            assert not await b.save(replace(one, state=InvocationState.RUNNING))
            assert await a.open(one) is None  # asked again by the gateway that does not know that it has succeeded
            assert await b.read("r", one.id) == ends[saved.index(True)]

    asyncio.run(run())


def test_an_end_that_was_guessed_gives_way_to_what_the_robot_says(store: Stores) -> None:
    async def run() -> None:
        async with store("a") as a, store("b") as b:
            one = an_invocation()
            await a.open(one)
            guess = replace(ended(one, InvocationState.FAILED), expired=True)
            assert await b.save(guess)
            assert await a.read("r", one.id) == guess
            assert await a.save(replace(one, state=InvocationState.RUNNING))
            assert await b.save(guess)
            assert await a.save(ended(one))
            assert not await b.save(guess)
            assert await b.read("r", one.id) == ended(one)

    asyncio.run(run())


def test_what_was_deleted_does_not_come_back(store: Stores) -> None:
    async def run() -> None:
        async with store("a") as a, store("b") as b:
            one, other = an_invocation(), ended(an_invocation())
            await a.open(one)
            await a.open(other)
            assert await b.delete(one)
            assert not await a.delete(one)
            assert not await a.save(ended(one))
            assert not await a.save(an_invocation())  # never opened
            assert await a.load() == [other]

    asyncio.run(run())


def test_what_is_over_is_forgotten_after_its_time_and_what_is_open_not_before_its_deadline(
    servers: Servers, namespace: str, store: Stores
) -> None:
    async def run() -> None:
        async with store("a", kept_s=SHORT_S) as a:
            over, still, later = ended(an_invocation()), an_invocation(), an_invocation(robot="x", deadline_ns=0)
            await a.open(over, key="k", digest="d")
            await a.open(still)
            assert {one.id for one in await a.load()} == {over.id, still.id}

            async def forgotten() -> bool:
                return await a.read("r", over.id) is None

            await until(forgotten, "what is over is forgotten")
            assert await a.load() == [still]
            assert await a.open(ended(an_invocation()), key="k", digest="e") is None  # the key is free again
            await a.save(ended(still))
            await a.open(later)

            async def empty() -> bool:
                return not await a.load() and not await a._redis.one("ZCARD", Keys(namespace).robots)

            await until(empty, "all is forgotten, the names of the robots too")

    asyncio.run(run())
    assert servers.lasting_keys(f"{namespace}:*") == [Keys(namespace).news]


def test_of_a_robot_that_nobody_asks_about_again_nothing_lasts(servers: Servers, namespace: str, store: Stores) -> None:
    async def run() -> None:
        async with store("a") as a:
            await a.open(ended(an_invocation()), key="k", digest="d")
            await a.open(an_invocation())
            await a.take("r", "Ada", 60)

    asyncio.run(run())
    assert servers.lasting_keys(f"{namespace}:*") == [Keys(namespace).news, Keys(namespace).robots]


def test_of_each_robot_a_thousand_are_kept_and_the_open_ones_first(store: Stores) -> None:
    async def run() -> None:
        async with store("a") as a, store("b") as b:
            open_one, other = an_invocation(created_ns=0), ended(an_invocation(robot="x", created_ns=0))
            await a.open(open_one)
            await a.open(other)
            many = [
                ended(an_invocation(created_ns=number)) for number in range(1_000, (MAX_TERMINAL + 5) * 1_000, 1_000)
            ]
            for first in range(0, len(many), 100):
                await asyncio.gather(*(a.open(one) for one in many[first : first + 100]))
            loaded = await b.load()
            assert len(loaded) == MAX_TERMINAL + 1
            assert {one.id for one in loaded} == {one.id for one in (open_one, other, *many[-MAX_TERMINAL + 1 :])}

    asyncio.run(run())


def test_what_this_version_cannot_read_is_left_alone(
    namespace: str, store: Stores, caplog: pytest.LogCaptureFixture
) -> None:
    async def run() -> None:
        async with store("a") as a:
            one, strange = an_invocation(), an_invocation()
            await a.open(one)
            await a.open(strange)
            await a._redis.one("HSET", Keys(namespace).invocations("r")[0], strange.id, '{"id":7}')
            assert await a.load() == [one]
            assert await a.read("r", strange.id) is None

    with caplog.at_level(logging.WARNING):
        asyncio.run(run())
    assert len(caplog.records) == 2
    assert "is left alone" in caplog.text


# Idempotency keys


def test_of_many_requests_with_one_key_at_two_gateways_exactly_one_opens(store: Stores) -> None:
    async def run() -> None:
        async with store("a") as a, store("b") as b:
            asked = [an_invocation() for _ in range(20)]
            firsts = await asyncio.gather(
                *((a, b)[number % 2].open(one, key="k", digest="d") for number, one in enumerate(asked))
            )
            (opened,) = [one for one, first in zip(asked, firsts, strict=True) if first is None]
            assert set(firsts) == {None, opened.id}
            assert await b.load() == [opened]

    asyncio.run(run())


def test_a_key_stands_for_one_request_to_one_robot(store: Stores) -> None:
    async def run() -> None:
        async with store("a") as a, store("b") as b:
            one, key = an_invocation(), "k{}\r\n" + "x" * 9000
            assert await a.open(one, key=key, digest="d") is None
            refused = an_invocation()
            with pytest.raises(KeyReused):
                await b.open(refused, key=key, digest="e")
            assert await b.read("r", refused.id) is None
            assert await b.open(an_invocation(), key="other", digest="d") is None
            assert await b.open(an_invocation(robot="x"), key=key, digest="e") is None
            assert await b.open(an_invocation()) is None
            await a.delete(one)
            assert await b.open(an_invocation(), key=key, digest="d") == one.id

    asyncio.run(run())


def test_a_gateway_may_ask_again_when_it_does_not_know_whether_it_was_heard(store: Stores) -> None:
    async def run() -> None:
        async with store("a") as a:
            one = an_invocation()
            for _ in range(2):
                assert await a.open(one, key="k", digest="d") is None
            assert await a.load() == [one]

    asyncio.run(run())


# Leases


def test_only_who_knows_the_token_acts_on_a_robot_that_is_held(store: Stores) -> None:
    async def run() -> None:
        async with store("a") as a, store("b") as b:
            lease, token = await a.take("r", "Ada", 60)
            assert (lease.robot, lease.holder, lease.duration_s) == ("r", "Ada", 60)
            assert lease.expires_ns - lease.taken_ns == 60 * 10**9
            assert token.startswith("urn:uuid:")
            assert lease.id not in token
            assert await b.lease("r") == lease
            for wrong in ("", "urn:uuid:0", lease.id):
                refused = an_invocation()
                with pytest.raises(LeaseHeld, match="Ada has the lease of r") as caught:
                    await b.open(refused, token=wrong, key="k", digest="d")
                assert caught.value.lease == lease
                with pytest.raises(LeaseHeld):
                    await b.check("r", wrong)
                assert await b.read("r", refused.id) is None
            await b.check("r", token)
            assert await b.open(an_invocation(), token=token, key="k", digest="d") is None
            assert await b.open(an_invocation(robot="x"), token=token) is None  # free for all
            assert await b.open(an_invocation(robot=FLEET)) is None

    asyncio.run(run())


def test_what_is_tied_to_a_lease_needs_that_very_lease(store: Stores) -> None:
    async def run() -> None:
        async with store("a") as a, store("b") as b:
            lease, token = await a.take("r", "Ada", 60)
            assert await b.open(an_invocation(lease=lease.id), token=token) is None
            with pytest.raises(LeaseOver):
                await b.check("r", token, "another")
            assert await a.release("r", token)
            with pytest.raises(LeaseOver):
                await b.open(an_invocation(lease=lease.id), token=token)
            await b.check("r", token)
            _, second = await a.take("r", "Ada", 60)
            with pytest.raises(LeaseOver):
                await b.open(an_invocation(lease=lease.id), token=second)
            with pytest.raises(LeaseHeld):
                await b.open(an_invocation(lease=lease.id), token=token)

    asyncio.run(run())


def test_of_many_who_want_a_lease_one_gets_it(store: Stores) -> None:
    async def run() -> None:
        async with store("a") as a, store("b") as b:
            taken = await asyncio.gather(
                *((a, b)[number % 2].take("r", str(number), 60) for number in range(20)), return_exceptions=True
            )
            (won,) = [one for one in taken if isinstance(one, tuple)]
            others = [one.lease for one in taken if isinstance(one, LeaseHeld)]
            assert others == [won[0]] * 19

    asyncio.run(run())


def test_a_renewal_is_the_same_lease_for_longer(store: Stores) -> None:
    async def run() -> None:
        async with store("a") as a, store("b") as b:
            lease, token = await a.take("r", "Ada", 60)
            renewed, same = await b.take("r", "Ada, or so she says", 120, token)
            assert same == token
            assert renewed == replace(lease, duration_s=120, expires_ns=renewed.expires_ns)
            assert renewed.expires_ns >= lease.expires_ns + 60 * 10**9
            assert await a.lease("r") == renewed
            with pytest.raises(LeaseHeld):
                await b.take("r", "Ben", 60, "urn:uuid:guessed")
            assert await a.lease("r") == renewed

    asyncio.run(run())


def test_what_is_left_of_a_lease_is_told_by_who_looks_at_it(store: Stores) -> None:
    async def run() -> None:
        async with store("a") as a, store("b") as b:
            lease, token = await a.take("r", "Ada", 60)
            assert lease.left_s == pytest.approx(60, abs=5)
            before = lease.left_s

            async def less() -> bool:
                looked = await b.lease("r")
                return looked is not None and 0 < looked.left_s < before

            await until(less, "time passes")
            renewed, _ = await b.take("r", "Ada", 120, token)
            assert renewed.left_s > before

    asyncio.run(run())


def test_an_expired_lease_is_anybody_s_and_its_token_worth_nothing(store: Stores) -> None:
    async def run() -> None:
        async with store("a") as a, store("b") as b:
            lease, token = await a.take("r", "Ada", 0.05)
            await until(lambda: is_free(b), "the lease expires")
            await b.open(an_invocation())
            taken, other = await b.take("r", "Ben", 60)
            assert (taken.holder, await a.lease("r")) == ("Ben", taken)
            assert len({lease.id, taken.id}) == len({token, other}) == 2
            for act in (a.take("r", "Ada", 60, token), a.release("r", token), a.open(an_invocation(), token=token)):
                with pytest.raises(LeaseHeld):
                    await act
            assert await b.release("r", other)
            assert not await b.release("r", other)
            again, fresh = await a.take("r", "Ada", 60, token)  # free, but an old token opens nothing
            assert again.id != lease.id
            assert fresh != token

    asyncio.run(run())


def test_redis_does_not_know_a_token(namespace: str, store: Stores) -> None:
    async def run() -> None:
        async with store("a") as a:
            _, token = await a.take("r", "Ada", 60)
            fields = await a._redis.one("HGETALL", Keys(namespace).lease("r"))
            assert token.removeprefix("urn:uuid:").encode() not in b" ".join(fields.values())

    asyncio.run(run())


# Settings


def test_settings_are_kept_by_robot_until_they_are_taken_back(servers: Servers, namespace: str, store: Stores) -> None:
    async def run() -> None:
        async with store("a") as a, store("b") as b:
            await a.set_setting("r", "title", None, "Später\r\n{}")
            await b.set_setting("r", "scale", None, "0.5")
            await a.set_setting(FLEET, "title", None, "")
            assert await b.settings("r") == {"title": "Später\r\n{}", "scale": "0.5"}
            assert await a.settings("x") == {}
            assert await b.all_settings() == {"r": await a.settings("r"), FLEET: {"title": ""}}
            await b.set_setting("r", "title", "Später\r\n{}", None)
            assert await a.settings("r") == {"scale": "0.5"}
            assert await b.set_setting("r", "scale", "0.5", None)
            assert await b.set_setting("r", "scale", None, None)
            await b.set_setting(FLEET, "title", "", None)
            assert await a.all_settings() == {}

    asyncio.run(run())
    assert servers.lasting_keys(f"{namespace}:*") == [Keys(namespace).news]


def test_a_setting_takes_the_place_of_what_was_there_and_of_nothing_else(store: Stores) -> None:
    async def run() -> None:
        async with store("a") as a, store("b") as b, Listener(b) as heard:
            assert await a.set_setting("r", "title", None, "first")
            for present in (None, "", "other", "=first"):
                assert not await a.set_setting("r", "title", present, "late")
                assert not await a.set_setting("r", "title", present, None)
            assert not await a.set_setting("r", "scale", "first", "late")
            assert await b.settings("r") == {"title": "first"}
            assert await a.set_setting("r", "title", "first", "second")
            assert await heard.next(2) == [News("settings", "r", "title")] * 2

    asyncio.run(run())


# Names


def test_whatever_a_robot_is_called_what_is_its_own_is_nobody_else_s(store: Stores) -> None:
    robots = [*HOSTILE, FLEET, "r"]

    async def run() -> None:
        async with store("a") as a, store("b") as b, Listener(b) as heard:
            made = {robot: an_invocation(robot=robot, client=robot) for robot in robots}
            for robot, one in made.items():
                assert await a.open(one, key="k", digest=robot) is None
                lease, _ = await a.take(robot, robot, 60)
                assert lease == await b.lease(robot)
                assert (lease.robot, lease.holder) == (robot, robot)
                await a.set_setting(robot, robot, None, robot)
                assert await heard.next(3) == [
                    News("invocation", robot, one.id),
                    News("lease", robot, lease.id),
                    News("settings", robot, robot),
                ]
            assert {one.robot: one for one in await b.load()} == made
            assert await b.all_settings() == {robot: {robot: robot} for robot in robots}

    asyncio.run(run())


@pytest.mark.parametrize("robot", ["a" * 129, "\udcff"])
def test_what_cannot_be_a_name_is_refused(robot: str, store: Stores) -> None:
    async def run() -> None:
        async with store("a") as a:
            for act in (a.open(an_invocation(robot=robot)), a.lease(robot), a.settings(robot), a.read(robot, "i")):
                with pytest.raises(ValueError, match=r"a name has|surrogates not allowed"):
                    await act

    asyncio.run(run())


@pytest.mark.parametrize("namespace", ["", "a:b", "{a}", "a b"])
def test_a_namespace_that_would_make_keys_ambiguous_is_refused(namespace: str) -> None:
    with pytest.raises(ValueError, match="is not a plain key"):
        ActionStore("redis://localhost", namespace, "a")


# News and outages


def test_others_hear_what_was_done_and_nobody_what_he_did_himself(store: Stores) -> None:
    async def run() -> None:
        async with store("a") as a, store("b") as b, Listener(a) as heard_by_a, Listener(b) as heard_by_b:
            one = an_invocation()
            await a.open(one, key="k", digest="d")
            assert await a.open(an_invocation(), key="k", digest="d") == one.id  # nothing new
            await a.save(replace(one, duration_s=30.0))
            await a.save(ended(one))
            assert not await a.save(replace(ended(one), reason="another"))  # too late, nothing is written
            lease, token = await a.take("r", "Ada", 60)
            await a.take("r", "Ada", 60, token)
            await a.release("r", token)
            await a.set_setting("r", "title", None, "R")
            await a.delete(one)
            await a.delete(one)
            await b.set_setting("x", "title", None, "X")
            assert await heard_by_b.next(8) == [
                *[News("invocation", "r", one.id)] * 3,
                *[News("lease", "r", lease.id)] * 3,
                News("settings", "r", "title"),
                News("deleted", "r", one.id),
            ]
            assert await heard_by_a.next(1) == [News("settings", "x", "title")]

    asyncio.run(run())


def test_after_an_outage_a_listener_is_told_to_read_anew_and_hears_the_rest(servers: Servers, store: Stores) -> None:
    async def run() -> None:
        async with store("a") as a, store("b") as b, Listener(a) as heard, Listener(b):
            await b.set_setting("r", "first", None, "1")
            assert await heard.next(1) == [News("settings", "r", "first")]
            await asyncio.to_thread(servers.kill)
            await asyncio.to_thread(servers.start)
            await until(lambda: done(b.set_setting("r", "second", None, "2")), "b is served again")
            assert await heard.next(2) == [News("lost"), News("settings", "r", "second")]

    asyncio.run(run())


def test_who_met_an_outage_before_listening_is_told_too(servers: Servers, store: Stores) -> None:
    async def run() -> None:
        async with store("a") as a, store("b") as b:
            await asyncio.to_thread(servers.kill)
            with pytest.raises(StoreUnavailable):
                await a.load()
            await asyncio.to_thread(servers.start)
            await until(lambda: done(a.load()), "a is served again")
            async with Listener(a) as heard:
                await until(lambda: done(b.set_setting("r", "title", None, "R")), "b is served")
                assert await heard.next(2) == [News("lost"), News("settings", "r", "title")]

    asyncio.run(run())


def test_a_listener_ends_when_it_is_told_to_even_as_news_come(store: Stores) -> None:
    async def run() -> None:
        async with store("a") as a, store("b") as b:
            for number in range(3):
                async with Listener(a) as heard:
                    await b.set_setting("r", str(number), None, "set")
                    await heard.next(1)

    asyncio.run(run())


def test_what_could_not_be_told_is_told_later(store: Stores) -> None:
    async def run() -> None:
        async with store("a") as a, store("b") as b, Listener(b) as heard:
            tell = a._redis.all

            async def away(*_: object) -> Any:
                raise StoreUnavailable

            a._redis.all = away  # type: ignore[method-assign]
            one = an_invocation()
            await a.open(one)
            lease, token = await a.take("r", "Ada", 60)  # its token is not lost
            assert await b.read("r", one.id) == one
            a._redis.all = tell  # type: ignore[method-assign]
            await a.check("r", token)
            async with Listener(a):
                assert await heard.next(2) == [News("invocation", "r", one.id), News("lease", "r", lease.id)]

    asyncio.run(run())


def test_what_was_accepted_survives_kill_9_of_the_server(servers: Servers, store: Stores) -> None:
    async def run() -> None:
        async with store("a") as a:
            made = [an_invocation(created_ns=number) for number in range(20)]
            for one in made:
                await a.open(one, key=one.id, digest="d")
            made[0] = ended(made[0])
            await a.save(made[0])
            lease, token = await a.take("r", "Ada", 600)
            await a.set_setting("r", "title", None, "R")
            await asyncio.to_thread(servers.kill)
            acts: tuple[Callable[[], Awaitable[Any]], ...] = (
                lambda: a.open(an_invocation()),
                lambda: a.check("r", token),
                lambda: a.save(made[1]),
                lambda: a.delete(made[1]),
                lambda: a.read("r", made[1].id),
                a.load,
                lambda: a.take("r", "Ada", 60, token),
                lambda: a.release("r", token),
                lambda: a.lease("r"),
                lambda: a.settings("r"),
                lambda: a.set_setting("r", "title", "R", None),
                a.all_settings,
            )
            for act in acts:
                with pytest.raises(StoreUnavailable):
                    await act()
            await asyncio.to_thread(servers.start)
            await until(lambda: done(a.load()), "a is served again")
            assert await a.load() == made
            held = await a.lease("r")  # which may have stood still meanwhile
            assert held is not None and held.expires_ns >= lease.expires_ns
            assert replace(held, expires_ns=lease.expires_ns) == lease
            assert await a.all_settings() == {"r": {"title": "R"}}
            assert await a.open(an_invocation(), token=token, key=made[5].id, digest="d") == made[5].id

    asyncio.run(run())
