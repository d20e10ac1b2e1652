"""Orders of three robots, while a gateway is killed at some instant: each runs once, and no robot has two at a time."""

import contextlib
import itertools
import signal
import time
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import pytest

from gateway_group import Gateway, gateways, hub
from redis_servers import single
from running import eventually, process
from small_fleet import live

pytestmark = pytest.mark.virtual
RAD = "http://qudt.org/vocab/unit/RAD"
ROBOTS = ("a", "b", "c")
ORDERS = 9
LASTS_S = 12.0
"""Longer than the orders take."""
INSTANTS = [LASTS_S * number / 48 for number in range(48)]


@dataclass
class Fleet:
    one: Gateway
    other: Gateway

    def mission(self, *robots: str) -> str:
        """Post a mission that waits, and then turns robots at the same time. Return its IRI."""
        root, http = self.one.browser.root, self.one.browser.http
        turns = [
            {
                "type": "invoke",
                "action": f"{root}{each}/wrist_3_joint/actions/rotate",
                "body": {"value": 0.1, "unit": RAD},
            }
            for each in robots
        ]
        steps = [{"type": "wait", "seconds": 1}, {"type": "parallel", "steps": turns}]
        said = {"title": "turn", "step": {"type": "sequence", "steps": steps}}
        return http.post(root + "missions", json=said).headers["location"]

    def orders(self) -> list[str]:
        """Order missions, of which some need two robots. Return the paths of the orders."""
        missions = [self.mission(*robots) for robots in (("a",), ("a", "b"), ("c",))]
        http, root = self.one.browser.http, self.one.browser.root
        posted = [http.post(root + "queue", json={"mission": each}) for each in missions * (ORDERS // 3)]
        return ["queue/" + each.headers["location"].rpartition("/")[2] for each in posted]

    def told(self, path: str) -> dict[str, Any]:
        answer = self.other.browser.http.get(self.other.browser.root + path, headers={"accept": "application/json"})
        found: dict[str, Any] = answer.json() if answer.status_code == 200 else {"state": "unknown here"}
        return found


@pytest.fixture
def fleet(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Fleet]:
    with single(tmp_path_factory.mktemp("redis")) as memory, hub() as centre, contextlib.ExitStack() as stack:
        names = [f"--robot={each}=ur5" for each in ROBOTS]
        stack.enter_context(process("-m", "linked_fleet_agent", *names, "--connect", centre.endpoint))
        one, other = stack.enter_context(gateways(centre, memory.url))
        for gateway, each in itertools.product((one, other), ROBOTS):
            live(gateway.browser, each)
        yield Fleet(one, other)


def _check(fleet: Fleet, at_s: float, signal_: signal.Signals) -> None:
    paths, begun_s = fleet.orders(), time.monotonic()
    eventually(lambda: all("rank" in fleet.told(each) for each in paths), "the orders at the other gateway")
    eventually(lambda: time.monotonic() >= begun_s + at_s, "the instant")
    fleet.one.process.send(signal_)

    def are_over() -> bool:
        return all(fleet.told(each)["state"] == "succeeded" for each in paths)

    eventually(are_over, lambda: "\n".join(str(fleet.told(each)) for each in paths))
    told = [fleet.told(each) for each in paths]
    assert {each["attempt"] for each in told} == {1}
    assert len({each["run"] for each in told}) == ORDERS
    root = fleet.other.browser.root
    runs = fleet.other.browser.http.get(root + "mission-runs", headers={"accept": "text/turtle"}).text
    assert runs.count("a lf:MissionRun") - runs.count("a lf:MissionRunList") == ORDERS, "no order has run twice"
    for one, other in itertools.combinations(told, 2):
        if set(one["robots"]) & set(other["robots"]):
            assert one["ended"] <= other["started"] or other["ended"] <= one["started"], (one, other)


@pytest.mark.parametrize("at_s", INSTANTS[::8])
def test_each_order_runs_once_when_a_gateway_is_killed(fleet: Fleet, at_s: float) -> None:
    _check(fleet, at_s, signal.SIGKILL)


@pytest.mark.test_all
@pytest.mark.parametrize("at_s", [each for number, each in enumerate(INSTANTS) if number % 8])
def test_each_order_runs_once_whenever_a_gateway_is_killed(fleet: Fleet, at_s: float) -> None:
    _check(fleet, at_s, signal.SIGKILL)


def test_a_gateway_that_ends_in_order_leaves_its_orders_to_the_others(fleet: Fleet) -> None:
    _check(fleet, 1.5, signal.SIGTERM)


def test_a_gateway_that_was_frozen_gives_nothing_twice(fleet: Fleet) -> None:
    paths, begun_s = fleet.orders(), time.monotonic()
    eventually(lambda: time.monotonic() >= begun_s + 0.5, "the first orders")
    fleet.one.process.send(signal.SIGSTOP)
    eventually(lambda: time.monotonic() >= begun_s + 25.0, "the other gateway has gone on")
    fleet.one.process.send(signal.SIGCONT)
    eventually(lambda: all(fleet.told(each)["state"] == "succeeded" for each in paths), "all orders")
    assert {fleet.told(each)["attempt"] for each in paths} == {1}
    assert len({fleet.told(each)["run"] for each in paths}) == ORDERS
