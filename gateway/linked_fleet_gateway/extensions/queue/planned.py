"""The service for other extensions that ask about orders and schedules: whose they are, and the starts to come."""

import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from datetime import datetime
from heapq import heapify, heappop, heapreplace

from linked_fleet_gateway.extensions.queue.needs import Needs
from linked_fleet_gateway.extensions.queue.order import Order
from linked_fleet_gateway.extensions.queue.schedule import Schedule
from linked_fleet_gateway.extensions.queue.schedules import as_order
from linked_fleet_gateway.extensions.queue.timetable import recurrence_of
from linked_fleet_gateway.faces import View

Start = tuple[int, str]
"""A start of a schedule: wall nanoseconds, and the id of the schedule."""


@dataclass(frozen=True)
class PlannedWork:
    """The orders and schedules of a fleet, by id."""

    orders: Mapping[str, Order]
    schedules: Mapping[str, Schedule]
    needs: Needs

    def robots_of(self, order: Order) -> tuple[str, ...]:
        """Return the robots of an order: those that it has, or names while no choice is open."""
        if order.robots or order.wanted.choice is not None:
            return order.robots
        return tuple(sorted(self.needs.robots_of(order)))

    def order_of(self, schedule: Schedule) -> Order:
        """Return the order of a schedule, as it would be put into the queue."""
        return as_order(schedule)

    def shows(self, order: Order, sees: View) -> bool:
        """Return True if those who see these robots may know of an order."""
        return self.needs.shows(order, sees)


def starts_between(
    schedules: Mapping[str, Schedule], from_ns: int, until_ns: int, most: int, most_s: float
) -> tuple[list[Start], int]:
    """Return the first ``most`` starts of schedules in a span, and the time before which these are all.

    It takes ``most_s`` and half a second at most, for a thread.
    """
    coming = [
        (each.next_ns, id, _following(each)) for id, each in schedules.items() if each.planned.active and each.next
    ]
    heapify(coming)
    found, stop_s = list[Start](), time.monotonic() + most_s
    while coming and (at_ns := coming[0][0]) < until_ns:
        if len(found) >= most or time.monotonic() >= stop_s:
            return found, at_ns
        _, id, following = coming[0]
        if at_ns >= from_ns:
            found.append((at_ns, id))
        after_ns = next(following, None)
        if after_ns is None:
            heappop(coming)
        else:
            heapreplace(coming, (after_ns, id, following))
    return found, until_ns


def _following(schedule: Schedule) -> Iterator[int]:
    """Yield the starts of a schedule after its next one. Each may take half a second."""
    recurrence, done = recurrence_of(schedule.planned), schedule.done + 1
    for local in recurrence.after(datetime.fromisoformat(schedule.next)):
        if recurrence.count and done >= recurrence.count:
            return
        yield recurrence.instant_ns(local)
        done += 1
