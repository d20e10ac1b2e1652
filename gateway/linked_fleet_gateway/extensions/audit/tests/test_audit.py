"""Actions are recorded in the audit, which administrators of everything can read."""

import html
import socket
from pathlib import Path

import httpx
import pytest
import rdflib
from rdflib import DCTERMS, PROV, URIRef

from authenticated_gateway import SEEN, AuthenticatedGateway, run_authenticated
from browser import LDP, LF, Browser
from redis_servers import single
from running import eventually
from subscribers import Socket

pytestmark = pytest.mark.virtual


def noted(browser: Browser, root: str) -> list[tuple[str, str, str]]:
    """Return who, what and the status of each entry, of all pages."""
    found, url = [], root + "audit"
    while url:
        graph = rdflib.Graph().parse(data=browser.http.get(url).text, format="turtle", publicID=url)
        here = URIRef(root + "audit")
        for entry in graph.objects(here, LDP.contains):
            who = graph.value(graph.value(entry, PROV.wasAssociatedWith), DCTERMS.title)
            found.append((str(who), str(graph.value(entry, DCTERMS.title)), str(graph.value(entry, LF.status))))
        url = str(graph.value(here, URIRef("http://www.w3.org/1999/xhtml/vocab#next")) or "")
    return found


def test_commands_and_subscriptions_are_noted(here: AuthenticatedGateway) -> None:
    with here.browsing("all") as browser, here.browsing("reader") as reader:
        robot = browser.robot(SEEN)
        stop = browser.action(robot, LF.StopRobot)
        path = stop.removeprefix(here.root[:-1])
        answer = browser.http.post(stop, headers={"x-request-id": "the-stop"})
        assert answer.status_code == 204
        reader.http.post(stop)
        reader.http.post(here.root + "hall-9/actions/stop")  # does not exist
        with Socket(robot.url, Authorization=f"Bearer {here.tokens['all']}") as listening:
            listening.raw()
        expected = {
            ("all", f"POST {path}", "204"),
            ("reader", f"POST {path}", "403"),
            ("all", f"subscribe /{SEEN}/", "101"),
            ("all", f"unsubscribe /{SEEN}/", "None"),
        }
        eventually(lambda: expected <= set(noted(browser, here.root)), "all of it noted")
        assert not [each for each in noted(browser, here.root) if "hall-9" in each[1]]
        found = browser.http.get(here.root + "audit", params={"who": "reader", "as": "json"}).json()["entries"][0]
        assert found["status"] == 403 and "stop" in found["reason"] and found["targetAddress"] == stop
        page = browser.http.get(here.root + "audit", params={"who": "reader"}, headers={"accept": "text/html"}).text
        assert found["reason"].split(";")[0] in html.unescape(page)
        lines = browser.http.get(here.root + "audit", params={"who": "reader", "as": "csv"}).text.splitlines()
        assert lines[0].startswith("time,who,what,target") and "reader,POST" in lines[1]
        said = browser.http.get(here.root + "audit").text
        assert "the-stop" in said and answer.headers["location"].rpartition("/")[2] in said
    assert here.gateway is not None
    here.gateway.said(f"gateway.audit: all: POST {path} 204")


def test_subscriptions_of_pages_are_shown_on_demand(here: AuthenticatedGateway) -> None:
    """A browser sends the address of the page; programs do not."""
    with here.browsing("all") as browser:
        robot = browser.robot(SEEN)
        token = f"Bearer {here.tokens['all']}"
        with Socket(robot.url, Authorization=token, Origin=here.root.rstrip("/"), X_Request_Id="a-page") as listening:
            listening.raw()
        url = here.root + "audit?as=json"

        def by_page() -> list[dict[str, object]]:
            return [each for each in browser.http.get(url + "&pages=on").json()["entries"] if each["byPage"]]

        assert eventually(lambda: len(by_page()) >= 2, "both ends of it noted")
        ids = {each["id"] for each in by_page()}
        assert not ids & {each["id"] for each in browser.http.get(url).json()["entries"]}


