"""Rules on their pages, counted in clicks: created from an example, tried, fired, disabled and enabled."""

from collections.abc import Iterator
from typing import Any

import pytest
from playwright.sync_api import Browser, Locator, Page, ViewportSize, expect

from browser import LDP, LF
from browser import Browser as Client
from chromium import DESK, PHONE
from commanding import PREFIXES, TURTLE
from page_user import PageUser
from running import PATIENCE_S, eventually

pytestmark = [pytest.mark.processes, pytest.mark.test_all]
TITLE = "The UR5 stands up when its wrist turns too far"


@pytest.fixture
def none_yet(client: Client) -> Iterator[str]:
    """Yield the address of all rules while there are none, and the wrist is at 0."""
    container = str(client.page(client.root).one(LF.rules))
    turn(client, 0.0)
    yield container
    for rule in client.page(container).graph.objects(None, LDP.contains):
        assert client.http.delete(str(rule)).status_code == 204


@pytest.fixture
def rules(none_yet: str, page: Page, watched: object, client: Client) -> Iterator[Page]:
    """Yield the page of all rules while there are none, and the wrist is at 0."""
    page.goto(none_yet)
    unfold(page)
    yield page
    page.goto(client.root)


def unfold(page: Page) -> None:
    """Open the form in SPARQL, which is folded where rules can be made without it."""
    expect(page.locator(".composer")).to_be_visible()
    page.get_by_text("In SPARQL, with examples").click()
    expect(page.locator(".editor")).to_have_count(2)


def turn(client: Client, angle: float) -> None:
    rotate = client.action(client.part("ur5", "wrist_3_joint"), LF.Rotate)
    body = f"{PREFIXES} [] vom:numericalValue {angle} ; vom:unit unit:RAD ."
    answer = client.http.post(rotate, content=body, headers=TURTLE | {"prefer": "wait=30"})
    assert answer.status_code < 300, answer.text


def row(page: Page) -> Locator:
    return page.locator("#rules tbody tr")


@pytest.mark.parametrize("size", [DESK, PHONE], ids=["desk", "phone"])
def test_a_rule_is_made_with_one_click_and_seen_to_fire(rules: Page, client: Client, size: ViewportSize) -> None:
    """From the example in the editor; another click leads to the result of the firing."""
    rules.set_viewport_size(size)
    rules.get_by_role("button", name="Save the rule").click()
    expect(rules.locator("output.answer")).to_contain_text(f"Done: {TITLE}")
    expect(row(rules).locator(".state")).to_have_text("active")
    expect(row(rules)).to_contain_text("never")
    turn(client, 1.2)
    expect(row(rules).locator(".state")).to_have_text(["active", "accepted"])
    assert rules.evaluate("document.documentElement.scrollWidth") == size["width"]
    row(rules).get_by_role("link", name=TITLE).click()
    fired = rules.locator("#fired tbody tr")
    expect(fired).to_contain_text("accepted")
    expect(fired).to_contain_text("wrist_3_joint")
    assert rules.evaluate("document.documentElement.scrollWidth") == size["width"]
    fired.get_by_role("link", name="Assume pose").click()
    expect(rules.locator("body")).to_have_attribute("data-kind", "invocation")


@pytest.mark.task("Make a rule: when a value is above a number, do something", presses=1)
def test_a_rule_is_made_without_sparql(none_yet: str, operator: PageUser, client: Client) -> None:
    """When a value passes a number for a time, then an action, whose form is the usual one. It fires, and names why."""
    page = operator.page
    page.goto(none_yet)
    composer = page.locator(".composer")
    composer.get_by_label("robot", exact=True).select_option(label="ur5: UR5, a six-axis arm")
    composer.get_by_label("value", exact=True).select_option(label="wrist_3_joint rotation")
    composer.get_by_label("who does it", exact=True).select_option(label="ur5: UR5, a six-axis arm")
    composer.get_by_label("what", exact=True).select_option(label="assume pose")
    save = composer.get_by_role("button", name="Save this rule")
    save.click()  # which is no press of the task: it says what is missing
    expect(composer.locator(".error:visible").last).to_contain_text("A number is needed")
    composer.get_by_label("with", exact=True).fill("1")
    expect(composer).to_contain_text("57.3°")
    composer.get_by_label("for seconds", exact=True).fill("0.2")
    composer.locator("select[data-path$='#poseName']").select_option("upright")
    operator.press(save)
    title = "When wrist_3_joint rotation of ur5 is above 1 rad for 0.2 s: assume pose"
    expect(composer.locator("output")).to_contain_text(f"Done: {title}")
    expect(row(page).locator(".state")).to_have_text("active")
    operator.finish()
    turn(client, 1.2)
    expect(row(page).locator(".state")).to_have_text(["active", "accepted"])
    page.goto(client.root)


def test_a_switch_disables_a_rule_and_enables_it(rules: Page, client: Client) -> None:
    """The switch changes nothing else of the rule."""
    rules.get_by_role("button", name="Save the rule").click()
    expect(row(rules).locator(".state")).to_have_text("active")
    iri = row(rules).get_by_role("link", name=TITLE).get_attribute("href")
    assert iri is not None
    condition = client.page(iri).one(LF.condition)
    switch = rules.get_by_role("switch", name=TITLE)
    switch.click()
    expect(switch).not_to_be_checked()
    expect(row(rules).locator(".state")).to_have_text("disabled")
    switch.click()
    expect(switch).to_be_checked()
    eventually(lambda: client.page(iri).one(LF.state) == LF.active, "evaluated again")
    assert client.page(iri).one(LF.condition) == condition


