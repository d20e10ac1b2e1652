"""A plot draws what was measured: its line is compared with the history in CSV."""

import csv
import re
import signal
from bisect import bisect_left
from collections.abc import Callable, Iterator, Sequence
from datetime import UTC, datetime
from io import StringIO
from itertools import pairwise
from pathlib import Path
from urllib.parse import urlencode

import pytest
from playwright.sync_api import Locator, Page, expect

from accessibility import violations
from browser import LF
from browser import Browser as Client
from commanding import TURTLE, angle, of_joint, of_robot, post, slowly
from fake_robots import FakeRobot, open_session
from page_user import PageUser
from running import Process, eventually
from small_fleet import Place, live

pytestmark = [pytest.mark.processes, pytest.mark.test_all]
JOINT = "wrist_3_joint"
SPEED, TARGET = 0.15, 6.0  # rad/s, rad
TOLERANCE_RAD = 0.02  # lines between points that are a tenth of a second apart
Line = Sequence[tuple[float, float]]
Drawn = Sequence[tuple[float, float | None]]
DATA = "(figure) => figure.plot?.chart?.data.map((each) => [...each])"


@pytest.fixture
def place(tmp_path: Path) -> Place:
    return Place(tmp_path)


@pytest.fixture
def ur5(place: Place) -> Iterator[tuple[Client, Process]]:
    with place.gateway() as (_, client), place.ur5() as agent:
        live(client, "ur5")
        yield client, agent


def drawn(figure: Locator, of: int = 1) -> Drawn:
    """Return the points of a line; it is drawn while its figure is in sight."""
    figure.scroll_into_view_if_needed()
    data = figure.evaluate(DATA)
    return list(zip(data[0], data[of], strict=True)) if data and len(data) > of else []


def end_of(figure: Locator, of: int = 1) -> float:
    """Return the time of the last point with a value, 0 without one."""
    return max((time for time, value in drawn(figure, of) if value is not None), default=0)


def recorded(client: Client, address: str, name: str) -> Line:
    """Return the last five minutes of a column, by time in seconds since 1970."""
    answer = client.http.get(address, params={"last": "PT300S"}, headers={"accept": "text/csv"})
    rows = list(csv.reader(StringIO(answer.text)))
    (column,) = [place for place, title in enumerate(rows[0]) if title.split(" (")[0] == name]
    return [(datetime.fromisoformat(row[0]).timestamp(), float(row[column])) for row in rows[1:] if row and row[column]]


def at(line: Line, time: float) -> float:
    place = bisect_left(line, (time, -10.0))
    (begin, one), (end, other) = line[place - 1], line[place]
    return one + (other - one) * (time - begin) / (end - begin)


def untrue(line: Drawn, truth: Line) -> Drawn:
    """Return the drawn points that are not on the line of the truth."""
    within = [(time, value) for time, value in line if value is not None and truth[0][0] < time < truth[-1][0]]
    return [(time, value) for time, value in within if abs(value - at(truth, time)) > TOLERANCE_RAD]


def steps(line: Drawn, speed: float) -> Sequence[tuple[float, float]]:
    """Return beginnings and ends of what is drawn faster than the joint has moved."""
    pairs = [(a, b) for a, b in pairwise(line) if a[1] is not None and b[1] is not None]
    return [(a[0], b[0]) for a, b in pairs if abs(b[1] - a[1]) > 2 * speed * (b[0] - a[0]) + TOLERANCE_RAD]


def address_of(csv_link: Locator) -> str:
    return str(csv_link.evaluate("(link) => link.href")).split("?")[0]


def on_the_page_of_the_joint(page: Page, client: Client) -> tuple[Locator, str, str]:
    page.goto(client.part("ur5", JOINT).url)
    figure = page.locator('figure.plot[data-subject$="/rotation"]').first
    return figure, address_of(figure.locator("a[download]")), "rotation"


def on_the_page_of_the_robot(page: Page, client: Client) -> tuple[Locator, str, str]:
    page.goto(client.robot("ur5").url)
    figure = page.locator("figure.chart")
    boxes = figure.get_by_role("checkbox")
    figure.get_by_role("checkbox", name=JOINT).check()
    for box in boxes.all()[:3]:
        box.uncheck()
    return figure, address_of(figure.get_by_role("link", name="CSV")), f"{JOINT}/rotation"


