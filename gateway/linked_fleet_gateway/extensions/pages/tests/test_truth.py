"""Pages show what they do not know: a hanging gateway, a late response, a robot that left."""

import re
import signal
from pathlib import Path

import pytest
from playwright.sync_api import Locator, Page, expect

from browser import LF, VOM
from commanding import WRIST, of_robot, post
from fake_robots import FakeRobot
from gateway_group import Gateway, Hub
from running import eventually
from small_fleet import Place, live
from watched_page import Watched

pytestmark = [pytest.mark.processes, pytest.mark.test_all]


@pytest.mark.parametrize("width", [1280, 390], ids=["desk", "phone"])
def test_a_gateway_that_hangs_is_told_from_one_with_no_news(
    page: Page,
    watched: Watched,
    toy: tuple[Hub, Gateway],
    width: int,
) -> None:
    """An open connection to a stopped process is called silent; values are grey until it continues."""
    robot, one = toy
    page.set_viewport_size({"width": width, "height": 844})
    page.goto(one.joint)
    robot.step()
    value = page.locator(f'data[data-subject="{one.rotation}"][data-path$="{VOM.numericalValue}"]').first
    expect(value).to_have_text(f"{robot.angle:g}")
    weight = "element => getComputedStyle(element.closest('.quantity')).filter"
    assert value.evaluate(weight) == "none"
    one.process.send(signal.SIGSTOP)
    try:
        connection = page.locator("#connection")
        expect(connection).to_have_text(re.compile("has not answered for 5 s: what you see is old"))
        assert "grayscale" in str(value.evaluate(weight))
        assert page.evaluate("document.documentElement.scrollWidth") == width
    finally:
        one.process.send(signal.SIGCONT)
    expect(connection).to_be_hidden()
    robot.step()

    def followed() -> bool:
        robot.repeat()  # a frame is lost while the gateway connects to the robot again
        return value.text_content() == f"{robot.angle:g}"

    eventually(followed, "the page follows again")
    watched.forgive("Failed to load resource")


def test_a_page_that_is_left_alone_stays_live(page: Page, watched: object, toy: tuple[Hub, Gateway]) -> None:
    """A robot that stands still is no hanging gateway: the page polls, and the response counts."""
    _, one = toy
    page.clock.install()
    page.goto(one.joint)
    expect(page.locator("body")).to_have_attribute("data-connection", "live")
    for _ in range(20):
        with page.expect_response(lambda answer: answer.request.method == "HEAD"):
            page.clock.run_for(2500)
        expect(page.locator("body")).to_have_attribute("data-connection", "live")


def test_a_stop_without_reply_is_reported(
    page: Page,
    watched: Watched,
    toy: tuple[Hub, Gateway],
) -> None:
    """After three seconds it refers to the hardware stop, and reports the late response; the button stays in place."""
    _, one = toy
    page.goto(one.joint)
    button, said = page.locator("form.stop button"), page.locator("form.stop output")
    place = button.bounding_box()
    one.process.send(signal.SIGSTOP)
    try:
        button.click()
        expect(said).to_have_text("Stopping…")
        assert button.bounding_box() == place
        expect(said).to_contain_text("No answer — use the hardware stop")
        assert button.bounding_box() == place
    finally:
        one.process.send(signal.SIGCONT)
    # The connection to the robot may have ended meanwhile: then the stop is owed, and the response is 504.
    expect(said).to_contain_text(re.compile("Stop accepted|Not confirmed by toy"))
    assert button.bounding_box() == place
    watched.forgive("Failed to load resource")


def test_a_stop_that_a_robot_has_not_confirmed_names_it(page: Page, watched: Watched, toy: tuple[Hub, Gateway]) -> None:
    """It says that the stop is repeated, too, and refers to the hardware stop."""
    robot, one = toy
    mute = FakeRobot(robot.session, "mute").appear()
    eventually(lambda: "mute" in one.get(one.browser.root).text, "the robot")
    page.goto(one.browser.root)
    page.locator("form.stop button").click()
    said = page.locator("form.stop output")
    expect(said).to_have_text("Not confirmed by mute: the stop is repeated until confirmed. Use the hardware stop.")
    mute.leave()
    watched.forgive("Failed to load resource")


@pytest.mark.parametrize("width", [1280, 390], ids=["desk", "phone"])
def test_the_text_of_a_stop_goes_once_it_is_confirmed(page: Page, watched: Watched, tmp_path: Path, width: int) -> None:
    """A robot and the fleet are stopped while the agent hangs; the agent continues."""
    page.set_viewport_size({"width": width, "height": 844})
    place = Place(tmp_path)
    with place.gateway() as (_, browser), place.ur5() as agent:
        live(browser, "ur5")
        said = page.locator("form.stop output")
        for address in (browser.robot("ur5").url, browser.root):
            page.goto(address)
            agent.send(signal.SIGSTOP)
            try:
                page.locator("form.stop button").click()
                expect(said).to_contain_text("Not confirmed by ur5")
            finally:
                agent.send(signal.SIGCONT)
            expect(said).to_contain_text("Stop confirmed at")
            expect(said).to_have_text("")
            live(browser, "ur5")
    watched.forgive("Failed to load resource")


