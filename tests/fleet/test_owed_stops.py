"""A stop is owed until its agent confirms it, through pauses, partitions and restarts of agents and gateways."""

import signal
import time
from collections.abc import Callable
from contextlib import ExitStack, suppress
from itertools import combinations, permutations
from pathlib import Path
from random import Random

import httpx
import pytest

from browser import LF, Browser
from commanding import (
    LIFT,
    PAN,
    STILL_RAD,
    all_see,
    angle,
    arm,
    begun,
    ended,
    moving,
    of_joint,
    of_robot,
    post,
    problem,
    put,
    slowly,
)
from gateway_group import gateways, hub
from mcp_client import mcp_session, text_of
from parallel import pool
from redis_servers import Servers
from running import Process, eventually, process
from small_fleet import Place, live
from virtual.loop import current
from virtual.processes import world

pytestmark = pytest.mark.virtual
_PAUSE_S = 2.2
"""Longer than the lease of the connection (2 s), in which a stop that waits in it is lost, and shorter than that of the
agent (2.5 s), after which it holds by itself."""


def _stop_all(browser: Browser) -> str:
    return browser.found("stop all", lambda: browser.action(browser.page(browser.root), LF.StopAll))


def _rests(browser: Browser, joint: str = PAN) -> float:
    """Wait until the joint rests; it must stay there. Return its position in rad."""

    def still() -> bool:
        before = angle(browser, joint)
        time.sleep(1.0)
        return abs(angle(browser, joint) - before) < 1e-3

    eventually(still, f"{joint} at rest")
    held = angle(browser, joint)
    time.sleep(5.0)
    assert angle(browser, joint) == pytest.approx(held, abs=1e-3)
    return held


def _moves_again(browser: Browser) -> None:
    """Move the robot deliberately, as soon as its stop is confirmed."""
    action = of_joint(browser, PAN)
    target = angle(browser, PAN) + 0.1

    def accepted() -> httpx.Response | None:
        answer = put(browser, action, slowly(target, speed=0.5), prefer="wait=30")
        return answer if answer.status_code == 204 else None

    page = browser.page(eventually(accepted, "a new motion").headers["location"])
    assert page.one(LF.state) == LF.succeeded
    assert angle(browser, PAN) == pytest.approx(target, abs=0.01)


class _Way:
    """The network of agents and gateways at one endpoint, in which two of them can be cut off from each other."""

    def __init__(self, endpoint: str) -> None:
        loop = current()
        assert loop is not None
        self._inside, self._network = loop.inside, world(loop).network((endpoint,))
        self._cuts: list[tuple[str, str]] = []

    def cut(self, gateway: Process, agent: Process) -> None:
        nodes = gateway.name, agent.name  # type: ignore[attr-defined]
        self._inside(self._network.partition, *nodes)
        self._cuts.append(nodes)

    def heal(self) -> None:
        for nodes in self._cuts:
            self._inside(self._network.heal, *nodes)
        self._cuts.clear()


_STOPS: dict[str, Callable[[Browser, str], str]] = {
    "stopAll": lambda browser, motion: _stop_all(browser),
    "stop": lambda browser, motion: of_robot(browser, LF.StopRobot),
    "hold": lambda browser, motion: of_joint(browser, PAN, LF.Hold),
    "cancel": lambda browser, motion: f"{motion}/actions/cancel",
}


