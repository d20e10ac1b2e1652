"""The timeline of a gateway: what is in which window, for whom, in which form."""

import csv
import io
import time
from collections.abc import Iterator
from datetime import UTC, datetime, timedelta
from typing import Any

import httpx
import pyshacl
import pytest
import rdflib

from authenticated_gateway import ALL, HIDDEN, SEEN, AuthenticatedGateway, run_authenticated
from browser import DCTERMS, LF, PROV, Browser
from dom import parsed
from plain_words import for_programs
from running import eventually

pytestmark = pytest.mark.virtual
RAD = "http://qudt.org/vocab/unit/RAD"
LONG = {"type": "wait", "seconds": 600}
HOURLY = "FREQ=DAILY;BYHOUR=" + ",".join(map(str, range(24)))


@pytest.fixture(scope="module")
def here(tmp_path_factory: pytest.TempPathFactory) -> Iterator[AuthenticatedGateway]:
    with run_authenticated(tmp_path_factory.mktemp("timeline")) as one:
        one.add("both", *ALL)
        one.add("lab", "read", robots=("lab-*",))
        one.known("lab")
        yield one


@pytest.fixture(scope="module")
def happened(here: AuthenticatedGateway) -> dict[str, str]:
    """Let something of each kind happen with each robot. Return the addresses by robot and kind."""
    found = dict[str, str]()
    with here.browsing("both") as both:
        found["fleet stop"] = both.http.post(both.root + "actions/stopAll").headers["location"]
        for robot in (SEEN, HIDDEN):
            found |= {f"{robot} {kind}": iri for kind, iri in _happen(both, robot).items()}
    return found


def _happen(both: Browser, robot: str) -> dict[str, str]:
    post, root = both.http.post, both.root
    hold = {"type": "invoke", "action": f"{root}{robot}/wrist_3_joint/actions/hold"}
    held = post(hold["action"]).headers["location"]
    mission = post(root + "missions", json={"title": f"=nod of {robot}", "step": hold}).headers["location"]
    run = post(mission + "/actions/run").headers["location"].rpartition("/")[2]
    said = {"about": f"{root}{robot}/", "title": f"{robot} rattles.", "latched": True}
    assert post(root + "actions/raiseFault", json=said).status_code == 204
    waits = {"type": "sequence", "steps": [LONG, hold]}
    slow = post(root + "missions", json={"title": f"wait for {robot}", "step": waits}).headers["location"]
    begun, waiting = (post(root + "queue", json={"mission": slow}).headers["location"] for _ in range(2))
    eventually(lambda: _json(both, begun)["state"] == "running", "the first order")
    start = datetime.fromtimestamp(time.time(), UTC) + timedelta(days=1)
    planned = {"order": {"mission": mission}, "rule": HOURLY, "start": f"{start:%Y-%m-%dT%H}:30:00", "timeZone": "UTC"}
    schedule = post(root + "schedules", json=planned).headers["location"]
    return {"held": held, "run": f"{root}mission-runs/{run}", "waiting": waiting, "schedule": schedule}


def _json(browser: Browser, iri: str, **query: str) -> dict[str, Any]:
    answer = browser.http.get(iri, headers={"accept": "application/json"}, params=query)
    assert answer.status_code == 200, answer.text
    found: dict[str, Any] = answer.json()
    return found


def timeline(browser: Browser, **query: str) -> list[dict[str, Any]]:
    found: list[dict[str, Any]] = _json(browser, browser.root + "timeline", **query)["activities"]
    return found


def of(told: list[dict[str, Any]], kind: str, robot: str) -> list[dict[str, Any]]:
    return [each for each in told if each["kind"] == kind and any(f"/{robot}/" in iri for iri in each["robots"])]


def hours(first: float, last: float) -> dict[str, str]:
    now = datetime.fromtimestamp(time.time(), UTC)
    return {name: f"{now + timedelta(hours=at):%Y-%m-%dT%H:%M:%SZ}" for name, at in (("from", first), ("until", last))}


def test_it_has_what_happened_with_each_robot_and_by_whom(here: AuthenticatedGateway, happened: dict[str, str]) -> None:
    with here.browsing("both") as both:
        eventually(lambda: of(timeline(both), "mission", SEEN)[0]["state"] == "succeeded", "the end of the run")
        told = timeline(both)
        held = next(each for each in told if each["of"] == happened[f"{SEEN} held"])
        assert (held["title"], held["state"], held["who"]) == ("hold wrist_3_joint", "succeeded", "both")
        assert held["begin"] <= held["end"]
        run = next(each for each in told if each["of"] == happened[f"{SEEN} run"])
        assert (run["title"], run["who"]) == (f"=nod of {SEEN}", "both")
        (fault,) = of(told, "fault", SEEN)
        assert (fault["title"], fault["state"]) == (f"{SEEN} rattles.", "confirmed")
        assert "end" not in fault, "it goes on"
        stop = next(each for each in told if each["of"] == happened["fleet stop"])
        assert {iri.rstrip("/").rpartition("/")[2] for iri in stop["robots"]} == {SEEN, HIDDEN}
        assert [each["begin"] for each in told] == sorted(each["begin"] for each in told)


