"""examples/twin.html: a page of another origin that draws a moving robot."""

import contextlib
import functools
import http.server
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Page, expect

from browser import DCTERMS, ROS, Browser
from running import ROOT, process
from small_fleet import Place, live

pytestmark = [pytest.mark.processes, pytest.mark.test_all]

_LINES = "Array.from(document.querySelectorAll('line'), (line) => line.outerHTML).join()"


class _Quiet(http.server.SimpleHTTPRequestHandler):
    def log_message(self, *_: object) -> None:
        pass


@contextlib.contextmanager
def _site() -> Iterator[str]:
    """Serve the files of examples/."""
    handler = functools.partial(_Quiet, directory=str(ROOT / "examples"))
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        yield f"http://127.0.0.1:{server.server_port}"
        server.shutdown()
        thread.join()


def test_the_twin_draws_a_robot_as_it_moves(page: Page, tmp_path: Path) -> None:
    """Each joint between two links is a line, and lines move with the robot."""
    place, errors = Place(tmp_path), list[str]()
    page.on("pageerror", lambda error: errors.append(str(error)))
    with _site() as site, process(*place.command(), "--cors-origins", site) as gateway:
        gateway.said("serving")
        with place.ur5("--sway", "ur5:shoulder_pan_joint"), contextlib.closing(Browser(place.root)) as browser:
            robot = live(browser, "ur5")
            page.goto(f"{site}/twin.html?robot={robot.url}")
            expect(page.locator("#state")).to_have_text(f"{robot.url} is online")
            parts = [browser.page(str(part)) for part in robot.graph.objects(robot.iri, DCTERMS.hasPart)]
            joints = [part for part in parts if (part.iri, ROS.succeedingLink, None) in part.graph]
            assert joints
            expect(page.locator("line")).to_have_count(len(joints))
            before = page.evaluate(_LINES)
            page.wait_for_function(f"(before) => {_LINES} !== before", arg=before)
    assert not errors
