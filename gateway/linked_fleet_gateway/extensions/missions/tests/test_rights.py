"""A mission has the present rights of who runs it, and shows nobody more than they may see."""

from collections.abc import Iterator
from types import SimpleNamespace

import httpx
import pytest

from authenticated_gateway import ALL, HIDDEN, SEEN, AuthenticatedGateway, run_authenticated
from browser import LDP, LF, Browser
from linked_fleet_gateway.extensions.missions.mission import Invoke, Mission
from linked_fleet_gateway.extensions.missions.targets import Targets
from running import eventually

pytestmark = pytest.mark.virtual
RAD = "http://qudt.org/vocab/unit/RAD"


@pytest.fixture(scope="module")
def here(tmp_path_factory: pytest.TempPathFactory) -> Iterator[AuthenticatedGateway]:
    with run_authenticated(tmp_path_factory.mktemp("guarded")) as one:
        one.add("reader", "read")
        one.add("writer", "read", "act", robots=("lab-*",))
        one.add("hall", *ALL, robots=("hall-*",))
        one.add("seer", "read")
        one.add("both", "read", "act")
        one.known("both")
        yield one


def mission(browser: Browser, robot: str, *before: dict[str, object]) -> httpx.Response:
    action = f"{browser.root}{robot}/wrist_3_joint/actions/rotate"
    turn = {"type": "invoke", "action": action, "body": {"value": 0.2, "unit": RAD}}
    step = {"type": "sequence", "steps": [*before, turn]}
    return browser.http.post(browser.root + "missions", json={"title": "turn", "step": step})


def succeeds(browser: Browser, run: str) -> None:
    """Wait for the end of a run, which then has no control of its robot any more."""
    eventually(lambda: browser.page(run).one(LF.state) == LF.succeeded, lambda: browser.page(run).response.text)


def test_writing_takes_the_right_to_each_action(here: AuthenticatedGateway) -> None:
    with here.browsing("reader") as reader, here.browsing("writer") as writer:
        assert mission(reader, SEEN).status_code == 403
        assert mission(writer, HIDDEN).status_code == 422
        assert mission(writer, SEEN).status_code == 201


def test_missions_and_runs_are_hidden_with_their_robots(here: AuthenticatedGateway) -> None:
    with here.browsing("hall") as hall, here.browsing("both") as both:
        answer = mission(both, SEEN)
        iri = answer.headers["location"]
        begun = both.http.post(iri + "/actions/run")
        assert begun.status_code == 204, begun.text
        run = f"{both.root}mission-runs/{begun.headers['location'].rpartition('/')[2]}"
        assert both.http.get(run).status_code == 200
        for path in (iri, run, iri + "/actions/run"):
            assert hall.http.get(path).status_code == 404, path
        for container in ("missions", "mission-runs"):
            page = hall.page(hall.root + container)
            assert not list(page.graph.objects(None, LDP.contains))
            assert SEEN not in page.response.text
        succeeds(both, run)


def test_invocations_of_missions_are_hidden_in_queries_too(here: AuthenticatedGateway) -> None:
    query = 'SELECT ?s ?o WHERE { ?s ?p ?o FILTER(CONTAINS(STR(?s), "/missions/")) }'
    fields = {"content-type": "application/sparql-query"}
    with here.browsing("hall") as hall, here.browsing("both") as both:
        iri = mission(both, SEEN).headers["location"]
        begun = both.http.post(iri + "/actions/run")
        assert begun.status_code == 204, begun.text
        succeeds(both, f"{both.root}mission-runs/{begun.headers['location'].rpartition('/')[2]}")
        assert iri in both.http.post(both.root + "query", content=query, headers=fields).text
        assert iri not in hall.http.post(hall.root + "query", content=query, headers=fields).text


@pytest.mark.parametrize(
    ("iri", "named"),
    [
        ("https://fleet.example/arm/elbow/actions/rotate", {"arm"}),
        ("https://fleet.example/gone/elbow/actions/rotate", {"gone"}),  # it may come back
        ("https://fleet.example/world/objects/1", set()),
        ("http://10.0.0.7:8000/arm/elbow/actions/rotate", {"arm"}),
        ("http://10.0.0.7:8000/gone/elbow/actions/rotate", set()),
        ("http://[::1/arm/", {"arm"}),
        ("http://qudt.org/vocab/unit/RAD", set()),
        ("http://10.0.0.7/arm/", {"arm"}),
        ("arm/", set()),
    ],
)
def test_a_robot_is_hidden_whichever_gateway_its_url_names(iri: str, named: set[str]) -> None:
    world = SimpleNamespace(at_root=("world",))
    core = SimpleNamespace(extensions=(world,), public_urls=("https://fleet.example",), robots={"arm": None})
    step = Invoke(kind="k", of=iri, body={"at": iri})
    assert Targets(core).named_robots(Mission("m", step)) == named  # type: ignore[arg-type]


def test_changing_a_run_takes_the_right_to_its_robots(here: AuthenticatedGateway) -> None:
    with here.browsing("both") as both, here.browsing("seer") as seer:
        iri = mission(both, SEEN, {"type": "confirm", "text": "now?"}).headers["location"]
        begun = both.http.post(iri + "/actions/run")
        run = f"{both.root}mission-runs/{begun.headers['location'].rpartition('/')[2]}"
        eventually(lambda: "lf:waiting" in both.http.get(run, headers={"accept": "text/turtle"}).text, "the question")
        answer = {"step": "0.0", "confirmed": True}
        assert seer.http.post(run + "/actions/confirm", json=answer).status_code == 403
        assert both.http.post(run + "/actions/confirm", json=answer).status_code == 204
        succeeds(both, run)


def test_a_right_that_has_ended_ends_the_run(here: AuthenticatedGateway) -> None:
    here.add("guest", "read", "act")
    here.known("guest")
    with here.browsing("guest") as guest, here.browsing("both") as both:
        iri = mission(guest, SEEN, {"type": "confirm", "text": "now?"}).headers["location"]
        begun = guest.http.post(iri + "/actions/run")
        run = f"{both.root}mission-runs/{begun.headers['location'].rpartition('/')[2]}"
        eventually(lambda: "lf:waiting" in both.http.get(run, headers={"accept": "text/turtle"}).text, "the question")
        here.revoke("guest")
        eventually(lambda: guest.http.get(guest.root).status_code == 401, "the guest is gone")
        assert both.http.post(run + "/actions/confirm", json={"step": "0.0", "confirmed": True}).status_code == 204
        eventually(lambda: both.page(run).one(LF.state) == LF.failed, lambda: both.page(run).response.text)
        assert "rights" in str(both.page(run).one(LF.reason))
