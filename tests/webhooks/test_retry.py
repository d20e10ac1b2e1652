"""Back-off, and the Retry-After of a receiver."""

import math
from datetime import UTC, datetime

import pytest
from hypothesis import given
from hypothesis import strategies as st

from linked_fleet_webhooks.delivery_pace import MAX_DELAY_S, MAX_RETRY_AFTER_S, backoff_s, retry_after_s

NOW_S = datetime(1994, 11, 6, 8, 49, 7, tzinfo=UTC).timestamp()


@pytest.mark.parametrize(
    ("failures", "least", "most"),
    [(1, 0.25, 0.5), (2, 0.5, 1.0), (5, 4.0, 8.0), (10, 128.0, 256.0), (11, 150.0, 300.0)],
)
def test_each_failure_doubles_the_delay_and_half_of_it_is_chance(failures: int, least: float, most: float) -> None:
    assert backoff_s(failures, 0.0) == least
    assert backoff_s(failures, 0.5) == (least + most) / 2
    assert backoff_s(failures, math.nextafter(1.0, 0.0)) <= most


@given(st.integers(min_value=-1), st.floats(0, 1, exclude_max=True))
def test_a_delay_is_never_nothing_and_never_beyond_the_cap(failures: int, draw: float) -> None:
    assert 0.25 <= backoff_s(failures, draw) <= MAX_DELAY_S


@pytest.mark.parametrize(
    ("field", "seconds"),
    [
        ("0", 0.0),
        ("120", 120.0),
        (" 120 ", 120.0),
        ("3601", MAX_RETRY_AFTER_S),
        ("9" * 60, MAX_RETRY_AFTER_S),
        ("Sun, 06 Nov 1994 08:49:37 GMT", 30.0),
        ("Sunday, 06-Nov-94 08:49:37 GMT", 30.0),
        ("Sun Nov  6 08:49:37 1994", 30.0),
        ("Sun, 06 Nov 1994 08:49:00 GMT", 0.0),
        ("Fri, 31 Dec 9999 23:59:59 GMT", MAX_RETRY_AFTER_S),
    ],
)
def test_seconds_and_all_three_forms_of_dates_are_understood(field: str, seconds: float) -> None:
    assert retry_after_s(field, NOW_S) == seconds


@pytest.mark.parametrize(
    "field",
    [
        None,
        "",
        "soon",
        "-1",
        "+1",
        "1.5",
        "1e3",
        "120, 120",
        "06 Nov 1994 08:49:37 GMT",
        "Sun, 06 Nov 99999999999999999999 08:49:37 GMT",
        "²",
        "١٢٠",
        "9" * 5000,
        "Sun, 99 Nov 1994 08:49:37 GMT",
    ],
)
def test_anything_else_says_nothing(field: str | None) -> None:
    assert retry_after_s(field, NOW_S) is None


@given(st.text(max_size=80) | st.from_regex(r"[A-Za-z]{3},? [0-9]{1,12} Nov [0-9]{1,12} [0-9:]{1,12} [+-][0-9]{1,9}"))
def test_no_field_breaks_it_or_holds_us_up_for_longer_than_an_hour(field: str) -> None:
    seconds = retry_after_s(field, NOW_S)
    assert seconds is None or 0.0 <= seconds <= MAX_RETRY_AFTER_S
