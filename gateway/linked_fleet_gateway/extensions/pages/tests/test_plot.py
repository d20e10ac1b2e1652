"""What a plot draws is what was measured: its line is compared with the history in CSV."""

import csv
import signal
from bisect import bisect_left
from collections.abc import Iterator, Sequence
from datetime import datetime
from io import StringIO
from itertools import pairwise
from pathlib import Path

import pytest
from playwright.sync_api import Locator, Page, expect

from browser import Browser as Client
from commanding import TURTLE, of_joint, slowly
from running import Process, eventually
from small_fleet import Place, live

pytestmark = [pytest.mark.processes, pytest.mark.test_all]
JOINT = "wrist_3_joint"
SPEED = 0.5  # rad/s
TOLERANCE_RAD = 0.02  # the history has ten values a second
Line = Sequence[tuple[float, float]]
DRAWN = "(figure) => figure.plot.chart.data.map((each) => [...each])"


@pytest.fixture
def ur5(tmp_path: Path) -> Iterator[tuple[Client, Process]]:
    place = Place(tmp_path)
    with place.gateway() as (_, client), place.ur5() as agent:
        live(client, "ur5")
        yield client, agent


def drawn(figure: Locator, of: int = 1) -> list[tuple[float, float | None]]:
    data = figure.evaluate(DRAWN)
    return list(zip(data[0], data[of], strict=True))


def has_a_line(figure: Locator) -> bool:
    """Return True if a line is drawn, for which its figure has to be in sight."""
    figure.scroll_into_view_if_needed()
    return bool(figure.evaluate("(figure) => Boolean(figure.plot?.chart)")) and len(drawn(figure)) > 10


def recorded(client: Client, address: str, name: str) -> Line:
    """Return the last five minutes of a column, by time in seconds since 1970."""
    rows = list(
        csv.reader(StringIO(client.http.get(address, params={"last": "PT300S"}, headers={"accept": "text/csv"}).text))
    )
    (column,) = [place for place, title in enumerate(rows[0]) if title.split(" (")[0] == name]
    return [(datetime.fromisoformat(row[0]).timestamp(), float(row[column])) for row in rows[1:] if row and row[column]]


def at(line: Line, time: float) -> float:
    place = bisect_left(line, (time, -10.0))
    (begin, one), (end, other) = line[place - 1], line[place]
    return one + (other - one) * (time - begin) / (end - begin)


def farthest(line: Sequence[tuple[float, float | None]], truth: Line) -> float:
    """Return how far the drawn line, between its points too, is from the truth."""
    found = 0.0
    for (begin, one), (end, other) in pairwise(line):
        if one is None or other is None:
            continue
        for share in (0.0, 0.25, 0.5, 0.75, 1.0):
            time = begin + share * (end - begin)
            if truth[0][0] < time < truth[-1][0]:
                found = max(found, abs(one + share * (other - one) - at(truth, time)))
    return found


@pytest.mark.parametrize("kind", ["joint", "robot"])
def test_the_line_of_a_moving_joint_is_that_of_the_csv(
    page: Page, watched: object, ur5: tuple[Client, Process], kind: str
) -> None:
    """The page is opened during a motion: no step is drawn where the history meets the live values."""
    client, _ = ur5
    answer = client.http.put(of_joint(client, JOINT), content=slowly(2.5, speed=SPEED), headers=TURTLE)
    assert answer.is_success, answer.text
    page.wait_for_timeout(1500)
    if kind == "joint":
        page.goto(client.part("ur5", JOINT).url)
        figure = page.locator('figure.plot[data-subject$="/rotation"]').first
        csv_link = figure.locator("a[download]")
    else:
        page.goto(client.robot("ur5").url)
        figure = page.locator("figure.chart")
        figure.scroll_into_view_if_needed()
        csv_link = figure.get_by_role("link", name="CSV")
        boxes = figure.get_by_role("checkbox")
        figure.get_by_role("checkbox", name=JOINT).check()
        for box in boxes.all()[:3]:
            box.uncheck()
    expect(csv_link).to_be_visible()
    page.wait_for_timeout(3000)
    line = drawn(figure)
    address = str(csv_link.evaluate("(link) => link.href")).split("?")[0]
    truth = recorded(client, address, "rotation" if kind == "joint" else f"{JOINT}/rotation")
    assert len([value for _, value in line if value is not None]) > 20
    assert line[-1][0] - line[0][0] > 3
    assert max(value for _, value in truth) - min(value for _, value in truth) > 1
    assert farthest(line, truth) < TOLERANCE_RAD


def test_the_line_ends_with_the_last_frame(page: Page, watched: object, ur5: tuple[Client, Process]) -> None:
    """While the gateway notices, and when the page of an offline robot is opened."""
    client, agent = ur5
    url = client.robot("ur5").url
    page.goto(url)
    figure = page.locator("figure.chart")
    history = str(figure.get_by_role("link", name="CSV").evaluate("(link) => link.href")).split("?")[0]
    eventually(lambda: has_a_line(figure), "a line")
    agent.send(signal.SIGKILL)
    expect(page.locator("#presence .state[data-state=offline]")).to_be_visible()
    last = recorded(client, history, f"{JOINT}/rotation")[-1][0]
    for _ in range(2):
        eventually(lambda: has_a_line(figure), "a line")
        page.wait_for_timeout(600)
        assert drawn(figure)[-1][0] < last + 0.3
        page.reload()
