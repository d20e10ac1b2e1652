"""Tasks of an operator on a desktop and on a phone, counted in clicks or taps, and in drags."""

import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from playwright.sync_api import Locator, Page, expect

from browser import LF
from browser import Browser as Client
from commanding import TURTLE, of_joint, of_robot, slowly
from fake_robots import FakeRobot, many_robots, open_session
from page_user import PageUser
from running import eventually
from small_fleet import Place

pytestmark = [pytest.mark.processes, pytest.mark.test_all]
THOUSAND = 1000
ON_A_PAGE = 100
FETCHED = "performance.getEntriesByType('resource').filter(({ name }) => name.endsWith('/thumbnail')).length"
# Where the target is on the screen that is dragged in the scene of a robot.
TARGET = """() => {
    const { view, robot } = document.getElementById("scene").scene;
    const point = robot.children.find((each) => each.children.some(({ type }) => type === "AxesHelper"));
    if (!point) return null;
    const at = point.getWorldPosition(point.position.clone()).project(view.camera);
    const { left, top, width, height } = view.canvas.getBoundingClientRect();
    return [left + ((at.x + 1) / 2) * width, top + ((1 - at.y) / 2) * height];
}"""


@pytest.fixture
def moving(client: Client) -> Iterator[str]:
    """An invocation that takes longer than its test."""
    answer = client.http.post(of_joint(client, "shoulder_pan_joint"), content=slowly(3.0, speed=0.02), headers=TURTLE)
    assert answer.is_success, answer.text
    yield answer.headers["location"]
    client.http.post(of_robot(client, LF.StopRobot))


@pytest.mark.task("See which robot moves, and go to it", presses=1)
def test_a_moving_robot_is_reached_with_one_click(operator: PageUser, client: Client, moving: str) -> None:
    """The card of the robot says what it does; a press on it leads to the robot, whose page shows how far that is."""
    page = operator.page
    page.goto(client.root)
    card = page.locator("#robots .card", has=page.locator(".activity.busy"))
    expect(card).to_contain_text("shoulder_pan_joint")
    thumbnail = card.locator(".thumbnail img")
    assert thumbnail.evaluate("async (image) => { await image.decode(); return image.naturalWidth; }") > 0
    before = thumbnail.get_attribute("src")
    eventually(_changed(thumbnail, before), "another pose on the card")
    operator.press(card.locator("h3 a"))
    expect(page.locator("#tasks .task, .task").first).to_contain_text("shoulder_pan_joint")


def _changed(image: Locator, before: str | None) -> Callable[[], bool]:
    def look() -> bool:
        image.page.wait_for_timeout(100)  # which is when its events come
        return image.get_attribute("src") != before

    return look


@pytest.mark.task("Bring the tip of an arm to a point in 3D", presses=3)
@pytest.mark.webgl
def test_a_point_is_reached_in_the_scene(operator: PageUser, client: Client) -> None:
    """Open *reach*, drag its target, whereupon a dry run says what would happen, and send it."""
    page = operator.page
    page.goto(client.robot("ur5").url)
    expect(page.locator("#scene")).to_have_attribute("data-phase", "ready")
    details = page.locator("details[data-reach]")
    operator.press(details.locator("summary"))
    form = details.locator("form.invoke")
    height = form.locator(f'fieldset[data-path="{LF.position}"] input[data-path$="#y"]')
    eventually(lambda: page.evaluate(TARGET), "the target in the scene")
    before = height.input_value()
    page.locator("#scene canvas").scroll_into_view_if_needed()
    eventually(_drawn(page), "a drawing of the target")
    operator.drag(*page.evaluate(TARGET), right=-6)
    expect(height).not_to_have_value(before)
    expect(form.locator(".answer")).to_contain_text("It would work")
    operator.press(form.get_by_role("button", name="reach", exact=True))
    expect(form.locator(".task .state")).to_have_text("succeeded")


def _drawn(page: Page) -> Callable[[], Any]:
    """The gizmo can be taken hold of once it was drawn where it is."""
    drawn = "() => new Promise((resolve) => requestAnimationFrame(() => requestAnimationFrame(() => resolve(true))))"
    return lambda: page.evaluate(drawn)


