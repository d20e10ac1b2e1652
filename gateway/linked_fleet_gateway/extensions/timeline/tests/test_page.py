"""The page of a timeline from its description: rows, bars, what they look like, and what is left out. Pure."""

from collections.abc import Sequence
from typing import Any

import pytest
from pyoxigraph import NamedNode

from linked_fleet_gateway.api import Graph
from linked_fleet_gateway.extensions.pages.api import Facts
from linked_fleet_gateway.extensions.timeline import page
from linked_fleet_gateway.extensions.timeline.activity import Activity
from linked_fleet_gateway.extensions.timeline.chart import WIDTH
from linked_fleet_gateway.extensions.timeline.collecting import Chronicle
from linked_fleet_gateway.extensions.timeline.describing import MOST_ROBOTS, steps
from linked_fleet_gateway.extensions.timeline.window import Window

BASE = "http://fleet.example"
NOW_NS = 1_800_000_000 * 10**9
MINUTE_NS = 60 * 10**9
WINDOW = Window(NOW_NS - 60 * MINUTE_NS, NOW_NS + 60 * MINUTE_NS)


def activity(state: str, begin: float, end: float | None, robots: Sequence[str] = ("ur5",), **more: Any) -> Activity:
    """Return an activity between two times, in minutes from now."""
    begin_ns, end_ns = (None if each is None else NOW_NS + int(each * MINUTE_NS) for each in (begin, end))
    assert begin_ns is not None
    id, path = f"{state}{begin}", "/ur5/actions/stop/invocations/1"
    return Activity(id, "action", path, "stop", state, begin_ns, end_ns, robots=tuple(robots), **more)


def shown(*activities: Activity, robots: Sequence[str] = ("panda", "ur5"), **more: Any) -> dict[str, Any]:
    known = {"complete_ns": WINDOW.from_ns, "planned_ns": WINDOW.until_ns} | more
    found, graph = Chronicle(WINDOW, NOW_NS, list(activities), **known), Graph()
    for _ in steps(graph, BASE, found, robots):
        pass
    return dict(page.timeline(Facts(graph.triples, BASE + "/"), NamedNode(BASE + "/timeline")).more)


def row(more: dict[str, Any], name: str) -> page.Row:
    (found,) = [each for each in more["rows"] if each.robot.text == name]
    return found  # type: ignore[no-any-return]


def test_bars_are_where_their_times_are() -> None:
    more = shown(activity("succeeded", -60, -30), activity("running", -15, None))
    assert [(each.x, each.width) for each in row(more, "ur5").bars] == [(0, WIDTH / 4), (WIDTH * 3 / 8, WIDTH / 8)]
    assert more["now"] == WIDTH / 2
    assert row(more, "panda").said == "nothing"


def test_texts_have_room_beside_short_bars_while_there_are_lanes() -> None:
    short = [activity("succeeded", -5 + n / 100, -4.9) for n in range(3)]
    bars = row(shown(*short), "ur5").bars
    assert all(each.room > 5 * each.width for each in bars)
    assert len({each.y for each in bars}) == 3
    many = row(shown(*short, *(activity("failed", -9 + n / 1000, -8.9) for n in range(20))), "ur5").bars
    assert all(each.room == each.width for each in many)


def test_what_waits_is_drawn_until_its_deadline() -> None:
    waits = activity("waiting", -30, None, latest_ns=NOW_NS + 30 * MINUTE_NS, planned=True)
    (bar,) = row(shown(waits), "ur5").bars
    assert (bar.x, bar.width) == (WIDTH / 4, WIDTH / 2)


def test_a_start_to_come_is_a_mark_at_its_time() -> None:
    start = Activity("s", "schedule", "/schedules/1", "clean", "planned", NOW_NS + 30 * MINUTE_NS, planned=True)
    (bar,) = row(shown(start), "Fleet").bars
    assert bar.x == WIDTH * 3 / 4
    assert bar.width < WIDTH / 50


@pytest.mark.parametrize(
    ("state", "look"),
    [
        ("succeeded", "good"), ("running", "busy"), ("waiting", "plan"), ("preempted", "warn"), ("failed", "bad"),
        ("confirmed", "bad"), ("acknowledged", "warn"), ("unknown", "odd"),
    ],
)  # fmt: skip
def test_a_state_is_a_word_a_look_and_a_sign(state: str, look: str) -> None:
    (entry,) = shown(activity(state, -5, -4))["entries"]
    assert (entry.state, entry.look) == (state, look)
    assert len({*page._SYMBOLS.values()}) == len(page._SYMBOLS)
    assert entry.symbol == page._SYMBOLS[look]


def test_what_many_robots_take_part_in_is_in_the_row_of_the_fleet() -> None:
    robots = [f"r{n}" for n in range(page.MOST_ROWS + 1)]
    more = shown(activity("succeeded", -5, -4, robots), activity("failed", -3, -2, robots[:2]), robots=robots)
    assert [len(each.bars) for each in more["rows"]] == [1, 1, 1, 0, 0, 0]


def test_what_is_left_out_is_said() -> None:
    assert shown(activity("succeeded", -5, -4))["notes"] == []
    robots = [f"r{n}" for n in range(MOST_ROBOTS + 7)]
    notes = shown(left_out=12, complete_ns=NOW_NS, planned_ns=NOW_NS + MINUTE_NS, robots=robots)["notes"]
    assert [each.split(" ")[0] for each in notes] == ["12", "Starts", "7"]
