"""The steps of a first-time visitor: look, walk, watch, move, stop. Takes the pictures for the README."""

import os
import re
import signal
from collections.abc import Iterator
from itertools import combinations
from pathlib import Path
from urllib.parse import urlsplit

import pytest
from playwright.sync_api import Page, expect

from animation import animate
from browser import Browser as Client
from browser import all_live
from commanding import angle
from linked_fleet_demo.tree import PLACES, ROBOTS
from linked_fleet_demo.tree import set_placement as place_robot
from page_user import PageUser
from running import Process, eventually, process
from small_fleet import Place
from watched_page import Watched

pytestmark = [pytest.mark.processes, pytest.mark.test_all, pytest.mark.webgl]
PICTURES = os.environ.get("LINKED_FLEET_PICTURES")  # a folder; without it the pictures are discarded


@pytest.fixture(scope="module")
def demo(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Client, Process]]:
    """Yield the robots of the demo, of which the UR5 can be stopped."""
    place = Place(tmp_path_factory.mktemp("state"))
    others = (f"--robot={name}" for name in ROBOTS if name != "ur5")
    agents = process("-m", "linked_fleet_agent", *others, "--connect", place.zenoh)
    with place.gateway() as (_, client), place.ur5() as ur5, agents:
        eventually(lambda: all_live(client, len(ROBOTS)), "six live robots")
        for robot in client.robots():
            place_robot(robot.url, PLACES[urlsplit(robot.url).path.strip("/")])
        yield client, ur5


def picture(page: Page, name: str, folder: Path) -> None:
    page.screenshot(path=Path(PICTURES or folder) / f"{name}.png")


def _rotate(page: Page, degrees: str, speed: str = "") -> None:
    """Fill in the form of ``rotate`` on the open page of the joint."""
    details = page.locator("details.action").filter(has=page.get_by_text("rotate", exact=True))
    if details.get_attribute("open") is None:
        details.locator("summary").click()
    form = details.locator("form.invoke")
    form.locator('> .field > input[data-path$="numericalValue"]').fill(degrees)
    if speed:
        form.get_by_text("Options", exact=True).click()
        form.locator('input[data-path$="#speedScale"]').fill(speed)
    form.get_by_role("button", name="rotate", exact=True).click()


def _drawn(page: Page, joint: str) -> float:
    return float(page.evaluate("joint => document.getElementById('scene').scene.positions()[joint]", joint))


def test_from_the_root_to_a_joint_that_moves(
    page: Page, watched: object, demo: tuple[Client, Process], tmp_path: Path
) -> None:
    """The value changes without a reload, the drawn robot matches the real one, and a motion can be cancelled."""
    client, _ = demo
    page.goto(client.root)
    expect(page.locator("#robots .state[data-state=online]")).to_have_count(len(ROBOTS))
    expect(page.locator("#scene")).to_have_attribute("data-phase", "ready")
    expect(page.locator(".scene-names a:visible")).to_have_count(len(ROBOTS))
    picture(page, "fleet", tmp_path)
    if PICTURES:
        animate(page, client, Path(PICTURES) / "world.webp")

    page.get_by_role("link", name="Baxter, a two-armed robot").click()
    expect(page.locator("#scene")).to_have_attribute("data-phase", "ready")
    picture(page, "robot", tmp_path)

    page.get_by_role("link", name="right_s1", exact=True).click()
    page.evaluate("window.untouched = true")
    _rotate(page, "-60")
    expect(page.locator(".task .state").first).to_have_text("succeeded")
    expect(page.locator("#lead .figure .converted")).to_have_text(re.compile(r"^.(60|59\.9)"))
    page.evaluate("scrollTo({ top: 0, behavior: 'instant' })")
    picture(page, "joint", tmp_path)

    _rotate(page, "20", speed="0.05")
    card = page.locator(".task[data-state=running]")
    card.get_by_role("button", name="Cancel").click()
    expect(page.locator(".task[data-state=cancelled]")).to_be_visible()
    assert page.evaluate("window.untouched")

    page.get_by_role("link", name="Baxter, a two-armed robot").first.click()
    expect(page).to_have_url(f"{client.root}baxter/")
    expect(page.locator("#scene")).to_have_attribute("data-phase", "ready")
    measured = angle(client, "right_s1", "baxter")
    assert measured < -0.9
    eventually(lambda: abs(_drawn(page, "right_s1") - measured) < 0.01, f"the drawn joint at {measured} rad")


NAMES = """() => [...document.querySelectorAll(".scene-names a")].filter((each) => !each.hidden).map((each) => {
    const { left, right, top, bottom } = each.getBoundingClientRect();
    return { name: each.textContent, left, right, top, bottom };
})"""
TURN = """() => new Promise((resolve) => {
    document.getElementById("scene").scene.view.turn(Math.PI / 4, 0);
    requestAnimationFrame(() => requestAnimationFrame(resolve));
})"""


def test_names_of_robots_do_not_cover_each_other(operator: PageUser, demo: tuple[Client, Process]) -> None:
    """From eight sides of the world, and none of them leaves the drawing; from the first, all have one."""
    page = operator.page
    page.goto(demo[0].root)
    if operator.touch:
        operator.press(page.get_by_role("button", name="Show the world"))
    expect(page.locator("#scene")).to_have_attribute("data-phase", "ready")
    expect(page.locator(".scene-names a:visible")).to_have_count(len(ROBOTS))
    for _ in range(8):
        shown, frame = page.evaluate(NAMES), page.locator("#scene canvas").bounding_box()
        assert shown and frame is not None
        for one, other in combinations(shown, 2):
            beside = one["right"] <= other["left"] or other["right"] <= one["left"]
            assert beside or one["bottom"] <= other["top"] or other["bottom"] <= one["top"], (one, other)
        for each in shown:
            assert frame["x"] - 1 <= each["left"] and each["right"] <= frame["x"] + frame["width"] + 1, each
            assert frame["y"] - 1 <= each["top"] and each["bottom"] <= frame["y"] + frame["height"] + 1, each
        page.evaluate(TURN)


def test_a_robot_that_left_is_marked(page: Page, watched: Watched, demo: tuple[Client, Process]) -> None:
    client, ur5 = demo
    page.goto(client.root)
    card = page.locator("#robots .robot", has_text="UR5")
    expect(card.locator(".state")).to_have_text("online")
    ur5.send(signal.SIGKILL)
    expect(card.locator(".state")).to_have_text("offline")
    card.locator("h3 a").click()
    expect(page.locator("#presence .state")).to_have_text("offline")
    expect(page.locator("#scene")).to_have_attribute("data-phase", "ready")
    watched.forgive("503", "is not drawn")  # meshes that were not requested while it was online
