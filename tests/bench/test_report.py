"""The table, the pictures and the page of a benchmark run."""

import json
import sys
import xml.etree.ElementTree as ElementTree

import pytest

from bench.__main__ import SUITES, Suite, run
from bench.plots import bars
from bench.report import BEGIN, END, PAGE, RESULTS, page, pictures, result, text
from bench.table import Row, at_least, at_most, known, markdown, median, number

ABOUT = {
    "at": "2026-11-21T12:00+00:00", "commit": "abc", "processor": "one", "processors": 2, "memory GiB": 8.0, "runs": 1,
    "seconds": 2.0, "kernel": "6", "load before": 0.1, "versions": {"Python": "3.11"},
}  # fmt: skip
ROWS = [
    at_least("GET", "1/CPU s", 90.0, "bare", 100.0, 0.8),
    at_most("state", 2.0, "Zenoh", 0.5, 1.0),
    known("x", "%", 0),
]
NUMBERS = [(0.0, "0"), (0.00123, "0.00123"), (12.345, "12.3"), (-1.5, "-1.50"), (24381.0, "24,381")]


def test_a_goal_holds_or_does_not() -> None:
    assert [(row.ratio, row.holds) for row in ROWS] == [(0.9, True), (4.0, False), (None, None)]


def test_the_median_is_taken_of_values_and_of_ratios() -> None:
    runs = [[at_least("GET", "1/s", value, "bare", beside, 0.8)] for value, beside in ((9, 10), (70, 100), (4, 5))]
    assert median(runs) == [Row("GET", "1/s", 9, "bare", 0.8, ">= 80% of it", True)]


def test_a_goal_holds_if_most_runs_reached_it() -> None:
    runs = [[at_most("state", value, "Zenoh", 1.0, 5.0)] for value in (4.0, 9.0, 8.0)]
    assert [(row.value, row.holds) for row in median(runs)] == [(8.0, False)]


@pytest.mark.parametrize(("value", "said"), NUMBERS)
def test_numbers_have_three_digits(value: float, said: str) -> None:
    assert number(value) == said


def test_the_table_has_a_line_for_each_row() -> None:
    lines = markdown(ROWS).splitlines()[2:]
    assert lines[0] == "| GET | 90.0 | 1/CPU s | 0.900 | bare | >= 80% of it | holds |"
    assert "not reached" in lines[1]
    assert len(lines) == 3


def test_a_missing_figure_has_a_reason() -> None:
    said = text(result(ABOUT, {"answers": ROWS}, {"transports": "Caddy is not here"}))
    assert "Not measured: transports. Caddy is not here" in said
    assert "1 of 2 goals reached" in said


def test_a_picture_has_a_bar_for_each_value() -> None:
    picture = ElementTree.fromstring(bars("<all>", ROWS, [row.ratio for row in ROWS]))
    found = picture.findall(".//{http://www.w3.org/2000/svg}rect")
    assert len(found) == 1 + 2  # the ground, and a bar for each ratio


def test_the_page_says_what_the_last_run_found() -> None:
    said = json.loads(RESULTS.read_text())
    written = PAGE.read_text()
    assert page(written, said) == written
    assert page(f"before {BEGIN} old {END} after", said).startswith("before ")
    for path, picture in pictures(said).items():
        assert path.read_text() == picture


def test_a_suite_is_run_as_often_as_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    seen: list[float] = []
    module = type("Module", (), {"rows": staticmethod(lambda seconds: seen.append(seconds) or ROWS)})
    monkeypatch.setitem(sys.modules, "bench.one", module)
    assert run(Suite("one"), 0.5, 3) == ROWS
    assert run(Suite("one", repeated=False), 0.5, 3) == ROWS
    assert seen == [0.5] * 4


def test_every_suite_has_another_name() -> None:
    assert len({suite.name for suite in SUITES}) == len(SUITES)
