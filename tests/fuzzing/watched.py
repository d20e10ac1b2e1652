"""``python -m fuzzing.watched``: the gateway on an event loop that logs callbacks of more than 25 ms of processor time.

It differs from ``python -m linked_fleet_gateway`` in two ways: the loop is that of asyncio, whose callbacks are Python
objects that can be timed, and slow callbacks are logged as errors.
"""

import asyncio
import logging
import sys
import time
from asyncio.events import Handle
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import uvloop

from linked_fleet_gateway.__main__ import main

MOST_S = 0.025
"""Limit of the thread's processor time for one callback of the event loop."""
STALL = "a callback of the event loop used"
log = logging.getLogger(__name__)


@contextmanager
def timed_callbacks(report: Callable[[float, Handle], None]) -> Iterator[None]:
    """In this context, call ``report`` with the processor time (s) of each callback."""
    run = Handle._run

    def timed(self: Handle) -> None:
        begun_s = time.thread_time()
        run(self)
        report(time.thread_time() - begun_s, self)

    Handle._run = timed  # type: ignore[method-assign]
    try:
        yield
    finally:
        Handle._run = run  # type: ignore[method-assign]


def _log_stall(used_s: float, callback: Handle) -> None:
    if used_s > MOST_S:
        log.error("%s %.1f ms of processor time: %s", STALL, used_s * 1000, callback)


if __name__ == "__main__":
    uvloop.run = asyncio.run
    with timed_callbacks(_log_stall):
        sys.exit(main())
