"""The part of the timeline that a request selects: its query, parsed and written. Pure; times are wall nanoseconds."""

from collections.abc import Iterable
from datetime import UTC, datetime
from urllib.parse import quote

from msgspec import Struct

from linked_fleet_base.instants import parse_instant
from linked_fleet_gateway.api import BadRequest

SECOND_NS = 1_000_000_000
HOUR_NS = 3600 * SECOND_NS
MOST_NS = 7 * 24 * HOUR_NS
"""The length of the longest window."""
LEAST_NS = SECOND_NS
_NAMES = ("from", "until", "robot")
_MOST_NAME = 256


class Window(Struct, frozen=True):
    """From ``from_ns`` on and before ``until_ns``; of one ``robot``, or of all if that is empty."""

    from_ns: int
    until_ns: int
    robot: str = ""

    @property
    def length_ns(self) -> int:
        return self.until_ns - self.from_ns


def parse_window(query: Iterable[tuple[str, str]], now_ns: int) -> Window:
    """Parse a query; without times it is the hour before and the hour after now. ``as`` is ignored here.

    Raises BadRequest for an invalid or repeated parameter, and for a window that is empty or too long.
    """
    given = [(name, value) for name, value in query if name != "as"]
    said = dict(given)
    if len(said) < len(given) or said.keys() - set(_NAMES):
        raise BadRequest("The parameters of the timeline are from, until, robot and as, each at most once.")
    if len(robot := said.get("robot", "")) > _MOST_NAME or ("robot" in said and not robot):
        raise BadRequest(f"robot is the name of a robot, of 1 to {_MOST_NAME} characters.")
    begin = parse_instant("from", said["from"]) if "from" in said else None
    end = parse_instant("until", said["until"]) if "until" in said else None
    return _checked(Window(*_span(begin, end, now_ns), robot))


def _span(begin_ns: int | None, end_ns: int | None, now_ns: int) -> tuple[int, int]:
    """Return both ends; of a window with one end, the other is two hours from it."""
    if begin_ns is None and end_ns is None:
        return now_ns - HOUR_NS, now_ns + HOUR_NS
    if begin_ns is None:
        assert end_ns is not None
        return end_ns - 2 * HOUR_NS, end_ns
    return begin_ns, begin_ns + 2 * HOUR_NS if end_ns is None else end_ns


def _checked(window: Window) -> Window:
    if window.length_ns < LEAST_NS:
        raise BadRequest("until is later than from, by a second at least.")
    if window.length_ns > MOST_NS:
        raise BadRequest("A timeline is of 7 days at most: from and until are further apart.")
    return window


# -- other windows ----------------------------------------------------------------------------------------------------


def moved(window: Window, share: float) -> Window:
    """Return the window later by a share of its length; earlier for a negative one."""
    by_ns = int(window.length_ns * share)
    return Window(window.from_ns + by_ns, window.until_ns + by_ns, window.robot)


def zoomed(window: Window, factor: float) -> Window:
    """Return the window with the same middle and so many times its length, as far as windows can have it."""
    length_ns = min(max(int(window.length_ns * factor), LEAST_NS), MOST_NS)
    begin_ns = window.from_ns + (window.length_ns - length_ns) // 2
    return Window(begin_ns, begin_ns + length_ns, window.robot)


def at(window: Window, middle_ns: int) -> Window:
    """Return the window of the same length around an instant."""
    begin_ns = middle_ns - window.length_ns // 2
    return Window(begin_ns, begin_ns + window.length_ns, window.robot)


def query_of(window: Window) -> str:
    """Return the query that selects a window, to the millisecond."""
    said = {"from": lexical(window.from_ns), "until": lexical(window.until_ns), "robot": window.robot}
    return "&".join(f"{name}={quote(value, safe='')}" for name, value in said.items() if value)


def lexical(stamp_ns: int) -> str:
    """Return an xsd:dateTime in UTC, to the millisecond."""
    seconds, rest_ns = divmod(stamp_ns, SECOND_NS)
    return f"{datetime.fromtimestamp(seconds, UTC):%Y-%m-%dT%H:%M:%S}.{rest_ns // 1_000_000:03d}Z"
