"""Rules run missions, with the present rights of their creators, and a stop disables them."""

from collections.abc import Iterator
from typing import Any

import pytest
from rdflib import URIRef

from authenticated_gateway import ALL, HIDDEN, SEEN, AuthenticatedGateway, run_authenticated
from browser import LDP, LF, Browser
from rules_client import a_rule, fired, firings, posted, put, sides
from running import eventually
from small_fleet import move

pytestmark = pytest.mark.virtual
RAD = "http://qudt.org/vocab/unit/RAD"
BY_SIDE = 'lf:toldApartBy "side" ; lf:minimumInterval 0'


@pytest.fixture(scope="module")
def here(tmp_path_factory: pytest.TempPathFactory) -> Iterator[AuthenticatedGateway]:
    with run_authenticated(tmp_path_factory.mktemp("guarded")) as one:
        one.add("writer", "read", "subscribe", "act", robots=("lab-*",))
        one.add("hall", *ALL, robots=("hall-*",))
        one.known("hall")
        yield one


@pytest.fixture(scope="module")
def root(here: AuthenticatedGateway) -> Iterator[Browser]:
    with here.browsing("root") as browser:
        yield browser


@pytest.fixture
def writer(here: AuthenticatedGateway, root: Browser) -> Iterator[Browser]:
    """Yield who writes a mission and a rule; both are removed afterwards."""
    turn(root, 0.0)
    with here.browsing("writer") as browser:
        yield browser
    for each in ("rules", "missions"):
        for member in root.page(root.root + each).graph.objects(None, LDP.contains):
            assert root.http.delete(str(member)).status_code == 204


def turn(root: Browser, angle: float) -> None:
    """Move until the joint of the condition is there."""
    action = root.action(root.part(SEEN, "wrist_2_joint"), LF.Rotate)
    assert move(root, action, angle, prefer="wait=20").status_code == 204


def mission(browser: Browser, joint: str = "wrist_3_joint", **more: Any) -> str:
    action = f"{browser.root}{SEEN}/{joint}/actions/rotate"
    step = {"type": "invoke", "action": action, "body": {"value": {"variable": "angle"}, "unit": RAD}}
    parameter = {"name": "angle", "type": "number", "minimum": -1, "maximum": 1, **more}
    given = {"title": "turn", "parameters": [parameter], "step": step}
    answer = browser.http.post(browser.root + "missions", json=given)
    assert answer.status_code == 201, answer.text
    return answer.headers["location"]


def rule(browser: Browser, mission: str, body: str = "", holds: str = "") -> str:
    """Write a rule that runs a mission when the joint is on another side, or when the angle ?x is so."""
    condition = sides(browser.part(SEEN, "wrist_2_joint").url)
    if holds:
        condition = condition.replace("BIND(?x / 10 AS ?target)", f"FILTER({holds})").replace("?side ?target", "?side")
    iri = posted(browser, a_rule(condition, f"{mission}/actions/run", body, BY_SIDE))
    reaches(browser, iri, LF.active)
    return iri


def reaches(browser: Browser, rule: str, state: URIRef) -> None:
    eventually(lambda: browser.page(rule).one(LF.state) == state, lambda: browser.page(rule).response.text)


def ran(browser: Browser, rule: str, number: int) -> dict[str, Any]:
    """Return the run that a firing began, once it is over."""
    firing = browser.page(f"{rule}/firings/{number}")
    run = f"{browser.root}mission-runs/{str(firing.one(LF.invocation)).rpartition('/')[2]}"

    def said() -> dict[str, Any]:
        return dict(browser.http.get(run, headers={"accept": "application/json"}).json())

    eventually(lambda: said()["state"] in ("succeeded", "failed"), lambda: str(said()))
    return said()


def test_a_rule_runs_a_mission_with_values_of_its_condition(root: Browser, writer: Browser) -> None:
    made = mission(writer)
    iri = rule(writer, made, f'<{made}#angle> [ lf:variable "target" ]')
    turn(root, 1.2)
    assert fired(root, iri, 1) == [("accepted", "up")]
    run = ran(writer, iri, 1)
    assert run["state"] == "succeeded", run
    assert run["values"]["angle"] == pytest.approx(0.11, abs=0.011)


def test_a_rule_runs_a_mission_with_its_defaults(root: Browser, writer: Browser) -> None:
    iri = rule(writer, mission(writer, default=0.2))
    turn(root, 1.2)
    assert fired(root, iri, 1) == [("accepted", "up")]
    assert ran(writer, iri, 1)["values"] == {"angle": 0.2}


def test_values_that_the_mission_refuses_are_the_reason_of_a_failed_firing(root: Browser, writer: Browser) -> None:
    made = mission(writer)
    iri = rule(writer, made, f"<{made}#angle> 7")
    turn(root, 1.2)
    assert fired(root, iri, 1) == [("failed", "up")]
    assert "angle" in str(root.page(f"{iri}/firings/1").one(LF.reason))


def test_a_run_by_a_rule_has_the_present_rights_of_its_creator(
    here: AuthenticatedGateway, root: Browser, writer: Browser
) -> None:
    iri = rule(writer, mission(writer, default=0.2))
    whole = here.tables["writer"]
    here.tables["writer"] = whole.replace('"act"', '"stop"')
    here.write()
    reaches(root, iri, LF.suspended)
    turn(root, 1.2)
    assert firings(root, iri) == []
    here.tables["writer"] = whole
    here.write()
    reaches(root, iri, LF.active)


def test_a_stop_of_a_robot_disables_rules_that_move_it_by_missions(
    here: AuthenticatedGateway, root: Browser, writer: Browser
) -> None:
    iri = rule(writer, mission(writer, default=0.2))
    with here.browsing("hall") as hall:
        assert hall.http.post(f"{hall.root}{HIDDEN}/actions/stop").status_code == 204
    turn(root, 1.2)
    assert fired(root, iri, 1) == [("accepted", "up")]
    ran(writer, iri, 1)
    assert root.http.post(f"{root.root}{SEEN}/actions/stop").status_code == 204
    reaches(root, iri, LF.disabled)
    assert str(writer.page(iri).one(LF.reason)) == f"disabled because {SEEN} was stopped"
    assert put(writer, iri, "lf:enabled false", "lf:enabled true").status_code == 204
    reaches(root, iri, LF.active)


def test_a_rule_causes_what_the_motions_of_its_missions_fulfil(root: Browser, writer: Browser) -> None:
    turn(root, 0.2)
    low, other = mission(writer, "wrist_2_joint", default=0.0), mission(writer, default=0.2)
    first, second = rule(writer, low, holds="?x > 0.3"), rule(writer, other, holds="?x < 0.1")
    turn(root, 0.5)
    fired(root, second, 1)
    causes = [
        set(map(str, root.page(f"{each}/firings/1").graph.objects(None, LF.causedBy))) for each in (first, second)
    ]
    assert causes == [set(), {first}]
