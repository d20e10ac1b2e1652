"""Forms of actions as people use them: validated, rehearsed, sent, followed, refused and stopped."""

import re
from collections.abc import Iterator
from dataclasses import dataclass

import pytest
import rdflib
from playwright.sync_api import Locator, Page, Request, expect

from browser import LF, ROS, SPATIAL, Browser
from small_fleet import Place, live, move, number, property_page
from watched_page import Watched

pytestmark = [pytest.mark.processes, pytest.mark.test_all]
JOINT = "wrist_3_joint"
REFUSED = "Failed to load resource"
SERIAL = rdflib.URIRef("https://schema.org/serialNumber")


@dataclass
class Robot:
    """A simulated arm, as another client sees it."""

    browser: Browser

    @property
    def joint(self) -> str:
        return self.browser.part("ur5", JOINT).url

    @property
    def rotate(self) -> str:
        return self.browser.action(self.browser.part("ur5", JOINT), LF.Rotate)

    @property
    def angle(self) -> float:
        found = number(property_page(self.browser, "ur5", JOINT, ROS.rotation), SPATIAL.rotationAngle)
        assert isinstance(found, float)
        return found


@pytest.fixture(scope="module")
def ur5(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Robot]:
    place = Place(tmp_path_factory.mktemp("state"))
    with place.gateway() as (_, browser), place.ur5():
        live(browser, "ur5")
        yield Robot(browser)


@pytest.fixture
def form(page: Page, watched: object, ur5: Robot) -> Locator:
    """The form that rotates one joint, opened on the page of the joint."""
    page.goto(ur5.joint)
    details = page.locator(f'details[data-include="{ur5.rotate}"]')
    details.locator("summary").click()
    return details.locator("form.invoke")


def value(form: Locator) -> Locator:
    return form.locator('> .field > input[data-path$="numericalValue"]')


def unit(form: Locator) -> Locator:
    return form.locator('> .field > select[data-path$="#unit"]')


def fill(form: Locator, text: str, name: str) -> None:
    unit(form).select_option(label=name)
    value(form).fill(text)


def press(form: Locator, dry: bool = False) -> None:
    form.locator(f"button[type=submit]{'' if dry else ':not('}[data-prefer]{'' if dry else ')'}").click()


def task(page: Page) -> Locator:
    return page.locator(".task").last


def test_a_joint_is_rotated_by_the_form(page: Page, form: Locator, ur5: Robot) -> None:
    """The task is shown until it has succeeded, and the value on the page has changed."""
    fill(form, "30", "°")
    press(form)
    expect(task(page).locator(".state")).to_have_text("succeeded")
    assert ur5.angle == pytest.approx(0.5236, abs=0.01)
    shown = page.locator(f'data[data-subject="{ur5.joint}/rotation"]').first
    expect(shown).to_have_text(re.compile(r"^0\.52"))


def test_enter_in_a_field_tries_and_does_not_move(page: Page, form: Locator, ur5: Robot) -> None:
    """On a phone, Go is Enter."""
    before, sent = ur5.angle, list[Request]()
    page.on("request", lambda request: sent.append(request) if request.method in ("PUT", "POST") else None)
    fill(form, "75", "°")
    value(form).press("Enter")
    expect(form.locator("output.answer")).to_have_attribute("data-state", "rehearsed")
    expect(form.locator("output.answer")).to_contain_text("nothing has moved")
    assert [request.headers.get("prefer") for request in sent] == ["dry-run"]
    assert ur5.angle == pytest.approx(before, abs=0.01)


def test_the_table_of_joints_follows(page: Page, watched: object, ur5: Robot) -> None:
    """Positions in named poses do not change."""
    page.goto(ur5.browser.robot("ur5").url)
    position = page.locator(f'#joints data[data-subject="{ur5.joint}"]').first
    for angle in (0.25, -0.25):
        answer = move(ur5.browser, ur5.rotate, angle, prefer="wait=30")
        assert answer.status_code == 204, answer.text
        expect(position).to_have_text(re.compile(r"^-?0\.2[45]"))
        expect(position).to_have_text(re.compile(r"^-" if angle < 0 else r"^0"))


