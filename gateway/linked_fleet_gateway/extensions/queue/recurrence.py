"""Recurrence rules of iCalendar (RFC 5545, 3.3.10) in the local time of a time zone. Pure.

The rule is evaluated by dateutil on local times. A local time that a change of the clock leaves out is taken by the
offset before it, and one that comes twice the first time (RFC 5545, 3.3.5).

dateutil looks for the next occurrence up to the year 9999. As the calendar repeats every 400 years, a rule is evaluated
that many years later, so that a rule that has no occurrence is known to have none after at most half a second.
"""

import re
from collections.abc import Iterator
from datetime import UTC, datetime, timedelta
from zoneinfo import ZoneInfo

from dateutil.rrule import rrulestr

from linked_fleet_gateway.api import UnprocessableContent

MOST_TEXT = 500
_CYCLE = 400
_LAST_YEAR = 9999 - 28  # rules such as 29 February on a Monday recur within 28 years
_FREQUENCIES = ("DAILY", "WEEKLY", "MONTHLY", "YEARLY")
_PART = re.compile(r"([A-Z]+)=([A-Z0-9,+-]+)")
_PARTS = (
    "FREQ", "INTERVAL", "COUNT", "UNTIL", "BYMONTH", "BYWEEKNO", "BYYEARDAY", "BYMONTHDAY", "BYDAY", "BYHOUR",
    "BYMINUTE", "BYSETPOS", "WKST",
)  # fmt: skip
_BOUNDS = {
    "BYMONTH": (1, 12), "BYWEEKNO": (-53, 53), "BYYEARDAY": (-366, 366), "BYMONTHDAY": (-31, 31), "BYHOUR": (0, 23),
    "BYMINUTE": (0, 59), "BYSETPOS": (-366, 366),
}  # fmt: skip
_MOST_OF_A_PART = 60
_UNTIL = re.compile(r"(\d{8})(T\d{6})?(Z)?")


class Recurrence:
    """A rule with its first local time and its time zone. Raises UnprocessableContent."""

    def __init__(self, rule: str, start: str, zone: str) -> None:
        self.zone, self._start = _zone(zone), _local(start)
        self._parts = _read(rule)
        self.count = int(self._parts.pop("COUNT", "0"))
        """The number of its occurrences; 0 if there is no such end."""
        until = self._parts.pop("UNTIL", "")
        self._until = _until(until, self.zone) if until else None
        self._rule = ";".join(f"{name}={value}" for name, value in self._parts.items())
        self._check()

    def after(self, last: datetime | None) -> Iterator[datetime]:
        """Yield the local times of occurrences after ``last``, which is one itself; all of them for None.

        One may take half a second. The caller limits their number.
        """
        begin = last or self._start
        moved = _CYCLE * ((_LAST_YEAR - begin.year) // _CYCLE)
        for later in rrulestr(self._rule, dtstart=begin.replace(year=begin.year + moved)):
            found: datetime = later.replace(year=later.year - moved)
            if self._until is not None and found > self._until:
                return
            if last is None or found > last:
                yield found

    def instant_ns(self, local: datetime) -> int:
        """Return the instant of a local time in wall nanoseconds."""
        since = local.replace(tzinfo=self.zone).astimezone(UTC) - datetime(1970, 1, 1, tzinfo=UTC)
        return since // timedelta(microseconds=1) * 1000

    def _check(self) -> None:
        try:
            rrulestr(self._rule, dtstart=self._start)
        except (ValueError, TypeError, AttributeError, IndexError, OverflowError) as error:
            raise UnprocessableContent(f"The rule {self._rule} is no RRULE: {error}.") from error


def _read(rule: str) -> dict[str, str]:
    """Return the parts of a rule. Raises UnprocessableContent."""
    parts = dict[str, str]()
    for each in rule.removeprefix("RRULE:").split(";"):
        match = _PART.fullmatch(each)
        if len(rule) > MOST_TEXT or match is None or match[1] in parts or match[1] not in _PARTS:
            raise UnprocessableContent(
                f"{each[:60]!r} is no part of a rule, of which there are {', '.join(_PARTS)}, each once, such as"
                " FREQ=WEEKLY;BYDAY=MO,FR;BYHOUR=9;BYMINUTE=30."
            )
        parts[match[1]] = match[2]
        if match[2].count(",") >= _MOST_OF_A_PART:
            raise UnprocessableContent(f"{match[1]} has at most {_MOST_OF_A_PART} values.")
    if parts.get("FREQ") not in _FREQUENCIES:
        raise UnprocessableContent(
            f"FREQ is one of {', '.join(_FREQUENCIES)}. What recurs within a day has BYHOUR and BYMINUTE:"
            " FREQ=DAILY;BYHOUR=8,9,10;BYMINUTE=0,30."
        )
    for name, bounds in _BOUNDS.items():
        _check_numbers(name, parts.get(name, ""), *bounds)
    if parts["FREQ"] in ("DAILY", "WEEKLY") and any(each.isdecimal() for each in parts.get("BYDAY", "")):
        raise UnprocessableContent("Days such as -1FR are of the frequencies MONTHLY and YEARLY alone.")
    _whole(parts, "INTERVAL", 1000)
    _whole(parts, "COUNT", 100_000)
    return parts


def _check_numbers(name: str, text: str, low: int, high: int) -> None:
    values = text.split(",") if text else []
    good = (re.fullmatch(r"[+-]?\d{1,3}", each) and low <= int(each) <= high for each in values)
    if not all(good) or (low < 0 and any(int(each) == 0 for each in values)):
        raise UnprocessableContent(f"{name} is from {low} to {high}{', but not 0' if low < 0 else ''}.")


def _whole(parts: dict[str, str], name: str, most: int) -> None:
    text = parts.get(name, "1")
    if not text.isdecimal() or not 1 <= int(text[:9]) <= most:
        raise UnprocessableContent(f"{name} is a whole number from 1 to {most}.")


def _zone(name: str) -> ZoneInfo:
    try:
        return ZoneInfo(name)
    except (KeyError, ValueError, OSError) as error:  # what ZoneInfo raises for names of all kinds
        raise UnprocessableContent(f"{name[:60]!r} is no time zone such as Europe/Berlin or UTC.") from error


def _local(text: str) -> datetime:
    try:
        found = datetime.fromisoformat(text)
    except ValueError as error:
        raise UnprocessableContent(
            f"The start is a local time such as 2026-12-01T09:00:00, not {text[:40]!r}."
        ) from error
    if found.tzinfo is not None:
        raise UnprocessableContent("The start is a local time without offset; the time zone is stated by itself.")
    if not 1970 <= found.year <= 2200:
        raise UnprocessableContent("The start is in the years 1970 to 2200.")
    return found.replace(microsecond=0)


def _until(text: str, zone: ZoneInfo) -> datetime:
    """Return the last local time of a rule."""
    match = _UNTIL.fullmatch(text)
    try:
        if match is None:
            raise ValueError("it is a date or a time")
        last = datetime.strptime(match[1] + (match[2] or "T235959"), "%Y%m%dT%H%M%S")
    except ValueError as error:
        raise UnprocessableContent("UNTIL is a date or a time, such as 20271231 or 20271231T220000Z.") from error
    if match[3] is None:
        return last
    return last.replace(tzinfo=UTC).astimezone(zone).replace(tzinfo=None)
