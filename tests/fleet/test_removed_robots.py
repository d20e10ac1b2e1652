"""A robot that has gone for good is removed by DELETE, at all gateways and with its memory."""

import gc
from pathlib import Path

import pytest

from browser import HYBRIT, LF, Browser
from commanding import PREFIXES, TURTLE, all_see, arm, at_all, begun, ended, problem
from gateway_group import gateways, hub
from linked_fleet_state.robot import Robot
from redis_servers import single
from small_fleet import Place, live, offline, presence

pytestmark = pytest.mark.virtual


def _held(name: str) -> list[Robot]:
    """Return what the gateways of this process hold of a robot."""
    gc.collect()
    return [each for each in gc.get_objects() if isinstance(each, Robot) and each.name == name]


def _use(browser: Browser) -> str:
    """Use every part of the gateway that can keep something about the robot; return its URL."""
    robot = browser.robot("ur5")
    ended(browser, begun(browser.http.post(f"{robot.iri}actions/stop")))
    body = f'{PREFIXES}<> lf:value "Grüße" .'
    title = str(robot.property(LF.TextProperty))
    assert browser.http.put(title, content=body.encode(), headers=TURTLE).status_code == 204
    joint = browser.part("ur5", "wrist_3_joint")
    pages = ("", "history", "things", "world", "query?query=ASK{?s ?p ?o}", "openapi.json", "metrics", "rules")
    for url in (str(robot.iri), joint.url, *(f"{browser.root}{page}" for page in pages)):
        for accept in ("text/turtle", "text/html", "application/json"):
            browser.http.get(url, headers={"accept": accept})
    return str(robot.iri)


def test_a_robot_is_removed_once_it_is_offline(tmp_path: Path) -> None:
    """The agent that comes back is a new robot, without former settings."""
    with hub() as stage, single(tmp_path) as memory, gateways(stage, memory.url) as found:
        one, other = (each.browser for each in found)
        with arm(stage.endpoint):
            all_see(found)
            url = _use(one)
            refused = one.http.delete(url)
            assert problem(refused) == (409, "conflict") and "online" in refused.json()["detail"]
        at_all(found, lambda each: offline(each.browser, "ur5"), "offline")
        assert "DELETE" in one.http.get(url).headers["allow"]
        assert one.http.delete(url, headers={"if-match": '"other"'}).status_code == 412
        assert one.http.delete(url).status_code == 204
        at_all(found, lambda each: presence(each.browser, "ur5") is None, "removed")
        assert [each.http.get(url.replace(one.root, each.root)).status_code for each in (one, other)] == [404, 404]
        assert problem(one.http.delete(url)) == (404, "not-found")
        with arm(stage.endpoint):
            all_see(found)
            back = one.robot("ur5")
            assert "Grüße" not in back.response.text
            invocations = one.page(f"{back.iri}actions/stop/invocations")
            assert not list(invocations.graph.objects(None, HYBRIT.action))


def test_the_memory_of_a_removed_robot_is_given_back(tmp_path: Path) -> None:
    place, before = Place(tmp_path), _held("ur5")  # of former tests
    with place.gateway() as (_, browser):
        with place.ur5():
            live(browser, "ur5")
            url = _use(browser)
        offline(browser, "ur5")
        assert len(_held("ur5")) == len(before) + 1
        assert browser.http.delete(url).status_code == 204
        # The listings are rendered without it.
        for page in ("", "things", "history", "openapi.json"):
            browser.http.get(f"{browser.root}{page}", headers={"accept": "application/json"})
        assert len(_held("ur5")) == len(before)
