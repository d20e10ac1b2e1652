"""``python -m fuzz.watched``: the gateway, on a loop that logs each callback of more than 25 ms of processor time.

It is ``python -m linked_fleet_gateway`` but for two things: the loop is that of asyncio, all of whose callbacks are
Python objects that can be timed, and such a callback is logged as an error.
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
"""Processor time of its thread that one callback of the event loop may use."""
STALL = "a callback of the event loop used"
log = logging.getLogger(__name__)


@contextmanager
def timed_callbacks(report: Callable[[float, Handle], None]) -> Iterator[None]:
    """Meanwhile have ``report`` called with the processor time (s) of each callback."""
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
