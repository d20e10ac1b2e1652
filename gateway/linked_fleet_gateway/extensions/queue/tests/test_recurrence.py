"""Rules of iCalendar: their occurrences in local time, changes of the clock, ends, and what is refused. Pure."""

import itertools
from datetime import UTC, datetime

import pytest

from linked_fleet_gateway.api import UnprocessableContent
from linked_fleet_gateway.extensions.queue.recurrence import Recurrence


def instants(rule: str, start: str, zone: str = "Europe/Berlin", most: int = 5) -> list[str]:
    """Return the first occurrences in UTC, each found from the one before, as a gateway does."""
    recurrence, found, last = Recurrence(rule, start, zone), list[str](), None
    for _ in range(most):
        last = next(recurrence.after(last), None)
        if last is None:
            break
        at = datetime.fromtimestamp(recurrence.instant_ns(last) / 1e9, UTC)
        found.append(at.strftime("%m-%d %H:%M"))
    return found


@pytest.mark.parametrize(
    ("rule", "start", "expected"),
    [
        (
            "FREQ=DAILY",
            "2026-12-01T09:00:00",
            ["12-01 08:00", "12-02 08:00", "12-03 08:00", "12-04 08:00", "12-05 08:00"],
        ),
        (
            "RRULE:FREQ=DAILY;INTERVAL=2",
            "2026-12-01T09:00",
            ["12-01 08:00", "12-03 08:00", "12-05 08:00", "12-07 08:00", "12-09 08:00"],
        ),
        (
            "FREQ=WEEKLY;BYDAY=MO,FR;BYHOUR=9,17",
            "2026-12-01T09:00",
            ["12-04 08:00", "12-04 16:00", "12-07 08:00", "12-07 16:00", "12-11 08:00"],
        ),
        (
            "FREQ=WEEKLY;INTERVAL=2;BYDAY=MO,FR",
            "2026-11-30T09:00",
            ["11-30 08:00", "12-04 08:00", "12-14 08:00", "12-18 08:00", "12-28 08:00"],
        ),
        (
            "FREQ=MONTHLY",
            "2027-01-31T09:00",
            ["01-31 08:00", "03-31 07:00", "05-31 07:00", "07-31 07:00", "08-31 07:00"],
        ),
        (
            "FREQ=MONTHLY;BYDAY=-1FR",
            "2026-12-01T09:00",
            ["12-25 08:00", "01-29 08:00", "02-26 08:00", "03-26 08:00", "04-30 07:00"],
        ),
        (
            "FREQ=MONTHLY;BYDAY=MO,TU,WE,TH,FR;BYSETPOS=-1",
            "2026-12-01T09:00",
            ["12-31 08:00", "01-29 08:00", "02-26 08:00", "03-31 07:00", "04-30 07:00"],
        ),
        ("FREQ=YEARLY", "2024-02-29T09:00", ["02-29 08:00"] * 5),
        (
            "FREQ=DAILY;BYHOUR=8;BYMINUTE=0,30",
            "2026-12-01T08:00",
            ["12-01 07:00", "12-01 07:30", "12-02 07:00", "12-02 07:30", "12-03 07:00"],
        ),
        ("FREQ=DAILY;UNTIL=20261202", "2026-12-01T09:00", ["12-01 08:00", "12-02 08:00"]),
        ("FREQ=DAILY;UNTIL=20261202T080000Z", "2026-12-01T09:00", ["12-01 08:00", "12-02 08:00"]),
        ("FREQ=DAILY;UNTIL=20261202T075959Z", "2026-12-01T09:00", ["12-01 08:00"]),
    ],
)
def test_occurrences_are_those_of_the_standard(rule: str, start: str, expected: list[str]) -> None:
    assert instants(rule, start) == expected


@pytest.mark.parametrize(
    ("start", "zone", "expected"),
    [
        # The clock goes on from 02:00 to 03:00 on 2027-03-28: 02:30 is taken by the offset before.
        ("2027-03-27T02:30", "Europe/Berlin", ["03-27 01:30", "03-28 01:30", "03-29 00:30"]),
        ("2027-03-27T09:00", "Europe/Berlin", ["03-27 08:00", "03-28 07:00", "03-29 07:00"]),
        # The clock goes back from 03:00 to 02:00 on 2026-10-25: the first 02:30 counts, once.
        ("2026-10-24T02:30", "Europe/Berlin", ["10-24 00:30", "10-25 00:30", "10-26 01:30"]),
        ("2026-10-31T01:30", "America/New_York", ["10-31 05:30", "11-01 05:30", "11-02 06:30"]),
        ("2027-03-13T02:30", "America/New_York", ["03-13 07:30", "03-14 07:30", "03-15 06:30"]),
        # Half an hour: Lord Howe goes back from 02:00 to 01:30 on 2027-04-04.
        ("2027-04-03T01:45", "Australia/Lord_Howe", ["04-02 14:45", "04-03 14:45", "04-04 15:15"]),
        ("2027-03-27T02:30", "UTC", ["03-27 02:30", "03-28 02:30", "03-29 02:30"]),
    ],
)
def test_changes_of_the_clock_are_those_of_the_standard(start: str, zone: str, expected: list[str]) -> None:
    assert instants("FREQ=DAILY", start, zone, 3) == expected