@pytest.mark.parametrize("kind", [*_STOPS, "DELETE"])
def test_a_stop_given_in_a_pause_is_sent_again_when_the_agent_is_heard_from(tmp_path: Path, kind: str) -> None:
    """The answer says that it is not confirmed; the robot stops as soon as it is back, until it is moved anew."""
    place = Place(tmp_path)
    with place.gateway() as (_, browser), place.ur5() as agent:
        live(browser, "ur5")
        motion = begun(put(browser, of_joint(browser, PAN), slowly(3.0)))
        moving(browser, PAN)
        url = motion if kind == "DELETE" else _STOPS[kind](browser, motion)
        agent.send(signal.SIGSTOP)
        begun_s = time.monotonic()
        answer = browser.http.delete(url) if kind == "DELETE" else post(browser, url)
        assert problem(answer) == (504, "agent-silent")
        assert answer.json()["unanswered"] == ["ur5"]
        assert "sent again" in answer.json()["detail"]
        time.sleep(max(0.0, begun_s + _PAUSE_S - time.monotonic()))
        agent.send(signal.SIGCONT)
        page = ended(browser, motion)
        assert page.one(LF.state) == LF.cancelled
        assert "did not run" not in agent.output
        assert _rests(browser) < 0.6
        if "location" in answer.headers:
            assert ended(browser, answer.headers["location"]).one(LF.state) == LF.succeeded
        _moves_again(browser)


def test_a_robot_that_is_stopped_in_a_long_pause_rests_afterwards(tmp_path: Path) -> None:
    """Its agent holds by itself, and confirms the stop that nobody answered."""
    place = Place(tmp_path)
    with place.gateway() as (gateway, browser), place.ur5() as agent:
        live(browser, "ur5")
        motion = begun(put(browser, of_joint(browser, PAN), slowly(3.0, speed=0.2)))
        moving(browser, PAN)
        url = _stop_all(browser)
        agent.send(signal.SIGSTOP)
        begun_s = time.monotonic()
        answer = post(browser, url)
        time.sleep(max(0.0, begun_s + 3.0 - time.monotonic()))
        before = angle(browser, PAN)
        agent.send(signal.SIGCONT)
        assert (answer.status_code, answer.json()["unanswered"]) == (504, ["ur5"])
        gateway.said("ur5 has confirmed the repeated stop")
        assert ended(browser, motion).one(LF.state) in (LF.cancelled, LF.failed)
        assert _rests(browser) == pytest.approx(before, abs=STILL_RAD)
        assert ended(browser, answer.headers["location"]).one(LF.state) == LF.succeeded
        _moves_again(browser)


def test_no_motion_overtakes_an_owed_stop(tmp_path: Path) -> None:
    """It is refused, and rehearsed with the same answer, until the agent has confirmed the stop."""
    place = Place(tmp_path)
    with place.gateway() as (_, browser), place.ur5("--lease-ms", "60000") as agent:
        live(browser, "ur5")
        motion, lift = of_joint(browser, PAN), of_joint(browser, LIFT)
        running = begun(put(browser, motion, slowly(3.0)))
        moving(browser, PAN)
        agent.send(signal.SIGSTOP)
        assert post(browser, of_robot(browser, LF.StopRobot)).status_code == 504
        for fields in ({}, {"prefer": "dry-run"}, {"idempotency-key": "k"}):
            refused = put(browser, lift, slowly(-1.0), **fields)
            assert problem(refused) == (503, "stop-owed")
            assert refused.headers["retry-after"] == "1"
        agent.send(signal.SIGCONT)
        assert ended(browser, running).one(LF.state) in (LF.cancelled, LF.failed)
        _rests(browser)
        assert put(browser, lift, slowly(-1.0), **{"idempotency-key": "k"}).status_code == 204


def test_stop_all_tells_who_has_not_answered(tmp_path: Path) -> None:
    """Its invocation too; robots that are offline do not make it an error, and are owed the stop nevertheless."""
    place = Place(tmp_path)
    second = ("-m", "linked_fleet_agent", "--robot=second=ur5", "--connect", place.zenoh)
    with place.gateway() as (gateway, browser), place.ur5() as agent, process(*second) as other:
        for robot in ("ur5", "second"):
            live(browser, robot)
        other.send(signal.SIGSTOP)
        answer = post(browser, _stop_all(browser))
        assert problem(answer) == (504, "agent-silent")
        assert (answer.json()["unanswered"], answer.json()["answered"]) == (["second"], ["ur5"])
        assert "second" in answer.json()["detail"]
        page = browser.page(answer.headers["location"])
        reasons = {
            str(page.graph.value(node, LF.ofRobot)).strip("/").rpartition("/")[2]: str(
                page.graph.value(node, LF.reason)
            )
            for node in page.graph.objects(page.iri, LF.answer)
        }
        assert "sent again" in reasons["second"]
        assert reasons["ur5"] in ("accepted", "running", "succeeded")
        other.send(signal.SIGCONT)
        page = ended(browser, answer.headers["location"])
        assert page.one(LF.state) == LF.succeeded
        live(browser, "second")
        agent.send(signal.SIGKILL)
        eventually(lambda: browser.robot("ur5").one(LF.presence) == LF.offline, "offline")
        assert post(browser, _stop_all(browser)).status_code == 204
        with place.ur5():
            live(browser, "ur5")
            gateway.said("ur5 has confirmed the repeated stop")


