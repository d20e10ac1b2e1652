"""Tasks: ended for certain, repeated in the background, and long work in slices or turns."""

import asyncio
import time
from collections.abc import AsyncIterator, Awaitable, Callable, Iterable
from contextvars import copy_context
from functools import partial
from logging import Logger
from typing import TypeVar

from linked_fleet_base.errors import RedisUnavailable
from linked_fleet_runtime.redis import BACKOFF_S

_PAUSE_S = 0.1


async def cancel_tasks(tasks: Iterable[asyncio.Task[None]]) -> None:
    """Cancel tasks until all of them are done.

    Once is not enough: a request that completes at the moment of cancellation can swallow it, and a loop then
    continues. Unlike the tasks, this call is interrupted when its own caller is cancelled.
    """
    pending = {task for task in tasks if not task.done()}
    while pending:
        for task in pending:
            task.cancel()
        _, pending = await asyncio.wait(pending, timeout=_PAUSE_S)


RETRY_S, MAX_RETRY_S = 0.5, 10.0
"""The shortest pause after an unexpected error; it doubles with each further one, up to the longest."""
FINISH_S = 1.0


def supervised(
    step: Callable[[], Awaitable[None]], name: str, log: Logger, failure_message: str, pause_s: float = RETRY_S
) -> asyncio.Task[None]:
    """Start a task that calls ``step`` repeatedly, ``pause_s`` after each return; ``cancel_tasks`` stops it.

    Unexpected errors are logged with ``failure_message`` as prefix. An outage of Redis is not logged here, because the
    lease renewal reports it.
    """
    return asyncio.create_task(_repeat(step, log, failure_message, pause_s), name=name)


async def _repeat(run: Callable[[], Awaitable[None]], log: Logger, failed: str, pause_s: float) -> None:
    retry_s = RETRY_S
    while True:
        rest_s = pause_s
        try:
            await run()
            retry_s = RETRY_S
        except RedisUnavailable as outage:
            log.debug("%s: %s", failed, outage)
            rest_s = max(pause_s, BACKOFF_S)
        except Exception:
            # The boundary of the task: without this it would never run again.
            log.exception("%s; it is tried again", failed)
            rest_s, retry_s = max(pause_s, retry_s), min(2 * retry_s, MAX_RETRY_S)
        await asyncio.sleep(rest_s)


async def run_last_step(step: Awaitable[object], log: Logger, failure_message: str, limit_s: float = FINISH_S) -> None:
    """Run a last step at Redis for at most ``limit_s``; log ``failure_message`` if it did not succeed."""
    try:
        async with asyncio.timeout(limit_s):
            await step
    except (RedisUnavailable, TimeoutError) as outage:
        log.info("%s: %s", failure_message, str(outage) or "no answer in time")


_T = TypeVar("_T")
SLICE_S = 0.002


async def time_sliced(items: Iterable[_T]) -> AsyncIterator[_T]:
    """Yield the items, giving other tasks a turn whenever ``SLICE_S`` has passed."""
    until_s = time.monotonic() + SLICE_S
    for item in items:
        yield item
        if time.monotonic() > until_s:
            await asyncio.sleep(0)
            until_s = time.monotonic() + SLICE_S


TURN_S = 0.004


class Turns:
    """Calls ``work`` on the event loop, in turns between which the loop serves everything else.

    ``work`` gets the time at which the turn began (``time.perf_counter``), should return within ``TURN_S``, and returns
    True if it has more to do. It is a callback rather than a task, because most turns take less time than a task.
    """

    def __init__(self, work: Callable[[float], bool]) -> None:
        self._work = work
        self._due = False

    def schedule(self) -> None:
        """Take a turn in the next iteration of the event loop; repeated calls before it make one turn."""
        if not self._due:
            self._due = True
            asyncio.get_running_loop().call_soon(self._take)

    def waker(self) -> Callable[[], object]:
        """Return a function by which any thread makes the running event loop take a turn."""
        return partial(asyncio.get_running_loop().call_soon_threadsafe, self._wake, context=copy_context())

    def _wake(self) -> None:
        """Take a turn now, unless one is due: each further one would go on beside it until all is done."""
        if not self._due:
            self._due = True
            self._take()

    def _take(self) -> None:
        """Take a turn, and further ones soon until there is nothing more to do."""
        more = True
        try:
            more = self._work(time.perf_counter())
        finally:
            self._due = False
            if more:
                self.schedule()
