"""Pages for everybody: by keyboard, by screen reader, in the dark, on a phone, and without scripts."""

from typing import Any

import pytest
from browser import DCTERMS, HYBRIT, LF, Browser
from conftest import RunningFleet
from playwright.sync_api import Browser as Chromium
from playwright.sync_api import Page, expect

pytestmark = pytest.mark.processes
PHONE = {"width": 360, "height": 740}
KINDS = [
    "fleet", "robot", "walker", "joint", "prismatic", "link", "property", "action", "nested action", "invocation",
    "subscriptions", "blueprint", "vocabulary", "lease", "nothing",
]  # fmt: skip


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
        "nothing": browser.root + "nothing/of/this/name",
    }


def _violations(page: Page, axe: str) -> list[str]:
    page.evaluate(axe)
    found: list[dict[str, Any]] = page.evaluate("axe.run()")["violations"]
    return [
        f"{each['id']}: {each['help']} at {[node['html'] for node in each['nodes']][:3]}"
        for each in found
        if each["impact"] in ("serious", "critical")
    ]


@pytest.mark.parametrize(
    ("kind", "scheme"),
    [*((kind, "light") for kind in KINDS), *((kind, "dark") for kind in ("fleet", "joint", "action", "subscriptions"))],
)
def test_no_serious_violation(page: Page, pages: dict[str, str], axe: str, kind: str, scheme: str) -> None:
    """As axe-core judges, with every action unfolded."""
    page.emulate_media(color_scheme=scheme)  # type: ignore[arg-type]
    page.goto(pages[kind])
    for details in page.locator("details.action").all():
        details.locator("summary").first.click()
        expect(details.locator("form.invoke, .problem").first).to_be_visible()
    assert _violations(page, axe) == []


def test_a_violation_would_be_found(page: Page, pages: dict[str, str], axe: str) -> None:
    page.goto(pages["fleet"])
    page.evaluate("document.querySelector('main').append(document.createElement('input'))")
    assert [each for each in _violations(page, axe) if each.startswith("label:")]


@pytest.mark.parametrize("kind", KINDS)
def test_a_phone_scrolls_no_page_sideways(page: Page, watched: Any, pages: dict[str, str], kind: str) -> None:
    page.set_viewport_size(PHONE)  # type: ignore[arg-type]
    page.goto(pages[kind])
    for details in page.locator("details.action").all():
        details.locator("summary").first.click()
        expect(details.locator("form.invoke").first).to_be_visible()
    watched.forgive("404")
    assert page.evaluate("document.documentElement.scrollWidth") <= PHONE["width"]


def test_stop_is_reached_by_keyboard_alone(page: Page, watched: object, pages: dict[str, str]) -> None:
    """From the top of the page, in a few steps, wherever it was scrolled to."""
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
