"""The tags of a robot are set by those who administer it, and shown where its fleet lists it."""

from collections.abc import Iterator

import pytest
from rdflib import Literal, URIRef

from authenticated_gateway import SEEN, AuthenticatedGateway, run_with_driver
from browser import LF, Browser

pytestmark = pytest.mark.virtual


@pytest.fixture(scope="module")
def here(tmp_path_factory: pytest.TempPathFactory) -> Iterator[AuthenticatedGateway]:
    with run_with_driver(tmp_path_factory.mktemp("guarded")) as one:
        yield one


def put(browser: Browser, *tags: str) -> int:
    return browser.http.put(f"{browser.root}{SEEN}/tags", json={"tags": tags}).status_code


def test_tags_are_set_and_listed(here: AuthenticatedGateway) -> None:
    with here.browsing("driver") as driver, here.browsing("admin") as admin:
        assert put(driver, "arms") == 403
        assert put(admin, "hall 3", "arms", "arms ") == 204
        found = driver.http.get(f"{driver.root}{SEEN}/tags", headers={"accept": "application/json"})
        assert found.json()["tags"] == ["arms", "hall 3"]
        fleet, robot = driver.page(driver.root), URIRef(f"{driver.root}{SEEN}/")
        assert set(fleet.graph.objects(robot, LF.tag)) == {Literal("arms"), Literal("hall 3")}
        patch = "DELETE DATA { <> <https://w3id.org/linked-fleet#tag> 'arms' }"
        sparql = {"content-type": "application/sparql-update"}
        answer = admin.http.patch(f"{admin.root}{SEEN}/tags", content=patch, headers=sparql)
        assert answer.status_code == 204, answer.text
        assert set(driver.page(driver.root).graph.objects(robot, LF.tag)) == {Literal("hall 3")}
        assert admin.http.delete(f"{admin.root}{SEEN}/tags").status_code == 204
        assert set(driver.page(driver.root).graph.objects(robot, LF.tag)) == set()


@pytest.mark.parametrize("tag", ["", " ", "a,b", "x" * 41, "a\nb"])
def test_what_is_no_tag_is_refused(here: AuthenticatedGateway, tag: str) -> None:
    with here.browsing("admin") as admin:
        assert put(admin, tag) == 422
