"""Background tasks continue after errors, and silently after outages of Redis."""

import asyncio
import logging
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

import pytest

from linked_fleet_base.errors import RedisUnavailable
from linked_fleet_runtime.background import (
    FINISH_S,
    MAX_RETRY_S,
    RETRY_S,
    cancel_tasks,
    run_last_step,
    supervised,
)
from linked_fleet_runtime.redis import BACKOFF_S
from virtual.loop import on_virtual_time

log = logging.getLogger("tests.background")


class Work:
    """Fails as told, and records its calls."""

    def __init__(self, *errors: Exception | None) -> None:
        self.errors = list(errors)
        self.called_s: list[float] = []

    async def __call__(self) -> None:
        self.called_s.append(time.monotonic())
        if self.errors and (error := self.errors.pop(0)) is not None:
            raise error

    @property
    def pauses_s(self) -> list[float]:
        return [round(later - sooner, 3) for sooner, later in zip(self.called_s, self.called_s[1:], strict=False)]


@asynccontextmanager
async def doing(work: Work, pause_s: float) -> AsyncIterator[asyncio.Task[None]]:
    task = supervised(work, "work", log, "work is not done", pause_s)
    yield task
    await cancel_tasks([task])


def test_work_that_fails_is_done_again_after_a_pause_and_each_error_is_one_line(
    caplog: pytest.LogCaptureFixture,
) -> None:
    work = Work(None, ValueError("wrong"), RedisUnavailable("away"))

    async def test() -> None:
        async with doing(work, 0.1) as task:
            await asyncio.sleep(1.0)
        assert task.cancelled() and task.get_name() == "work"

    on_virtual_time(test)
    assert work.pauses_s[:4] == [0.1, RETRY_S, BACKOFF_S, 0.1]
    assert [each.message for each in caplog.records] == ["work is not done; it is tried again"]
    assert caplog.records[0].exc_info is not None


def test_the_pause_grows_while_work_fails_and_begins_anew_when_it_succeeds() -> None:
    work = Work(*[ValueError("wrong")] * 7, None, ValueError("again"))

    async def test() -> None:
        async with doing(work, 0.1):
            await asyncio.sleep(60.0)

    on_virtual_time(test)
    assert work.pauses_s[:10] == [0.5, 1.0, 2.0, 4.0, 8.0, MAX_RETRY_S, MAX_RETRY_S, 0.1, RETRY_S, 0.1]


def test_a_long_pause_is_as_long_after_an_error() -> None:
    work = Work(ValueError("wrong"), RedisUnavailable("away"), None)

    async def test() -> None:
        async with doing(work, 5.0):
            await asyncio.sleep(16.0)

    on_virtual_time(test)
    assert work.pauses_s == [5.0, 5.0, 5.0]


def test_a_last_step_is_waited_for_as_long_as_redis_may_take(caplog: pytest.LogCaptureFixture) -> None:
    async def test() -> None:
        begun_s = time.monotonic()
        await run_last_step(asyncio.sleep(0.5), log, "a step was not taken")
        await run_last_step(Work(RedisUnavailable("away"))(), log, "it could not be said")
        await run_last_step(asyncio.sleep(3600), log, "it hangs")
        assert time.monotonic() - begun_s == pytest.approx(0.5 + FINISH_S)

    with caplog.at_level(logging.INFO):
        on_virtual_time(test)
    assert [each.message for each in caplog.records] == [
        "it could not be said: Redis is unavailable: away",
        "it hangs: no answer in time",
    ]
