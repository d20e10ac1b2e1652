"""All kinds of pages of the demo contain plain words: no IRIs, no property names, no e-notation."""

import re
from collections import Counter
from urllib.parse import urldefrag, urljoin, urlsplit

import pytest

from browser import LF, Browser
from dom import Element, parsed
from linked_fleet_gateway.extensions.pages import texts
from linked_fleet_gateway.resources.paths import reserved_at_root, reserved_in_robot
from plain_words import for_programs

pytestmark = pytest.mark.virtual

ALIKE = 4
"""Limit of pages whose paths differ only in names."""
KINDS = {
    *("fleet", "robot", "joint", "link", "property", "joint_state", "action", "invocation", "invocations", "lease"),
    *("subscriptions", "vocabulary", "directory", "audit", "world", "query", "document"),
}


def pattern(path: str) -> str:
    """Return the path without the names of robots, joints and links, and without ids."""
    known = reserved_at_root() | reserved_in_robot()
    parts = [part if part in known or not part else "*" for part in path.split("/")]
    actions = [n for n, part in enumerate(parts) if part == "actions"]
    return "/".join(path.split("/")[n] if n - 1 in actions else part for n, part in enumerate(parts))


def walked(browser: Browser) -> dict[str, Element]:
    """Return all pages linked from pages, beginning at the root."""
    found: dict[str, Element] = {}
    seen: Counter[str] = Counter()
    waiting = [browser.root]
    while waiting:
        url = waiting.pop(0)
        path = urlsplit(url).path
        if url in found or seen[pattern(path)] >= ALIKE:
            continue
        answer = browser.http.get(url, headers={"accept": "text/html"})
        if answer.status_code in (404, 406) or not answer.headers["content-type"].startswith("text/html"):
            continue  # gone, a mesh, or a document that is no page
        assert answer.status_code == 200, url
        seen[pattern(path)] += 1
        page = found[url] = parsed(answer.content)
        links = [urldefrag(urljoin(url, each["href"])).url for each in page.all("a") if "href" in each.attributes]
        waiting += [each for each in links if each.startswith(browser.root) and not urlsplit(each).query]
    return found


@pytest.fixture(scope="module")
def pages(browser: Browser) -> dict[str, Element]:
    turning = browser.part("ur5", "elbow_joint")
    held = browser.http.post(browser.action(turning, LF.Hold), headers={"prefer": "return=minimal"})
    assert held.is_success, held.text
    link = browser.part("ur5", "tool0").url
    return (
        walked(browser) | walked_from(browser, f"{turning.url}/actions/hold/invocations") | walked_from(browser, link)
    )


def walked_from(browser: Browser, url: str) -> dict[str, Element]:
    answer = browser.http.get(url, headers={"accept": "text/html"})
    return {url: parsed(answer.content)}


def test_texts_for_programs_are_not_shown(pages: dict[str, Element]) -> None:
    assert {next(page.all("body"))["data-kind"] for page in pages.values()} >= KINDS
    wrong = {url: found for url, page in pages.items() if (found := for_programs(page))}
    assert not wrong, "\n".join(f"{url} {each}" for url, found in wrong.items() for each in found)


def test_every_page_has_the_navigation_and_marks_one_entry(pages: dict[str, Element]) -> None:
    for url, page in pages.items():
        (nav,) = [each for each in page.all("nav") if each.get("class") == "sections"]
        entries = {each.text: each.get("aria-current") for each in nav.all("a")}
        first, last = list(entries)[:6], list(entries)[-1]
        assert first == ["Fleet", "Faults", "World", "Missions", "Queue", "Rules"] and last == "Audit", url
        marked = [name for name, current in entries.items() if current]
        path = urlsplit(url).path
        wanted = path.split("/")[1].capitalize() if path.split("/")[1].capitalize() in entries else "Fleet"
        assert marked == [wanted], url


def test_a_motion_is_a_sentence() -> None:
    assert texts.motion("/b/s1/actions/rotateBy/invocations/7", "/", {"s1": (-1.745329, "rad")}) == (
        "Rotate by s1 to \N{MINUS SIGN}100°"
    )
    both = {"a": (0.0, "rad"), "b": (1.0, "m")}
    assert texts.motion("/b/actions/moveJoints/invocations/7", "/", both) == "Move joints (2 joints)"
    assert texts.motion("/actions/stopAll/invocations/7", "/", {}) == "Stop all"
    run = "/missions/0cdc393b-aaa3-4605-a0cb-6e8111341243/actions/run/invocations/7"
    assert texts.motion(run, "/", {}) == "Run mission"


def test_terms_are_words_and_have_help() -> None:
    assert texts.term_in_words("http://vocab.arvida.de/2015/06/spatial/vocab#Rotation3D") == "rotation 3D"
    assert texts.term_in_words(f"{LF}lastSeen") == "last seen"
    assert texts.help_of(f"{LF}offline") == "The agent is not connected; see last seen."
    assert texts.help_of("http://www.w3.org/2000/01/rdf-schema#label") == ""
    assert not re.search(r"[a-z]:[a-z]", texts.sentence("see lf:lastSeen, maths:x"))


def test_an_id_is_named_by_its_container() -> None:
    one = "10421415-23b7-4b39-9e85-93fa4776e84d"
    assert texts.place(f"/ur5/elbow/actions/hold/invocations/{one}", "/") == "invocation"
    assert texts.place(f"/world/objects/{one}", "/") == "object"
    assert texts.place(f"/ur5/elbow/actions/hold/invocations/{one}/blueprint", "/") == "blueprint"
    assert texts.place("/ur5/12345678", "/") == "12345678"


@pytest.mark.parametrize(
    ("name", "symbol"),
    [("HZ", "Hz"), ("M-PER-SEC2", "m/s²"), ("KiloGM-M2", "kg·m²"), ("A-HR", "A·h"), ("DEG_C", "°C"), ("DEG", "°")],
)
def test_units_have_the_symbols_that_people_write(name: str, symbol: str) -> None:
    assert texts.unit(f"http://qudt.org/vocab/unit/{name}") == symbol
