"""The starts of schedules in a span: in order, bounded, and with the time before which they are complete. Pure."""

from datetime import UTC, datetime

import pytest

from linked_fleet_gateway.extensions.queue.order import Wanted
from linked_fleet_gateway.extensions.queue.planned import starts_between
from linked_fleet_gateway.extensions.queue.schedule import Planned, Schedule
from linked_fleet_gateway.extensions.queue.timetable import first_start

HOUR_NS = 3600 * 10**9
NOW_NS = int(datetime(2026, 12, 1, tzinfo=UTC).timestamp()) * 10**9


def schedule(rule: str, *, active: bool = True) -> Schedule:
    planned = Planned(Wanted("https://fleet.example/missions/1"), rule, "2026-12-01T00:30:00", "UTC", active=active)
    found = first_start(Schedule(planned), NOW_NS)
    assert found is not None
    return found


HALF_HOURLY = "FREQ=DAILY;BYHOUR=" + ",".join(map(str, range(24))) + ";BYMINUTE=30"


def hours(found: list[tuple[int, str]]) -> list[tuple[float, str]]:
    return [((at_ns - NOW_NS) / HOUR_NS, id) for at_ns, id in found]


def test_starts_of_several_schedules_are_in_order_and_in_the_span() -> None:
    known = {"a": schedule(HALF_HOURLY), "b": schedule("FREQ=DAILY;BYHOUR=2;BYMINUTE=0")}
    found, complete_ns = starts_between(known, NOW_NS + HOUR_NS, NOW_NS + 3 * HOUR_NS, 100, 9.0)
    assert hours(found) == [(1.5, "a"), (2.0, "b"), (2.5, "a")]
    assert complete_ns == NOW_NS + 3 * HOUR_NS


def test_of_too_many_the_first_are_told_and_until_when() -> None:
    known = {"a": schedule(HALF_HOURLY)}
    found, complete_ns = starts_between(known, NOW_NS, NOW_NS + 24 * HOUR_NS, 3, 9.0)
    assert hours(found) == [(0.5, "a"), (1.5, "a"), (2.5, "a")]
    assert complete_ns == NOW_NS + 3 * HOUR_NS + HOUR_NS // 2


@pytest.mark.parametrize(
    ("planned", "wanted"),
    [(schedule(HALF_HOURLY + ";COUNT=2"), [0.5, 1.5]), (schedule(HALF_HOURLY, active=False), [])],
)
def test_a_schedule_that_ends_or_rests_has_no_further_starts(planned: Schedule, wanted: list[float]) -> None:
    found, _ = starts_between({"a": planned}, NOW_NS, NOW_NS + 24 * HOUR_NS, 100, 9.0)
    assert [at for at, _ in hours(found)] == wanted


def test_no_time_is_spent_beyond_the_bound() -> None:
    found, complete_ns = starts_between({"a": schedule(HALF_HOURLY)}, NOW_NS, NOW_NS + HOUR_NS, 100, 0.0)
    assert (found, complete_ns) == ([], NOW_NS + HOUR_NS // 2)
