"""Schedules: orders that are put into the queue at the times of a rule. Pure values."""

from collections.abc import Sequence
from typing import Annotated

from msgspec import Meta, Struct
from msgspec.structs import replace

from linked_fleet_gateway.extensions.missions.record import Creator
from linked_fleet_gateway.extensions.queue.order import Wanted

KEPT = 20
"""Missed starts that a schedule shows, the latest."""
_DAY_S = 86_400


class Planned(Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True):
    """The statements of a client. Its order may begin ``within`` so many seconds after a start; 0 for no end."""

    order: Wanted
    rule: Annotated[str, Meta(min_length=1, max_length=500)]
    start: Annotated[str, Meta(max_length=40)]
    timeZone: Annotated[str, Meta(min_length=1, max_length=60)]  # noqa: N815
    title: Annotated[str, Meta(max_length=200)] = ""
    within: Annotated[float, Meta(ge=0, le=30 * _DAY_S)] = 0.0
    active: bool = True


class Missed(Struct, frozen=True):
    """A start at which no order was put into the queue, in wall nanoseconds, and why not."""

    at_ns: int
    reason: str


class Schedule(Struct, frozen=True, omit_defaults=True):
    """A schedule. ``base`` begins the IRIs of its client. ``next`` is the local time of its next start, empty if there
    is none; ``done`` counts starts.
    """

    planned: Planned
    base: str = ""
    title: str = ""
    creator: Creator = Creator()
    created_ns: int = 0
    next: str = ""
    next_ns: int = 0
    done: int = 0
    last: str = ""
    """The id of the order that was put into the queue last."""
    missed: tuple[Missed, ...] = ()
    missed_count: int = 0

    @property
    def client(self) -> str:
        return self.creator.identity or self.creator.client


def with_missed(schedule: Schedule, missed: Sequence[Missed]) -> Schedule:
    """Return a schedule that has missed starts."""
    kept = (*schedule.missed, *missed)[-KEPT:]
    return replace(schedule, missed=kept, missed_count=schedule.missed_count + len(missed))