def test_a_motion_is_cancelled(page: Page, form: Locator) -> None:
    fill(form, "-6", "rad")
    press(form)
    task(page).get_by_role("button", name="Cancel").click()
    expect(task(page).locator(".state")).to_have_text("cancelled")
    expect(task(page)).to_contain_text("cancelled by a client")


def test_invalid_input_is_reported_beside_its_field_and_not_sent(page: Page, form: Locator) -> None:
    """The message is beside the field, with the limits; missing values are reported too."""
    sent: list[Request] = []
    page.on("request", lambda request: sent.append(request) if request.method not in ("GET", "HEAD") else None)
    fill(form, "4000", "°")
    press(form)
    field = value(form)
    expect(field).to_have_attribute("aria-invalid", "true")
    expect(field).to_be_focused()
    expect(form.locator(".error").first).to_have_text(re.compile(r"^This must be from -360[.\d]* to 360"))
    field.fill("")
    press(form)
    expect(form.locator(".error").first).to_have_text("This is needed.")
    assert sent == []


def test_the_unit_changes_the_limits(form: Locator) -> None:
    unit(form).select_option(label="°")
    expect(value(form)).to_have_attribute("max", re.compile("^360"))
    unit(form).select_option(label="rad")
    expect(value(form)).to_have_attribute("max", re.compile(r"^6\.28"))
    expect(form.locator(".range").first).to_contain_text("6.28")


def test_a_motion_is_tried_without_moving(page: Page, form: Locator, ur5: Robot) -> None:
    before = ur5.angle
    fill(form, "-1.25", "rad")
    press(form, dry=True)
    answer = form.locator("output.answer")
    expect(answer).to_contain_text("nothing has moved")
    expect(answer).to_contain_text(re.compile(r"it would take [\d.]+ s"))
    expect(answer).to_contain_text(f"{JOINT} would be at -1.25 rad")
    assert ur5.angle == pytest.approx(before, abs=0.01)


def test_a_refusal_is_shown_in_the_words_of_the_server(
    form: Locator,
    watched: Watched,
    ur5: Robot,
) -> None:
    """Somebody else has the control lease, of which the page has not heard."""
    http = ur5.browser.http
    lease = str(ur5.browser.robot("ur5").one(LF.lease))
    form.page.route(lease, lambda route: route.abort())
    said = f'@prefix lf: <{LF}> . <> lf:holder "somebody else" ; lf:leaseDuration 60 .'
    taken = http.put(lease, content=said, headers={"content-type": "text/turtle"})
    assert taken.status_code in (200, 201, 204), taken.text
    try:
        fill(form, "0.1", "rad")
        press(form)
        expect(form.locator("output.answer[data-state=error]")).to_contain_text("somebody else")
    finally:
        assert http.delete(lease, headers={"lock-token": taken.headers["lock-token"]}).status_code == 204
    watched.forgive(REFUSED)


@pytest.mark.parametrize("by", ["button", "keyboard"])
def test_stop_is_always_in_reach_and_holds(page: Page, form: Locator, ur5: Robot, watched: Watched, by: str) -> None:
    """It ends the running motion, and the page says so; nothing moves until somebody resets it."""
    slow = ur5.browser.http.put(f"{ur5.browser.root}ur5/maximumSpeedScale", json={"value": {"value": 0.05}})
    assert slow.status_code == 204, slow.text
    fill(form, "6" if ur5.angle < 0 else "-6", "rad")
    press(form)
    expect(task(page).locator(".state")).to_have_text("running")
    if by == "button":
        page.locator("form.stop button").click()
    else:
        page.keyboard.press("Escape")
        page.keyboard.press("Escape")
    expect(page.locator("form.stop output")).to_contain_text("Stop accepted")
    expect(page.locator(".task .state", has_text="cancelled")).to_be_visible()
    bar = page.locator("#latch-bar")
    expect(bar).to_contain_text("The stop of ur5 holds since")
    expect(bar).to_contain_text("s after the stop")
    fill(form, "0.1", "rad")
    press(form)
    expect(form.locator("output.answer[data-state=error]")).to_contain_text("A stop holds until it is reset")
    bar.get_by_role("button", name="Reset").click()
    page.get_by_role("dialog").get_by_role("button", name="Reset").click()
    expect(bar).to_have_count(0)
    usual = ur5.browser.http.put(f"{ur5.browser.root}ur5/maximumSpeedScale", json={"value": {"value": 1.0}})
    assert usual.status_code == 204, usual.text
    press(form)
    expect(form.locator("output.answer[data-state=error]")).to_have_count(0)
    watched.forgive(REFUSED)


