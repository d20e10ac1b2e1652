"""Gateways, agents and Redis learn of events at different times but agree: no motion is lost or misreported."""

import asyncio
import signal
import time
from pathlib import Path

import httpx
import pytest
from pyoxigraph import NamedNode
from rdflib import URIRef

from browser import HYBRIT, LF
from commanding import (
    PAN,
    PREFIXES,
    WRIST,
    all_see,
    angle,
    arm,
    at_all,
    begun,
    control,
    ended,
    moving,
    of_joint,
    of_robot,
    post,
    problem,
    put,
    radian,
    reason,
    slowly,
    state_at,
    stop_all,
)
from gateway_group import Gateway, gateway, gateways, hub
from linked_fleet_base.errors import Busy
from linked_fleet_gateway.actions.guards import Guards
from linked_fleet_gateway.actions.plan import Caller, Motion
from linked_fleet_gateway.subscriptions.live import Live
from linked_fleet_state.invocations import Invocation
from parallel import at_once, pool
from redis_servers import Servers
from running import eventually
from small_fleet import Place, live, number, property_page

pytestmark = pytest.mark.virtual
_KEY = {"idempotency-key": "once"}


def _target(each: Gateway) -> float | URIRef:
    return number(property_page(each.browser, "ur5", PAN, LF.targetRotation), LF.value)


def _tied(each: Gateway, target: float, lease_s: float) -> tuple[str, str, dict[str, str]]:
    """Begin a motion of 0.1 rad/s that is tied to a lease; return its invocation, the lease and its proof."""
    lease = str(each.browser.robot("ur5").one(LF.lease))
    token = {"lock-token": put(each.browser, lease, control("Ada", lease_s)).headers["lock-token"]}
    body = slowly(target, f"; lf:tiedTo <{lease}>")
    return begun(put(each.browser, of_joint(each.browser, PAN), body, **token)), lease, token


def _tasks(each: Gateway) -> set[object]:
    robot = each.browser.robot("ur5")
    return set(robot.graph.objects(robot.iri, LF.currentTask))


def test_a_long_motion_is_under_way_at_both_gateways_until_its_lease_ends(memory: Servers) -> None:
    """The other gateway learned of it before the agent had told its duration."""
    with hub() as stage, arm(stage.endpoint), gateways(stage, memory.url) as two:
        all_see(two)
        one, other = two
        url, lease, token = _tied(one, 3.0, 600)

        def far() -> bool:
            assert {state_at(each, url) for each in two} <= {LF.accepted, LF.running}, reason(one.browser.page(url))
            return angle(one.browser, PAN) > 2.0

        at_all(two, lambda each: state_at(each, url) == LF.running, "the motion")
        eventually(far, "twenty seconds of it")
        assert [_target(each) for each in two] == [3.0, 3.0]
        assert (URIRef(other.here(url)), HYBRIT.action, None) in other.browser.page(other.here(url)).graph
        assert one.browser.http.delete(lease, headers=token).status_code == 204
        at_all(two, lambda each: state_at(each, url) == LF.cancelled, "the end with the lease")
        at_all(two, lambda each: _target(each) == LF.unknown, "no target")


def test_a_lease_ends_without_redis_when_it_would_have_ended(memory: Servers) -> None:
    """The motion is limited by the rest of the lease, not by its whole duration again."""
    with hub() as stage, arm(stage.endpoint), gateways(stage, memory.url) as two:
        all_see(two)
        url, _, _ = _tied(two[0], 3.0, 8)
        eventually(lambda: angle(two[0].browser, PAN) > 0.5, "most of the lease")
        memory.nodes[0].pause()
        try:
            page = ended(two[0].browser, url)
            assert (page.one(LF.state), "lease" in reason(page)) == (LF.cancelled, True)
            assert angle(two[0].browser, PAN) < 1.1
        finally:
            memory.nodes[0].resume()


def test_a_request_repeated_while_the_agent_hangs(memory: Servers) -> None:
    """Both gateways respond with 504 and the first Location, before and after that is settled; nothing begins."""
    with hub() as stage, arm(stage.endpoint, "--lease-ms", "30000") as agent, gateways(stage, memory.url) as two:
        all_see(two)
        urls = {each.browser.root: of_joint(each.browser, WRIST) for each in two}

        def ask(each: Gateway) -> httpx.Response:
            return put(each.browser, urls[each.browser.root], radian(0.7), **_KEY)

        agent.send(signal.SIGSTOP)
        try:
            answers = at_once([lambda each=each: ask(each) for each in (*two, *two)])
            answers += [ask(each) for each in two]
        finally:
            agent.send(signal.SIGCONT)
        assert {problem(answer) for answer in answers} == {(504, "agent-silent")}
        (path,) = {httpx.URL(answer.headers["location"]).path for answer in answers}
        eventually(lambda: "stale" in agent.output, "a refusal of what came late")
        here = answers[-1].headers["location"]
        cancel = str(two[1].browser.page(here).one(HYBRIT.action))
        assert post(two[1].browser, cancel).status_code == 204
        at_all(two, lambda each: state_at(each, path) == LF.failed, "an end, although the agent knows of none")
        assert "knows no such motion" in reason(two[1].browser.page(here))
        assert {problem(ask(each)) for each in two} == {(504, "agent-silent")}


def test_an_unanswered_command_is_unknown_rather_than_refused(memory: Servers) -> None:
    """The deadline has passed: a repeated request still hears that there was no answer."""
    with hub() as stage, gateways(stage, memory.url) as two:

        def ask(each: Gateway) -> httpx.Response:
            url = of_joint(each.browser, "elbow", robot="toy")
            return put(each.browser, url, radian(0.5), **_KEY)

        location = ask(two[0]).headers["location"]
        at_all(two, lambda each: state_at(each, location) == LF.failed, "the deadline")
        assert {problem(ask(each)) for each in two} == {(504, "agent-silent")}


