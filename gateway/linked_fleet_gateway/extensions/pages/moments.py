"""Links from pages to the time around what they show."""

from datetime import UTC, datetime, timedelta
from urllib.parse import quote

from linked_fleet_gateway.extensions.pages.values import Facts
from linked_fleet_gateway.extensions.pages.views import constant

_AROUND = timedelta(minutes=1)
_MOST = timedelta(days=7)


def timeline_link(facts: Facts, begin: str, end: str = "") -> str:
    """Return the address of the timeline around two xsd:dateTime; empty without a beginning, or if that is off.

    Its fragment is the instant at which the page begins to show robots as they were.
    """
    path = constant("timeline")
    if not path or not begin:
        return ""
    first = datetime.fromisoformat(begin) - _AROUND
    last = min(datetime.fromisoformat(end or begin) + _AROUND, first + _MOST)
    return f"{facts.root.rstrip('/')}{path}?from={_written(first)}&until={_written(last)}#at={quote(begin, safe='')}"


def _written(instant: datetime) -> str:
    return quote(f"{instant.astimezone(UTC):%Y-%m-%dT%H:%M:%SZ}", safe="")


def shows_past() -> bool:
    """Return True if histories are kept, so that pages can show robots as they were."""
    return bool(constant("history"))