@pytest.mark.task("Download what a robot did", presses=1)
def test_a_recording_is_downloaded_with_one_click(operator: PageUser, client: Client) -> None:
    page = operator.page
    page.goto(client.robot("ur5").url)
    figure = page.locator("figure.chart")
    figure.scroll_into_view_if_needed()
    eventually(lambda: int(figure.get_attribute("data-remembered") or 0) > 5, "the past")
    with page.expect_download() as download:
        operator.press(figure.get_by_role("link", name="MCAP"))
    assert download.value.suggested_filename == "ur5-history.mcap"
    assert download.value.path().read_bytes().startswith(b"\x89MCAP")


@pytest.mark.task("Find the past of a joint in plots", presses=2)
def test_the_history_of_a_robot_is_found_with_two_clicks(operator: PageUser, client: Client) -> None:
    """From any page: its chart is filled with the past, of several joints, and reaches as far back as one likes."""
    page = operator.page
    page.goto(client.part("ur5", "elbow_joint").url)
    operator.press(page.get_by_role("navigation", name="Sections").get_by_role("link", name="History"))
    expect(page.get_by_role("heading", level=1)).to_have_text("History")
    assert operator.fits()
    operator.press(page.get_by_role("row", name=re.compile("^ur5")).get_by_role("link", name="ur5", exact=True))
    operator.finish()
    figure = page.locator("figure.chart")
    eventually(lambda: int(figure.get_attribute("data-remembered") or 0) > 5, "the past")
    drawing = figure.locator("[role=img]")
    expect(drawing).to_have_attribute("aria-label", re.compile("^position of .*, .*, .*, last 60 s$"))
    figure.get_by_label("wrist_1_joint").check()
    figure.get_by_label("of the last").select_option("5 minutes")
    expect(drawing).to_have_attribute("aria-label", re.compile("wrist_1_joint.*, last 300 s$"))
    operator.press(page.get_by_role("link", name="velocity of elbow_joint"))
    expect(page.locator("#observed tbody tr").first).to_contain_text("rad/s")


@pytest.fixture
def thousand(tmp_path: Path) -> Iterator[tuple[Client, list[FakeRobot]]]:
    """A thousand robots, each of which sends a position once a second."""
    place = Place(tmp_path)
    with place.gateway() as (_, client), open_session(place.zenoh) as session, many_robots(session, THOUSAND) as actors:
        eventually(lambda: f"{THOUSAND} robots</h2>" in front_page(client), "a thousand robots")
        yield client, actors


@pytest.mark.task("Find one of a thousand robots", presses=1)
def test_a_thousand_robots_can_be_searched(thousand: tuple[Client, list[FakeRobot]], operator: PageUser) -> None:
    """``bench/console.py`` measures what it costs."""
    (client, actors), page = thousand, operator.page
    page.goto(client.root, wait_until="domcontentloaded")
    title, cards = page.locator("#robots-title"), page.locator("#robots .card")
    expect(title).to_have_text(f"{THOUSAND} robots")
    expect(cards).to_have_count(ON_A_PAGE)
    expect(page.locator("nav.pages")).to_contain_text(f"Robots 1 to {ON_A_PAGE} of {THOUSAND}")
    page.locator("#filter-text").fill("robot-09 robot")
    expect(title).to_have_text(f"100 of {THOUSAND} robots")
    for actor in actors[900:905]:
        actor.leave()
    page.get_by_label("Presence").select_option("offline")
    expect(title).to_have_text(f"5 of {THOUSAND} robots")
    page.get_by_label("Kind").select_option("synthetic")
    page.locator("#filter-text").fill("robot-0903")
    expect(cards).to_have_count(1)
    expect(page.locator("#counts")).to_have_text(f"{THOUSAND - 5} online 5 offline")
    assert page.evaluate(FETCHED) < 60
    operator.press(page.locator("#robots .card:visible a"))
    expect(page.get_by_role("heading", level=1)).to_have_text("The robot-0903")


def front_page(client: Client) -> str:
    return client.http.get(client.root, headers={"accept": "text/html"}).text
