"""The gateway's copy of invocations while Redis cannot store them yet."""

import asyncio
import logging
import time
from pathlib import Path

import pytest

from linked_fleet_base.errors import RedisUnavailable
from linked_fleet_gateway.actions.replicated_invocations import ReplicatedInvocations
from linked_fleet_gateway.actions.store import ActionStore
from linked_fleet_gateway.app.application import create_live
from linked_fleet_gateway.app.settings import GatewaySettings
from linked_fleet_gateway.subscriptions.live import Live
from linked_fleet_state.invocations import Invocation, InvocationState
from redis_servers import single
from running import PATIENCE_S
from virtual.zenoh_network import ZenohNetwork

pytestmark = pytest.mark.virtual
MOST = 10_000


class Slow(ActionStore):
    """Delays the first answer of the method ``held``, as a busy event loop may do."""

    def __init__(self, url: str, held: str) -> None:
        super().__init__(url, "n", "run")
        self._held = held
        self.answered, self.handed_over = asyncio.Event(), asyncio.Event()

    async def read_invocation(self, robot: str, id: str) -> Invocation | None:
        found = await super().read_invocation(robot, id)
        await self._hold("read_invocation")
        return found

    async def read_settings(self, robot: str) -> dict[str, str]:
        found = await super().read_settings(robot)
        await self._hold("read_settings")
        return found

    async def _hold(self, method: str) -> None:
        if method == self._held and not self.answered.is_set():
            self.answered.set()
            await self.handed_over.wait()


async def _stop(*_: object) -> None: ...


def _live() -> Live:
    return create_live(GatewaySettings(), ZenohNetwork().gateway("g"))


def test_unsaved_invocations_are_bounded_and_open_ones_dropped_last(
    caplog: pytest.LogCaptureFixture,
) -> None:
    memory = ReplicatedInvocations(_live(), ActionStore("redis://127.0.0.1:1", "n", "run"), _stop, lambda _: None)
    states = [InvocationState.RUNNING] + [InvocationState.SUCCEEDED] * (MOST + 1)
    made = [
        Invocation(str(number), "r", "/r/actions/stop", {}, time.time_ns(), time.time_ns(), state=state)
        for number, state in enumerate(states)
    ]
    with caplog.at_level(logging.WARNING):
        for one in made:
            memory.save_stop(one)
    assert set(memory._unsaved) == {one.id for one in made} - {"1", "2"}
    assert memory._unasked == set(memory._unsaved)
    assert len([each for each in caplog.records if "given up" in each.message]) == 1


def test_a_stop_that_ends_before_it_is_recorded_is_remembered(tmp_path: Path) -> None:
    """The robot reports the end together with its answer: both arrive before anything is written."""
    stopped = Invocation("i", "r", "/r/actions/stop", {}, time.time_ns(), time.time_ns() + 10**10, stops=())

    async def scenario(url: str) -> None:
        store, other = (ActionStore(url, "n", run) for run in ("one", "other"))
        async with store, other, ReplicatedInvocations(_live(), store, _stop, lambda _: None) as memory:
            await other.load_invocations()
            memory.mark_own(stopped)
            stopped.state = InvocationState.SUCCEEDED
            memory.store_end(stopped)
            memory.save_stop(stopped)
            async with asyncio.timeout(PATIENCE_S):
                async for news in other.news():
                    if (found := await other.read_invocation(news.robot, news.id)) is not None and found.is_final:
                        break

    with single(tmp_path) as servers:
        asyncio.run(scenario(servers.url))


