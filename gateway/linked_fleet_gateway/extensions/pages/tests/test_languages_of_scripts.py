"""What scripts write is in the language of the page: in the marked language no word of theirs is outside of marks."""

import re

import pytest
from playwright.sync_api import Browser as Chromium
from playwright.sync_api import expect

from browser import Browser
from dom import parsed
from outside_catalogue import outside

pytestmark = [pytest.mark.processes, pytest.mark.test_all]
PATHS = (
    *("", "?view=table", "ur5/", "ur5/elbow_joint", "ur5/elbow_joint/actions/rotate", "faults", "world", "world/map"),
    *("missions/builder", "rules", "queue", "ur5/history", "people", "query"),
)
# Names of the robot, its parts and its poses, units, and a format.
DATA = {"ur5", "base", "world", "home", "upright", "CSV", "x", "y", "z", "s", "m", "mm", "rad", "r"}


def words(text: str) -> set[str]:
    """Return the words of a finding that are no data, without its element, marks, addresses and names of joints."""
    rest = re.sub(r"^<[^>]*>|⟦.*⟧|\S*(?:://|_)\S*", " ", text)
    return set(re.findall(r"[A-Za-z]\w*", rest)) - DATA


@pytest.mark.parametrize("path", PATHS)
def test_no_word_of_scripts_is_outside_the_catalogue(chromium: Chromium, client: Browser, path: str) -> None:
    with chromium.new_context(extra_http_headers={"accept-language": "en-XA"}) as context:
        page = context.new_page()
        page.goto(client.root + path)
        expect(
            page.locator("body[data-connection=live]").or_(page.locator("body:not([data-observable])"))
        ).to_be_attached()
        for each in page.locator("details.action > summary").all()[:2]:
            each.click()
        found = outside(parsed(page.evaluate("document.body.outerHTML")))
        assert [each for each in found if words(each)] == []


def test_scripts_speak_german(chromium: Chromium, client: Browser) -> None:
    with chromium.new_context(locale="de-DE") as context:
        page = context.new_page()
        page.goto(client.root + "ur5/")
        expect(page.locator("#control .state")).to_have_text("frei")
        expect(page.get_by_role("button", name="Steuerung übernehmen")).to_be_visible()
        page.get_by_role("link", name="English").click()
        expect(page.get_by_role("button", name="Take control")).to_be_visible()
        assert page.locator("html").get_attribute("lang") == "en"