@pytest.mark.parametrize("width", [1280, 390], ids=["desk", "phone"])
def test_a_stop_without_a_gateway_covers_no_warning_and_is_not_told_for_ever(
    page: Page, watched: Watched, tmp_path: Path, width: int
) -> None:
    """The gateway ends and starts again: it may not have got the stop, which is said once and goes."""
    page.set_viewport_size({"width": width, "height": 844})
    place = Place(tmp_path)
    said, banner = page.locator("form.stop output"), page.locator("#connection")
    with place.ur5():
        with place.gateway() as (_, browser):
            live(browser, "ur5")
            page.goto(browser.robot("ur5").url)
        page.locator("form.stop button").click()
        expect(said).to_have_text("No answer — use the hardware stop.")
        expect(banner).to_be_visible()
        assert not overlap(said, banner)
        page.evaluate("scrollTo(0, 400)")
        assert not overlap(said, banner)
        with place.gateway():
            expect(said).to_contain_text("The gateway answers again")
            expect(said).to_have_text("")
            expect(banner).to_be_hidden()
    watched.forgive("Failed to load resource", "WebSocket connection", "status of 5")


def overlap(one: Locator, other: Locator) -> bool:
    """Return True if two elements cover the same place."""
    a, b = one.bounding_box(), other.bounding_box()
    assert a is not None and b is not None
    beside = a["x"] + a["width"] <= b["x"] or b["x"] + b["width"] <= a["x"]
    return not (beside or a["y"] + a["height"] <= b["y"] or b["y"] + b["height"] <= a["y"])


def test_one_escape_announces_that_a_second_one_stops(page: Page, watched: object, toy: tuple[Hub, Gateway]) -> None:
    """Menus and dialogs use the key, too: the first press sends nothing, and is forgotten after two seconds."""
    _, one = toy
    sent: list[str] = []
    page.on("request", lambda request: sent.append(request.url) if request.method == "POST" else None)
    page.clock.install()
    page.goto(one.joint)
    said = page.locator("form.stop output")
    page.keyboard.press("Escape")
    expect(said).to_contain_text("Press Escape again to stop")
    page.clock.run_for(2000)
    expect(said).to_have_text("")
    assert sent == []
    page.keyboard.press("Escape")
    page.keyboard.press("Escape")
    expect(said).to_contain_text("Stop accepted")
    assert sent[0].endswith("/actions/stopAll")


def test_the_whole_label_of_stop_is_seen_on_a_phone(page: Page, watched: object, toy: tuple[Hub, Gateway]) -> None:
    """It names what it stops; a longer name than in the demo takes a second line."""
    _, one = toy
    page.set_viewport_size({"width": 390, "height": 844})
    page.goto(one.joint)
    button = page.locator("form.stop button")
    for name in ("toy", "warehouse_arm_17"):
        button.locator("bdi").evaluate("(each, name) => (each.textContent = name)", name)
        for each in (button, button.locator("bdi")):
            assert each.evaluate(
                "each => each.scrollWidth <= each.clientWidth && each.scrollHeight <= each.clientHeight + 1"
            )
    assert page.evaluate("document.documentElement.scrollWidth <= innerWidth")


def test_nothing_can_be_sent_to_a_robot_that_is_offline(page: Page, watched: object, tmp_path: Path) -> None:
    """Its numbers are no longer bold, and action forms say why they are disabled, until the robot is back."""
    place = Place(tmp_path)
    with place.gateway() as (_, browser):
        with place.ur5() as agent:
            live(browser, "ur5")
            page.goto(browser.part("ur5", "elbow_joint").url)
            details = page.locator("details.action").first
            details.locator("summary").click()
            send = details.locator("form.invoke button[type=submit]:not([data-prefer])").first
            expect(send).to_be_enabled()
            agent.send(signal.SIGKILL)
            expect(send).to_be_disabled()
            expect(details).to_contain_text("The robot is offline: nothing can be sent to it.")
            number = page.locator("#lead .figure data").first
            assert number.evaluate("each => getComputedStyle(each).fontWeight") == "400"
        with place.ur5():
            expect(send).to_be_enabled()
            expect(details).not_to_contain_text("is offline")


def test_a_card_follows_a_movement_that_no_command_caused(page: Page, watched: object, tmp_path: Path) -> None:
    """It says what the frames show: on a page that is opened during the movement, at its end, and anew."""
    place = Place(tmp_path)
    with place.gateway() as (_, client), place.ur5("--sway", f"ur5:{WRIST}") as agent:
        live(client, "ur5")
        page.goto(client.root)
        card = page.locator("li[data-robot]")
        doing, moved = card.locator("[data-activity]"), card.locator("[data-moved]")
        expect(doing).to_have_text("moving")
        expect(moved).to_have_text("now")
        page.reload()
        expect(doing).to_have_text("moving")
        assert post(client, of_robot(client, LF.StopRobot)).is_success
        expect(doing).to_have_text("idle")
        expect(moved).to_contain_text(re.compile(r"^moved \d.* s ago$"))
        agent.send(signal.SIGUSR1)
        expect(doing).to_have_text("moving")
        expect(moved).to_have_text("now")
