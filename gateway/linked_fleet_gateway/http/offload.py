"""Work in a thread: parsing and validation of long bodies, and writing of long ones, so that none delays a stop."""

import asyncio
from collections.abc import Callable
from typing import TypeVar

from linked_fleet_gateway.base.errors import Busy

SHORT_BYTES = 1024
"""Bodies up to this length are processed on the event loop, in a few milliseconds at most."""
MOST_WAITING = 64
T = TypeVar("T")


class Offload:
    """One thread at a time, because the interpreter runs only one, and more would compete with the event loop."""

    def __init__(self, most_waiting: int = MOST_WAITING) -> None:
        self._most_waiting = most_waiting
        self._place = asyncio.Semaphore(1)
        self._waiting = 0

    async def run(self, work: Callable[[], T], size: int, short: int = SHORT_BYTES) -> T:
        """Run ``work`` on this many bytes, directly if they are few. Raises Busy if too many calls wait.

        ``work`` must not use anything that the event loop changes.
        """
        if size <= short:
            return work()
        if self._waiting >= self._most_waiting:
            raise Busy(f"{self._most_waiting} long bodies are being read; ask again.")
        self._waiting += 1
        try:
            async with self._place:
                return await asyncio.to_thread(work)
        finally:
            self._waiting -= 1
