"""The cost of the front page: five real robots that all move, visible and hidden, and a thousand robots as cards.

``PYTHONPATH=.:tests:tests/support python -m bench.console``. In processor time if available; Chromium has no
graphics card, so that the processor draws.
"""

import gzip
import os
import tempfile
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from urllib.parse import urlsplit

from playwright.sync_api import Page, sync_playwright

from bench.scene import pid_of
from bench.table import Row, UnavailableError, known
from browser import Browser, all_live
from chromium import EXECUTABLE, MISSING, MainThread, launch
from fake_robots import many_robots, open_session
from linked_fleet_demo.tree import PLACES
from linked_fleet_demo.tree import set_placement as place_robot
from running import Process, eventually, process
from small_fleet import Place

_SWAYS = (
    "baxter:right_s1", "ur5:shoulder_pan_joint", "panda:panda_joint1", "tiago:arm_2_joint", "go2:FL_thigh_joint",
)  # fmt: skip
_THOUSAND = 1000
_DRAWN_MS = 180_000  # meshes of five robots, on a machine without a graphics card that has more to do
_ASKED = 40
_DRAWINGS = """() => {
    const { view } = document.getElementById("scene").scene;
    const draw = view.draw;
    window.drawn = 0;
    view.draw = (...given) => { window.drawn += 1; draw.apply(view, given); };
}"""
_FILTER = """() => {
    const input = document.getElementById("filter-text"), begin = performance.now();
    input.value = "robot-09";
    input.dispatchEvent(new Event("input", { bubbles: true }));
    document.body.offsetHeight;
    return performance.now() - begin;
}"""


def rows(seconds: float) -> list[Row]:
    if EXECUTABLE is None:
        raise UnavailableError(MISSING)
    with sync_playwright() as playwright:
        browser = launch(playwright)
        found = [*_moving(browser.new_page(), max(seconds, 10.0)), *_thousand(browser.new_page(), max(seconds, 10.0))]
        browser.close()
    return found


# -- five robots ----------------------------------------------------------------------------------------------------


@contextmanager
def _demo() -> Iterator[Browser]:
    """Run the robots of the demo, each with a swaying joint."""
    with tempfile.TemporaryDirectory() as folder, ExitStack() as stack:
        place = Place(Path(folder))
        _, browser = stack.enter_context(place.gateway())
        robots = [f"--robot={each.partition(':')[0]}" for each in _SWAYS]
        sways = [part for each in _SWAYS for part in ("--sway", each)]
        stack.enter_context(process("-m", "linked_fleet_agent", *robots, *sways, "--connect", place.zenoh))
        eventually(lambda: all_live(browser, len(_SWAYS)), "five live robots")
        for robot in browser.robots():
            place_robot(robot.url, PLACES[urlsplit(robot.url).path.strip("/")])
        yield browser


def _moving(page: Page, seconds: float) -> Iterator[Row]:
    with _demo() as browser:
        chromium = MainThread(page)
        page.goto(browser.root, wait_until="domcontentloaded")
        name = "front page of five robots"
        timing = "performance.getEntriesByType('navigation')[0].domContentLoadedEventEnd"
        yield known(f"{name}: interactive, by the clock", "ms", page.evaluate(timing))
        yield known(f"{name}: interactive, processor of the main thread", "ms", chromium.busy_s() * 1000)
        page.wait_for_selector("#scene[data-phase=ready]", timeout=_DRAWN_MS)
        page.evaluate(_DRAWINGS)
        page.wait_for_timeout(3000)  # until it has found how well it can draw here
        yield from _share(f"{name}, all moving, drawn by the processor", page, chromium, seconds)
        page.evaluate("document.querySelector('main').style.paddingBottom = '4000px'")
        page.evaluate("scrollTo(0, document.documentElement.scrollHeight)")
        page.wait_for_timeout(1000)
        yield from _share(f"{name}, all moving, out of sight", page, chromium, seconds)


def _share(name: str, page: Page, chromium: "MainThread", seconds: float) -> Iterator[Row]:
    before, drawn, begin = chromium.busy_s(), page.evaluate("window.drawn"), time.monotonic()
    page.wait_for_timeout(seconds * 1000)
    busy, took = chromium.busy_s() - before, time.monotonic() - begin
    yield known(f"{name}: main thread", "%", 100 * busy / took)
    yield known(f"{name}: drawings", "1/s", (page.evaluate("window.drawn") - drawn) / took)


# -- a thousand robots ----------------------------------------------------------------------------------------------


def _thousand(page: Page, seconds: float) -> Iterator[Row]:
    """Measure a thousand robots, each of which sends a new position once a second."""
    with tempfile.TemporaryDirectory() as folder:
        place = Place(Path(folder))
        with (
            place.gateway() as (gateway, browser),
            open_session(place.zenoh) as session,
            many_robots(session, _THOUSAND),
        ):
            eventually(lambda: f"{_THOUSAND} robots</h2>" in _front_page(browser), "a thousand robots")
            yield from _written(browser, gateway)
            yield from _shown(page, browser, seconds)


def _front_page(browser: Browser) -> str:
    return browser.http.get(browser.root, headers={"accept": "text/html"}).text


def _written(browser: Browser, gateway: Process) -> Iterator[Row]:
    body = browser.http.get(browser.root, headers={"accept": "text/html"}).content
    yield known("front page of 1,000 robots", "kB", len(body) / 1000)
    yield known("front page of 1,000 robots, gzip", "kB", len(gzip.compress(body, 6)) / 1000)
    for what, path, accept in (("front page", "", "text/html"), ("thumbnail", "robot-0001/thumbnail", "image/svg+xml")):
        idle = _spent_s(pid_of(gateway), 1.0)
        before, begin = _cpu_s(pid_of(gateway)), time.monotonic()
        for _ in range(_ASKED):
            assert browser.http.get(browser.root + path, headers={"accept": accept}).is_success
        spent = _cpu_s(pid_of(gateway)) - before - idle * (time.monotonic() - begin)
        yield known(f"{what} of 1,000 robots, processor of the gateway", "ms", 1000 * spent / _ASKED)


def _spent_s(pid: int, seconds: float) -> float:
    """Return processor seconds per second, without requests."""
    before = _cpu_s(pid)
    time.sleep(seconds)
    return (_cpu_s(pid) - before) / seconds


def _cpu_s(pid: int) -> float:
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def _shown(page: Page, browser: Browser, seconds: float) -> Iterator[Row]:
    chromium = MainThread(page)
    page.goto(browser.root, wait_until="domcontentloaded")
    page.wait_for_selector("#robots .card:last-child")
    yield known("front page of 1,000 robots: until it is usable, main thread", "ms", chromium.busy_s() * 1000)
    page.wait_for_timeout(3000)
    before, begin = chromium.busy_s(), time.monotonic()
    page.wait_for_timeout(seconds * 1000)
    share = 100 * (chromium.busy_s() - before) / (time.monotonic() - begin)
    yield known("front page of 1,000 robots: main thread", "%", share)
    yield known("front page of 1,000 robots: a step of the filter", "ms", page.evaluate(_FILTER))
    yield known("front page of 1,000 robots: thumbnails that were fetched", "", page.evaluate(_FETCHED))


_FETCHED = "performance.getEntriesByType('resource').filter(({ name }) => name.endsWith('/thumbnail')).length"


if __name__ == "__main__":
    for row in rows(10.0):
        print(f"{row.value:10.1f} {row.unit:5} {row.name}", flush=True)