def test_going_on_from_an_occurrence_changes_nothing() -> None:
    for rule in (
        "FREQ=WEEKLY;INTERVAL=3;BYDAY=TU,SU;WKST=SU",
        "FREQ=MONTHLY;INTERVAL=5;BYMONTHDAY=1,15,-1;BYHOUR=3,22",
        "FREQ=YEARLY;BYWEEKNO=20;BYDAY=MO,TH",
        "FREQ=YEARLY;INTERVAL=4;BYMONTH=2;BYMONTHDAY=29",
    ):
        recurrence = Recurrence(rule, "2024-02-29T03:00", "UTC")
        whole = list(itertools.islice(recurrence.after(None), 40))
        steps = [next(recurrence.after(None))]
        while len(steps) < len(whole):
            steps.append(next(recurrence.after(steps[-1])))
        assert steps == whole and len(whole) == 40


@pytest.mark.parametrize(
    "rule",
    [
        "FREQ=DAILY;BYMONTH=2;BYMONTHDAY=30",
        "FREQ=YEARLY;BYMONTH=4;BYMONTHDAY=31",
        "FREQ=DAILY;INTERVAL=7;BYDAY=MO",
        "FREQ=DAILY;BYSETPOS=2",
    ],
)
def test_a_rule_without_occurrences_is_known_to_have_none(rule: str) -> None:
    assert instants(rule, "2026-12-01T09:00") == []


@pytest.mark.parametrize(
    ("rule", "words"),
    [
        ("FREQ=SECONDLY", "BYHOUR and BYMINUTE"),
        ("FREQ=MINUTELY", "FREQ is one of"),
        ("FREQ=HOURLY", "FREQ is one of"),
        ("BYDAY=MO", "FREQ is one of"),
        ("FREQ=DAILY;BYSECOND=0,1", "no part of a rule"),
        ("", "no part of a rule"),
        ("FREQ=DAILY;FREQ=DAILY", "each once"),
        ("FREQ=DAILY;INTERVAL=0", "INTERVAL"),
        ("FREQ=DAILY;INTERVAL=-1", "INTERVAL"),
        ("FREQ=DAILY;INTERVAL=99999999999999999999", "INTERVAL"),
        ("FREQ=DAILY;COUNT=0", "COUNT"),
        ("FREQ=DAILY;UNTIL=tomorrow", "no part of a rule"),
        ("FREQ=DAILY;UNTIL=20261332", "UNTIL"),
        ("FREQ=DAILY;UNTIL=99", "UNTIL"),
        ("FREQ=WEEKLY;BYDAY=XX", "no RRULE"),
        ("FREQ=DAILY;BYHOUR=25", "BYHOUR is from 0 to 23"),
        ("FREQ=DAILY;BYMINUTE=60", "BYMINUTE is"),
        ("FREQ=DAILY;BYSETPOS=0", "BYSETPOS is"),
        ("FREQ=DAILY;BYEASTER=0", "no part"),
        ("FREQ=DAILY\nDTSTART:19700101T000000", "no part of a rule"),
        ("FREQ=DAILY;BYHOUR=" + ",".join(["1"] * 100), "at most"),
        ("FREQ=DAILY;BYMONTH=13", "BYMONTH is from 1 to 12"),
        ("FREQ=DAILY;BYMONTHDAY=32", "BYMONTHDAY is from -31 to 31"),
        ("FREQ=DAILY;" * 100, "no part"),
        ("FREQ=DAILY;BYHOUR=,", "BYHOUR is"),
        ("FREQ=DAILY;WKST=1,2", "no RRULE"),
        ("FREQ=DAILY;BYDAY=99MO", "MONTHLY and YEARLY"),
    ],
)
def test_what_is_no_rule_is_refused_with_what_is_right(rule: str, words: str) -> None:
    with pytest.raises(UnprocessableContent, match=words):
        list(itertools.islice(Recurrence(rule, "2026-12-01T09:00", "UTC").after(None), 2))
        pytest.fail("it was not refused")


@pytest.mark.parametrize(
    ("start", "zone", "words"),
    [
        ("2026-12-01T09:00Z", "UTC", "without offset"),
        ("soon", "UTC", "local time"),
        ("1066-10-14T09:00", "UTC", "years"),
        ("2026-12-01T09:00", "Mars/Olympus", "time zone"),
        ("2026-12-01T09:00", "../../etc/passwd", "time zone"),
        ("2026-12-01T09:00", "", "time zone"),
        ("2026-12-01T09:00", "Europe", "time zone"),
        ("2026-12-01T09:00", "\0", "time zone"),
    ],
)
def test_a_start_and_a_time_zone_that_are_none_are_refused(start: str, zone: str, words: str) -> None:
    with pytest.raises(UnprocessableContent, match=words):
        Recurrence("FREQ=DAILY", start, zone)
