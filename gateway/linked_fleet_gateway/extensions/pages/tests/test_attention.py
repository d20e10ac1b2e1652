"""What pages say needs attention: the counter, the cards and the list, as people use them."""

import re
from collections.abc import Iterator

import pytest
from playwright.sync_api import Browser as Chromium
from playwright.sync_api import expect

from accessibility import violations_in_both_schemes
from browser import Browser
from page_user import PageUser, using_page
from small_fleet import Place, live

pytestmark = [pytest.mark.processes, pytest.mark.test_all]


@pytest.fixture(scope="module")
def client(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    place = Place(tmp_path_factory.mktemp("state"))
    with place.gateway() as (_, client), place.ur5("--robot=panda"):
        live(client, "ur5")
        live(client, "panda")
        yield client


@pytest.fixture
def user(chromium: Chromium) -> Iterator[PageUser]:
    with using_page(chromium, "desk") as user:
        yield user


def told(client: Browser, robot: str, severity: str) -> None:
    said = {"about": f"{client.root}{robot}/", "title": f"{robot} rattles.", "faultKind": severity,
            "severity": f"https://w3id.org/linked-fleet#{severity}"}  # fmt: skip
    assert client.http.post(client.root + "actions/raiseFault", json=said).status_code == 204


def test_a_fault_is_counted_shown_first_and_acknowledged(client: Browser, user: PageUser) -> None:
    """Simulated robots may tell meanwhile that the computer is too slow, which is a warning."""
    page = user.page
    page.goto(client.root)
    critical = page.locator('.sections .attention[data-severity="critical"]')
    expect(critical).to_have_count(0)
    last = page.locator("#robots li").last.get_attribute("data-name")
    assert last is not None and last != page.locator("#robots li").first.get_attribute("data-name")
    told(client, last, "critical")
    expect(critical).to_be_visible()
    expect(page).to_have_title(re.compile(r"^\(\d+\) Linked Fleet$"))
    expect(page.locator("#robots li").first).to_have_attribute("data-name", last)
    expect(page.locator("#robots li").first.locator(".trouble")).to_contain_text(f"{last} rattles.")
    assert violations_in_both_schemes(page) == []
    page.locator(".sections a", has_text="Faults").click()
    first = page.locator("#faults tbody tr").first
    expect(first).to_contain_text("rattles")
    assert violations_in_both_schemes(page) == []
    first.locator("a[data-acknowledge]").click()
    expect(page.locator("#cleared")).to_contain_text("rattles")
    expect(critical).to_have_count(0)
    page.locator("#cleared tbody a", has_text="rattles").click()
    expect(page.locator("main")).to_contain_text("cleared")
    assert violations_in_both_schemes(page) == []
