"""A rule has its creator's present rights when it fires, and shows nobody more than they may see."""

from collections.abc import Iterator

import pytest
from rdflib import URIRef

from authenticated_gateway import ALL, HIDDEN, SEEN, AuthenticatedGateway, run_authenticated
from browser import LDP, LF, Browser
from rules_client import a_rule, container, fired, firings, post, posted, put, sides
from running import eventually
from small_fleet import move

pytestmark = pytest.mark.virtual
LAB = ("lab-*",)
_BODY = "vom:numericalValue 0.1 ; vom:unit unit:RAD"


@pytest.fixture(scope="module")
def here(tmp_path_factory: pytest.TempPathFactory) -> Iterator[AuthenticatedGateway]:
    with run_authenticated(tmp_path_factory.mktemp("guarded"), "--rules-per-client", "2") as one:
        one.add("reader", "read")
        one.add("subscriber", "read", "subscribe")
        one.add("writer", "read", "subscribe", "act", robots=LAB)
        one.add("colleague", "read", "subscribe", "act", robots=LAB)
        one.add("hall", *ALL, robots=("hall-*",))
        one.add("guard", "read", "stop", robots=("hall-*", *LAB))
        one.known("guard")
        yield one


@pytest.fixture(scope="module")
def root(here: AuthenticatedGateway) -> Iterator[Browser]:
    with here.browsing("root") as browser:
        yield browser


@pytest.fixture
def rule(here: AuthenticatedGateway, root: Browser) -> Iterator[str]:
    """Return the writer's rule: the position of one joint controls another."""
    with here.browsing("writer") as writer:
        text = a_rule(
            sides(joint(root, SEEN)), rotate(root, SEEN), _BODY, 'lf:toldApartBy "side" ; lf:minimumInterval 0'
        )
        turn(root, 0.0)
        iri = posted(writer, text)
        reaches(root, iri, LF.active)
        yield iri
    assert root.http.delete(iri).status_code == 204


def joint(root: Browser, robot: str) -> str:
    return root.part(robot, "wrist_2_joint").url


def rotate(root: Browser, robot: str, name: str = "wrist_3_joint") -> str:
    return root.action(root.part(robot, name), LF.Rotate)


def turn(root: Browser, angle: float) -> None:
    """Move until the first joint is there."""
    assert move(root, rotate(root, SEEN, "wrist_2_joint"), angle, prefer="wait=20").status_code == 204


def reaches(root: Browser, rule: str, state: URIRef) -> None:
    eventually(lambda: root.page(rule).one(LF.state) == state, lambda: root.page(rule).response.text)


@pytest.mark.parametrize("name", ["reader", "subscriber"])
def test_a_rule_takes_the_rights_to_be_told_and_to_act(here: AuthenticatedGateway, root: Browser, name: str) -> None:
    with here.browsing(name) as browser:
        answer = post(browser, a_rule(sides(joint(root, SEEN)), rotate(root, SEEN), _BODY))
        assert answer.status_code == 403


def test_rules_need_the_right_to_see_and_move_their_robots(here: AuthenticatedGateway, root: Browser) -> None:
    with here.browsing("writer") as writer:
        answer = post(writer, a_rule(sides(joint(root, SEEN)), rotate(root, HIDDEN), _BODY))
        absent = post(writer, a_rule(sides(joint(root, SEEN)), rotate(root, HIDDEN).replace(HIDDEN, "hall-9"), _BODY))
        assert answer.status_code == absent.status_code == 422
        assert answer.json()["detail"].replace(HIDDEN, "hall-9") == absent.json()["detail"]


def test_a_rule_is_invisible_without_the_right_to_its_robots(
    here: AuthenticatedGateway, root: Browser, rule: str
) -> None:
    with here.browsing("hall") as browser:
        assert browser.http.get(rule).status_code == browser.http.get(rule + "/firings").status_code == 404
        assert not list(browser.page(container(browser)).graph.objects(None, LDP.contains))
        assert browser.http.delete(rule).status_code == 404
    with here.browsing("colleague") as browser:
        assert browser.page(rule).one(LF.enabled)


def test_creators_change_rules_and_administrators_delete_them(
    here: AuthenticatedGateway, root: Browser, rule: str
) -> None:
    with here.browsing("colleague") as browser:
        assert put(browser, rule, "lf:enabled true", "lf:enabled false").status_code == 403
        assert browser.http.delete(rule).status_code == 403
    assert put(root, rule, '"a rule"', '"another rule"').status_code == 403
    assert put(root, rule, "lf:enabled true", "lf:enabled false").status_code == 204
    reaches(root, rule, LF.disabled)
    with here.browsing("writer") as writer:
        assert put(writer, rule, "lf:enabled false", "lf:enabled true").status_code == 204
    reaches(root, rule, LF.active)


def test_a_rule_fires_with_the_present_rights_of_its_creator(
    here: AuthenticatedGateway, root: Browser, rule: str
) -> None:
    turn(root, 1.2)
    assert fired(root, rule, 1) == [("accepted", "up")]
    whole = here.tables["writer"]
    here.tables["writer"] = whole.replace('"act"', '"stop"')
    here.write()
    reaches(root, rule, LF.suspended)
    assert "act" in str(root.page(rule).one(LF.reason))
    here.revoke("writer")
    eventually(lambda: "rights of its creator ended" in root.http.get(rule).text, "ended")
    turn(root, 0.0)
    assert len(firings(root, rule)) == 1
    here.tables["writer"] = whole
    here.write()
    reaches(root, rule, LF.active)
    assert len(firings(root, rule)) == 1  # a condition that came to hold while the creator had no rights is not new
    turn(root, 1.2)
    assert fired(root, rule, 2)[1:] == [("accepted", "up")]


def test_the_reason_of_a_stop_names_no_robot_that_the_creator_may_not_see(
    here: AuthenticatedGateway, root: Browser, rule: str
) -> None:
    with here.browsing("guard") as browser:
        assert browser.http.post(here.root + "actions/stopAll").status_code == 204
    reaches(root, rule, LF.disabled)
    with here.browsing("writer") as writer:
        assert str(writer.page(rule).one(LF.reason)) == f"disabled because {SEEN} was stopped"


def test_a_client_has_so_many_rules(here: AuthenticatedGateway, root: Browser, rule: str) -> None:
    text = a_rule(sides(joint(root, SEEN)), rotate(root, SEEN), _BODY)
    with here.browsing("writer") as writer:
        second = posted(writer, text)
        assert post(writer, text).status_code == 429
        assert writer.http.delete(second).status_code == 204


def test_firings_are_audited(root: Browser, rule: str) -> None:
    turn(root, 1.2)
    fired(root, rule, 1)
    path = rule.removeprefix(root.root.rstrip("/")) + "/firings/1"
    entry = eventually(lambda: path in root.http.get(root.root + "audit").text, "an entry")
    assert entry
