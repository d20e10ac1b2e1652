"""The window of a timeline: what queries select, what they are refused for, and the windows beside it. Pure."""

from urllib.parse import parse_qsl

import pytest

from linked_fleet_gateway.api import BadRequest
from linked_fleet_gateway.extensions.timeline.window import (
    HOUR_NS,
    LEAST_NS,
    MOST_NS,
    Window,
    at,
    lexical,
    moved,
    parse_window,
    query_of,
    zoomed,
)

NOW_NS = 1_800_000_000 * 10**9
DAY = "2026-11-30T00:00:00Z"


def test_without_times_it_is_the_hour_before_and_the_hour_after_now() -> None:
    assert parse_window([], NOW_NS) == Window(NOW_NS - HOUR_NS, NOW_NS + HOUR_NS)
    assert parse_window([("robot", "ur5"), ("as", "csv")], NOW_NS).robot == "ur5"


@pytest.mark.parametrize("name", ["from", "until"])
def test_with_one_end_it_is_of_two_hours(name: str) -> None:
    found = parse_window([(name, DAY)], NOW_NS)
    assert found.length_ns == 2 * HOUR_NS
    assert lexical(found.from_ns if name == "from" else found.until_ns) == "2026-11-30T00:00:00.000Z"


def test_times_have_any_zone() -> None:
    found = parse_window([("from", "2026-11-30T01:00:00.25+01:00"), ("until", "2026-11-30T02:00:00 01:00")], NOW_NS)
    assert (lexical(found.from_ns), lexical(found.until_ns)) == ("2026-11-30T00:00:00.250Z", "2026-11-30T01:00:00.000Z")


@pytest.mark.parametrize(
    ("query", "said"),
    [
        ([("form", DAY)], "from, until, robot and as"),
        ([("from", DAY), ("from", DAY)], "at most once"),
        ([("from", "yesterday")], "from is a time"),
        ([("until", "2026-11-30T00:00:00")], "with its zone"),
        ([("until", "2026-02-30T00:00:00Z")], "until is a time"),
        ([("from", "0001-01-01T00:00:00+14:00")], "1970 to 2200"),
        ([("from", "9999-12-31T23:59:59Z")], "1970 to 2200"),
        ([("from", DAY), ("until", DAY)], "later than from"),
        ([("from", DAY), ("until", "2026-12-07T00:00:01Z")], "7 days"),
        ([("robot", "")], "name of a robot"),
        ([("robot", "x" * 257)], "name of a robot"),
    ],
)
def test_other_queries_are_refused_with_what_would_be_right(query: list[tuple[str, str]], said: str) -> None:
    with pytest.raises(BadRequest, match=said):
        parse_window(query, NOW_NS)


def test_windows_beside_it_keep_its_middle_or_its_length() -> None:
    window = Window(NOW_NS, NOW_NS + 4 * HOUR_NS, "ur5")
    assert moved(window, -0.5) == Window(NOW_NS - 2 * HOUR_NS, NOW_NS + 2 * HOUR_NS, "ur5")
    assert zoomed(window, 0.5) == Window(NOW_NS + HOUR_NS, NOW_NS + 3 * HOUR_NS, "ur5")
    assert zoomed(window, 2) == Window(NOW_NS - 2 * HOUR_NS, NOW_NS + 6 * HOUR_NS, "ur5")
    assert at(window, NOW_NS) == moved(window, -0.5)


def test_zooming_ends_at_the_longest_and_the_shortest_window() -> None:
    assert zoomed(Window(0, MOST_NS), 2).length_ns == MOST_NS
    assert zoomed(Window(0, LEAST_NS), 0.5).length_ns == LEAST_NS


def test_a_window_that_is_linked_is_the_one_that_is_selected() -> None:
    window = Window(NOW_NS, NOW_NS + HOUR_NS, "a b&c")
    assert parse_window(parse_qsl(query_of(window)), NOW_NS) == window