def test_a_run_is_not_told_twice(here: AuthenticatedGateway, happened: dict[str, str]) -> None:
    id = happened[f"{SEEN} run"].rpartition("/")[2]
    with here.browsing("both") as both:
        assert [each["kind"] for each in timeline(both) if each["of"].endswith(id)] == ["mission"]


def test_an_order_that_waits_is_planned_and_one_that_runs_is_its_run(
    here: AuthenticatedGateway, happened: dict[str, str]
) -> None:
    with here.browsing("both") as both:
        (order,) = of(timeline(both), "order", SEEN)
        assert (order["of"], order["state"], order["planned"]) == (happened[f"{SEEN} waiting"], "waiting", True)
        running = [each for each in of(timeline(both), "mission", SEEN) if each["state"] == "running"]
        assert [each["title"] for each in running] == [f"wait for {SEEN}"]


def test_starts_of_schedules_are_in_the_windows_to_come(here: AuthenticatedGateway, happened: dict[str, str]) -> None:
    with here.browsing("both") as both:
        assert not of(timeline(both), "schedule", SEEN)
        told = timeline(both, **hours(23.6, 28.6))
        starts = of(told, "schedule", SEEN)
        assert len(starts) in (4, 5)
        assert all(each["begin"].endswith(":30:00.000Z") for each in starts)
        assert {(each["of"], each["planned"]) for each in starts} == {(happened[f"{SEEN} schedule"], True)}
        assert {each["kind"] for each in told} == {"schedule"}


def test_nothing_is_in_the_windows_before(here: AuthenticatedGateway, happened: dict[str, str]) -> None:
    with here.browsing("both") as both:
        assert timeline(both, **hours(-50, -48)) == []


def test_hidden_robots_and_what_they_do_are_hidden(here: AuthenticatedGateway, happened: dict[str, str]) -> None:
    with here.browsing("lab") as lab:
        for query in ({}, hours(23.6, 28.6)):
            kinds = {each["kind"] for each in timeline(lab, **query)}
            assert kinds == ({"schedule"} if query else {"action", "mission", "fault", "order"})
            for media_type in ("application/json", "text/turtle", "text/csv", "text/html"):
                answer = lab.http.get(lab.root + "timeline", headers={"accept": media_type}, params=query)
                assert SEEN in answer.text
                assert HIDDEN not in answer.text, media_type


def test_a_hidden_robot_is_refused_as_one_that_does_not_exist(here: AuthenticatedGateway) -> None:
    with here.browsing("lab") as lab, here.browsing("both") as both:
        hidden, missing = (lab.http.get(lab.root + "timeline", params={"robot": each}) for each in (HIDDEN, "nobody-1"))
        assert hidden.status_code == missing.status_code == 404
        assert hidden.text.replace(HIDDEN, "nobody-1") == missing.text
        assert both.http.get(both.root + "timeline", params={"robot": HIDDEN}).status_code == 200


def test_of_one_robot_it_has_what_that_takes_part_in(here: AuthenticatedGateway, happened: dict[str, str]) -> None:
    with here.browsing("both") as both:
        told = timeline(both, robot=SEEN)
        assert happened["fleet stop"] in {each["of"] for each in told}
        assert all(f"{both.root}{SEEN}/" in each["robots"] for each in told)
        assert happened[f"{HIDDEN} held"] not in {each["of"] for each in told}


def test_the_description_conforms_to_its_blueprint(here: AuthenticatedGateway, happened: dict[str, str]) -> None:
    with here.browsing("both") as both:
        page = both.page(both.root + "timeline")
        shapes = both.page(both.root + "timeline/blueprint").graph
        assert pyshacl.validate(page.graph, shacl_graph=shapes, inference="none")[0]
        assert str(both.page(both.root).one(LF.timeline)) == both.root + "timeline"
        (held,) = page.graph.subjects(LF.activityOf, rdflib.URIRef(happened[f"{SEEN} held"]))
        assert (held, rdflib.RDF.type, PROV.Activity) in page.graph
        who = page.graph.value(held, PROV.wasAssociatedWith)
        assert str(page.graph.value(who, DCTERMS.title)) == "both"
        assert page.graph.value(held, PROV.startedAtTime) <= page.graph.value(held, PROV.endedAtTime)


