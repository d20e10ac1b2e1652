"""Which activities are in a window, which are left out, where their bars are, and how they are written. Pure."""

import csv
import io

import pytest

from linked_fleet_gateway.extensions.timeline.activity import Activity, Newest
from linked_fleet_gateway.extensions.timeline.chart import MOST_LANES, WIDTH, Scale, lanes, ticks
from linked_fleet_gateway.extensions.timeline.collecting import Chronicle
from linked_fleet_gateway.extensions.timeline.describing import MOST_ROBOTS, shown_robots, timeline_csv
from linked_fleet_gateway.extensions.timeline.sources import title_of
from linked_fleet_gateway.extensions.timeline.window import Window

WINDOW = Window(100, 200)
NOW_NS = 150


def activity(begin: int, end: int | None = None, id: str = "1", **more: object) -> Activity:
    return Activity(id, "action", "/ur5/actions/stop", "stop", "running", begin, end, **more)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("one", "shown"),
    [
        (activity(50, 99), False),
        (activity(50, 100), True),
        (activity(50), True),  # it goes on
        (activity(199, 300), True),
        (activity(200, 300), False),
        (activity(120, latest_ns=900, planned=True), True),
    ],
)
def test_an_activity_is_in_each_window_that_it_touches(one: Activity, shown: bool) -> None:
    assert one.is_in(WINDOW, NOW_NS) is shown


def test_what_goes_on_is_in_no_window_to_come_unless_it_may_begin_then() -> None:
    later = Window(160, 200)
    assert not activity(50).is_in(later, NOW_NS)
    assert activity(50, latest_ns=170, planned=True).is_in(later, NOW_NS)


def test_a_timeline_of_a_robot_has_what_it_takes_part_in() -> None:
    of_ur5 = Window(100, 200, "ur5")
    assert activity(120, robots=("panda", "ur5")).is_in(of_ur5, NOW_NS)
    assert not activity(120, robots=("panda",)).is_in(of_ur5, NOW_NS)
    assert not activity(120).is_in(of_ur5, NOW_NS)


def test_of_too_many_those_are_left_out_that_began_first() -> None:
    newest = Newest(most=3)
    for begin in (5, 1, 4, 2, 3):
        newest.add(activity(begin, begin, id=str(begin)))
    assert [each.begin_ns for each in newest.in_order()] == [3, 4, 5]
    assert (newest.left_out, newest.complete_ns) == (2, 3)


def test_nothing_is_left_out_of_few() -> None:
    newest = Newest(most=3)
    newest.add(activity(5))
    assert (newest.left_out, newest.complete_ns) == (0, None)


@pytest.mark.parametrize("begin", ["=", "+", "-", "@", " =", "\t=", "\r"])
def test_no_cell_begins_a_formula(begin: str) -> None:
    text = f"{begin}HYPERLINK(1)"
    one = Activity("1", "fault", "/faults/1", text, "raised", 120, who=text)
    content = timeline_csv("http://fleet.example", Chronicle(WINDOW, NOW_NS, [one])).decode()
    _, line = csv.reader(io.StringIO(content, newline=""))
    assert line[5] == line[7] == f"'{text}"


def test_the_time_of_what_is_planned_is_said_to_be_so() -> None:
    start = Activity("1", "schedule", "/schedules/1", "clean", "planned", 0, 0, 10**9, True, "anna", ("ur5", "panda"))
    content = timeline_csv("http://fleet.example", Chronicle(WINDOW, NOW_NS, [start])).decode()
    assert content.splitlines()[1] == (
        "1970-01-01T00:00:00.000Z,,yes,1970-01-01T00:00:01.000Z,schedule,clean,planned,anna,ur5; panda,"
        "http://fleet.example/schedules/1"
    )


@pytest.mark.parametrize(
    ("action", "said"),
    [
        ("/ur5/elbow_joint/actions/rotateBy", "rotate by elbow_joint"),
        ("/ur5/actions/moveJoints", "move joints"),
        ("/actions/stopAll", "stop all"),
    ],
)
def test_an_action_is_named_in_words(action: str, said: str) -> None:
    assert title_of(action) == said


def test_idle_robots_have_rows_while_there_are_few() -> None:
    robots = [f"r{n}" for n in range(MOST_ROBOTS + 50)]
    found = Chronicle(WINDOW, NOW_NS, [activity(120, robots=(robots[-1],))])
    shown = shown_robots(found, robots)
    assert len(shown) == MOST_ROBOTS
    assert shown[0] == "r0"
    assert shown[-1] == robots[-1]
    assert shown_robots(found, robots[:3]) == ["r0", "r1", "r2"]


# -- the chart --------------------------------------------------------------------------------------------------------


def test_bars_that_overlap_are_beside_each_other() -> None:
    assert lanes([(0, 10), (5, 10), (10, 10), (16, 3)]) == [0, 1, 0, 1]


def test_a_row_has_so_many_lanes_at_most() -> None:
    assert max(lanes([(0, 10)] * 50)) == MOST_LANES - 1


def test_a_bar_is_in_the_chart_and_can_be_hit() -> None:
    scale = Scale(1000, 2000)
    assert scale.extent(1250, 1500) == (WIDTH / 4, WIDTH / 4)
    for begin, end in ((0, 500), (1999, 1999), (3000, 4000), (900, 4000)):
        x, width = scale.extent(begin, end)
        assert x >= 0
        assert width >= 10
        assert x + width <= WIDTH


@pytest.mark.parametrize("length", [1, 7, 60, 3599, 7200, 86_400, 7 * 86_400])
def test_the_times_on_top_are_whole_and_few(length: int) -> None:
    found = ticks(Scale(1_800_000_123.4, 1_800_000_123.4 + length))
    assert len(found) <= 8
    assert found or length == 1
    assert [each.x for each in found] == sorted(each.x for each in found)
    assert not found or found[0].day == "2027-01-15" or length > 86_400
