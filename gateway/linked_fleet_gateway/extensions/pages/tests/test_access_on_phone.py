"""Accessibility of pages on a phone (on a desktop: test_access.py), and that most do not move while they load."""

from collections.abc import Iterator, Mapping

import pytest
from playwright.sync_api import Browser as Chromium
from playwright.sync_api import Page, ViewportSize

from browser import Browser
from chromium import PHONE
from every_page import obstacles, pages_of_each_kind
from page_user import PageUser
from shared_fixtures import RunningFleet

pytestmark = [pytest.mark.processes, pytest.mark.test_all]
MOST_SHIFTED, MOST_HEADER_PX = 0.05, 64
AT_ONCE, SETTLED_MS = 8, 1500
ZOOMED: ViewportSize = {"width": 320, "height": 480}
"""What is left of a window of 1280 pixels at 400 % (WCAG 2.2, 1.4.10)."""
FILLED_LATER = ("objects", "object", "map", "world", "rules", "invocation", "subscriptions")
"""Pages with alternatives in forms, with lists and plans as high as what scripts find, or with what has come meanwhile,
such as the subscription of the page itself."""
SHIFTS = """
    window.shifts = [];
    new PerformanceObserver((list) => {
        for (const { value, hadRecentInput, sources } of list.getEntries()) {
            const nodes = sources.map(({ node }) => node?.outerHTML ?? node?.parentElement?.outerHTML ?? "");
            if (!hadRecentInput) window.shifts.push([value, nodes[0]?.slice(0, 80)]);
        }
    }).observe({ type: "layout-shift", buffered: true });
"""


@pytest.fixture(scope="module")
def pages(fleet: RunningFleet, browser: Browser) -> dict[str, str]:
    return pages_of_each_kind(browser)


@pytest.mark.parametrize("operator", ["phone"], indirect=True)
def test_no_page_shuts_anybody_out(operator: PageUser, pages: dict[str, str]) -> None:
    assert obstacles(operator, pages) == []


def test_no_page_moves_while_it_loads_or_is_wider_than_a_zoomed_window(
    chromium: Chromium, pages: dict[str, str], no_webgl: str
) -> None:
    """The header leaves room for the page. Several pages are open at once, because they mostly wait."""
    context = chromium.new_context(viewport=PHONE, reduced_motion="reduce", device_scale_factor=0.5)
    context.add_init_script(no_webgl)
    context.add_init_script(SHIFTS)
    found = list[str]()
    table = {"table": f"{pages['fleet']}?view=table"}
    every = [*(pages | table).items()]
    for begin in range(0, len(every), AT_ONCE):
        tabs = {kind: context.new_page() for kind, _ in every[begin : begin + AT_ONCE]}
        for kind, url in every[begin : begin + AT_ONCE]:
            tabs[kind].goto(url, wait_until="commit")
        next(iter(tabs.values())).wait_for_timeout(SETTLED_MS)
        found += _unstable(tabs)
        for each in tabs.values():
            each.close()
    context.close()
    assert not found, "\n".join(found)


def _unstable(tabs: Mapping[str, Page]) -> Iterator[str]:
    for kind, page in tabs.items():
        page.wait_for_load_state()
        shifts = page.evaluate("window.shifts")
        if kind not in FILLED_LATER and sum(value for value, _ in shifts) > MOST_SHIFTED:
            yield f"{kind} moves: {sorted(shifts, reverse=True)[:3]}"
        header = page.locator("header.bar").bounding_box()
        assert header is not None
        if header["height"] > MOST_HEADER_PX:
            yield f"{kind} has a header of {header['height']} px"
        page.set_viewport_size(ZOOMED)
        width = page.evaluate("document.documentElement.scrollWidth")
        if width > ZOOMED["width"]:
            yield f"{kind} is {width} px wide at 400 %"