def test_an_end_before_the_reply_is_stored_with_the_facts_of_the_reply(tmp_path: Path) -> None:
    moved = Invocation("i", "r", "/r/j/actions/rotate", {"j": 1.0}, time.time_ns(), time.time_ns() + 10**10)
    later = Invocation("k", "r", "/r/j/actions/rotate", {"j": 1.0}, time.time_ns(), time.time_ns() + 10**10)

    async def scenario(url: str) -> None:
        store, other = (ActionStore(url, "n", run) for run in ("one", "other"))
        async with store, other, ReplicatedInvocations(_live(), store, _stop, lambda _: None) as memory:
            await other.load_invocations()
            for each in (moved, later):
                await store.create(each)
                memory.mark_own(each)
            async with asyncio.timeout(PATIENCE_S):
                with memory.defer_end(moved):
                    moved.state = later.state = InvocationState.SUCCEEDED
                    memory.store_end(moved)
                    memory.store_end(later)
                    while not (found := await other.read_invocation("r", "k")) or not found.is_final:  # noqa: ASYNC110 - in Redis
                        await asyncio.sleep(0.01)
                moved.duration_s = 0.5
                while not (found := await other.read_invocation("r", "i")) or not found.is_final:  # noqa: ASYNC110 - in Redis
                    await asyncio.sleep(0.01)
        assert found.duration_s == 0.5

    with single(tmp_path) as servers:
        asyncio.run(scenario(servers.url))


def test_an_invocation_deleted_during_a_read_stays_deleted(tmp_path: Path) -> None:
    """The store's answers to both arrive on different connections, in any order."""
    invocation = Invocation("i", "r", "/r/j/actions/rotate", {"j": 1.0}, time.time_ns(), time.time_ns() + 10**10)

    async def scenario(url: str) -> None:
        live = _live()
        async with (
            Slow(url, "read_invocation") as store,
            ReplicatedInvocations(live, store, _stop, lambda _: None) as memory,
        ):
            await store.create(invocation)
            reading = asyncio.create_task(memory.fetch("r", "i"))
            await store.answered.wait()
            await store.delete(invocation)
            memory.forget(invocation.id)
            store.handed_over.set()
            assert await reading is None
            assert live.invocations.get("i") is None

    with single(tmp_path) as servers:
        asyncio.run(scenario(servers.url))


def test_a_setting_removed_during_an_outage_is_no_longer_set(tmp_path: Path) -> None:
    class CutOff(ActionStore):
        """The next request for settings fails as in an outage."""

        away = False

        async def read_settings(self, robot: str) -> dict[str, str]:
            if self.away:
                self.away = False
                self._redis.outage_count += 1
                raise RedisUnavailable("cut off")
            return await super().read_settings(robot)

    async def scenario(url: str) -> None:
        live = _live()
        async with CutOff(url, "n", "one") as store, ActionStore(url, "n", "other") as other:
            await other.set_setting("r", "title", None, "x")
            async with ReplicatedInvocations(live, store, _stop, lambda _: None), asyncio.timeout(PATIENCE_S):
                assert live.fleet.settings == {"r": {"title": "x"}}
                store.away = True
                await other.set_setting("r", "title", "x", None)
                while live.fleet.settings.get("r"):  # noqa: ASYNC110 - in Redis
                    await asyncio.sleep(0.01)
        assert not store.away

    with single(tmp_path) as servers:
        asyncio.run(scenario(servers.url))


def test_a_late_read_does_not_replace_a_newer_setting(tmp_path: Path) -> None:
    async def scenario(url: str) -> None:
        live = _live()
        async with (
            Slow(url, "read_settings") as store,
            ReplicatedInvocations(live, store, _stop, lambda _: None) as memory,
        ):
            await store.set_setting("r", "title", None, "old")
            first = asyncio.create_task(memory._settings.refresh("r"))
            await store.answered.wait()
            await store.set_setting("r", "title", "old", "new")
            second = asyncio.create_task(memory._settings.refresh("r"))
            await asyncio.wait([second], timeout=1.0)
            store.handed_over.set()
            await asyncio.gather(first, second)
            assert live.fleet.settings == {"r": {"title": "new"}}

    with single(tmp_path) as servers:
        asyncio.run(scenario(servers.url))
