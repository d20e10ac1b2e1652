"""Notes are kept with who has written them and when, are shared by gateways, and hidden as their robots are."""

from collections.abc import Iterator

import httpx
import pytest
from rdflib import Literal, URIRef

from authenticated_gateway import ALL, HIDDEN, SEEN, AuthenticatedGateway, run_authenticated
from browser import DCTERMS, LF, Browser
from gateway_group import Gateway
from linked_fleet_gateway.extensions.notes import extension
from redis_servers import Servers
from running import eventually
from subscribers import members

pytestmark = pytest.mark.virtual
JSON = {"accept": "application/json"}


def write(browser: Browser, about: str, text: str = "Mind the cable.") -> httpx.Response:
    return browser.http.post(browser.root + "notes", json={"about": browser.root + about, "text": text})


def listed(browser: Browser, path: str) -> set[str]:
    return members(browser.page(browser.root + path))


@pytest.fixture(scope="module")
def here(tmp_path_factory: pytest.TempPathFactory) -> Iterator[AuthenticatedGateway]:
    with run_authenticated(tmp_path_factory.mktemp("guarded")) as one:
        one.add("admin", *ALL)
        for name in ("ann", "bob"):
            one.add(name, "read", "act")
        one.add("lab", "read", "act", robots=("lab-*",))
        one.add("reader", "read")
        one.known("reader")
        yield one


def test_a_note_has_an_author_and_a_time(here: AuthenticatedGateway) -> None:
    with here.browsing("ann") as ann, here.browsing("bob") as bob, here.browsing("admin") as admin:
        url = write(ann, f"{SEEN}/", "It squeaks.\nI have greased it.").headers["location"]
        page = bob.page(url)
        assert (page.iri, LF.writtenBy, Literal("ann")) in page.graph
        assert (page.iri, DCTERMS.title, Literal("It squeaks.")) in page.graph
        assert page.one(DCTERMS.created)
        assert url in listed(bob, f"{SEEN}/notes") and url in listed(bob, "notes")
        assert bob.http.delete(url).status_code == 403
        assert bob.http.put(url, json={"about": f"{bob.root}{SEEN}/", "text": "It is fine."}).status_code == 403
        changed = ann.http.put(url, json={"about": f"{ann.root}{SEEN}/", "text": "It squeaked."})
        assert changed.status_code == 204, changed.text
        html = bob.http.get(f"{bob.root}{SEEN}/notes", headers={"accept": "text/html"}).text
        assert "It squeaked." in html and "ann" in html
        corrected = admin.http.put(url, json={"about": f"{ann.root}{SEEN}/", "text": "It squeaked once."})
        assert corrected.status_code == 204, corrected.text
        after = bob.page(url)
        assert (after.iri, LF.writtenBy, Literal("ann")) in after.graph
        assert after.one(DCTERMS.created) == page.one(DCTERMS.created)
        assert ann.http.delete(url).status_code == 204


def test_what_is_hidden_is_refused_like_what_is_not_there(here: AuthenticatedGateway) -> None:
    with here.browsing("lab") as lab:
        hidden, nothing = (write(lab, about).json()["detail"] for about in (f"{HIDDEN}/", "nobody/"))
        assert hidden.replace(HIDDEN, "nobody") == nothing


def test_a_robot_has_at_most_so_many_notes(here: AuthenticatedGateway, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(extension, "MOST_OF_ROBOT", 1)
    with here.browsing("ann") as ann:
        url = write(ann, f"{SEEN}/").headers["location"]
        refused = write(ann, f"{SEEN}/elbow_joint")
        assert refused.status_code == 409 and "Delete some first" in refused.text
        assert ann.http.put(url, json={"about": f"{ann.root}{SEEN}/", "text": "Changed."}).status_code == 204
        assert ann.http.delete(url).status_code == 204


def test_notes_take_the_right_to_act_and_something_that_is_there(here: AuthenticatedGateway) -> None:
    with here.browsing("reader") as reader, here.browsing("ann") as ann, here.browsing("lab") as lab:
        assert write(reader, f"{SEEN}/").status_code == 403
        for nothing in ("nobody/", "faults/1", "", f"{SEEN}/nose"):
            answer = write(ann, nothing)
            assert answer.status_code == 422 and "There is no robot, part of one or fault" in answer.text, nothing
        for text in ("", " ", "\x07"):
            assert write(ann, f"{SEEN}/", text).status_code == 422
        foreign = ann.http.post(ann.root + "notes", json={"about": f"http://elsewhere.example/{SEEN}/", "text": "x"})
        assert foreign.status_code == 422
        assert write(lab, f"{HIDDEN}/").status_code == 422
        url = write(ann, f"{HIDDEN}/").headers["location"]
        assert lab.http.get(url).status_code == 404 and url not in listed(lab, "notes")
        assert ann.http.delete(url).status_code == 204


def test_notes_about_a_part_are_in_the_timeline(here: AuthenticatedGateway) -> None:
    with here.browsing("ann") as ann:
        url = write(ann, f"{SEEN}/elbow_joint", "It is warm.").headers["location"]
        said = ann.http.get(f"{ann.root}timeline?robot={SEEN}", headers=JSON).json()
        (note,) = (each for each in said["activities"] if each["kind"] == "note")
        assert (note["title"], note["state"], note["who"]) == ("It is warm.", "noted", "ann")
        turtle = ann.http.get(f"{ann.root}timeline", headers={"accept": "text/turtle"})
        assert turtle.status_code == 200 and "It is warm." in turtle.text
        assert ann.http.delete(url).status_code == 204


def test_a_fault_has_notes(here: AuthenticatedGateway) -> None:
    with here.browsing("ann") as ann:
        said = {"about": f"{ann.root}{SEEN}/", "title": "It rattles."}
        assert ann.http.post(ann.root + "actions/raiseFault", json=said, headers={"prefer": "wait=10"}).is_success
        (fault,) = eventually(lambda: listed(ann, "faults"), "the fault")
        url = write(ann, fault.removeprefix(ann.root)).headers["location"]
        page = ann.page(f"{ann.root}{SEEN}/notes")
        assert (URIRef(url), LF.noteAbout, URIRef(fault)) in page.graph


def test_gateways_share_notes_and_refuse_them_while_redis_is_away(
    two_and_store: tuple[Servers, Gateway, Gateway],
) -> None:
    memory, one, other = two_and_store
    path = write(one.browser, "ur5/").headers["location"].removeprefix(one.browser.root)
    eventually(lambda: other.get(other.browser.root + path).status_code == 200, "the note at the other gateway")
    memory.kill()
    answer = write(one.browser, "ur5/")
    tags = one.browser.http.put(one.browser.root + "ur5/tags", json={"tags": ["x"]})
    assert answer.status_code == 503 and answer.json()["detail"] == tags.json()["detail"]
    assert one.get(one.browser.root + path).status_code == 200
