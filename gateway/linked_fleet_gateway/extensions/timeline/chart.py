"""The chart of a timeline: where bars are, which of them are beside each other, and the times on top. Pure.

Lengths are in units of the chart, which is ``WIDTH`` wide.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from datetime import UTC, datetime

WIDTH = 1000
LANE = 26
MOST_LANES = 10
"""Lanes of a row; what does not fit is in the last one, over others."""
_LEAST_BAR = 10
_MOST_TICKS = 8
_STEPS_S = (1, 2, 5, 10, 30, 60, 120, 300, 600, 1800, 3600, 7200, 10_800, 21_600, 43_200, 86_400)
_DAY_S = 86_400


@dataclass(frozen=True)
class Scale:
    """The times of a chart, in seconds since 1970."""

    begin_s: float
    end_s: float

    def at(self, time_s: float) -> float:
        """Return the place of a time, at most at an end of the chart."""
        share = (time_s - self.begin_s) / (self.end_s - self.begin_s)
        return round(WIDTH * min(max(share, 0.0), 1.0), 1)

    def extent(self, begin_s: float, end_s: float) -> tuple[float, float]:
        """Return place and width of a bar, which is wide enough to be hit."""
        begin, end = self.at(begin_s), self.at(end_s)
        width = max(end - begin, _LEAST_BAR)
        return round(min(begin, WIDTH - width), 1), round(width, 1)


@dataclass(frozen=True)
class Tick:
    """A time on top of a chart. ``day`` is the date, if it is the first one of a day or of the chart."""

    x: float
    text: str
    day: str


def ticks(scale: Scale) -> list[Tick]:
    """Return the times on top of a chart: whole ones in UTC, at most 8."""
    length_s = scale.end_s - scale.begin_s
    step_s = next((each for each in _STEPS_S if length_s / each <= _MOST_TICKS), _DAY_S)
    first_s = -int(-scale.begin_s // step_s) * step_s
    times = [first_s + step_s * n for n in range(_MOST_TICKS + 1) if first_s + step_s * n < scale.end_s]
    found, before = list[Tick](), ""
    for each in times:
        instant = datetime.fromtimestamp(each, UTC)
        day = f"{instant:%Y-%m-%d}"
        text = f"{instant:%H:%M:%S}" if step_s < 60 else f"{instant:%H:%M}"
        found.append(Tick(scale.at(each), text, day if day != before else ""))
        before = day
    return found


def room_of(text: str) -> float:
    """Return the width of a text with its sign, at most that of 30 characters."""
    return 30.0 + 7.0 * min(len(text), 30)


def lanes(extents: Iterable[tuple[float, float]]) -> list[int]:
    """Return the lanes of bars, in the order of their beginnings: none is over another while there is room."""
    ends, found = list[float](), list[int]()
    for x, width in extents:
        lane = next((n for n, end in enumerate(ends) if end <= x), len(ends))
        lane = min(lane, MOST_LANES - 1)
        if lane == len(ends):
            ends.append(0.0)
        ends[lane] = max(ends[lane], x + width)
        found.append(lane)
    return found
