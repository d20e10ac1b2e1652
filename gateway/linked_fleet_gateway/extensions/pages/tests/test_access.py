"""Accessibility of pages: by keyboard, by screen reader, in the dark, on a phone, and without scripts."""

from typing import Any

import pytest
from playwright.sync_api import Browser as Chromium
from playwright.sync_api import Page, ViewportSize, expect

from browser import DCTERMS, HYBRIT, LF, Browser
from shared_fixtures import RunningFleet

pytestmark = [pytest.mark.processes, pytest.mark.test_all]
PHONE: ViewportSize = {"width": 360, "height": 740}
IN_THE_DARK = ("fleet", "audit", "results", "joint", "action", "subscriptions")


@pytest.fixture(scope="module")
def pages(fleet: RunningFleet, browser: Browser) -> dict[str, str]:
    """A page of each kind."""
    robot, joint = browser.robot("ur5"), browser.part("ur5", "elbow_joint")
    rotate, stop = browser.action(joint, LF.Rotate), browser.action(robot, LF.StopRobot)
    tiago = browser.part("tiago", "torso_lift_joint")
    return {
        "fleet": browser.root,
        "robot": robot.url,
        "walker": browser.robot("go2").url,
        "joint": joint.url,
        "prismatic": tiago.url,
        "link": browser.part("ur5", "wrist_3_link").url,
        "property": str(next(joint.graph.objects(joint.iri, LF.velocity))),
        "action": rotate,
        "nested action": browser.action(robot, LF.FollowTrajectory),
        "invocation": browser.http.post(stop, headers={"prefer": "wait=30"}).headers["location"],
        "subscriptions": str(joint.one(HYBRIT.subscriptions)),
        "blueprint": rotate.removesuffix("/actions/rotate") + "/blueprint",
        "vocabulary": str(browser.page(browser.root).one(LF.vocabulary)),
        "lease": str(robot.one(LF.lease)),
        "joint state": str(robot.one(LF.jointState)),
        "invocations": rotate + "/invocations",
        "audit": browser.root + "audit",
        "query": str(browser.page(browser.root).one(LF.query)),
        "results": browser.root + "query?query=SELECT%20%3Fa%20%7B%20%3Fa%20a%20%3Fb%20%7D%20LIMIT%209",
        "things": str(browser.page(browser.root).one(LF.things)),
        "nothing": browser.root + "nothing/of/this/name",
    }


def _violations(page: Page, axe: str) -> list[str]:
    """Return the findings of axe-core, a line each."""
    page.evaluate(axe)
    found: list[dict[str, Any]] = page.evaluate("axe.run({ resultTypes: ['violations'] })")["violations"]
    return [
        f"{each['id']}: {each['help']} at {[node['html'] for node in each['nodes']][:3]}"
        for each in found
        if each["impact"] in ("serious", "critical")
    ]


def test_no_page_shuts_anybody_out(page: Page, watched: Any, pages: dict[str, str], axe: str) -> None:
    """No serious violation in light or dark mode, and no sideways scrolling on a phone, with all actions unfolded."""
    desk, found = page.viewport_size, []
    assert desk is not None
    for kind, url in pages.items():
        page.set_viewport_size(desk)
        page.emulate_media(color_scheme="light")
        page.goto(url)
        for details in page.locator("details.action").all():
            details.locator("summary").first.click()
            expect(details.locator("form.invoke, .problem").first).to_be_visible()
        found += [(kind, each) for each in _violations(page, axe)]
        if kind in IN_THE_DARK:
            page.emulate_media(color_scheme="dark")
            found += [(kind, "in the dark", each) for each in _violations(page, axe)]
        page.set_viewport_size(PHONE)
        width = page.evaluate("document.documentElement.scrollWidth")
        found += [(kind, f"{width} pixels wide")] if width > PHONE["width"] else []
    watched.forgive("404")
    assert found == []


def test_a_violation_would_be_found(page: Page, pages: dict[str, str], axe: str) -> None:
    page.goto(pages["nothing"])
    page.evaluate("document.querySelector('main').append(document.createElement('input'))")
    assert [each for each in _violations(page, axe) if each.startswith("label:")]


def test_stop_is_reached_by_keyboard_alone(page: Page, watched: object, pages: dict[str, str]) -> None:
    """In a few steps from the top of the page, wherever it was scrolled."""
    page.goto(pages["robot"])
    page.mouse.wheel(0, 2000)
    for _ in range(8):
        page.keyboard.press("Tab")
        if page.evaluate("document.activeElement.closest('form.stop') !== null"):
            break
    else:
        pytest.fail("the stop button is not among the first things that the keyboard reaches")
    page.keyboard.press("Enter")
    expect(page.locator("form.stop")).to_contain_text("stop", ignore_case=True)


def test_everything_is_readable_without_scripts(chromium: Chromium, pages: dict[str, str], browser: Browser) -> None:
    context = chromium.new_context(java_script_enabled=False)
    page = context.new_page()
    page.goto(pages["robot"])
    title = str(browser.robot("ur5").graph.value(browser.robot("ur5").iri, DCTERMS.title))
    expect(page.get_by_role("heading", level=1)).to_have_text(title)
    page.get_by_role("link", name="elbow_joint", exact=True).first.click()
    expect(page.get_by_role("heading", level=1)).to_have_text("elbow_joint")
    expect(page.locator("#lead data").first).to_be_visible()
    page.locator("details.action summary").first.click()
    page.locator("details.action a").first.click()
    expect(page.locator("form.invoke")).to_be_visible()
    context.close()
