"""Collects what a caller may see in a window, in steps between which other tasks get turns."""

import asyncio
from collections.abc import AsyncIterator, Iterator
from dataclasses import dataclass, field
from itertools import chain

from msgspec import Struct

from linked_fleet_gateway.api import RequestView, time_sliced
from linked_fleet_gateway.extensions.faults.extension import KnownFaults
from linked_fleet_gateway.extensions.missions.extension import RunsOfMissions
from linked_fleet_gateway.extensions.missions.record import Run
from linked_fleet_gateway.extensions.notes.extension import KnownNotes
from linked_fleet_gateway.extensions.queue.planned import PlannedWork, starts_between
from linked_fleet_gateway.extensions.queue.schedule import Schedule
from linked_fleet_gateway.extensions.timeline import sources
from linked_fleet_gateway.extensions.timeline.activity import Activity, Newest
from linked_fleet_gateway.extensions.timeline.window import Window

MOST_STARTS = 500
_MOST_STARTS_S = 0.5
"""Seconds in which starts of schedules are computed; a rule may take half a second for one."""


class Chronicle(Struct, frozen=True):
    """Activities in a window at ``now_ns``: all that began from ``complete_ns`` on, planned until ``planned_ns``."""

    window: Window
    now_ns: int
    activities: list[Activity]
    left_out: int = 0
    complete_ns: int = 0
    planned_ns: int = 0


@dataclass(frozen=True)
class Collector:
    """The services of other extensions, as far as these are on."""

    runs: RunsOfMissions | None = None
    faults: KnownFaults | None = None
    work: PlannedWork | None = None
    notes: KnownNotes | None = None
    computing: asyncio.Semaphore = field(default_factory=lambda: asyncio.Semaphore(1))
    """Held while starts are computed: one thread at a time does so."""

    async def collect(self, view: RequestView, window: Window, now_ns: int) -> Chronicle:
        """Return what a caller may see in a window."""
        newest = Newest()
        starts, planned_ns = await self._starts(view, window)
        async for each in self._activities(view, window):
            if each.is_in(window, now_ns):
                newest.add(each)
        for each in starts:
            newest.add(each)
        complete_ns = window.from_ns if newest.complete_ns is None else newest.complete_ns
        return Chronicle(window, now_ns, newest.in_order(), newest.left_out, complete_ns, planned_ns)

    async def _activities(self, view: RequestView, window: Window) -> AsyncIterator[Activity]:
        """Yield all activities but starts to come. Few of them were over before the window."""
        runs = await self._visible_runs(view)
        for id, (run, about) in runs.items():
            yield sources.of_run(id, run, about)
        async for robot in time_sliced((sources.FLEET, *view.robots)):
            async for invocation in time_sliced(view.invocations.of_robot(robot)):
                if invocation.id not in runs and not sources.ended_before(invocation, window.from_ns):
                    yield sources.of_invocation(view, invocation)
        async for each in time_sliced(chain(self._faults(view), self._notes(view), self._orders(view))):
            if each is not None:
                yield each

    async def _visible_runs(self, view: RequestView) -> dict[str, tuple[Run, tuple[str, ...]]]:
        """Return the runs of which a caller may know, each with the robots that it names."""
        found = dict[str, tuple[Run, tuple[str, ...]]]()
        async for id, run in time_sliced([] if self.runs is None else list(self.runs.known.items())):
            about = None if self.runs is None else self.runs.about(id)
            if about is not None and all(map(view.visible_robots.includes, about[1])):
                found[id] = run, about[1]
        return found

    def _faults(self, view: RequestView) -> Iterator[Activity]:
        known = [] if self.faults is None else self.faults.seen_by(view.visible_robots)
        return (sources.of_fault(id, fault) for id, fault in known)

    def _notes(self, view: RequestView) -> Iterator[Activity]:
        known = [] if self.notes is None else self.notes.seen_by(view.visible_robots)
        return (sources.of_note(id, note) for id, note in known)

    def _orders(self, view: RequestView) -> Iterator[Activity | None]:
        """Yield the orders that wait, and those that were over before a run of a mission began; None for others."""
        for id, order in [] if self.work is None else list(self.work.orders.items()):
            shown = self.work is not None and not order.run and self.work.shows(order, view.visible_robots)
            yield sources.of_order(id, order, self.work.robots_of(order)) if shown and self.work else None

    async def _starts(self, view: RequestView, window: Window) -> tuple[list[Activity], int]:
        """Return the starts of schedules in a window, and the time until which these are all."""
        shown = await self._schedules(view, window)
        if not shown:
            return [], window.until_ns
        known, span = {id: each for id, (each, _) in shown.items()}, (window.from_ns, window.until_ns)
        async with self.computing:
            found, until_ns = await asyncio.to_thread(starts_between, known, *span, MOST_STARTS, _MOST_STARTS_S)
        return [sources.of_start(id, known[id], at_ns, shown[id][1]) for at_ns, id in found], until_ns

    async def _schedules(self, view: RequestView, window: Window) -> dict[str, tuple[Schedule, tuple[str, ...]]]:
        """Return the schedules of which a caller may know and that start in a window, each with its robots."""
        found = dict[str, tuple[Schedule, tuple[str, ...]]]()
        if (work := self.work) is None:
            return found
        async for id, schedule in time_sliced(list(work.schedules.items())):
            if schedule.planned.active and schedule.next and schedule.next_ns < window.until_ns:
                order = work.order_of(schedule)
                robots = work.robots_of(order) if work.shows(order, view.visible_robots) else None
                if robots is not None and (not window.robot or window.robot in robots):
                    found[id] = schedule, robots
        return found
