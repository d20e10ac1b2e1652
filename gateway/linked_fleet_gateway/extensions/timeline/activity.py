"""Activities: what somebody or something did, does or is to do, and a bounded choice of them. Pure values.

Times are wall nanoseconds.
"""

from heapq import heappush, heappushpop
from typing import Literal

from msgspec import Struct

from linked_fleet_gateway.extensions.timeline.window import Window

Kind = Literal["action", "mission", "fault", "order", "schedule", "note"]
MOST = 2000
"""Most activities of one timeline."""


class Activity(Struct, frozen=True):
    """An activity. ``path`` is that of the resource that it is of, ``id`` is unique in a timeline.

    ``begin_ns`` is when it began; if it is ``planned``, when it is to begin, or since when its order waits, which may
    begin until ``latest_ns``. ``end_ns`` is None while it goes on. ``robots`` are those that it is about; none for the
    fleet.
    """

    id: str
    kind: Kind
    path: str
    title: str
    state: str
    begin_ns: int
    end_ns: int | None = None
    latest_ns: int | None = None
    planned: bool = False
    who: str = ""
    robots: tuple[str, ...] = ()

    def last_ns(self, now_ns: int) -> int:
        """Return when it ended, or until when it lasts as far as one knows now."""
        return max(self.begin_ns, now_ns, self.latest_ns or 0) if self.end_ns is None else self.end_ns

    def is_in(self, window: Window, now_ns: int) -> bool:
        """Return True if it is about the robot of a window, and some of it is in its time."""
        if self.begin_ns >= window.until_ns or (window.robot and window.robot not in self.robots):
            return False
        return max(self.begin_ns, self.last_ns(now_ns)) >= window.from_ns


class Newest:
    """The ``most`` activities that began last, of any number, and how many were left out."""

    def __init__(self, most: int = MOST) -> None:
        self._most = most
        self._kept: list[tuple[int, int, Activity]] = []
        self._count = 0
        self._complete_ns: int | None = None

    def add(self, activity: Activity) -> None:
        """Add an activity; the one that began first is left out if there are too many."""
        self._count += 1
        entry = activity.begin_ns, self._count, activity
        if len(self._kept) < self._most:
            heappush(self._kept, entry)
            return
        begin_ns, _, _ = heappushpop(self._kept, entry)
        self._complete_ns = begin_ns + 1

    @property
    def left_out(self) -> int:
        return self._count - len(self._kept)

    @property
    def complete_ns(self) -> int | None:
        """Return the time from which all that began is there; None if nothing was left out."""
        return self._complete_ns

    def in_order(self) -> list[Activity]:
        """Return them in the order of their beginnings."""
        return [activity for _, _, activity in sorted(self._kept, key=lambda entry: (entry[0], entry[2].id))]
