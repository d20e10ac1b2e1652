"""The part of a history that a request selects: its query, parsed and written."""

import re
from collections.abc import Iterable
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from urllib.parse import quote

from linked_fleet_base.errors import BadRequest

MOST = 1000
"""Most observations in one response; files have more."""
_NEWEST = 10
"""Observations in a response to a query without a time."""
_SECOND_NS = 1_000_000_000
_MOST_SPACING_NS = 10**6 * _SECOND_NS
_LATEST_NS = 2**63 - 1  # no frame has a later stamp, nor one before 1970
_VARIABLES = ("from", "to", "last", "limit", "every", "at")
_TIME = re.compile(r"(\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d)(?:\.(\d{1,9}))?(Z|[+ -]\d\d:\d\d)", re.ASCII)
_END_OF_DAY = "T24:00:00"
_MOST_ZONE = timedelta(hours=14)
_YEAR_DAYS, _MONTH_DAYS = 366, 31
"""The longest ones, so that nothing of the span is left out."""
_DURATION = re.compile(
    r"P(?=[\dT])(?:(\d{1,4})Y)?(?:(\d{1,4})M)?(?:(\d{1,6})D)?"
    r"(?:T(?=\d)(?:(\d{1,6})H)?(?:(\d{1,6})M)?(?:(\d{1,6})(?:\.(\d{1,9}))?S)?)?",
    re.ASCII,
)


@dataclass(frozen=True)
class Span:
    """From ``begin_ns`` on and before ``end_ns`` (since 1970); ``last_ns`` is the length up to the newest sample."""

    begin_ns: int | None = None
    end_ns: int | None = None
    last_ns: int | None = None
    limit: int | None = None
    every_ns: int | None = None
    """The least time between two samples; others are left out."""
    at_ns: int | None = None
    """The instant of a single sample: the one that held then."""

    @property
    def forward(self) -> bool:
        """True if it has a beginning. Pages then start with the oldest samples, otherwise they end with the newest."""
        return self.begin_ns is not None or self.last_ns is not None

    @property
    def observations(self) -> int:
        """Number of observations on a page."""
        whole = self.forward or self.end_ns is not None
        return min(self.limit or (MOST if whole else _NEWEST), MOST)

    def begin(self, newest_ns: int) -> int | None:
        return self.begin_ns if self.last_ns is None else max(0, newest_ns - self.last_ns)


def parse_span(query: Iterable[tuple[str, str]]) -> Span:
    """Parse a query. Raises BadRequest for an invalid or repeated parameter. ``as`` is ignored here."""
    given = [(name, value) for name, value in query if name != "as"]
    said = dict(given)
    if len(said) < len(given) or said.keys() - set(_VARIABLES):
        raise BadRequest(f"The parameters of a history are {', '.join(_VARIABLES)} and as, each at most once.")
    if "last" in said and said.keys() & {"from", "to"}:
        raise BadRequest("Either last, or from and to.")
    if "at" in said and len(said) > 1:
        raise BadRequest("at is a single time: without from, to, last, limit and every.")
    span = Span(
        _time("from", said["from"]) if "from" in said else None,
        _time("to", said["to"]) if "to" in said else None,
        _duration("last", said["last"]) if "last" in said else None,
        _limit(said["limit"]) if "limit" in said else None,
        _spacing(said["every"]) if "every" in said else None,
        _time("at", said["at"]) if "at" in said else None,
    )
    if span.begin_ns is not None and span.end_ns is not None and span.begin_ns > span.end_ns:
        raise BadRequest("from is later than to.")
    return span


def lexical_time(stamp_ns: int) -> str:
    """Return an xsd:dateTime in UTC with all digits, so that parsing it gives the same time."""
    seconds = datetime.fromtimestamp(stamp_ns // _SECOND_NS, UTC).strftime("%Y-%m-%dT%H:%M:%S")
    return f"{seconds}.{stamp_ns % _SECOND_NS:09}Z"


def lexical_duration(length_ns: int) -> str:
    """Return an xsd:duration in seconds with all digits."""
    seconds, rest = divmod(length_ns, _SECOND_NS)
    return f"PT{seconds}.{rest:09}".rstrip("0").rstrip(".") + "S" if rest else f"PT{seconds}S"


def query(**said: str | int) -> str:
    """Return a query string without colons, because in a relative reference a colon may look like the end of a scheme.

    ``from_`` stands for from, which is a Python keyword.
    """
    return "&".join(f"{name.rstrip('_')}={quote(str(value), safe='')}" for name, value in said.items())


def _time(name: str, text: str) -> int:
    found = _TIME.fullmatch(text)
    try:
        if found is None:
            raise ValueError
        # an unescaped plus sign has been decoded to a space
        ends_day = found[1].endswith(_END_OF_DAY) and not (found[2] or "").strip("0")
        local = found[1].replace(_END_OF_DAY, "T00:00:00") if ends_day else found[1]
        whole = datetime.fromisoformat(local + found[3].replace(" ", "+"))
        if abs(whole.utcoffset() or timedelta()) > _MOST_ZONE:  # XML Schema 2, 3.3.7
            raise ValueError
        whole += timedelta(days=ends_day)
        stamp_ns = int(whole.timestamp()) * _SECOND_NS + int((found[2] or "0").ljust(9, "0"))
        return min(max(stamp_ns, 0), _LATEST_NS)
    except (ValueError, OverflowError):
        example = "2026-11-22T10:00:00.5Z"
        raise BadRequest(f"{name} is a time with its zone such as {example}, not {text[:40]!r}.") from None


def _duration(name: str, text: str) -> int:
    found = _DURATION.fullmatch(text)
    if found is None:
        raise BadRequest(f"{name} is a duration such as PT10S or PT1M, not {text[:40]!r}.")
    years, months, days, hours, minutes, seconds = (int(each or 0) for each in found.groups()[:6])
    fraction = int((found[7] or "0").ljust(9, "0"))
    days += years * _YEAR_DAYS + months * _MONTH_DAYS
    return (((days * 24 + hours) * 60 + minutes) * 60 + seconds) * _SECOND_NS + fraction


def _spacing(text: str) -> int:
    found = _duration("every", text)
    if found >= _MOST_SPACING_NS:
        raise BadRequest("every is less than 1,000,000 s.")
    return found


def _limit(text: str) -> int:
    if not re.fullmatch(r"[1-9]\d{0,8}", text, re.ASCII):
        raise BadRequest(f"limit is a number of samples above 0, not {text[:40]!r}.")
    return int(text)
