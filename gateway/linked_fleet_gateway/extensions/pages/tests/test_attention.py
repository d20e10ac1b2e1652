"""What pages say needs attention: the counter, the cards and the list, as people use them."""

import re
from collections.abc import Iterator
from functools import partial

import pytest
from playwright.sync_api import Browser as Chromium
from playwright.sync_api import expect
from rdflib import URIRef

from accessibility import violations_in_both_schemes
from browser import LF, Browser
from page_user import PageUser, using_page
from running import eventually
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


TELLING = """
    window.told = [];
    window.Notification = class {
        static permission = "granted";
        static requestPermission = async () => "granted";
        constructor(title, { body }) { window.told.push(`${title}: ${body}`); }
    };
    const start = OscillatorNode.prototype.start;
    OscillatorNode.prototype.start = function (...when) {
        window.told.push("a sound");
        start.apply(this, when);
    };
"""


def test_new_faults_are_told_by_sound_and_notification_if_the_reader_has_chosen_so(
    client: Browser, user: PageUser
) -> None:
    page = user.page
    page.context.add_init_script(TELLING)
    page.goto(f"{client.root}ur5/")
    shown = page.locator(".sections .attention")
    before = 0 if shown.count() == 0 or shown.is_hidden() else int(shown.inner_text())
    told(client, "ur5", "error")
    expect(shown).not_to_have_text(str(before))
    assert page.evaluate("window.told") == []
    page.goto(f"{client.root}faults")
    page.get_by_label("Tell me of new faults").check()
    assert page.evaluate("window.told") == ["a sound"]  # what it will be like
    page.goto(client.root)
    expect(shown).to_be_visible()  # the faults that are known are no news
    assert page.evaluate("window.told") == []
    told(client, "panda", "critical")
    eventually(lambda: page.evaluate("window.told.length > 1"), "a sound and a notification")
    assert page.evaluate("window.told") == ["a sound", "Linked Fleet: panda rattles."]


def test_the_table_is_sorted_filtered_and_tagged_by_its_address(client: Browser, user: PageUser) -> None:
    page = user.page
    page.goto(client.root)
    page.get_by_role("link", name="Table", exact=True).click()
    page.get_by_role("link", name="Robot", exact=True).click()
    expect(page).to_have_url(client.root + "?view=table&sort=name")
    rows = page.locator("table.fleet tbody tr")
    assert [each.get_attribute("data-name") for each in rows.all()] == ["panda", "ur5"]
    expect(page.get_by_role("columnheader", name=re.compile("^Robot"))).to_have_attribute("aria-sort", "ascending")
    page.get_by_label("Choose all robots").check()
    expect(page.locator("#chosen")).to_have_text("2 chosen")
    page.get_by_role("button", name="Add a tag").click()
    dialog = page.get_by_role("dialog", name="Which tag do 2 robots get?")
    dialog.get_by_label("Tag").fill("hall 3")
    dialog.get_by_role("button", name="Add the tag").click()
    expect(page.locator("#group-results li")).to_have_text(["panda: done", "ur5: done"])
    page.get_by_label("Choose panda").uncheck()
    page.get_by_role("button", name="Remove a tag").click()
    page.get_by_label("Tag").last.fill("hall 3")
    page.get_by_role("button", name="Remove the tag").click()
    expect(page.locator("#group-results li")).to_have_text(["ur5: done"])
    page.get_by_role("button", name="Stop", exact=True).click()
    expect(page.locator("#group-results li")).to_have_text(["ur5: done"])
    page.locator("#filter-text").fill("hall")
    expect(rows).to_have_count(1)
    expect(page).to_have_url(client.root + "?view=table&sort=name&text=hall")
    expect(rows.first).to_contain_text("hall 3")
    assert violations_in_both_schemes(page) == []
    page.goto(client.root)  # the reader's choice is remembered
    expect(page).to_have_url(client.root + "?view=table")
    expect(rows).to_have_count(2)


@pytest.mark.parametrize("language", ["en", "de"])
def test_no_head_of_the_table_covers_the_next_one(client: Browser, user: PageUser, language: str) -> None:
    user.page.goto(f"{client.root}~language/{language}?then=/")
    user.page.goto(client.root + "?view=table")
    expect(user.page.locator("table.fleet tbody tr")).to_have_count(2)
    wide = "[...document.querySelectorAll('table.fleet th')].filter((each) => each.scrollWidth > each.clientWidth)"
    assert user.page.evaluate(f"{wide}.map((each) => each.textContent)") == []
    assert user.page.evaluate("getComputedStyle(document.querySelector('table.fleet td')).display") == "table-cell"


def test_the_table_works_without_scripts(client: Browser, chromium: Chromium) -> None:
    with chromium.new_context(java_script_enabled=False) as context:
        page = context.new_page()
        page.goto(client.root + "?view=table")
        page.get_by_label("Search").fill("panda")
        page.get_by_role("button", name="Filter").click()
        expect(page.locator("table.fleet tbody tr")).to_have_count(1)
        page.get_by_role("link", name="Connection", exact=True).click()
        expect(page).to_have_url(client.root + "?view=table&sort=link&text=panda")
        expect(page.locator("table.fleet tbody tr")).to_have_count(1)


def test_the_chosen_robots_get_a_mission(client: Browser, user: PageUser) -> None:
    """One result for each robot, which leads to its order or its run."""
    page = user.page
    stop = {"type": "invoke", "kind": str(LF.StopRobot), "of": {"variable": "robot"}}
    for title, parameters, step in (
        ("Halt", [{"name": "robot", "type": "iri"}], stop),
        ("Nothing", [], {"type": "wait", "seconds": 0}),
    ):
        said = {"title": title, "parameters": parameters, "step": step}
        made = client.http.post(client.root + "missions", json=said)
        assert made.status_code == 201, made.text

    def are_over(count: int) -> bool:
        """Return True if so many runs have given back the control of their robots."""
        runs = client.page(client.root + "mission-runs").graph
        return len([each for each in set(runs.subjects(LF.state, LF.succeeded)) if isinstance(each, URIRef)]) == count

    page.goto(client.root + "?view=table")
    page.get_by_label("Choose all robots").check()
    for number, (when, container) in enumerate((("queue", "queue"), ("now", "missions")), 1):
        page.get_by_role("button", name="Give a mission").click()
        dialog = page.get_by_role("dialog", name="Which mission do 2 robots get?")
        expect(dialog.get_by_label("Mission").locator("option")).to_have_text(["Halt"])
        dialog.get_by_label("Begin").select_option(when)
        dialog.get_by_role("button", name="Give the mission").click()
        expect(page.locator(f'#group-results a[href^="{client.root}{container}/"]')).to_have_count(2)
        expect(page.locator("#group-results li")).to_have_text(["panda: done", "ur5: done"])
        eventually(partial(are_over, 2 * number), "the runs are over")
