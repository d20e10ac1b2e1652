"""The part of the audit that a request selects: its query, parsed and written. Pure; times are wall nanoseconds."""

import re
from collections.abc import Iterable
from datetime import UTC, datetime
from typing import Literal, cast, get_args
from urllib.parse import urlencode

from msgspec import Struct
from msgspec.structs import asdict

from linked_fleet_base.instants import parse_instant
from linked_fleet_gateway.api import BadRequest

PAGE_SIZE = 100
MOST_ENTRIES = 1000
"""The largest number of entries in one answer."""
_MOST_TEXT = 200
ID_PATTERN = "[1-9][0-9]{0,18}-[0-9]{1,19}p?"
"""Ids of entries, within what Redis accepts as the open end of a range: 64 bits, and not 0-0."""
_ID = re.compile(ID_PATTERN)
_IN_MINUTES = re.compile(r"\d{4}-\d\d-\d\dT\d\d:\d\d(:\d\d)?", re.ASCII)
_TEXTS = ("who", "robot", "resource", "action", "text")
_NAMES = (*_TEXTS, "outcome", "from", "until", "pages", "before", "after", "limit")
_ON_OFF = {"on": True, "off": False}
Outcome = Literal["", "succeeded", "refused", "failed", "ended"]
OUTCOMES: tuple[str, ...] = get_args(Outcome)


class Query(Struct, frozen=True):
    """A query of the audit. Empty texts and None select everything.

    ``resource``: the path of a resource, which stands for all below it. ``action``: a method, an event or the name of
    an action. ``text``: words that an entry contains. ``from_ns`` is included, ``until_ns`` is not. ``pages``: also
    what pages did by themselves. ``before`` and ``after``: ids of entries.
    """

    who: str = ""
    robot: str = ""
    resource: str = ""
    action: str = ""
    text: str = ""
    outcome: Outcome = ""
    from_ns: int | None = None
    until_ns: int | None = None
    pages: bool = False
    before: str = ""
    after: str = ""
    limit: int = PAGE_SIZE

    @property
    def filters(self) -> dict[str, str]:
        """The parameters that select entries, but for their place, as they are written."""
        said = {name: value for name, value in asdict(self).items() if value and isinstance(value, str)}
        times = {"from": self.from_ns, "until": self.until_ns}
        said |= {name: _lexical(value) for name, value in times.items() if value is not None}
        said |= {"pages": "on"} if self.pages else {}
        return {name: said[name] for name in (*_TEXTS, "outcome", "from", "until", "pages") if name in said}

    def at(self, before: str) -> str:
        """Return the query for the entries before an id, or for the newest ones."""
        limit = {"limit": str(self.limit)} if self.limit != PAGE_SIZE else {}
        return urlencode(self.filters | ({"before": before} if before else {}) | limit)


def parse_query(query: Iterable[tuple[str, str]]) -> Query:
    """Parse a query; parameters without a value select nothing, as forms send them. ``as`` is ignored here.

    Raises BadRequest for a parameter that is unknown, repeated or invalid.
    """
    given = [(name, value) for name, value in query if name != "as"]
    said = dict(given)
    if len(said) < len(given) or said.keys() - set(_NAMES):
        raise BadRequest(f"The parameters of the audit are {', '.join(_NAMES)} and as, each at most once.")
    said = {name: value.strip() for name, value in said.items() if value.strip()}
    who, robot, resource, action, text = (_text(name, said.get(name, "")) for name in _TEXTS)
    begin, end = (_instant(name, said[name]) if name in said else None for name in ("from", "until"))
    if begin is not None and end is not None and end <= begin:
        raise BadRequest("until is later than from.")
    return Query(
        who,
        robot,
        resource,
        action,
        text,
        cast(Outcome, _choice("outcome", said.get("outcome", ""), OUTCOMES)),
        begin,
        end,
        _ON_OFF[_choice("pages", said.get("pages", "off"), tuple(_ON_OFF))],
        _id("before", said.get("before", "")),
        _id("after", said.get("after", "")),
        _limit(said.get("limit", str(PAGE_SIZE))),
    )


def _text(name: str, value: str) -> str:
    if len(value) > _MOST_TEXT:
        raise BadRequest(f"{name} has at most {_MOST_TEXT} characters.")
    if name == "resource" and value and not value.startswith("/"):
        raise BadRequest(f"resource is a path such as /ur5/, not {value[:40]!r}.")
    return value


def _instant(name: str, value: str) -> int:
    """Return a time; without a zone, as browsers write it, it is one in UTC."""
    if found := _IN_MINUTES.fullmatch(value):
        value += "Z" if found[1] else ":00Z"
    return parse_instant(name, value)


def _id(name: str, value: str) -> str:
    if value and not _ID.fullmatch(value):
        raise BadRequest(f"{name} is the id of an entry of the audit, such as 1764547200000-0, not {value[:40]!r}.")
    return value


def _choice(name: str, value: str, choices: tuple[str, ...]) -> str:
    if value not in choices:
        raise BadRequest(f"{name} is one of {', '.join(filter(None, choices))}, not {value[:40]!r}.")
    return value


def _limit(value: str) -> int:
    if not (value.isascii() and value.isdecimal() and 1 <= int(value[:6]) <= MOST_ENTRIES and len(value) < 6):
        raise BadRequest(f"limit is a whole number of 1 to {MOST_ENTRIES}, not {value[:40]!r}.")
    return int(value)


def _lexical(stamp_ns: int) -> str:
    seconds, rest_ns = divmod(stamp_ns, 1_000_000_000)
    fraction = f".{rest_ns:09d}".rstrip("0") if rest_ns else ""
    return f"{datetime.fromtimestamp(seconds, UTC):%Y-%m-%dT%H:%M:%S}{fraction}Z"
