"""A copy of data in Redis: read at once, updated by news, and read again after outages and errors."""

import asyncio
import logging
from collections.abc import AsyncGenerator, Callable, Coroutine
from typing import Any

import pytest

from linked_fleet_base.errors import RedisUnavailable
from linked_fleet_runtime.background import cancel_tasks
from linked_fleet_runtime.replica import Copies, Replica, follow_changes
from virtual.loop import on_virtual_time

log = logging.getLogger("tests.replica")


class Shared:
    """The simulated data in Redis, and a gateway's ``copy`` of it. ``error``: raised for each request."""

    def __init__(self, **values: str) -> None:
        self.values, self.copy = values, dict[str, str]()
        self.error: Exception | None = None
        self.asked = list[str]()
        self.told: asyncio.Queue[str | None] = asyncio.Queue()
        self.replica = Replica(self._load, self._read, self._take)

    async def _load(self) -> dict[str, str]:
        self._ask("everything")
        return dict(self.values)

    async def _read(self, id: str) -> str | None:
        self._ask(id)
        value = self.values.get(id)
        await asyncio.sleep(1.0 if value == "slow" else 0.0)
        return value

    def _ask(self, what: str) -> None:
        self.asked.append(what)
        if self.error is not None:
            raise self.error

    def _take(self, id: str, value: str | None) -> None:
        self.copy.pop(id, None)
        if value is not None:
            self.copy[id] = value

    async def news(self) -> AsyncGenerator[str | None, None]:
        while True:
            yield await self.told.get()

    async def tell(self, news: str | None, **values: str) -> None:
        """Change the data, and send ``news`` of it to the copy."""
        self.values = values
        self.told.put_nowait(news)
        await asyncio.sleep(0.01)


def following(shared: Shared, test: Callable[[], Coroutine[Any, Any, None]]) -> None:
    async def run() -> None:
        task = await follow_changes("values", log, shared.replica.load, shared.replica.refresh, shared.news)
        await test()
        await cancel_tasks([task])

    on_virtual_time(run)


def test_one_value_is_read_for_news_and_everything_after_an_outage() -> None:
    shared = Shared(a="1", b="1")

    async def test() -> None:
        assert shared.copy == {"a": "1", "b": "1"}
        await shared.tell("a", a="2", b="2", c="2")
        assert shared.copy == {"a": "2", "b": "1"}
        await shared.tell("b", a="2", c="2")
        assert shared.copy == {"a": "2"}
        await shared.tell(None, c="3")
        assert shared.copy == {"c": "3"}
        assert shared.asked == ["everything", "a", "b", "everything"]

    following(shared, test)


def test_an_outage_is_waited_out_from_the_start(caplog: pytest.LogCaptureFixture) -> None:
    shared = Shared(a="1")
    shared.error = RedisUnavailable("away")

    async def test() -> None:
        await shared.tell("a", a="2")
        shared.error = None
        await shared.tell(None, a="3")
        assert shared.copy == {"a": "3"} and shared.asked == ["everything", "a", "everything"]

    following(shared, test)
    assert [each.message for each in caplog.records] == ["values are not known yet: Redis is unavailable: away"]


def test_a_gateway_is_ready_and_judges_motions_once_all_is_read() -> None:
    """Not while the last values are still being taken."""
    shared, copies = Shared(a="1"), Copies()
    copies.add("values", shared.replica, needed_by_motions=True)
    known = list[str]()
    others = Replica(shared._load, shared._read, lambda id, value: known.append(copies.awaited()))
    copies.add("others", others)
    shared.error = RedisUnavailable("away")

    async def test() -> None:
        assert copies.awaited() == "not read from Redis yet: values, others"
        assert copies.missed_by_motions() == "values"
        shared.error = None
        await shared.tell(None, a="1")
        assert copies.awaited() == "not read from Redis yet: others" and copies.missed_by_motions() == ""
        await others.load()
        assert known == ["not read from Redis yet: others"] and copies.awaited() == ""
        shared.error = RedisUnavailable("away")
        await shared.tell(None, a="1")
        assert copies.awaited() == copies.missed_by_motions() == "", "what was read stays known"

    following(shared, test)


def test_what_cannot_be_read_keeps_no_gateway_away_and_moves_nothing() -> None:
    shared, copies = Shared(a="1"), Copies()
    copies.add("values", shared.replica, needed_by_motions=True)
    shared.error = ValueError("damaged")

    async def test() -> None:
        assert copies.awaited() == "" and copies.missed_by_motions() == "values"

    following(shared, test)


def test_after_an_unforeseen_error_everything_is_read_anew(caplog: pytest.LogCaptureFixture) -> None:
    shared = Shared(a="1")

    async def test() -> None:
        assert shared.copy == {}
        shared.error = None
        await asyncio.sleep(5.0)
        shared.error = ValueError("damaged")
        await shared.tell("a", a="2", b="2")
        shared.error = None
        await asyncio.sleep(5.0)
        assert shared.copy == {"a": "2", "b": "2"}

    shared.error = ValueError("damaged")
    following(shared, test)
    assert [each.message for each in caplog.records] == [
        "values cannot be read; the gateway starts without them",
        "values are not up to date; it is tried again",
    ]


def test_a_late_read_does_not_replace_a_newer_write() -> None:
    async def test() -> None:
        shared = Shared(a="slow")
        late = asyncio.create_task(shared.replica.refresh("a"))
        await asyncio.sleep(0.5)

        async def step() -> bool:
            shared.values = {"a": "new"}
            return True

        assert await shared.replica.write("a", step())
        await late
        assert shared.copy == {"a": "new"}

    on_virtual_time(test)
