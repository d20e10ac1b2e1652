"""A mission of ten steps on three robots, whose gateway is killed at some instant: each step is taken once."""

import contextlib
import signal
import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import pytest
import rdflib
from rdflib import URIRef

from browser import LDP, LF
from gateway_group import Gateway, gateways, hub
from redis_servers import single
from running import eventually, process
from small_fleet import live

pytestmark = pytest.mark.virtual
RAD = "http://qudt.org/vocab/unit/RAD"
ROBOTS = ("a", "b", "c")
LASTS_S = 16.0
"""Longer than the mission takes."""
INSTANTS = [LASTS_S * number / 32 for number in range(32)]


@dataclass
class Fleet:
    one: Gateway
    other: Gateway

    def turn(self, robot: str, angle: float) -> dict[str, Any]:
        action = f"{self.one.browser.root}{robot}/wrist_3_joint/actions/rotate"
        return {"type": "invoke", "action": action, "body": {"value": angle, "unit": RAD}}

    def ten_steps(self) -> dict[str, Any]:
        """Return turns one after the other and at the same time, and waits between them."""
        all_ = [self.turn(each, 0.2) for each in ROBOTS]
        back = [self.turn(each, 0.0) for each in ROBOTS]
        return {
            "type": "sequence",
            "steps": [
                self.turn("a", 0.1),
                {"type": "parallel", "steps": all_},
                {"type": "wait", "seconds": 1},
                {"type": "firstOf", "steps": [{"type": "parallel", "steps": back}, self.turn("b", 1.0)]},
                {"type": "repeat", "times": 2, "step": self.turn("c", 0.1)},
            ],
        }

    def begin(self) -> str:
        """Post the mission and run it. Return the path of the run."""
        http = self.one.browser.http
        said = {"title": "ten steps", "step": self.ten_steps()}
        mission = http.post(self.one.browser.root + "missions", json=said).headers["location"]
        begun = http.post(mission + "/actions/run")
        assert begun.status_code == 204, begun.text
        return "mission-runs/" + begun.headers["location"].rpartition("/")[2]

    def described(self, path: str) -> rdflib.Graph:
        answer = self.other.get(self.other.browser.root + path)
        return rdflib.Graph().parse(data=answer.text if answer.status_code == 200 else "", format="turtle")

    def taken(self) -> Counter[str]:
        """Return how often each robot was told to turn, whoever asked."""
        found = Counter[str]()
        for robot in ROBOTS:
            url = f"{self.other.browser.root}{robot}/wrist_3_joint/actions/rotate/invocations"
            found[robot] = len(list(self.other.browser.page(url).graph.objects(None, LDP.contains)))
        return found


@pytest.fixture
def fleet(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Fleet]:
    with single(tmp_path_factory.mktemp("redis")) as memory, hub() as centre, contextlib.ExitStack() as stack:
        names = [f"--robot={each}=ur5" for each in ROBOTS]
        stack.enter_context(process("-m", "linked_fleet_agent", *names, "--connect", centre.endpoint))
        one, other = stack.enter_context(gateways(centre, memory.url))
        for each in ROBOTS:
            live(one.browser, each)
            live(other.browser, each)
        yield Fleet(one, other)


def _check(fleet: Fleet, at_s: float, signal_: signal.Signals) -> None:
    path, begun_s = fleet.begin(), time.monotonic()
    eventually(lambda: len(fleet.described(path)) > 0, "the run at the other gateway")
    eventually(lambda: time.monotonic() >= begun_s + at_s, "the instant")
    fleet.one.process.send(signal_)

    def state() -> object:
        return next(fleet.described(path).objects(None, LF.state), None)

    def is_over() -> bool:
        run = rdflib.URIRef(fleet.other.browser.root + path)
        return (run, LF.state, LF.succeeded) in fleet.described(path)

    eventually(is_over, lambda: fleet.other.get(fleet.other.browser.root + path).text)
    assert fleet.taken() == {"a": 3, "b": 2, "c": 4}, state()


@pytest.mark.parametrize("at_s", INSTANTS[::8])
def test_each_step_is_taken_once_when_a_gateway_is_killed(fleet: Fleet, at_s: float) -> None:
    _check(fleet, at_s, signal.SIGKILL)


@pytest.mark.test_all
@pytest.mark.parametrize("at_s", [each for number, each in enumerate(INSTANTS) if number % 8])
def test_each_step_is_taken_once_whenever_a_gateway_is_killed(fleet: Fleet, at_s: float) -> None:
    _check(fleet, at_s, signal.SIGKILL)


def test_a_gateway_that_ends_in_order_hands_its_runs_over(fleet: Fleet) -> None:
    _check(fleet, 2.0, signal.SIGTERM)


def test_a_gateway_that_was_frozen_leaves_its_runs_to_who_has_gone_on(fleet: Fleet) -> None:
    path, begun_s = fleet.begin(), time.monotonic()
    eventually(lambda: time.monotonic() >= begun_s + 1.0, "the first steps")
    fleet.one.process.send(signal.SIGSTOP)
    eventually(lambda: time.monotonic() >= begun_s + 25.0, "the other gateway has gone on")
    fleet.one.process.send(signal.SIGCONT)
    run = rdflib.URIRef(fleet.other.browser.root + path)
    eventually(lambda: (run, LF.state, LF.succeeded) in fleet.described(path), lambda: str(fleet.described(path)))
    assert fleet.taken() == {"a": 3, "b": 2, "c": 4}
    invocation = next(fleet.described(path).objects(run, LF.invocation))
    for each in (fleet.one, fleet.other):
        ends = URIRef(each.here(str(invocation)))
        eventually(
            lambda each=each, ends=ends: each.browser.page(str(ends)).one(LF.state) == LF.succeeded,  # type: ignore[misc]
            "the end of the invocation",
        )
