"""What pages say needs attention: the counter, the cards and the list, as people use them."""

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
    page = user.page
    page.goto(client.root)
    expect(page.locator(".sections .attention")).to_be_hidden()
    first = page.locator("#robots li").first.get_attribute("data-name")
    last = page.locator("#robots li").last.get_attribute("data-name")
    assert last is not None and first != last
    told(client, last, "error")
    expect(page.locator(".sections .attention")).to_have_text("1")
    expect(page).to_have_title("(1) Linked Fleet")
    expect(page.locator("#robots li").first).to_have_attribute("data-name", last)
    expect(page.locator("#robots li").first.locator(".trouble")).to_have_text(f"{last} rattles.")
    assert violations_in_both_schemes(page) == []
    page.locator(".sections a", has_text="Faults").click()
    expect(page.locator("#faults-title")).to_have_text("1 open fault")
    assert violations_in_both_schemes(page) == []
    page.locator("a[data-acknowledge]").click()
    expect(page.locator("#faults-title")).to_have_text("0 open faults")
    expect(page.locator("#cleared")).to_contain_text("rattles")
    expect(page.locator(".sections .attention")).to_be_hidden()
    page.locator("#cleared tbody a").first.click()
    expect(page.locator("main")).to_contain_text("cleared")
    assert violations_in_both_schemes(page) == []
