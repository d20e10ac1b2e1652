"""Puts the orders of schedules into the queue when their time comes (flow "schedules").

All gateways do this. The id of an order is made of schedule and start, so that there is one, whoever adds it. A start
that came while no gateway ran is recorded as missed, and not made up.
"""

import asyncio
import logging
import time
import uuid
from collections.abc import Awaitable, Callable
from datetime import UTC, datetime

from msgspec.structs import replace

from linked_fleet_gateway.api import Core, FleetError, RedisUnavailable, Table, cancel_tasks, supervised
from linked_fleet_gateway.extensions.queue.order import Order, Wanted
from linked_fleet_gateway.extensions.queue.records import OrderRecords
from linked_fleet_gateway.extensions.queue.recurrence import Recurrence
from linked_fleet_gateway.extensions.queue.schedule import Missed, Planned, Schedule, with_missed

log = logging.getLogger(__name__)
GRACE_S = 60.0
"""Time after its start for which an order is still put into the queue."""
AT_ONCE = 1000
"""Starts that are looked at in one pass."""
_LOOK_S = 1.0
_NAMESPACE = uuid.UUID("5b0d1c0e-7f0b-5c1c-9d0c-6f6b6d3f2f11")

Check = Callable[[Schedule], Awaitable[None]]


def recurrence_of(planned: Planned) -> Recurrence:
    """Return the recurrence of a schedule. Raises UnprocessableContent."""
    return Recurrence(planned.rule, planned.start, planned.timeZone)


def first_start(schedule: Schedule, now_ns: int) -> Schedule | None:
    """Return a schedule with its first start that is not past; None if its rule has more past starts than may be.

    It may take a second.
    """
    recurrence, done = recurrence_of(schedule.planned), 0
    for local in recurrence.after(None):
        if recurrence.count and done >= recurrence.count:
            break
        if (at_ns := recurrence.instant_ns(local)) >= now_ns:
            return replace(schedule, next=local.isoformat(), next_ns=at_ns, done=done)
        done += 1
        if done > AT_ONCE:
            return None
    return replace(schedule, next="", next_ns=0, done=done)


def advanced(schedule: Schedule, now_ns: int) -> tuple[Schedule, list[int]]:
    """Return a schedule with the next start after those that are due, and these in wall nanoseconds.

    It may take half a second.
    """
    recurrence, due = recurrence_of(schedule.planned), list[int]()
    starts = recurrence.after(datetime.fromisoformat(schedule.next))
    local: datetime | None = datetime.fromisoformat(schedule.next)
    at_ns, done = schedule.next_ns, schedule.done
    while local is not None and at_ns <= now_ns and len(due) < AT_ONCE:
        due.append(at_ns)
        done += 1
        local = None if recurrence.count and done >= recurrence.count else next(starts, None)
        at_ns = 0 if local is None else recurrence.instant_ns(local)
    after = "" if local is None else local.isoformat()
    return replace(schedule, next=after, next_ns=at_ns, done=done), due


def order_id(schedule: str, at_ns: int) -> str:
    """Return the id of the order of a start."""
    return str(uuid.uuid5(_NAMESPACE, f"{schedule} {at_ns}"))


class Timetable:
    """Puts orders into the queue at the times of schedules; an async context manager."""

    def __init__(self, core: Core, schedules: Table[Schedule], orders: OrderRecords, check: Check) -> None:
        self._core, self._schedules, self._orders, self._check = core, schedules, orders, check
        self._tasks: list[asyncio.Task[None]] = []

    async def __aenter__(self) -> "Timetable":
        self._tasks = [supervised(self._look, "schedules", log, "schedules put no orders into the queue", _LOOK_S)]
        return self

    async def __aexit__(self, *_: object) -> None:
        await cancel_tasks(self._tasks)

    async def _look(self) -> None:
        now_ns = time.time_ns()
        for id, schedule in list(self._schedules.known.items()):
            if schedule.planned.active and schedule.next and schedule.next_ns <= now_ns:
                await self._start(id, schedule, now_ns)

    async def _start(self, id: str, schedule: Schedule, now_ns: int) -> None:
        """Put the orders of the starts that are due into the queue. Raises RedisUnavailable."""
        after, due = await asyncio.to_thread(advanced, schedule, now_ns)
        missed = list[Missed]()
        for at_ns in due:
            if now_ns - at_ns > GRACE_S * 1e9:
                missed.append(Missed(at_ns, "no gateway was there to put its order into the queue"))
                continue
            try:
                await self._add(id, schedule, at_ns)
            except RedisUnavailable:
                raise
            except FleetError as error:
                missed.append(Missed(at_ns, error.detail))
            else:
                after = replace(after, last=order_id(id, at_ns))
        if not await self._schedules.change(id, with_missed(after, missed) if missed else after):
            log.debug("another gateway has gone on with the schedule %s", id)

    async def _add(self, id: str, schedule: Schedule, at_ns: int) -> None:
        """Put the order of a start into the queue, unless it is there. Raises FleetError."""
        own = order_id(id, at_ns)
        if own in self._orders.known:
            return
        await self._check(schedule)
        wanted, path = _wanted(schedule.planned, at_ns), f"/schedules/{id}"
        order = self._orders.new(Order(wanted, base=schedule.base, creator=schedule.creator, schedule=path))
        await self._orders.table.change(own, order)  # False: another gateway was faster


def _wanted(planned: Planned, at_ns: int) -> Wanted:
    wanted = planned.order
    title = wanted.title or planned.title
    if not planned.within:
        return replace(wanted, title=title)
    deadline = datetime.fromtimestamp(at_ns / 1e9 + planned.within, UTC).isoformat()
    return replace(wanted, title=title, deadline=deadline)
