"""Links from pages to the time around what they show."""

from datetime import UTC, datetime, timedelta
from urllib.parse import quote

from linked_fleet_gateway.extensions.pages.values import Facts
from linked_fleet_gateway.extensions.pages.views import constant

_AROUND = timedelta(minutes=1)
_MOST = timedelta(days=7)


def timeline_link(facts: Facts, begin: str, end: str = "") -> str:
    """Return the address of the timeline around two xsd:dateTime; empty without a beginning, or if that is off."""
    path = constant("timeline")
    if not path or not begin:
        return ""
    first = datetime.fromisoformat(begin) - _AROUND
    last = min(datetime.fromisoformat(end or begin) + _AROUND, first + _MOST)
    return f"{facts.root.rstrip('/')}{path}?from={_written(first)}&until={_written(last)}"


def _written(instant: datetime) -> str:
    return quote(f"{instant.astimezone(UTC):%Y-%m-%dT%H:%M:%SZ}", safe="")
