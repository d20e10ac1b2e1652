"""Queries on their page, counted in clicks: the editor stays, with rows, charts and errors beside it."""

import json
from pathlib import Path
from typing import Any

import pytest
from playwright.sync_api import Browser, Page, expect

from browser import LF
from browser import Browser as Client
from page_user import PageUser
from running import PATIENCE_S

pytestmark = [pytest.mark.processes, pytest.mark.test_all]


@pytest.fixture
def query(page: Page, watched: object, client: Client) -> Page:
    return _opened(page, client)


def _opened(page: Page, client: Client) -> Page:
    page.goto(str(client.page(client.root).one(LF.query)))
    expect(page.locator(".editor").get_by_role("textbox", name="Query")).to_be_visible()
    return page


def write(page: Page, text: str) -> None:
    page.get_by_role("textbox", name="Query").fill(text)


@pytest.mark.task("Ask a question of the fleet, and see the answer in a chart", presses=2)
def test_rows_are_asked_for_and_drawn_with_two_clicks(operator: PageUser, client: Client) -> None:
    """The positions and limits of all joints; nothing scrolls sideways on a phone."""
    page = _opened(operator.page, client)
    operator.press(page.get_by_role("button", name="Ask", exact=True))
    results = page.locator("#results")
    expect(results.get_by_role("columnheader")).to_have_text(["robot", "joint", "position", "lower", "upper"])
    expect(results.locator("tbody tr")).to_have_count(6)
    operator.press(results.get_by_role("button", name="Chart"))
    expect(results.locator("figure.chart canvas")).to_be_visible()
    expect(results.get_by_role("img", name="position, lower, upper over 6 rows")).to_be_visible()
    expect(page.get_by_role("textbox", name="Query")).to_contain_text("ORDER BY ?robot ?joint")


def test_rows_are_downloaded(query: Page) -> None:
    write(query, "SELECT ?b ?a { VALUES (?a ?b) { (1 2.5) } }")
    query.get_by_role("button", name="Ask", exact=True).click()
    with query.expect_download() as table:
        query.locator("#results").get_by_role("link", name="csv").click()
    assert table.value.suggested_filename == "results.csv"
    assert Path(table.value.path()).read_text().split() == ["b,a", "2.5,1"]
    with query.expect_download() as document:
        query.locator("#results").get_by_role("link", name="json").click()
    assert json.loads(Path(document.value.path()).read_text())["head"]["vars"] == ["b", "a"]


def test_a_mistake_keeps_the_text_and_is_marked(query: Page, watched: Any) -> None:
    """Also after a reload; a corrected query is answered without the mark."""
    wrong = "SELECT ?x {\n  VALUES ?x nonsense { 1 }\n}"
    write(query, wrong)
    query.get_by_role("button", name="Ask", exact=True).click()
    expect(query.locator("#results .error")).to_contain_text("This is not a SPARQL query")
    expect(query.locator(".cm-lintRange-error")).to_have_text("nonsense")
    assert query.locator("textarea[name=query]").input_value() == wrong
    query.reload()
    expect(query.locator(".editor")).to_be_visible()
    expect(query.locator(".cm-lintRange-error")).to_have_text("nonsense")
    write(query, wrong.replace("nonsense ", ""))
    query.keyboard.press("Control+Enter")
    expect(query.locator("#results tbody td")).to_have_text(["1"])
    expect(query.locator(".cm-lintRange-error")).to_have_count(0)
    watched.forgive("400")


def test_our_terms_are_completed_from_the_vocabulary(query: Page) -> None:
    """With their prefix, if it was not declared."""
    write(query, "")
    query.get_by_role("textbox", name="Query").press_sequentially("SELECT ?x { ?x lf:lastMo")
    option = query.locator(".cm-tooltip-autocomplete [role=option]").first
    expect(option).to_contain_text("lf:lastMoved")
    option.click()
    text = query.locator("textarea[name=query]").input_value()
    assert text.startswith(f"PREFIX lf: <{LF}>\n") and "?x lf:lastMoved" in text


def test_the_editor_comes_to_no_other_page(query: Page, client: Client) -> None:
    asked: list[str] = []
    query.on("request", lambda request: asked.append(request.url))
    query.goto(client.root)
    expect(query.get_by_role("link", name="Query")).to_be_visible()
    query.wait_for_load_state("load")
    assert asked and not [each for each in asked if "/editor-" in each]


def test_a_query_needs_no_script(chromium: Browser, client: Client) -> None:
    context = chromium.new_context(java_script_enabled=False)
    context.set_default_timeout(PATIENCE_S * 1000)
    page = context.new_page()
    page.goto(str(client.page(client.root).one(LF.query)))
    page.get_by_role("textbox", name="Query").fill("ASK {")
    page.get_by_role("button", name="Ask", exact=True).click()
    expect(page.get_by_role("alert")).to_contain_text("This is not a SPARQL query")
    expect(page.get_by_role("textbox", name="Query")).to_have_value("ASK {")
    page.get_by_role("textbox", name="Query").fill("ASK {}")
    page.get_by_role("button", name="Ask", exact=True).click()
    expect(page.locator("#results")).to_contain_text("Yes.")
    context.close()