def test_the_stop_tool_names_who_has_not_answered(tmp_path: Path) -> None:
    place = Place(tmp_path)
    with place.gateway() as (_, browser), place.ur5() as agent, mcp_session(place.root) as assistant:
        live(browser, "ur5")
        agent.send(signal.SIGSTOP)
        result = assistant.call("stop", target="/")
        assert (result["isError"], result["structuredContent"]["unanswered"]) == (True, ["ur5"])
        assert "The agent of ur5 has not confirmed the stop. It is sent again" in text_of(result)
        agent.send(signal.SIGCONT)


def test_another_gateway_sends_the_stop_of_one_that_died(memory: Servers) -> None:
    with hub() as stage, arm(stage.endpoint) as agent, gateways(stage, memory.url) as two:
        all_see(two)
        dying, other = two
        motion = begun(put(dying.browser, of_joint(dying.browser, PAN), slowly(3.0)))
        moving(other.browser, PAN)
        stop = of_robot(dying.browser, LF.StopRobot)
        agent.send(signal.SIGSTOP)
        with pool(1) as threads:
            asked = threads.submit(post, dying.browser, stop)
            time.sleep(0.5)
            dying.process.send(signal.SIGKILL)
            time.sleep(_PAUSE_S - 0.5)
            agent.send(signal.SIGCONT)
            with pytest.raises(httpx.HTTPError):
                asked.result()
        assert ended(other.browser, other.here(motion)).one(LF.state) == LF.cancelled
        other.process.said("ur5 has confirmed the repeated stop")
        _rests(other.browser)
        _moves_again(other.browser)


def test_a_gateway_that_hears_the_robot_sends_the_stop_of_one_that_does_not(memory: Servers) -> None:
    """The robot is cut off from the gateway that is asked to stop it, and moved through the other one."""
    with hub() as stage, arm(stage.endpoint) as agent, gateways(stage, memory.url) as two:
        all_see(two)
        deaf, other = two
        stop = of_robot(deaf.browser, LF.StopRobot)
        motion = begun(put(other.browser, of_joint(other.browser, PAN), slowly(3.0)))
        moving(other.browser, PAN)
        way = _Way(stage.endpoint)
        way.cut(two[0].process, agent)
        assert problem(post(deaf.browser, stop))[0] in (503, 504)
        assert ended(other.browser, motion).one(LF.state) == LF.cancelled
        _rests(other.browser)
        _moves_again(other.browser)
        way.heal()
        live(deaf.browser, "ur5")
        _moves_again(deaf.browser)
        assert "Traceback" not in agent.output


def test_a_stop_is_owed_without_redis(memory: Servers) -> None:
    with hub() as stage, arm(stage.endpoint) as agent, gateways(stage, memory.url, count=1) as (one,):
        all_see([one])
        motion = begun(put(one.browser, of_joint(one.browser, PAN), slowly(3.0)))
        moving(one.browser, PAN)
        url = of_robot(one.browser, LF.StopRobot)
        memory.nodes[0].pause()
        try:
            agent.send(signal.SIGSTOP)
            begun_s = time.monotonic()
            assert post(one.browser, url).status_code == 504
            time.sleep(max(0.0, begun_s + _PAUSE_S - time.monotonic()))
            agent.send(signal.SIGCONT)
            assert ended(one.browser, motion).one(LF.state) == LF.cancelled
            _rests(one.browser)
        finally:
            memory.nodes[0].resume()
        _moves_again(one.browser)


