"""The people who are here: those whose pages follow something, or have just been read, at any gateway."""

import logging
import time
from asyncio import Task
from collections import Counter
from collections.abc import Callable, Mapping
from contextlib import suppress
from typing import Self

from msgspec import Struct

from linked_fleet_gateway.api import Core, RedisUnavailable, RequestEvent, cancel_tasks, supervised

log = logging.getLogger(__name__)
LOOK_S, BEAT_S, SILENT_S = 2.0, 15.0, 50.0
"""Periods of looks and of beats of a gateway, and the silence after which it counts as gone."""
STAY_S = 20.0
"""Time for which somebody stays after the last sign of a page, such as between two pages."""
MOST = 200
"""People whom one gateway tells of."""


class Here(Struct, frozen=True):
    """Those who are at one gateway: since when, in wall nanoseconds, by name. ``beats`` counts that it is alive."""

    since_ns: dict[str, int]
    beats: int = 0


class Presence:
    """An async context manager. ``seen`` returns when a session of somebody was used (monotonic), by name."""

    def __init__(self, core: Core, seen: Callable[[], Mapping[str, float]], changed: Callable[[], None]) -> None:
        self._core, self._seen, self._changed = core, seen, changed
        self._open: Counter[str] = Counter()
        self._left_s: dict[str, float] = {}
        self._since_ns: dict[str, int] = {}
        self._heard_s: dict[str, float] = {}
        self._beat_s = float("-inf")
        self._table = core.table("here", Here, self._hear)
        self._tasks: list[Task[None]] = []

    async def __aenter__(self) -> Self:
        await self._table.__aenter__()
        self._tasks = [supervised(self._look, "who is here", log, "others do not know who is here", LOOK_S)]
        return self

    async def __aexit__(self, *_: object) -> None:
        await cancel_tasks(self._tasks)
        with suppress(RedisUnavailable):
            await self._table.change(self._core.run, None)
        await self._table.__aexit__(None, None, None)

    @property
    def people(self) -> dict[str, int]:
        """Those who are here at any gateway, with the time since which they are."""
        now_s, found = time.monotonic(), dict[str, int]()
        for run, each in self._table.known.items():
            if run == self._core.run or now_s - self._heard_s.get(run, now_s) < SILENT_S:
                for name, since_ns in each.since_ns.items():
                    found[name] = min(since_ns, found.get(name, since_ns))
        return found

    def hear(self, event: RequestEvent) -> None:
        """Count the streams that pages have open."""
        if not event.by_page:
            return
        if event.event == "subscribe":
            self._open[event.client] += 1
        elif event.event == "unsubscribe" and self._open[event.client] > 0:
            self._open[event.client] -= 1
            self._left_s[event.client] = time.monotonic()

    def _hear(self, run: str, before: Here | None, after: Here | None) -> None:
        if after is None:
            self._heard_s.pop(run, None)
        else:
            self._heard_s[run] = time.monotonic()
        if (before and before.since_ns) != (after and after.since_ns):
            self._changed()

    async def _look(self) -> None:
        now_s = time.monotonic()
        recent = {**self._left_s, **self._seen()}
        self._left_s = {name: at_s for name, at_s in self._left_s.items() if now_s - at_s < STAY_S}
        self._open = +self._open
        names = sorted({*self._open, *(name for name, at_s in recent.items() if now_s - at_s < STAY_S)})[:MOST]
        since_ns = {name: self._since_ns.get(name, time.time_ns()) for name in names}
        if since_ns != self._since_ns or now_s - self._beat_s >= BEAT_S:
            self._since_ns, self._beat_s = since_ns, now_s
            known = self._table.known.get(self._core.run)
            await self._table.change(self._core.run, Here(since_ns, 0 if known is None else known.beats + 1))
        for run, heard_s in list(self._heard_s.items()):
            if now_s - heard_s > SILENT_S and run != self._core.run:
                await self._table.change(run, None)
