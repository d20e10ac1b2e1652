"""Accessibility of pages: by keyboard, by screen reader, in the dark, on a phone, and without scripts."""

from pathlib import Path

import pytest
from playwright.sync_api import Browser as Chromium
from playwright.sync_api import Page, expect

from accessibility import violations
from browser import DCTERMS, Browser
from every_page import FOR_PROGRAMS_ON_SCREEN, READ, obstacles, pages_of_each_kind
from html_checker import errors
from page_user import PageUser
from plain_words import faults
from shared_fixtures import RunningFleet

pytestmark = [pytest.mark.processes, pytest.mark.test_all]


@pytest.fixture(scope="module")
def pages(fleet: RunningFleet, browser: Browser) -> dict[str, str]:
    return pages_of_each_kind(browser)


@pytest.mark.parametrize("operator", ["desk"], indirect=True)
def test_no_page_shuts_anybody_out(operator: PageUser, pages: dict[str, str]) -> None:
    assert obstacles(operator, pages) == []


def test_pages_are_valid_html(browser: Browser, pages: dict[str, str], tmp_path: Path) -> None:
    documents = {kind: browser.http.get(url, headers={"accept": "text/html"}).content for kind, url in pages.items()}
    assert len(documents) > 30
    assert errors(documents, tmp_path) == []


def test_faults_would_be_found(page: Page, pages: dict[str, str], tmp_path: Path) -> None:
    page.goto(pages["nothing"])
    page.evaluate("document.querySelector('main').append(document.createElement('input'), 'https://bare.example/')")
    assert [each for each in violations(page) if each.startswith("label:")]
    assert [each for text in page.evaluate(READ, FOR_PROGRAMS_ON_SCREEN) for each in faults(text)]
    assert len(errors({"wrong": b"<!DOCTYPE html><title>x</title><ul><p>"}, tmp_path)) >= 1


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