# -- all orders -----------------------------------------------------------------------------------------------------


class _Stage:
    """One gateway and one robot, whose faults begin and end in any order."""

    def __init__(self, place: Place, stack: ExitStack) -> None:
        self._place, self._stack, self._cut = place, stack, False
        self.way = _Way(place.zenoh)
        self.gateway, self.browser = stack.enter_context(place.gateway())
        self.agent = stack.enter_context(place.ur5())
        self._steps: dict[str, Callable[[], object]] = {
            "pause+": lambda: self.agent.send(signal.SIGSTOP),
            "pause-": lambda: self.agent.send(signal.SIGCONT),
            "cut+": self._cut_off,
            "cut-": self._heal,
            "gateway+": lambda: self.gateway.send(signal.SIGKILL),
            "gateway-": self._restart_gateway,
            "agent+": lambda: self.agent.send(signal.SIGKILL),
            "agent-": self._restart_agent,
        }

    def step(self, name: str) -> None:
        self._steps[name]()

    def _cut_off(self) -> None:
        self._cut = True
        self.way.cut(self.gateway, self.agent)

    def _heal(self) -> None:
        self._cut = False
        self.way.heal()

    def _restart_gateway(self) -> None:
        self.gateway, self.browser = self._stack.enter_context(self._place.gateway())
        if self._cut:
            self._cut_off()

    def _restart_agent(self) -> None:
        self.agent = self._stack.enter_context(self._place.ur5())
        if self._cut:
            self._cut_off()


def _orders() -> list[tuple[str, ...]]:
    """Return all orders in which two faults begin and end and a stop is asked for, while the gateway runs."""
    found = []
    for one, other in combinations(("pause", "cut", "gateway", "agent"), 2):
        for order in permutations((f"{one}+", f"{one}-", f"{other}+", f"{other}-", "stop")):
            at = order.index
            served = "gateway" not in (one, other) or not at("gateway+") < at("stop") < at("gateway-")
            if at(f"{one}+") < at(f"{one}-") and at(f"{other}+") < at(f"{other}-") and served:
                found.append(order)
    return found


def _is_in_pause(order: tuple[str, ...]) -> bool:
    return "pause+" in order and order.index("pause+") < order.index("stop") < order.index("pause-")


_ORDERS = _orders()
_OFTEN = {*Random(37).sample(_ORDERS, 12), *Random(37).sample([each for each in _ORDERS if _is_in_pause(each)], 12)}


@pytest.mark.parametrize(
    "order",
    [pytest.param(each, id=" ".join(each), marks=[] if each in _OFTEN else pytest.mark.test_all) for each in _ORDERS],
)
def test_whatever_fails_around_a_stop_the_robot_rests_afterwards(tmp_path: Path, order: tuple[str, ...]) -> None:
    """It stays at rest until it is moved deliberately, and the stopped motion has not succeeded."""
    random, place = Random(" ".join(order)), Place(tmp_path)
    with ExitStack() as stack, pool(1) as threads:
        stage = _Stage(place, stack)
        live(stage.browser, "ur5")
        motion = begun(put(stage.browser, of_joint(stage.browser, PAN), slowly(3.0, speed=0.06)))
        moving(stage.browser, PAN)
        stop = of_robot(stage.browser, LF.StopRobot)
        for name in order:
            if name == "stop":
                threads.submit(_asked, stop)
            else:
                stage.step(name)
            time.sleep(random.choice((0.3, 1.0, _PAUSE_S)))
        live(stage.browser, "ur5")
        assert _rests(stage.browser) < 1.5
        assert ended(stage.browser, motion).one(LF.state) in (LF.cancelled, LF.failed)
        _moves_again(stage.browser)
        assert "Traceback" not in stage.gateway.output + stage.agent.output


def _asked(url: str) -> None:
    """Ask for a stop by a connection of its own; the gateway may die meanwhile."""
    with suppress(httpx.HTTPError), httpx.Client(timeout=30) as client:
        client.post(url)