def on_a_board(page: Page, client: Client) -> tuple[Locator, str, str]:
    page.goto(board(client, f"ur5/{JOINT}/rotation"))
    return page.locator(".board-charts figure"), f"{client.root}ur5/{JOINT}/rotation/history", "rotation"


def board(client: Client, *lines: str) -> str:
    """Save a board and return its address."""
    given = {"title": "Joints", "lines": [client.root + each for each in lines]}
    return client.http.post(client.root + "boards", json=given).headers["location"]


Opened = Callable[[Page, Client], tuple[Locator, str, str]]
all_pages = pytest.mark.parametrize("opened", [on_the_page_of_the_joint, on_the_page_of_the_robot, on_a_board])


@all_pages
def test_the_line_of_a_moving_joint_is_that_of_the_csv(
    page: Page, watched: object, ur5: tuple[Client, Process], opened: Opened
) -> None:
    """The page is opened during a motion: no step is drawn where the history meets the live values."""
    client, _ = ur5
    answer = client.http.put(of_joint(client, JOINT), content=slowly(TARGET, speed=SPEED), headers=TURTLE)
    assert answer.is_success, answer.text
    eventually(lambda: angle(client, JOINT) > 0.2, "a history of the motion")
    figure, address, name = opened(page, client)
    eventually(lambda: end_of(figure) > 0, "a line")
    loaded_s, loaded_rad = end_of(figure), angle(client, JOINT)
    eventually(lambda: end_of(figure) > loaded_s + 2, "live values")
    assert post(client, of_robot(client, LF.StopRobot)).is_success
    stopped_s = recorded(client, address, name)[-1][0]
    eventually(lambda: end_of(figure) > stopped_s + 1, "a line beyond the stop")
    line, truth = drawn(figure), recorded(client, address, name)
    assert truth[-1][1] < TARGET - 0.1, "the motion ended before the stop"
    assert untrue(line, truth) == []
    assert steps(line, SPEED) == []
    moving = [value for _, value in line if value is not None and value > 0.1]
    assert min(moving) < loaded_rad < max(moving)


@all_pages
def test_the_line_of_a_resting_robot_goes_on(
    page: Page, watched: object, ur5: tuple[Client, Process], opened: Opened
) -> None:
    """It sends frames that say the same, which are no news; its last frame is not told by the time of the page."""
    client, _ = ur5
    figure, _, _ = opened(page, client)
    eventually(lambda: end_of(figure) > 0, "a line")
    begin = end_of(figure)
    eventually(lambda: end_of(figure) > begin + 4, "more of it")
    if opened is on_the_page_of_the_robot:
        expect(page.locator(f'time[data-path="{LF.lastFrame}"]')).to_have_text("live")


@pytest.mark.parametrize("opened", [on_the_page_of_the_robot, on_a_board])
def test_the_line_ends_with_the_last_frame(
    page: Page, watched: object, ur5: tuple[Client, Process], opened: Opened
) -> None:
    """While the gateway notices, and when the page of an offline robot is opened."""
    client, agent = ur5
    figure, address, name = opened(page, client)
    eventually(lambda: end_of(figure) > 0, "a line")
    agent.send(signal.SIGKILL)
    if opened is on_a_board:
        expect(page.locator("[data-line] data")).to_have_text("offline")
    else:
        expect(page.locator("#presence .state[data-state=offline]")).to_be_visible()
    last = recorded(client, address, name)[-1][0]
    for _ in range(2):
        eventually(lambda: last - 0.3 < end_of(figure) < last + 0.3, lambda: f"{end_of(figure)} is {last}")
        assert drawn(figure)[-1][1] is None
        page.reload()


