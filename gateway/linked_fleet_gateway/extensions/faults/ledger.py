"""The faults of the fleet: what this gateway sees, written to the records that all gateways share.

One gateway writes at a time. What changes a fault for people is written within a round; counts and words wait, so that
thousands of flaps cost a write every few seconds.
"""

import logging
import time
from collections.abc import Callable, Iterator, Mapping

from linked_fleet_base.errors import ContainerFull
from linked_fleet_gateway.api import NotFound, Table
from linked_fleet_gateway.extensions.faults.fault import Fault, Sight, Trouble, observe, over
from linked_fleet_gateway.extensions.faults.signals import Signals

log = logging.getLogger(__name__)

ROUND_S = 0.5
COUNTS_S = 5.0
"""Least time between two writes of a fault of which only counts and words have changed."""
MOST_WRITES = 50
"""Writes of one round; the others wait for the next one."""
FULL_S = 60.0
"""Time between two lines of the log about faults that find no room."""
Change = Callable[[Fault], Fault]
Write = tuple[str, Fault | None]


class Ledger:
    """Writes faults. ``leads`` tells whether this gateway does, ``judges`` whether it can tell that one is over."""

    def __init__(
        self,
        records: Table[Fault],
        signals: Signals,
        leads: Callable[[], bool],
        judges: Callable[[Trouble], bool],
        kept_s: float,
        most: int,
    ) -> None:
        self._records, self._signals, self._leads, self._judges = records, signals, leads, judges
        self._kept_ns, self._most_cleared = int(kept_s * 1e9), most * 3 // 4
        self._written_ns: dict[str, int] = {}
        self._full_ns = 0
        self.full = 0
        """Faults that could not be recorded because there was no room."""

    @property
    def known(self) -> Mapping[str, Fault]:
        return self._records.known

    async def round(self) -> None:
        """Write what has changed. Raises RedisUnavailable; the next round then writes it."""
        now_ns = time.time_ns()
        sights = dict(self._signals.sights(now_ns))
        self._signals.forget_old_events(now_ns)
        if not self._leads():
            return
        news, counts = self._news(sights, now_ns)
        wanted = [*news, *self._ended(now_ns), *self._old(now_ns), *counts]
        for id, fault in wanted[:MOST_WRITES]:
            await self._write(id, fault, sights.get(id), now_ns)

    def _news(self, sights: Mapping[str, Sight], now_ns: int) -> tuple[list[Write], list[Write]]:
        """Return what people must hear of at once, and the counts that are due."""
        news, counts = list[Write](), list[Write]()
        for id, sight in sights.items():
            before = self.known.get(id)
            after = observe(before, sight, now_ns)
            if after == before:
                self._signals.written(id, sight)
            elif _differ(before, after):
                news.append((id, after))
            elif now_ns - self._written_ns.get(id, 0) > COUNTS_S * 1e9:
                counts.append((id, after))
        return news, counts

    def _ended(self, now_ns: int) -> Iterator[Write]:
        """Yield open faults whose trouble nobody sees, such as those of a gateway that has died."""
        for id, fault in list(self.known.items()):
            if fault.is_open and fault.present and not self._signals.has(id) and self._judges(fault.trouble):
                yield id, over(fault, now_ns)

    def _old(self, now_ns: int) -> Iterator[Write]:
        cleared = sorted((fault.cleared_ns, id) for id, fault in self.known.items() if not fault.is_open)
        for place, (cleared_ns, id) in enumerate(reversed(cleared)):
            if place >= self._most_cleared or now_ns - cleared_ns > self._kept_ns:
                yield id, None

    async def _write(self, id: str, fault: Fault | None, sight: Sight | None, now_ns: int) -> None:
        try:
            done = await self._records.change(id, fault)
        except ContainerFull as error:
            self.full += 1
            if now_ns - self._full_ns > FULL_S * 1e9:
                self._full_ns = now_ns
                log.warning("faults are not recorded, such as one of %s: %s", fault and fault.trouble.place, error)
            return
        if not done:
            return
        self._written_ns[id] = now_ns
        if fault is None:
            del self._written_ns[id]
        if sight is not None:
            self._signals.written(id, sight)

    async def change(self, id: str, change: Change) -> Fault:
        """Change a fault for a person. Raises NotFound, RedisUnavailable, and the errors of ``change``."""
        if (fault := await self._records.update(id, change)) is None:
            raise NotFound("The fault has been deleted.")
        return fault

    async def record(self, trouble: Trouble, event: str) -> Fault:
        """Record an event that somebody tells of, at once. Raises RedisUnavailable, ContainerFull."""
        while True:
            now_ns, before = time.time_ns(), self.known.get(trouble.id)
            sight = Sight(trouble, "confirmed", False, now_ns, now_ns, 1, (event,))
            after = observe(before, sight, now_ns)
            assert after is not None
            if after == before or await self._records.change(trouble.id, after):
                return after


def _differ(before: Fault | None, after: Fault | None) -> bool:
    """Return True if people must hear of a change at once."""
    if before is None or after is None:
        return True
    told, now = before.trouble, after.trouble
    return (before.state, before.present, told.severity) != (after.state, after.present, now.severity)
