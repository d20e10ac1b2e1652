"""Which gateway writes faults: of those that are alive, the one whose run has the lowest name.

Each gateway counts a beat in a table that all share. Times are those at which this gateway has heard of a beat, so that
clocks need not agree.
"""

import logging
import time
from asyncio import Task
from contextlib import suppress

from msgspec import Struct

from linked_fleet_gateway.api import Core, RedisUnavailable, cancel_tasks, supervised

log = logging.getLogger(__name__)

BEAT_S, SILENT_S, FORGOTTEN_S = 2.0, 8.0, 60.0


class Beat(Struct, frozen=True):
    """Number of times that a gateway has counted."""

    count: int


class Gateways:
    """The gateways of the fleet; an async context manager."""

    def __init__(self, core: Core) -> None:
        self._run = core.run
        self._heard_s: dict[str, float] = {}
        self._table = core.table("fault-gateways", Beat, self._hear)
        self._count = 0
        self._tasks: list[Task[None]] = []

    async def __aenter__(self) -> "Gateways":
        await self._table.__aenter__()
        failed = "other gateways do not know that this one is alive"
        self._tasks = [supervised(self._beat, "beats of gateways", log, failed, BEAT_S)]
        return self

    async def __aexit__(self, *_: object) -> None:
        await cancel_tasks(self._tasks)
        with suppress(RedisUnavailable):
            await self._table.change(self._run, None)
        await self._table.__aexit__(None, None, None)

    @property
    def leads(self) -> bool:
        """True if this gateway writes faults."""
        now_s = time.monotonic()
        return not any(run < self._run and now_s - heard_s < SILENT_S for run, heard_s in self._heard_s.items())

    def _hear(self, run: str, before: Beat | None, after: Beat | None) -> None:
        if after is None:
            self._heard_s.pop(run, None)
        elif run != self._run:
            self._heard_s[run] = time.monotonic()

    async def _beat(self) -> None:
        self._count += 1
        await self._table.change(self._run, Beat(self._count))
        for run, heard_s in list(self._heard_s.items()):
            if time.monotonic() - heard_s > FORGOTTEN_S:
                await self._table.change(run, None)