def test_running_invocations_of_a_restarted_agent_fail(memory: Servers) -> None:
    """At both gateways, and at one that starts later; nothing is left for the robot to do."""
    with hub() as stage, gateways(stage, memory.url) as two:
        with arm(stage.endpoint) as agent:
            all_see(two)
            url = begun(put(two[0].browser, of_joint(two[0].browser, PAN), slowly(3.0, speed=0.01)))
            at_all(two, lambda each: state_at(each, url) == LF.running, "the motion")
            agent.send(signal.SIGKILL)
        with arm(stage.endpoint):
            at_all(two, lambda each: state_at(each, url) == LF.failed, "an end")
            with gateway(stage, "--redis-url", memory.url) as third:
                all_see([*two, third])
                for each in (*two, third):
                    eventually(lambda each=each: state_at(each, url) == LF.failed, "an end")
                    assert "started anew" in reason(each.browser.page(each.here(url)))
                    assert _tasks(each) == set()
                    assert _target(each) == LF.unknown


def test_a_target_is_the_same_at_both_gateways_and_gone_after_a_stop(memory: Servers) -> None:
    """All gateways agree on the target of a joint: for each way to set it, and after a later start of a gateway."""
    with hub() as stage, arm(stage.endpoint), gateways(stage, memory.url) as two:
        all_see(two)
        one, other = two

        def same(target: float | URIRef) -> None:
            at_all(two, lambda each: _target(each) == target, f"the target {target}")

        body = PREFIXES + "<> lf:value [ vom:numericalValue 0.3 ; vom:unit unit:RAD ] ."
        begun(put(one.browser, property_page(one.browser, "ur5", PAN, LF.targetRotation).url, body, prefer="wait=30"))
        same(0.3)
        begun(put(other.browser, of_joint(other.browser, PAN), radian(0.1), prefer="wait=30"))
        same(0.1)
        with gateway(stage, "--redis-url", memory.url) as third:
            all_see([third])
            eventually(lambda: _target(third) == 0.1, "the target")
        begun(post(other.browser, of_joint(other.browser, WRIST, LF.Hold)))
        same(0.1)
        begun(post(one.browser, of_robot(one.browser, LF.StopRobot)))
        same(LF.unknown)
        begun(put(other.browser, of_joint(other.browser, PAN), slowly(2.0)))
        same(2.0)
        moving(one.browser, PAN)
        begun(post(other.browser, of_joint(other.browser, PAN, LF.Hold)))
        same(LF.unknown)
        begun(put(one.browser, of_joint(one.browser, PAN), radian(0.2), prefer="wait=30"))
        same(0.2)
        begun(post(one.browser, stop_all(one.browser)))
        same(LF.unknown)


def test_a_check_that_breaks_off_ends_the_invocation(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Others saw the motion when the check began; it neither runs nor counts any more."""
    began: list[str] = []

    async def findings(guards: Guards, motion: Motion, caller: Caller, own: str) -> None:
        began.append(own)
        raise Busy("too many are being checked")

    place = Place(tmp_path)
    with place.gateway() as (_, browser), place.ur5():
        live(browser, "ur5")
        with monkeypatch.context() as patch:
            patch.setattr(Guards, "findings", findings)
            answer = put(browser, action := of_joint(browser, PAN), radian(0.5))
        assert problem(answer) == (503, "busy")
        assert browser.page(f"{action}/invocations/{began[0]}").one(LF.state) == LF.failed
        robot = browser.robot("ur5")
        assert not list(robot.graph.objects(robot.iri, LF.currentTask))


def test_a_lease_that_is_taken_during_a_check_counts(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The holder alone moves the robot, although another motion was let in before and checked for longer."""
    lasts_s = [3.0, 0.0, 0.0]

    async def findings(*_: object) -> dict[NamedNode, bool]:
        await asyncio.sleep(lasts_s.pop(0))
        return {}

    place = Place(tmp_path)
    with place.gateway() as (_, browser), place.ur5(), pool(1) as thread:
        live(browser, "ur5")
        monkeypatch.setattr(Guards, "findings", findings)
        action = of_joint(browser, PAN)
        lease = str(browser.robot("ur5").one(LF.lease))
        asked = thread.submit(put, browser, action, radian(-1.0))
        time.sleep(1.0)
        token = {"lock-token": put(browser, lease, control("Ada", 600)).headers["lock-token"]}
        held = begun(put(browser, action, slowly(1.0), **token))
        assert problem(asked.result()) == (409, "controlled")
        assert browser.page(held).one(LF.state) == LF.running
        begun(put(browser, action, radian(0.5), **token))


@pytest.mark.parametrize("kind", [LF.StopRobot, LF.StopAll])
def test_a_stop_is_sent_although_it_cannot_be_announced(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kind: URIRef
) -> None:
    """An error of whoever hears of invocations, such as an extension, is logged."""
    errors = [ValueError("a defect")]
    tell = Live.mark_invocation_changed

    def tell_or_fail(live: Live, invocation: Invocation) -> None:
        if errors:
            raise errors.pop()
        tell(live, invocation)

    place = Place(tmp_path)
    with place.gateway() as (gateway, browser), place.ur5():
        live(browser, "ur5")
        motion = begun(put(browser, of_joint(browser, PAN), slowly(3.0)))
        moving(browser, PAN)
        stop = of_robot(browser, kind) if kind == LF.StopRobot else browser.action(browser.page(browser.root), kind)
        monkeypatch.setattr(Live, "mark_invocation_changed", tell_or_fail)
        begun(post(browser, stop))
        assert ended(browser, motion).one(LF.state) == LF.cancelled
        gateway.said("a defect")
