"""The cost of pages for the browser: the fleet with 200 robots of which some come and go, and a moving joint."""

import tempfile
import threading
import time
from pathlib import Path

from playwright.sync_api import Page, sync_playwright

from bench.table import Row, UnavailableError, bounded, known, percentile
from chromium import EXECUTABLE, MISSING, launch
from fake_robots import FakeRobot, open_session
from running import eventually, process
from small_fleet import Place, live

# Times between two animation frames, for so many seconds.
_FRAMES = """seconds => new Promise(done => {
  const gaps = [], end = performance.now() + seconds * 1000;
  let last = performance.now();
  requestAnimationFrame(function step(now) {
    gaps.push(now - last); last = now;
    now < end ? requestAnimationFrame(step) : done(gaps.slice(1));
  });
})"""

_FIRST = 20
"""Messages after which those that show the present state once have come."""
_COUNT = """() => {
  window.seen = 0;
  const observer = new MutationObserver(changes => { window.seen += changes.length; });
  const all = {subtree: true, childList: true, characterData: true, attributes: true};
  observer.observe(document.querySelector("main"), all);
}"""


def rows(seconds: float, robots: int = 200) -> list[Row]:
    if EXECUTABLE is None:
        raise UnavailableError(MISSING)
    with sync_playwright() as playwright:
        browser = launch(playwright)
        found = [
            *_fleet(browser.new_page(), robots, seconds),
            *_joint(browser.new_page(), seconds),
            *_robot(browser.new_page(), max(1.0, seconds)),
        ]
        browser.close()
    return found


def _fleet(page: Page, robots: int, seconds: float) -> list[Row]:
    """Measure the page of the fleet. Robots send frames at 20 Hz from one thread; ten come and go twice a second."""
    with tempfile.TemporaryDirectory() as folder:
        place = Place(Path(folder))
        with place.gateway() as (_, browser), open_session(place.zenoh) as session:
            actors = [FakeRobot(session, f"robot-{number:03}").appear() for number in range(robots)]
            ended = threading.Event()
            threads = [
                threading.Thread(target=_send, args=(actors, ended)),
                threading.Thread(target=_come_and_go, args=(actors[:10], ended)),
            ]
            page.goto(browser.root)
            page.wait_for_function(f"() => document.querySelectorAll('#robots .robot').length === {robots}")
            for thread in threads:
                thread.start()
            try:
                found = _measure(f"page of {robots} robots of which ten come and go", page, seconds)
            finally:
                ended.set()
                for thread in threads:
                    thread.join()
    return found


def _send(actors: list[FakeRobot], ended: threading.Event) -> None:
    angle = 0.0
    while not ended.wait(0.05):
        angle = 0.5 - angle
        for actor in actors:
            actor.put("state", actor.frame([angle]))


def _come_and_go(actors: list[FakeRobot], ended: threading.Event) -> None:
    while not ended.wait(0.25):
        for actor in actors:
            actor.leave()
        ended.wait(0.25)
        for actor in actors:
            actor.appear()


def _joint(page: Page, seconds: float) -> list[Row]:
    with tempfile.TemporaryDirectory() as folder:
        place = Place(Path(folder))
        with place.gateway() as (_, browser), place.ur5("--sway", "ur5:elbow_joint"):
            live(browser, "ur5")
            page.goto(browser.part("ur5", "elbow_joint").url)
            page.wait_for_selector(".plot canvas")
            return _measure("page of a joint that sways, with plots", page, seconds)


def _robot(page: Page, seconds: float) -> list[Row]:
    """Let a robot of twenty joints move one of them. Messages are those of all WebSockets of its page."""
    messages, name = list[int](), "page of a robot of 20 joints that moves: a message on its live connections"
    page.on("websocket", lambda socket: socket.on("framereceived", lambda said: messages.append(len(said))))
    with tempfile.TemporaryDirectory() as folder:
        place = Place(Path(folder))
        agent = process("-m", "linked_fleet_agent", "--robot=baxter", "--sway=baxter:left_s0", "--connect", place.zenoh)
        with place.gateway() as (_, browser), agent:
            page.goto(live(browser, "baxter").url)
            eventually(lambda: page.wait_for_timeout(50) or len(messages) > _FIRST, "messages")
            messages.clear()
            began_s = time.monotonic()
            eventually(lambda: page.wait_for_timeout(seconds * 1e3) or messages, "a message from a very busy machine")
            found, took_s = messages[:], time.monotonic() - began_s
    return [
        bounded(f"{name}, mean", "B", sum(found) / len(found), 1000),
        known(f"{name}, each second", "1/s", len(found) / took_s),
    ]


def _measure(name: str, page: Page, seconds: float) -> list[Row]:
    session = page.context.new_cdp_session(page)
    session.send("Performance.enable")
    page.evaluate(_COUNT)

    def busy_s() -> float:
        metrics = {each["name"]: each["value"] for each in session.send("Performance.getMetrics")["metrics"]}
        return float(metrics["TaskDuration"])

    gaps: list[float] = []
    while not gaps:  # a very busy machine may draw no frame at all
        before = busy_s()
        gaps = page.evaluate(_FRAMES, seconds)
        busy = busy_s() - before
    eventually(lambda: page.evaluate("window.seen"), "a change on the page")
    return [
        known(f"{name}: its main thread", "%", busy / seconds * 100),
        known(f"{name}: between two frames, p99", "ms", percentile(gaps, 0.99)),
    ]