def test_csv_has_a_line_for_each_activity_and_no_formula(here: AuthenticatedGateway, happened: dict[str, str]) -> None:
    with here.browsing("both") as both:
        answer = both.http.get(both.root + "timeline?as=csv")
        assert answer.headers["content-type"].startswith("text/csv")
        assert "timeline.csv" in answer.headers["content-disposition"]
        head, *lines = csv.reader(io.StringIO(answer.text, newline=""))
        assert head[:2] == ["begin", "end"]
        assert {line[-1] for line in lines} == {each["of"] for each in timeline(both)}
        assert [line[5] for line in lines if line[-1] == happened[f"{SEEN} run"]] == [f"'=nod of {SEEN}"]


@pytest.mark.parametrize(
    "query", ["from=now", "until=2026-11-30", "from=2026-11-30T00:00:00Z&until=1970-01-01T00:00:00Z", "what=1"]
)
def test_a_malformed_window_is_refused_with_a_sentence(here: AuthenticatedGateway, query: str) -> None:
    with here.browsing("both") as both:
        answer = both.http.get(f"{both.root}timeline?{query}")
        assert answer.status_code == 400
        assert len(answer.json()["detail"].split()) > 5


# -- the page ---------------------------------------------------------------------------------------------------------


def _page(browser: Browser, **query: str) -> httpx.Response:
    answer = browser.http.get(browser.root + "timeline", headers={"accept": "text/html"}, params=query)
    assert answer.status_code == 200, answer.text
    return answer


def test_the_page_has_a_row_for_each_robot_and_the_fleet(here: AuthenticatedGateway, happened: dict[str, str]) -> None:
    with here.browsing("both") as both:
        page = parsed(_page(both).content)
        chart = next(each for each in page.all("table") if each.get("class") == "timeline")
        heads = [each.text.split()[0] for each in chart.all("th") if each.get("scope") == "row"]
        assert heads == ["Fleet", *sorted((SEEN, HIDDEN))]
        links = {each["href"] for each in chart.all("a")}
        assert {happened[f"{SEEN} held"], happened[f"{SEEN} run"], happened[f"{SEEN} waiting"]} <= links
        rows = next(each for each in page.all("section") if each.get("id") == "activities")
        assert {happened[f"{SEEN} held"], happened[f"{HIDDEN} waiting"]} <= {each["href"] for each in rows.all("a")}


def test_the_page_has_plain_words_and_no_style_of_its_own(here: AuthenticatedGateway, happened: dict[str, str]) -> None:
    with here.browsing("both") as both:
        for query in ({}, hours(23.6, 28.6), hours(-50, -48), {"robot": SEEN}):
            answer = _page(both, **query)
            assert for_programs(parsed(answer.content)) == []
            assert " style=" not in answer.text
            assert "<style" not in answer.text


def test_other_times_are_links_that_work_without_a_script(here: AuthenticatedGateway) -> None:
    with here.browsing("both") as both:
        page = parsed(_page(both, robot=SEEN, **hours(-1, 1)).content)
        ways = {each.text: each["href"] for each in page.all("a") if each.get("class") == "button"}
        assert {"Earlier", "Later", "Zoom in", "Zoom out", "Now"} <= ways.keys()
        for text, href in ways.items():
            answer = both.http.get(href, headers={"accept": "application/json"})
            assert answer.status_code == 200, text
        told = both.http.get(ways["Zoom in"], headers={"accept": "application/json"}).json()
        length = datetime.fromisoformat(told["until"]) - datetime.fromisoformat(told["from"])
        assert length == timedelta(hours=1)


def test_what_happened_links_the_time_around_it(here: AuthenticatedGateway, happened: dict[str, str]) -> None:
    with here.browsing("both") as both:
        (fault,) = of(timeline(both), "fault", SEEN)
        for iri in (happened[f"{SEEN} held"], happened[f"{SEEN} run"], fault["of"]):
            page = parsed(both.http.get(iri, headers={"accept": "text/html"}).content)
            (href,) = [each["href"] for each in page.all("a") if each.text == "In the timeline"]
            told = both.http.get(href, headers={"accept": "application/json"}).json()
            assert iri in {each["of"] for each in told["activities"]}, iri
            length = datetime.fromisoformat(told["until"]) - datetime.fromisoformat(told["from"])
            assert length < timedelta(minutes=10)