def test_a_condition_is_tried_before_it_is_saved(rules: Page, watched: Any, client: Client) -> None:
    """Rows are shown while it holds; a syntax error is marked, and a refusal shown, with the text unchanged."""
    editor = rules.get_by_role("textbox", name="condition")
    editor.fill("SELECT ?robot WHERE { ?robot a <https://w3id.org/linked-fleet#Robot> }")
    rules.get_by_role("button", name="Try the condition").click()
    expect(rules.locator("#results tbody td")).to_have_text(["ur5/"])
    editor.fill("SELECT ?robot WHERE { ?robot nonsense }")
    rules.get_by_role("button", name="Try the condition").click()
    expect(rules.locator("#results .error")).to_contain_text("This is not a SPARQL query")
    expect(rules.locator(".cm-lintRange-error")).to_have_count(1)
    rules.get_by_role("button", name="Save the rule").click()
    expect(rules.locator("output.answer")).to_contain_text("condition")
    expect(editor).to_contain_text("nonsense")
    assert not list(client.page(str(client.page(client.root).one(LF.rules))).graph.objects(None, LDP.contains))
    watched.forgive("400", "422")


def test_a_saved_rule_is_edited_by_its_form(rules: Page, watched: Any, client: Client) -> None:
    """Its options as well; not after somebody else has changed it, but after it has fired."""
    rules.get_by_role("button", name="Save the rule").click()
    expect(row(rules).locator(".state")).to_have_text("active")
    row(rules).get_by_role("link", name=TITLE).click()
    expect(rules.locator(".editor")).to_have_count(2)
    turn(client, 1.2)
    expect(rules.locator("#fired tbody tr")).to_contain_text("accepted")
    rules.get_by_text("Options", exact=True).click()
    rules.get_by_label("minimum interval").fill("7.5")
    rules.get_by_label("action").fill("/ur5/actions/stop")
    rules.get_by_role("textbox", name="body").fill("")
    rules.get_by_role("button", name="Save the changes").click()
    expect(rules.locator("output.answer")).to_have_text("Done.")
    page = client.page(rules.url)
    assert (float(page.one(LF.minimumInterval)), page.one(LF.invokes).rpartition("/")[2]) == (7.5, "stop")
    assert page.graph.value(page.iri, LF.body) is None
    changed = page.response.text.replace("7.5", "8.5")
    assert client.http.put(rules.url, content=changed, headers=TURTLE).is_success
    rules.get_by_role("button", name="Save the changes").click()
    expect(rules.locator("output.answer")).to_contain_text("changed")
    assert float(client.page(rules.url).one(LF.minimumInterval)) == 8.5
    watched.forgive("412")


def test_examples_fill_the_editor(rules: Page) -> None:
    rules.get_by_role("button", name="The UR5 stops when it comes near to the Panda").click()
    expect(rules.get_by_label("title")).to_have_value("The UR5 stops when it comes near to the Panda")
    expect(rules.get_by_role("textbox", name="condition")).to_contain_text("lf:distance")
    expect(rules.get_by_label("action")).to_have_value("/ur5/actions/stop")
    assert rules.locator('textarea[data-path$="#body"]').input_value() == ""


def test_rules_are_read_and_conditions_tried_without_scripts(chromium: Browser, client: Client) -> None:
    context = chromium.new_context(java_script_enabled=False)
    context.set_default_timeout(PATIENCE_S * 1000)
    page = context.new_page()
    page.goto(str(client.page(client.root).one(LF.rules)))
    expect(page.get_by_text("There are none so far.")).to_be_visible()
    assert "Saving takes scripts: a rule is sent as RDF" in page.content()  # noscript, not shown by Playwright
    page.get_by_label("condition").fill("SELECT ?x { VALUES ?x { 7 } }")
    page.get_by_role("button", name="Try the condition").click()
    expect(page.locator("#results tbody td")).to_have_text(["7"])
    context.close()


NUMBERED = """(editor) => {
    const tops = (selector) => [...editor.shadowRoot.querySelectorAll(selector)]
        .filter((each) => getComputedStyle(each).visibility === "visible")
        .map((each) => Math.round(each.getBoundingClientRect().top));
    return [tops(".cm-line"), tops(".cm-lineNumbers .cm-gutterElement")];
}"""


@pytest.mark.parametrize("size", [DESK, PHONE], ids=["desk", "phone"])
def test_line_numbers_are_beside_their_lines(rules: Page, size: ViewportSize) -> None:
    """Also beside lines that are wrapped, of editors that nobody has scrolled to, and of a text that was replaced."""
    rules.set_viewport_size(size)
    rules.reload()
    unfold(rules)

    def numbered() -> bool:
        found = [editor.evaluate(NUMBERED) for editor in rules.locator(".editor").all()]
        return all(lines and lines == numbers for lines, numbers in found)

    places = lambda: str([editor.evaluate(NUMBERED) for editor in rules.locator(".editor").all()])  # noqa: E731
    eventually(numbered, places)
    rules.locator("button[data-example]").last.click()
    eventually(numbered, places)
