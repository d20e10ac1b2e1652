"""Components on pages, as people use them: a gripper, a tool and a protective stop of simulated robots."""

import contextlib
import re
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Locator, Page, expect

from accessibility import violations_in_both_schemes
from running import ROOT, eventually, process
from small_fleet import Place, live
from watched_page import Watched

pytestmark = [pytest.mark.processes, pytest.mark.test_all]


@pytest.fixture(scope="module")
def panda(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    place = Place(tmp_path_factory.mktemp("state"))
    with (
        place.gateway() as (_, browser),
        process("-m", "linked_fleet_agent", "--robot=panda", "--connect", place.zenoh),
    ):
        live(browser, "panda")
        yield place.root + "panda/"


@pytest.fixture
def base(tmp_path: Path) -> Iterator[str]:
    """The page of the base of examples/base.py."""
    place = Place(tmp_path)
    with place.gateway() as (_, browser), process(str(ROOT / "examples" / "base.py"), "--connect", place.zenoh):
        live(browser, "cart")
        yield place.root + "cart/mobile_base"


def do(page: Page, action: str, fill: str = "") -> None:
    """Open the form of an action on the page of its component, and send it."""
    details = page.locator(f'details[data-include$="/{action}"]')
    details.locator("summary").click()
    if fill:
        details.locator("input[type=number]").first.fill(fill)
    details.locator("button[type=submit]:not([data-prefer])").click()
    expect(page.locator(".task").last).to_contain_text("succeeded", timeout=20_000)


def card(page: Page, title: str) -> Locator:
    return page.locator(".card", has=page.get_by_role("heading", name=title, exact=True))


def test_something_is_grasped_held_and_lost(page: Page, watched: object, panda: str) -> None:
    page.goto(panda + "gripper")
    do(page, "open")
    page.goto(panda + "simulation")
    do(page, "putObject", "0.04")
    page.goto(panda + "gripper")
    do(page, "grasp")
    expect(card(page, "Object held")).to_contain_text("true")
    page.goto(panda + "simulation")
    do(page, "takeObject")
    page.goto(panda + "gripper")
    expect(card(page, "Object held")).to_contain_text("false")
    expect(card(page, "Object lost").locator(".figure")).to_contain_text("1")


def test_a_protective_stop_is_shown_and_reset(page: Page, watched: object, panda: str) -> None:
    page.goto(panda + "simulation")
    do(page, "stopProtectively")
    page.goto(panda + "mode")
    expect(card(page, "Protective stop")).to_contain_text("true")
    do(page, "reset")
    expect(card(page, "Protective stop")).to_contain_text("false")


def test_values_with_members_stay_within_their_cards(page: Page, watched: object, base: str) -> None:
    page.set_viewport_size({"width": 1100, "height": 900})
    page.goto(base)
    expect(card(page, "pose")).to_contain_text("heading")
    out = page.evaluate(
        """() => [...document.querySelectorAll(".card *")].filter((each) =>
          each.getBoundingClientRect().right > each.closest(".card").getBoundingClientRect().right)
          .map((each) => each.outerHTML)"""
    )
    assert out == []


def test_a_base_is_driven_and_comes_to_rest(page: Page, watched: object, base: str) -> None:
    page.goto(base)
    do(page, "drive", "0.5")
    expect(card(page, "twist").locator("data").first).to_have_text("0")
    expect(card(page, "pose").locator("data").first).not_to_have_text("0")


def pushed(page: Page, push: Callable[[], None], release: Callable[[], None], seen: str) -> None:
    """Push the stick until the base moves, and release it. On a busy machine it locks until it is released."""
    figures = page.locator("#drive .figures")

    def moves() -> bool:
        push()
        with contextlib.suppress(AssertionError):
            expect(figures).to_have_text(re.compile(seen), timeout=2_000)
            return True
        release()
        return False

    eventually(moves, "a base that moves")
    release()
    expect(figures).to_contain_text("0.00 m/s, 0.00 rad/s")


def test_a_base_is_driven_by_hand(page: Page, base: str, watched: Watched) -> None:
    """By a key, and by the stick itself, until the person lets go."""
    page.goto(base)
    drive = page.locator("#drive")
    drive.get_by_role("button", name="Drive").click()
    expect(drive.get_by_role("status")).to_contain_text("You drive")
    pushed(page, lambda: page.keyboard.down("KeyW"), lambda: page.keyboard.up("KeyW"), r"^0\.[1-3]\d m/s, 0\.00 rad/s")
    stick = drive.locator(".stick").bounding_box()
    assert stick is not None
    x, y = stick["x"] + stick["width"] / 2, stick["y"] + stick["height"] / 2

    def turn() -> None:
        page.mouse.move(x, y)
        page.mouse.down()
        page.mouse.move(stick["x"], y)

    pushed(page, turn, page.mouse.up, r"^0\.00 m/s, 0\.[1-6]\d rad/s")
    drive.get_by_role("button", name="Let go").click()
    expect(drive.get_by_role("status")).to_have_text("You do not drive.")


def test_who_may_not_drive_is_told_why(page: Page, base: str, watched: Watched) -> None:
    robot = base.rpartition("/")[0]
    page.request.put(robot + "/lease", data={"holder": "Ann", "duration": 60})
    page.goto(base)
    page.locator("#drive").get_by_role("button", name="Drive").click()
    expect(page.locator("#drive").get_by_role("status")).to_contain_text("Ann")
    watched.forgive("WebSocket connection", "status of 409")


def position(page: Page, panda: str) -> float:
    """Return where the fourth joint is, in rad."""
    said = page.request.get(f"{panda}panda_joint4/rotation", headers={"accept": "application/json"}).json()
    return float(said["value"])


def test_an_arm_is_jogged_by_hand(page: Page, watched: Watched, panda: str) -> None:
    """Joints and the hand by held buttons, with a key and with the mouse, until the person lets go."""
    page.goto(panda + "jogging")
    jog = page.locator("#jog")

    def held(button: Locator, press: Callable[[], None], release: Callable[[], None]) -> None:
        """Hold a button until the arm moves. On a busy machine the panel locks until it is released."""
        expect(button).to_be_enabled()
        before = position(page, panda)

        button.hover()
        button.focus()
        press()

        def moves() -> bool:
            if "locked" in jog.get_by_role("status").inner_text():
                release()
                press()
            return abs(position(page, panda) - before) > 0.02

        eventually(moves, "an arm that moves")
        release()
        expect(jog.locator(".figures")).to_contain_text("Nothing is held")

    expect(jog.get_by_role("button", name="panda_joint4 plus")).to_be_disabled()
    jog.get_by_role("button", name="Jog", exact=True).click()
    expect(jog.get_by_role("status")).to_contain_text("You jog")
    joint = jog.get_by_role("button", name="panda_joint4 plus")
    held(joint, lambda: page.keyboard.down("Space"), lambda: page.keyboard.up("Space"))
    jog.get_by_role("radio", name="A link").check()
    expect(jog.get_by_role("status")).to_have_text("You do not jog.")
    expect(jog.get_by_label("Link", exact=True).first).to_be_visible()
    jog.get_by_role("button", name="Jog", exact=True).click()
    expect(jog.get_by_role("status")).to_contain_text("You jog")
    held(jog.get_by_role("button", name="Along z plus"), page.mouse.down, page.mouse.up)
    jog.get_by_role("button", name="Let go").click()
    expect(jog.get_by_role("status")).to_have_text("You do not jog.")
    assert violations_in_both_schemes(page) == []
