"""A real Chromium on real pages. A test fails if its page logs an error or contacts another origin."""

import json
import os
from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Page, expect, sync_playwright

from browser import Browser as Client
from chromium import DESK, EXECUTABLE, MISSING, launch
from gateway_group import Gateway, Hub, gateway, hub
from needs import missing
from page_user import SIZES, PageUser, using_page
from running import PATIENCE_S
from small_fleet import Place, live
from watched_page import Watched

MANIFEST = Path(__file__).parents[1] / "assets" / "manifest.json"
# a folder for the pictures of README.md, which are then taken in high resolution
PICTURES = os.environ.get("LINKED_FLEET_PICTURES")
# a file to which the tasks of operators are written, with their clicks and seconds (`make tasks`)
TASKS = os.environ.get("LINKED_FLEET_TASKS")
NO_WEBGL = """
    const own = HTMLCanvasElement.prototype.getContext;
    HTMLCanvasElement.prototype.getContext = function (kind, ...more) {
        return kind.startsWith("webgl") ? null : own.call(this, kind, ...more);
    };
"""


@pytest.fixture(scope="module")
def chromium() -> Iterator[Browser]:
    if EXECUTABLE is None:
        missing("Chromium", MISSING)
    if not MANIFEST.is_file():
        missing("Chromium with the scripts of the pages", "make assets")
    expect.set_options(timeout=PATIENCE_S * 1000)
    with sync_playwright() as playwright:
        browser = launch(playwright)
        yield browser
        browser.close()


@pytest.fixture(scope="module")
def client(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Client]:
    """Yield a client of a gateway with one robot, a live UR5."""
    place = Place(tmp_path_factory.mktemp("state"))
    with place.gateway() as (_, client), place.ur5():
        live(client, "ur5")
        yield client


@pytest.fixture(scope="session")
def no_webgl() -> str:
    """The script with which a page has no WebGL, for contexts other than that of ``page``."""
    return NO_WEBGL


@pytest.fixture
def page(chromium: Browser, request: pytest.FixtureRequest) -> Iterator[Page]:
    """Open an empty page in a context of its own, with few pixels.

    Without a graphics card the processor draws 3D, which takes most of the time of a test. So a page has WebGL only in
    a test that is marked ``webgl``.
    """
    context = chromium.new_context(viewport=DESK, reduced_motion="reduce", device_scale_factor=1 if PICTURES else 0.5)
    context.set_default_timeout(PATIENCE_S * 1000)
    if request.node.get_closest_marker("webgl") is None:
        context.add_init_script(NO_WEBGL)
    yield context.new_page()
    context.close()


@pytest.fixture(params=list(SIZES))
def operator(request: pytest.FixtureRequest, chromium: Browser, no_webgl: str) -> Iterator[PageUser]:
    """Yield somebody at an empty page, on a desktop and on a phone; with WebGL in tests that are marked ``webgl``.

    A test that is marked ``task`` fails if its task takes more presses than the mark says.
    """
    drawing, task = request.node.get_closest_marker("webgl") is not None, request.node.get_closest_marker("task")
    with using_page(chromium, request.param, "" if drawing else no_webgl) as one:
        yield one
    if task is not None:
        one.finish()
        assert one.needed <= task.kwargs["presses"], f"{one.needed} clicks, taps or drags"
        if TASKS:
            said = {"task": task.args[0], "size": request.param, "presses": one.needed, "seconds": round(one.took_s, 1)}
            with Path(TASKS).open("a") as file:
                file.write(json.dumps(said) + "\n")


@pytest.fixture
def watched(page: Page) -> Iterator[Watched]:
    """Record all console messages and requests of ``page``; checked at the end of the test."""
    found = Watched(page)
    yield found
    found.check()


@pytest.fixture
def toy() -> Iterator[tuple[Hub, Gateway]]:
    """Yield a robot with one joint, played by the test, and a gateway."""
    with hub() as there, gateway(there) as one:
        yield there, one
