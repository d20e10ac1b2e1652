"""Faults are hidden with their robots, and people change those of robots on which they have the right."""

from collections.abc import Iterator

import pytest

from authenticated_gateway import HIDDEN, SEEN, AuthenticatedGateway, run_authenticated
from browser import LDP, LF, Browser

pytestmark = pytest.mark.virtual


@pytest.fixture(scope="module")
def here(tmp_path_factory: pytest.TempPathFactory) -> Iterator[AuthenticatedGateway]:
    with run_authenticated(tmp_path_factory.mktemp("faults")) as one:
        one.add("hall", "read", "act", "reset", robots=("hall-*",))
        one.add("lab", "read", "act", robots=("lab-*",))
        one.add("reader", "read", robots=("lab-*",))
        one.add("mixed", "read")
        one.known("mixed")
        yield one


def told(browser: Browser, robot: str, **more: object) -> int:
    said = {"about": f"{browser.root}{robot}/", "title": "It rattles.", "latched": True, **more}
    return browser.http.post(browser.root + "actions/raiseFault", json=said).status_code


def listed(browser: Browser) -> list[str]:
    page = browser.page(browser.root + "faults")
    return [str(each) for each in page.graph.objects(page.iri, LDP.contains)]


def test_raising_takes_the_right_to_act_and_sight_of_the_robot(here: AuthenticatedGateway) -> None:
    with here.browsing("lab") as lab, here.browsing("reader") as reader, here.browsing("mixed") as mixed:
        assert told(lab, HIDDEN) == 422, "as a robot that does not exist"
        assert told(reader, SEEN) == 403
        assert told(mixed, SEEN) == 403
        assert told(lab, SEEN) == 204


def test_faults_are_hidden_with_their_robots_in_queries_too(here: AuthenticatedGateway) -> None:
    query = "PREFIX lf: <https://w3id.org/linked-fleet#> SELECT ?about WHERE { ?fault lf:about ?about }"
    with here.browsing("hall") as hall, here.browsing("lab") as lab, here.browsing("reader") as reader:
        assert told(hall, HIDDEN) == told(lab, SEEN) == 204
        (seen,) = listed(hall)
        assert str(hall.page(seen).one(LF.about)) == f"{hall.root}{HIDDEN}/"
        assert lab.http.get(seen).status_code == 404
        assert lab.http.get(seen + "/actions/acknowledge").status_code == 404
        fields = {"content-type": "application/sparql-query"}
        answer = reader.http.post(reader.root + "query", content=query, headers=fields)
        assert f"{SEEN}/" in answer.text
        assert HIDDEN not in answer.text


def test_acknowledging_and_clearing_take_rights_on_the_robot(here: AuthenticatedGateway) -> None:
    with here.browsing("lab") as lab, here.browsing("reader") as reader, here.browsing("root") as root:
        assert told(lab, SEEN) == 204
        (iri,) = listed(lab)
        assert reader.http.post(iri + "/actions/acknowledge").status_code == 403
        assert lab.http.post(iri + "/actions/acknowledge").status_code == 204
        assert str(lab.page(iri).one(LF.acknowledgedBy)) == "lab"
        assert lab.http.post(iri + "/actions/clear").status_code == 403, "this takes the right to reset"
        assert lab.http.delete(iri).status_code == 403
        assert root.http.post(iri + "/actions/clear").status_code == 204
        assert root.http.delete(iri).status_code == 204
        assert iri not in listed(lab)