def test_a_task_is_followed_on_the_next_page(page: Page, form: Locator, ur5: Robot) -> None:
    fill(form, "6" if ur5.angle < 0 else "-6", "rad")
    press(form)
    expect(task(page).locator(".state")).to_have_text("running")
    page.goto(ur5.browser.root)
    expect(task(page).locator(".state")).to_have_text("running")
    task(page).get_by_role("button", name="Cancel").click()
    expect(task(page).locator(".state")).to_have_text("cancelled")


def test_a_task_that_is_gone_is_forgotten(
    page: Page,
    form: Locator,
    watched: Watched,
    ur5: Robot,
) -> None:
    """It was deleted between two pages: the next page neither shows it for ever nor reports a lost connection."""
    fill(form, "6" if ur5.angle < 0 else "-6", "rad")
    press(form)
    expect(task(page).locator(".state")).to_have_text("running")
    invocation = str(task(page).get_attribute("data-task"))
    page.goto("about:blank")
    assert ur5.browser.http.delete(invocation).status_code == 204
    page.goto(ur5.browser.root)
    expect(page.locator("body[data-connection]")).to_have_count(1)
    expect(page.locator(".task")).to_have_count(0)
    expect(page.locator("#connection")).to_be_hidden()
    watched.forgive(REFUSED, "WebSocket connection")


def test_a_callback_is_made_and_deleted(page: Page, watched: object, ur5: Robot) -> None:
    """On the page of subscriptions, by the form generated from the shape."""
    joint = ur5.browser.part("ur5", JOINT)
    container = joint.url + "/subscriptions"
    page.goto(container)
    form = page.locator("form.invoke")
    url = "http://127.0.0.1:9/nobody"
    options = form.locator("details:not([open]) > summary")
    if options.count():
        options.click()
    form.locator('[data-path$="onResource"]').first.fill(joint.url + "/rotation")
    form.locator('[data-path$="callbackURL"]').first.fill(url)
    press(form)
    expect(form.locator("output.answer")).to_contain_text("Done")
    row = page.locator("#watches tr", has_text=url)
    expect(row).to_be_visible()
    row.get_by_role("button").click()
    page.get_by_role("button", name="Delete", exact=True).last.click()
    expect(row).to_have_count(0)


def test_annotations_are_added_and_deleted(page: Page, watched: object, ur5: Robot) -> None:
    page.goto(f"{ur5.browser.root}ur5/annotations")
    said, add = page.locator("#annotations"), page.locator("form.annotate")
    add.get_by_label("What").select_option(label="Serial number")
    add.get_by_label("Value").fill('4711 "B"')
    add.get_by_role("button", name="Add it").click()
    expect(said).to_contain_text('4711 "B"')
    graph = ur5.browser.robot("ur5").graph
    assert (None, SERIAL, rdflib.Literal('4711 "B"')) in graph
    add.get_by_label("What").select_option(label="Another property")
    add.get_by_label("Address of the property").fill("urn:example:colour")
    add.get_by_label("Value").fill("red")
    add.get_by_role("button", name="Add it").click()
    expect(said).to_contain_text("red")
    for text in ("red", "4711"):
        said.get_by_role("listitem").filter(has_text=text).get_by_role("button").click()
        page.get_by_role("dialog").get_by_role("button", name="Delete").click()
        expect(said).not_to_contain_text(text)
    assert (None, SERIAL, None) not in ur5.browser.robot("ur5").graph


def test_what_the_robot_says_itself_is_known_before_a_click(page: Page, watched: object, ur5: Robot) -> None:
    page.goto(f"{ur5.browser.root}ur5/annotations")
    said = page.locator("#annotations").get_by_role("listitem")
    of_agent = said.filter(has_text="The robot itself says so")
    assert of_agent.count() > 0
    expect(of_agent.get_by_role("button")).to_have_count(0)