def test_a_board_has_numbers_of_several_robots_in_one_chart(
    ur5: tuple[Client, Process], place: Place, operator: PageUser
) -> None:
    """Lines are chosen by robot and value; one unit is one chart, a part of which can be looked at closer."""
    client, _ = ur5
    page = operator.page
    with place.robot("panda") as panda:
        live(client, "panda")
        page.goto(client.root + "boards")
        page.get_by_label("Title").fill("Wrists")
        page.get_by_label("Robot").select_option(f"{client.root}ur5/")
        page.get_by_label("Value").select_option("wrist_3_joint rotation")
        operator.press(page.get_by_role("button", name="Save the board"))
        charts, lines = page.locator(".board-charts figure"), page.locator("[data-line]")
        expect(charts).to_have_count(1)
        page.get_by_label("Robot").select_option(f"{client.root}panda/")
        for count, value in ((2, "panda_joint4 rotation"), (3, "panda_joint4 effort")):
            page.get_by_label("Value").select_option(value)
            operator.press(page.get_by_role("button", name="Add this line"))
            expect(lines).to_have_count(count)
        expect(charts).to_have_count(2)
        angles = charts.filter(has_text="in rad")
        eventually(lambda: all(end_of(angles, of) > 0 for of in (1, 2)), "two lines in one chart")
        values = [[value for _, value in drawn(angles, of) if value is not None] for of in (1, 2)]
        assert {round(each[-1], 1) for each in values} == {0.0, -2.4}
        panda.stop()
        expect(lines.filter(has_text="panda").first.locator("data")).to_have_text("offline")
        expect(lines.filter(has_text="ur5").locator("data")).to_have_text(re.compile(" rad$"))
    if not operator.touch:
        box = angles.locator(".canvas").bounding_box()
        assert box is not None
        page.mouse.move(box["x"] + box["width"] * 0.6, box["y"] + 50)
        page.mouse.down()
        page.mouse.move(box["x"] + box["width"] * 0.9, box["y"] + 50, steps=4)
        page.mouse.up()
        scale = "(figure) => figure.plot.chart.scales.x.max - figure.plot.chart.scales.x.min"
        assert angles.evaluate(scale) < 30
        operator.press(page.get_by_role("button", name="Follow what is measured now"))
        eventually(lambda: angles.evaluate(scale) > 59, "the last minute")
    operator.press(lines.filter(has_text="effort").get_by_role("button"))
    expect(charts).to_have_count(1)


def test_a_board_shows_the_times_of_a_timeline_and_leads_back(page: Page, ur5: tuple[Client, Process]) -> None:
    """Its slider shows what was measured at a time, in all charts."""
    client, _ = ur5
    answer = client.http.put(of_joint(client, JOINT), content=slowly(0.5, speed=1.0), headers=TURTLE)
    assert answer.is_success, answer.text
    eventually(lambda: angle(client, JOINT) > 0.49, "the end of the motion")
    _, address, name = on_a_board(page, client)
    board_page = page.url
    times = [time for time, value in recorded(client, address, name) if value is not None]
    begin, until = (
        datetime.fromtimestamp(each, UTC).isoformat(timespec="milliseconds") for each in (times[0], times[-1])
    )
    window = urlencode({"from": begin.replace("+00:00", "Z"), "until": until.replace("+00:00", "Z")})
    page.goto(f"{client.root}timeline?{window}")
    page.get_by_role("link", name="Boards of this time").click()
    page.locator(f'.boards a[href^="{board_page}?"]').click()
    figure = page.locator(".board-charts figure")
    eventually(lambda: end_of(figure) > 0, "the line of that time")
    assert end_of(figure) <= times[-1]
    page.get_by_label("Time").fill("0")
    shown = page.locator("[data-line] data")
    eventually(lambda: abs(float(shown.get_attribute("value") or 9)) < 0.1, "the value of the beginning")
    page.get_by_label("Time").fill("999")
    eventually(lambda: abs(float(shown.get_attribute("value") or 9) - 0.5) < 0.1, "the value of the end")
    expect(page.get_by_role("link", name="What happened in this time")).to_have_attribute(
        "href", re.compile("from=.*#at=")
    )
    assert violations(page) == []
    page.get_by_role("button", name="Follow what is measured now").click()
    eventually(lambda: end_of(figure) > times[-1] + 1, "the present")


def test_a_robot_whose_clock_is_behind_is_drawn_at_the_present_and_named(page: Page, place: Place) -> None:
    with place.gateway() as (_, client), open_session(place.zenoh) as session:
        late = FakeRobot(session, "late").appear()
        late.behind_s = 40.0
        late.stand(0.3)
        live(client, "late")
        page.goto(board(client, "late/elbow/rotation"))
        expect(page.locator("[data-clock]")).to_have_text(re.compile("its clock is (39|40|41) s behind"))
        figure = page.locator(".board-charts figure")
        eventually(lambda: end_of(figure) > datetime.now(UTC).timestamp() - 5, "the present")
        assert violations(page) == []
