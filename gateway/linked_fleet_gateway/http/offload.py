"""Long bodies are parsed and judged in a thread, so that no body keeps the event loop from stopping a robot."""

import asyncio
from collections.abc import Callable
from typing import TypeVar

from linked_fleet_gateway.base.errors import Busy

SHORT_BYTES = 1024
"""Bodies up to this length are read on the event loop, in at most a few milliseconds."""
MOST_WAITING = 64
T = TypeVar("T")


class Offload:
    """One thread at a time: the interpreter runs one anyway, and more would compete with the event loop."""

    def __init__(self) -> None:
        self._place = asyncio.Semaphore(1)
        self._waiting = 0

    async def run(self, work: Callable[[], T], size: int, short: int = SHORT_BYTES) -> T:
        """The result of ``work`` on so many bytes, at once if they are few; Busy where too many wait.

        ``work`` must use nothing that the event loop changes.
        """
        if size <= short:
            return work()
        if self._waiting >= MOST_WAITING:
            raise Busy(f"{MOST_WAITING} long bodies are being read; ask again.")
        self._waiting += 1
        try:
            async with self._place:
                return await asyncio.to_thread(work)
        finally:
            self._waiting -= 1
