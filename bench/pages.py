"""What pages cost the browser: the fleet with 200 robots of which some come and go, and a robot that moves."""

import argparse
import shutil
import statistics
import sys
import tempfile
import threading
from pathlib import Path

import zenoh
from actor import KEYS, Actor, stage
from playwright.sync_api import Page, sync_playwright
from running import eventually
from small_fleet import Place, live

_ARGUMENTS = [
    "--no-sandbox",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--disable-background-networking",
]
# Time between two animation frames, for as long as asked.
_FRAMES = """seconds => new Promise(done => {
  const gaps = [], end = performance.now() + seconds * 1000;
  let last = performance.now();
  requestAnimationFrame(function step(now) {
    gaps.push(now - last); last = now;
    now < end ? requestAnimationFrame(step) : done(gaps.slice(1));
  });
})"""

_COUNT = """() => {
  window.seen = 0;
  const observer = new MutationObserver(changes => { window.seen += changes.length; });
  const all = {subtree: true, childList: true, characterData: true, attributes: true};
  observer.observe(document.querySelector("main"), all);
}"""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--robots", type=int, default=200)
    parser.add_argument("--seconds", type=float, default=10)
    arguments = parser.parse_args()
    chromium = shutil.which("chromium")
    if chromium is None:
        sys.exit("Chromium is not there: apt install chromium")
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium, args=_ARGUMENTS)
        print(f"{'page':44}{'frames/s':>9}{'p50 ms':>8}{'p99 ms':>8}{'worst':>8}{'main %':>10}{'changes seen':>14}")
        _fleet(browser.new_page(), arguments.robots, arguments.seconds)
        _robot(browser.new_page(), arguments.seconds)
        browser.close()


def _fleet(page: Page, robots: int, seconds: float) -> None:
    """All send frames at 20 Hz from one thread; ten come and go twice a second."""
    with tempfile.TemporaryDirectory() as folder:
        place = Place(Path(folder))
        with place.gateway() as (_, browser), stage(place.zenoh) as session:
            actors = [Actor(session, f"robot-{number:03}").appear() for number in range(robots)]
            ended = threading.Event()
            threads = [
                threading.Thread(target=_send, args=(actors, ended)),
                threading.Thread(target=_come_and_go, args=(session, actors[:10], ended)),
            ]
            page.goto(browser.root)
            page.wait_for_function(f"() => document.querySelectorAll('#robots .robot').length === {robots}")
            for thread in threads:
                thread.start()
            _measure(f"fleet of {robots}, ten come and go at 2 Hz", page, seconds)
            ended.set()
            for thread in threads:
                thread.join()


def _send(actors: list[Actor], ended: threading.Event) -> None:
    angle = 0.0
    while not ended.wait(0.05):
        angle = 0.5 - angle
        for actor in actors:
            actor.put("state", actor.frame([angle]))


def _come_and_go(session: zenoh.Session, actors: list[Actor], ended: threading.Event) -> None:
    while not ended.wait(0.25):
        extra = [
            session.liveliness().declare_token(KEYS.presence(each.name, each.incarnation + 1000)) for each in actors
        ]
        ended.wait(0.25)
        for token in extra:
            token.undeclare()


def _robot(page: Page, seconds: float) -> None:
    with tempfile.TemporaryDirectory() as folder:
        place = Place(Path(folder))
        with place.gateway() as (_, browser), place.ur5("--sway", "ur5:elbow_joint"):
            page.goto(live(browser, "ur5").url)
            page.wait_for_function("() => document.getElementById('scene').dataset.phase === 'ready'")
            _measure("UR5 in 3D (drawn by the processor), swaying", page, seconds)
            page.goto(browser.part("ur5", "elbow_joint").url)
            page.wait_for_selector(".plot canvas")
            _measure("its joint that sways, with plots", page, seconds)


def _measure(name: str, page: Page, seconds: float) -> None:
    session = page.context.new_cdp_session(page)
    session.send("Performance.enable")
    page.evaluate(_COUNT)

    def script() -> float:
        metrics = {each["name"]: each["value"] for each in session.send("Performance.getMetrics")["metrics"]}
        return float(metrics["TaskDuration"])

    before = script()
    gaps = sorted(page.evaluate(_FRAMES, seconds))
    busy = (script() - before) / seconds * 100
    changes = eventually(lambda: page.evaluate("window.seen"), "a change on the page")
    p50, p99, worst = statistics.median(gaps), gaps[int(len(gaps) * 0.99)], gaps[-1]
    print(f"{name:44}{len(gaps) / seconds:9.1f}{p50:8.1f}{p99:8.1f}{worst:8.1f}{busy:10.0f}{changes:14}")


if __name__ == "__main__":
    main()
