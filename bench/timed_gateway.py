"""``python -m bench.timed_gateway``: a gateway that prints its longest callback since the last SIGUSR1, in ms.

It is the thread's processor time. The event loop is that of asyncio, whose callbacks can be timed, instead of uvloop.
"""

import asyncio
import signal
import sys
import time
from asyncio.events import Handle

import uvloop

from linked_fleet_gateway.__main__ import main

SAID = "longest callback, ms:"


class Longest:
    """Times each callback of the event loop."""

    def __init__(self) -> None:
        self._used_s, self._run = 0.0, Handle._run

    def run(self, callback: Handle) -> None:
        begun_s = time.thread_time()
        self._run(callback)
        self._used_s = max(self._used_s, time.thread_time() - begun_s)

    def say(self, *_: object) -> None:
        print(SAID, f"{self._used_s * 1e3:.3f}", flush=True)
        self._used_s = 0.0


if __name__ == "__main__":
    longest = Longest()
    signal.signal(signal.SIGUSR1, longest.say)
    Handle._run = lambda callback: longest.run(callback)  # type: ignore[method-assign]
    uvloop.run = asyncio.run
    sys.exit(main())
