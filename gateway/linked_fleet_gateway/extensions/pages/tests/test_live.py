"""Pages follow changes without being reloaded."""

import re
import signal
from pathlib import Path

import pytest
from playwright.sync_api import Locator, Page, expect

from browser import DCTERMS, LF, VOM
from gateway_group import Gateway, Hub, gateway, hub
from running import eventually
from small_fleet import Place, live, offline
from watched_page import Watched

pytestmark = pytest.mark.processes


def _position(page: Page, joint: Gateway) -> Locator:
    return page.locator(f'data[data-subject="{joint.rotation}"][data-path$="{VOM.numericalValue}"]').first


def _mark(page: Page) -> None:
    """Mark a page with something that a reload would lose."""
    page.evaluate("window.marked = true")


def _same(page: Page) -> bool:
    return bool(page.evaluate("window.marked === true"))


def test_a_value_changes_without_reload(page: Page, watched: object, toy: tuple[Hub, Gateway]) -> None:
    """The number, its unit in degrees, and its age; the past minute is plotted beside it."""
    robot, one = toy
    page.goto(one.joint)
    _mark(page)
    value = _position(page, one)
    # The history begins after the first message.
    figure = page.locator(f'figure.plot[data-subject="{one.rotation}"]').first
    expect(figure).to_have_attribute("data-points", re.compile(r"\d+"))
    for _ in range(3):
        robot.step()
        expect(value).to_have_text(f"{robot.angle:g}")
    expect(value.locator("xpath=../*[@class='converted']")).to_have_text("0.2°")
    expect(page.locator(f'time[data-subject="{one.rotation}"]').first).to_have_text(re.compile("s ago$"))
    expect(figure.locator("canvas")).to_be_visible()
    expect(figure.locator("[role=img]")).to_have_attribute(
        "aria-label", re.compile(r"rotation.*last minute: from 0.* to 0.*, now 0\.00")
    )
    assert _same(page)


def test_an_unknown_value_says_so(page: Page, watched: object, toy: tuple[Hub, Gateway]) -> None:
    """The toy measures no velocity."""
    _, one = toy
    page.goto(one.joint)
    velocity = str(one.browser.page(one.joint).one(LF.velocity))
    expect(page.locator(f'data[data-subject="{velocity}"]').first).to_have_text("unknown")


def test_a_robot_goes_and_comes_on_the_page_of_the_fleet(page: Page, watched: object, tmp_path: Path) -> None:
    """It appears, is marked offline with the time when it was last seen, and is online again."""
    place = Place(tmp_path)
    with place.gateway() as (_, browser):
        page.goto(browser.root)
        _mark(page)
        state = page.locator("#robots .state")
        with place.ur5() as agent:
            expect(state).to_have_text("online")
            live(browser, "ur5")
            agent.send(signal.SIGKILL)
            expect(state).to_have_text("offline")
            expect(page.locator("#robots")).to_contain_text("last seen")
        with place.ur5():
            expect(state).to_have_text("online")
            expect(page.locator("#robots .thumbnail > img")).to_be_visible()  # of the new card
        assert _same(page)


def test_a_robot_that_left_is_marked_on_the_page_of_its_joint(page: Page, watched: object, tmp_path: Path) -> None:
    place = Place(tmp_path)
    with place.gateway() as (_, browser):
        with place.ur5() as agent:
            live(browser, "ur5")
            page.goto(browser.part("ur5", "elbow_joint").url)
            expect(page.locator("#presence .state[data-state=offline]")).to_have_count(0)
            agent.send(signal.SIGKILL)
            expect(page.locator("#presence .state[data-state=offline]")).to_be_visible()
        offline(browser, "ur5")


@pytest.mark.parametrize("width", [1280, 390], ids=["desk", "phone"])
def test_a_lost_connection_is_shown_and_recovers(
    page: Page,
    watched: Watched,
    tmp_path: Path,
    width: int,
) -> None:
    """The gateway is killed and restarted: meanwhile the page shows that its values are old."""
    page.set_viewport_size({"width": width, "height": 844})
    with hub() as robot:
        port = None
        with gateway(robot, state=tmp_path) as one:
            port = int(one.browser.root.rsplit(":", 1)[1].strip("/"))
            page.goto(one.joint)
            _mark(page)
            expect(page.locator("#connection")).to_be_hidden()
            robot.step()
            value = _position(page, one)
            expect(value).to_have_text(f"{robot.angle:g}")
            one.process.send(signal.SIGKILL)
            expect(page.locator("#connection")).to_contain_text("onnection lost")
        robot.step()
        with gateway(robot, port=port, state=tmp_path):
            expect(page.locator("#connection")).to_be_hidden()
            robot.step()
            expect(value).to_have_text(f"{robot.angle:g}")
            assert _same(page)
    watched.forgive("WebSocket connection", "Failed to load resource")


def test_changes_of_other_facts_are_shown_live(page: Page, watched: object, toy: tuple[Hub, Gateway]) -> None:
    """The title of a robot is changed elsewhere; opened parts of the page stay open."""
    _, one = toy
    robot = one.browser.robot("toy")
    page.goto(robot.url)
    _mark(page)
    title = str(robot.property(LF.TextProperty))
    said = '@prefix lf: <https://w3id.org/linked-fleet#> . <> lf:value "Ada" .'
    details = page.locator("details.action").first
    details.locator("summary").click()
    expect(details.locator("form.invoke")).to_be_visible()
    page.locator("h1").click()
    answer = one.browser.http.put(title, content=said, headers={"content-type": "text/turtle"})
    assert answer.status_code == 204, answer.text
    eventually(lambda: str(one.browser.page(robot.url).graph.value(robot.iri, DCTERMS.title)) == "Ada", "the title")
    expect(page.locator("#settings")).to_contain_text("Ada")
    expect(details.locator("form.invoke")).to_be_visible()
    assert _same(page)
