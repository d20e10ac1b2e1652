"""A mission on three robots while they are cut off from gateways: each step succeeds once; people retry what failed."""

import contextlib
import functools
import itertools
import time
from collections import Counter
from collections.abc import Iterator
from typing import Any

import pytest
from rdflib import RDF, URIRef

from browser import LDP, LF
from gateway_group import Gateway
from mission_fleet import ROBOTS, MissionFleet, mission_fleet
from running import eventually
from small_fleet import live
from virtual.zenoh_proxy import zenoh_proxy

pytestmark = pytest.mark.virtual
ONCE = Counter({"a": 3, "b": 1, "c": 2})
"""How often the mission turns a joint of each arm."""
INSTANTS = {4.0: True, 6.0: False, 16.0: True}
"""Instants at which robots are cut off, and whether a step fails then: an agent holds after 2.5 s."""
BRIEF_S, AWAY_S = 0.5, 10.0


@pytest.fixture
def fleet(tmp_path_factory: pytest.TempPathFactory) -> Iterator[MissionFleet]:
    with mission_fleet(tmp_path_factory.mktemp("redis")) as found:
        yield found


def _begin(fleet: MissionFleet) -> str:
    """Run a mission that holds where a step fails. Return the path of the run."""
    steps = [
        _slow(fleet.turn("a", 1.0)),
        {"type": "parallel", "steps": [_slow(fleet.turn(each, 2.0)) for each in ROBOTS]},
        fleet.turn("c", 0.0),
        fleet.turn("a", 0.0),
    ]
    http, root = fleet.one.browser.http, fleet.one.browser.root
    said = {"title": "six turns", "holds": True, "step": {"type": "sequence", "steps": steps}}
    begun = http.post(http.post(root + "missions", json=said).headers["location"] + "/actions/run")
    assert begun.status_code == 204, begun.text
    path = "mission-runs/" + begun.headers["location"].rpartition("/")[2]
    eventually(lambda: len(fleet.described(path)) > 0, "the run at the other gateway")
    return path


def _slow(turn: dict[str, Any]) -> dict[str, Any]:
    """Return a turn at a tenth of the speed."""
    return {**turn, "body": {**turn["body"], "speedScale": 0.1}}


def _passes(seconds: float) -> None:
    end_s = time.monotonic() + seconds
    eventually(lambda: time.monotonic() >= end_s, "the time has passed")


@contextlib.contextmanager
def _cut(fleet: MissionFleet, *gateways: Gateway) -> Iterator[None]:
    """Cut all robots off from these gateways."""
    with contextlib.ExitStack() as stack:
        ways = [
            stack.enter_context(zenoh_proxy(fleet.hub.endpoint, each.process, fleet.agents.name))  # type: ignore[attr-defined]
            for each in gateways
        ]
        for way in ways:
            way.cut()
        yield
        for way in ways:
            way.heal()


def _state(fleet: MissionFleet, path: str, gateway: Gateway | None = None) -> str:
    at = gateway or fleet.other
    value = fleet.described(path, at).value(URIRef(at.browser.root + path), LF.state)
    return str(value).rpartition("#")[2]


def _failed(fleet: MissionFleet, path: str) -> dict[str, str]:
    """Return the reason of each failed step, by its path."""
    graph = fleet.described(path)
    return {
        str(graph.value(step, LF.stepPath)): str(graph.value(step, LF.reason))
        for step in graph.subjects(RDF.type, LF.StepRun)
        if graph.value(step, LF.state) == LF.failed
    }


def _retried(fleet: MissionFleet, path: str) -> list[str]:
    """Retry what has failed until the run has succeeded, like a person. Return the reasons that the person read."""
    reasons = list[str]()
    while True:
        eventually(lambda: _state(fleet, path) in ("blocked", "succeeded"), lambda: fleet.other.get(path).text)
        if _state(fleet, path) == "succeeded":
            return reasons
        step, reason = next(iter(_failed(fleet, path).items()))
        reasons.append(reason)
        eventually(functools.partial(_retry, fleet, path, step), f"step {step} is retried")


def _retry(fleet: MissionFleet, path: str, step: str) -> bool:
    answer = fleet.other.browser.http.post(f"{fleet.other.browser.root}{path}/actions/retry", json={"step": step})
    assert answer.status_code in (204, 409, 503), answer.text
    return answer.status_code == 204


def _succeeded(fleet: MissionFleet) -> Counter[str]:
    """Return how many turns of each arm have succeeded."""
    found = Counter[str]()
    for robot in ROBOTS:
        url = f"{fleet.other.browser.root}{robot}/wrist_3_joint/actions/rotate/invocations"
        all_ = [str(each) for each in fleet.other.browser.page(url).graph.objects(None, LDP.contains)]
        found[robot] = sum(fleet.other.browser.page(each).one(LF.state) == LF.succeeded for each in all_)
    return found


@pytest.mark.parametrize(("at_s", "loses"), INSTANTS.items())
def test_each_step_succeeds_once_when_robots_are_cut_off_from_all(
    fleet: MissionFleet, at_s: float, loses: bool
) -> None:
    """The robots hold; the run says why its step failed, and goes on when a person says so."""
    path = _begin(fleet)
    _passes(at_s)
    with _cut(fleet, fleet.one, fleet.other):
        _passes(AWAY_S)
        assert _state(fleet, path) in ("running", "blocked")
    for gateway, robot in itertools.product((fleet.one, fleet.other), ROBOTS):
        live(gateway.browser, robot)
    reasons = _retried(fleet, path)
    assert bool(reasons) == loses
    assert all("gateway lost" in each or "offline" in each for each in reasons), reasons
    assert _succeeded(fleet) == ONCE


@pytest.mark.parametrize("at_s", [6.0])
def test_a_short_cut_costs_no_step(fleet: MissionFleet, at_s: float) -> None:
    path = _begin(fleet)
    _passes(at_s)
    with _cut(fleet, fleet.one, fleet.other):
        _passes(BRIEF_S)
    eventually(lambda: _state(fleet, path) == "succeeded", lambda: str(_failed(fleet, path)))
    assert _succeeded(fleet) == ONCE


@pytest.mark.parametrize("at_s", [4.0])
def test_each_step_succeeds_once_when_its_gateway_alone_is_cut_off(fleet: MissionFleet, at_s: float) -> None:
    """The robots go on, because another gateway sees them. What they did is known when the connection is back."""
    path = _begin(fleet)
    _passes(at_s)
    with _cut(fleet, fleet.one):
        _passes(AWAY_S)
    for robot in ROBOTS:
        live(fleet.one.browser, robot)
    _retried(fleet, path)
    assert _succeeded(fleet) == ONCE