def test_links_lead_to_what_there_is(here: AuthenticatedGateway) -> None:
    with here.browsing("all") as browser:
        stop = browser.action(browser.robot(SEEN), LF.StopRobot)
        made = browser.http.post(stop).headers["location"]

        def entry() -> dict[str, object]:
            found = browser.http.get(here.root + "audit", params={"as": "json", "text": made.rpartition("/")[2]}).json()
            return next((each for each in found["entries"] if each["what"] == "POST"), {})

        assert eventually(entry, "the stop noted")["resultAddress"] == made
        assert browser.http.delete(made).status_code == 204
        assert "resultAddress" not in entry() and entry()["result"]


def test_a_target_that_is_no_path_is_noted_as_it_was(here: AuthenticatedGateway) -> None:
    """It does not make the audit unreadable."""
    with here.browsing("all") as browser:
        url = httpx.URL(here.root)
        with socket.create_connection((url.host, url.port), timeout=20) as connection:
            token = here.tokens["all"]
            head = f"POST example HTTP/1.1\r\nHost: {url.netloc.decode()}\r\nAuthorization: Bearer {token}\r\n"
            connection.sendall(f"{head}Content-Length: 0\r\nConnection: close\r\n\r\n".encode())
            assert connection.makefile("rb").readline().split()[1] == b"400"
        eventually(lambda: ("all", "POST example", "400") in noted(browser, here.root), "it noted")


def test_more_than_a_page_is_linked(here: AuthenticatedGateway) -> None:
    with here.browsing("all") as browser:
        stop = browser.action(browser.robot(SEEN), LF.StopRobot)
        before = len(noted(browser, here.root))
        for _ in range(105):
            assert browser.http.post(stop, headers={"prefer": "dry-run"}).status_code == 200
        eventually(lambda: len(noted(browser, here.root)) >= before + 105, "all pages")
        assert browser.http.get(here.root + "audit/x").status_code == 404
        assert browser.http.get(here.root + "audit", params={"before": "x"}).status_code == 400
        page = browser.http.get(here.root + "audit", headers={"accept": "text/html"})
        assert page.status_code == 200 and "Audit" in page.text


@pytest.mark.parametrize(
    ("name", "status"), [(None, 401), ("reader", 403), ("lab", 403), ("actor", 403), ("admin", 200), ("scraper", 200)]
)
def test_the_audit_needs_administration_of_the_fleet(here: AuthenticatedGateway, name: str | None, status: int) -> None:
    with here.browsing(name) as browser:
        assert browser.http.get(here.root + "audit").status_code == status


@pytest.mark.parametrize(("name", "linked"), [("reader", False), ("lab", False), ("admin", True)])
def test_the_root_links_the_audit_if_readable(here: AuthenticatedGateway, name: str, linked: bool) -> None:
    with here.browsing(name) as browser:
        audit = f"{here.root}audit"
        root = browser.http.get(here.root)
        assert (f"<{audit}>" in root.headers["link"]) == linked
        linkset = browser.http.get(here.root + "linkset", headers={"accept": "application/linkset"})
        assert (audit in linkset.text) == linked
        page = browser.http.get(here.root, headers={"accept": "text/html"})
        assert (f'href="{audit}"' in page.text) == linked
        assert audit not in browser.http.get(f"{here.root}{SEEN}/").headers["link"]


def test_nothing_waits_for_redis_and_nothing_is_forgotten(tmp_path: Path) -> None:
    with (
        single(tmp_path / "redis") as servers,
        run_authenticated(tmp_path, "--redis-url", servers.url) as own,
        own.browsing("root") as root,
    ):
        stop = root.action(root.robot(SEEN), LF.StopRobot)
        servers.kill()
        assert root.http.post(stop).status_code == 204
        assert root.http.get(own.root + "audit").status_code == 503
        assert own.gateway is not None
        own.gateway.said("gateway.audit: root: POST /lab-1/actions/stop 204")
        servers.start()

        def remembered() -> bool:
            answer = root.http.get(own.root + "audit")
            return answer.status_code == 200 and "POST /lab-1/actions/stop" in answer.text

        assert eventually(remembered, "the stop noted")
