"""Times in the queries of requests, in nanoseconds since 1970."""

import re
from datetime import UTC, datetime

from linked_fleet_base.errors import BadRequest

_YEARS = (1970, 2200)
_TIME = re.compile(r"(\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d)(?:\.(\d{1,9}))?(Z|[+ -]\d\d:\d\d)", re.ASCII)
_EXAMPLE = "2026-11-22T10:00:00Z"


def parse_instant(name: str, text: str) -> int:
    """Return the value of the parameter ``name``, an xsd:dateTime with its zone. Raises BadRequest."""
    found = _TIME.fullmatch(text)
    try:
        if found is None:
            raise ValueError
        # an unescaped plus sign has been decoded to a space
        instant = datetime.fromisoformat(found[1] + found[3].replace(" ", "+")).astimezone(UTC)
        if not _YEARS[0] <= instant.year < _YEARS[1]:
            raise ValueError
    except (ValueError, OverflowError):
        years = f"{_YEARS[0]} to {_YEARS[1]}"
        raise BadRequest(
            f"{name} is a time of the years {years} with its zone, such as {_EXAMPLE}, not {text[:40]!r}."
        ) from None
    return int(instant.timestamp()) * 1_000_000_000 + int((found[2] or "0").ljust(9, "0"))
