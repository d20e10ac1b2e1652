"""Invocations survive their gateway, belong to all gateways, and begin once however often they are requested."""

import contextlib
import itertools
import signal
import time
from collections.abc import Iterator
from pathlib import Path

import httpx
import pytest
import rdflib
from rdflib import URIRef
from rdflib.compare import isomorphic

from browser import DCTERMS, HYBRIT, LF, PROV, VOM, Browser, Page
from commanding import (
    ENDED,
    LIFT,
    PAN,
    STILL_RAD,
    WRIST,
    all_see,
    angle,
    arm,
    at_all,
    begun,
    ended,
    expecting,
    invocations,
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
from gateway_group import Gateway, Hub, gateway, gateways
from parallel import at_once, pool
from redis_servers import Servers
from running import eventually, process
from small_fleet import Place, live, offline
from subscribers import events

pytestmark = pytest.mark.virtual
_JOINTS = (PAN, LIFT, "elbow_joint", "wrist_1_joint", "wrist_2_joint", WRIST)
_numbers = itertools.count()


@pytest.fixture
def pair(two: list[Gateway]) -> Iterator[tuple[Gateway, Gateway]]:
    one, other = two
    yield one, other
    stop = begun(post(one.browser, of_robot(one.browser, LF.StopRobot), prefer="wait=30"))
    at_all(two, lambda each: state_at(each, stop) == LF.succeeded, "a robot that stands")


def _key() -> dict[str, str]:
    return {"idempotency-key": f"key-{next(_numbers)}"}


def _far(browser: Browser, joint: str, by: float = 2.0) -> float:
    """Return a reachable position that is not near."""
    present = angle(browser, joint)
    return round(present - by if present > 0 else present + by, 3)


def _begin(browser: Browser, joint: str, **fields: str) -> str:
    """Begin a motion of twenty seconds; return its invocation."""
    return begun(put(browser, of_joint(browser, joint), slowly(_far(browser, joint)), **fields))


def _said(page: Page) -> tuple[float, str]:
    """Return the requested position and the requester."""
    asked = page.graph.value(page.iri, LF.input)
    client = page.graph.value(page.iri, PROV.wasAssociatedWith)
    return float(page.graph.value(asked, VOM.numericalValue)), str(page.graph.value(client, DCTERMS.title))


def _path(url: str) -> str:
    return httpx.URL(url).path


# -- what outlives a gateway ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("where", ["redis", "redis killed as well", "embedded"])
def test_no_motion_is_forgotten_when_its_gateway_is_killed(tmp_path: Path, memory: Servers, where: str) -> None:
    """SIGKILL just after the response: each is there again with input and requester, and ends as the robot reports."""
    place = Place(tmp_path / "state")
    flags = () if where == "embedded" else ("--redis-url", memory.url)
    asked: dict[str, float] = {}
    with place.ur5():
        with process(*place.command(), *flags) as first, contextlib.closing(Browser(place.root)) as browser:
            first.said("serving")
            live(browser, "ur5")
            actions = {of_joint(browser, joint): _far(browser, joint) for joint in _JOINTS}
            for url, target in actions.items():
                asked[begun(put(browser, url, slowly(target)))] = target
            first.send(signal.SIGKILL)
        time.sleep(5)  # by then the robot knows that the gateway is lost
        if where == "redis killed as well":
            memory.nodes[0].kill()
            memory.nodes[0].start()
        with process(*place.command(), *flags) as second, contextlib.closing(Browser(place.root)) as browser:
            second.said("serving")
            live(browser, "ur5")
            for url, target in asked.items():
                page = ended(browser, url)
                assert (page.one(LF.state), reason(page)) == (LF.failed, "gateway lost")
                assert _said(page) == (target, "127.0.0.1")
                assert (page.iri, PROV.endedAtTime, None) in page.graph
            assert {_path(url) for url in asked} == {path for url in actions for path in invocations(browser, url)}


def test_a_motion_goes_on_when_another_gateway_stays(stage: Hub, memory: Servers) -> None:
    """It succeeds at the remaining gateway, and at the killed one as soon as it is back."""
    shared = ("--redis-url", memory.url)
    with arm(stage.endpoint), gateway(stage, *shared) as other:
        with gateway(stage, *shared) as one:
            all_see([one, other])
            url = begun(put(one.browser, of_joint(one.browser, PAN), slowly(1.5, speed=0.5)))
            eventually(lambda: state_at(other, url) == LF.running, "the motion at the other gateway")
            one.process.send(signal.SIGKILL)
        assert ended(other.browser, other.here(url)).one(LF.state) == LF.succeeded
        assert angle(other.browser, PAN) == pytest.approx(1.5, abs=STILL_RAD)
        time.sleep(2)  # the gateway that began it reports first, and others wait that long for it
        with gateway(stage, *shared) as back:
            all_see([back])
            eventually(lambda: state_at(back, url) == LF.succeeded, "the end where it began")
            assert _described(back, url, other) == _described(other, url, other)


def test_robot_and_gateway_killed_at_once(stage: Hub, memory: Servers) -> None:
    """Nobody can report the end: the invocation is there once they are back, and fails with the next agent."""
    shared = ("--redis-url", memory.url)
    with arm(stage.endpoint) as agent, gateway(stage, *shared) as one:
        all_see([one])
        url = begun(put(one.browser, of_joint(one.browser, WRIST), radian(0.5)))
        agent.send(signal.SIGKILL)
        one.process.send(signal.SIGKILL)
    with arm(stage.endpoint), gateway(stage, *shared) as back:
        all_see([back])
        page = ended(back.browser, back.here(url))
        assert (page.one(LF.state), _said(page)) == (LF.failed, (0.5, "127.0.0.1"))
        assert "started anew" in reason(page)


# -- what gateways have in common -----------------------------------------------------------------------------------


def _described(each: Gateway, invocation: str, like: Gateway) -> rdflib.compare.IsomorphicGraph:
    """Return the description of an invocation at one gateway, in the IRIs of another."""
    text = each.browser.page(each.here(invocation)).response.text.replace(each.browser.root, like.browser.root)
    return rdflib.compare.to_isomorphic(rdflib.Graph().parse(data=text, format="turtle"))


def test_the_other_gateway_shows_what_one_began(pair: tuple[Gateway, Gateway]) -> None:
    """It lists and describes it identically, also as a task of the robot, and shows its progress."""
    one, other = pair
    target = _far(one.browser, PAN, 0.6)
    url = begun(put(one.browser, of_joint(one.browser, PAN), slowly(target, speed=0.3)))
    eventually(lambda: state_at(other, url) is not None, "the invocation at the other gateway")
    assert _path(url) in invocations(other.browser, of_joint(other.browser, PAN))
    robot = other.browser.robot("ur5")
    assert URIRef(other.here(url)) in set(robot.graph.objects(robot.iri, LF.currentTask))
    progress = []
    with events(other.here(url)) as stream:
        while not progress or progress[-1][0] not in ENDED:
            graph, iri = (message := stream.next()).graph, message.iri
            done = graph.value(graph.value(iri, LF.progress), VOM.numericalValue)
            progress.append((graph.value(iri, LF.state), float(done)))
    assert progress[-1] == (LF.succeeded, 1.0)
    shares = [share for _, share in progress]
    assert shares == sorted(shares)
    assert len(set(shares)) > 3
    eventually(lambda: isomorphic(_described(one, url, one), _described(other, url, one)), "the same words")
    assert _said(other.browser.page(other.here(url))) == (target, "127.0.0.1")


def test_the_other_gateway_cancels(pair: tuple[Gateway, Gateway]) -> None:
    """The robot brakes; the invocation stays as cancelled at both, without the action cancel."""
    one, other = pair
    url = _begin(one.browser, PAN)
    eventually(lambda: state_at(other, url) == LF.running, "the motion at the other gateway")
    cancel = str(other.browser.page(other.here(url)).graph.value(URIRef(other.here(url)), HYBRIT.action))
    assert post(other.browser, cancel).status_code == 204
    at_all([one, other], lambda each: state_at(each, url) == LF.cancelled, "a cancelled motion")
    assert "client" in reason(one.browser.page(url))
    assert other.get(cancel).status_code == 404


def test_the_other_gateway_deletes(pair: tuple[Gateway, Gateway]) -> None:
    """The robot brakes, and the invocation is gone everywhere, even after its end was reported."""
    one, other = pair
    url = _begin(one.browser, PAN)
    moving(one.browser, PAN)
    eventually(lambda: state_at(other, url) == LF.running, "the motion at the other gateway")
    assert other.browser.http.delete(other.here(url)).status_code == 204
    at_all([one, other], lambda each: state_at(each, url) is None, "a deleted invocation")
    for each in pair:
        robot = each.browser.robot("ur5")
        assert (robot.iri, LF.currentTask, None) not in robot.graph
        assert _path(url) not in invocations(each.browser, of_joint(each.browser, PAN))


def test_the_other_gateway_shows_what_the_fleet_was_asked(pair: tuple[Gateway, Gateway]) -> None:
    """stopAll: the answers of the robots, of which one reports nothing more (others: test_owed_stops.py)."""
    one, other = pair
    motion = _begin(one.browser, PAN)
    url = begun(post(other.browser, stop_all(other.browser)))
    assert ended(one.browser, motion).one(LF.state) == LF.cancelled
    eventually(lambda: state_at(one, url) is not None, "the invocation at the other gateway")
    eventually(lambda: _answers(one, url).get("ur5") == "succeeded", "the answer of ur5")
    assert _answers(one, url)["toy"] == "accepted"


def _answers(each: Gateway, invocation: str) -> dict[str, str]:
    page = each.browser.page(each.here(invocation))
    answers = page.graph.objects(page.iri, LF.answer)
    return {
        str(page.graph.value(node, LF.ofRobot)).split("/")[-2]: str(page.graph.value(node, LF.reason))
        for node in answers
    }


# -- asked for once -------------------------------------------------------------------------------------------------


def test_a_repeated_request_begins_nothing(pair: tuple[Gateway, Gateway]) -> None:
    """At both gateways, during the motion and afterwards: the same Location, and the joint rotates once."""
    one, _ = pair
    start, key = angle(one.browser, WRIST), _key()
    turn = 0.4 if start < 0 else -0.4
    urls = [of_joint(each.browser, WRIST, LF.RotateBy) for each in pair]
    first = begun(post(one.browser, urls[0], slowly(turn, speed=0.4), **key))
    answers = [post(each.browser, url, slowly(turn, speed=0.4), **key) for each, url in zip(pair, urls, strict=True)]
    ended(one.browser, first)
    answers += [post(each.browser, url, slowly(turn, speed=0.4), **key) for each, url in zip(pair, urls, strict=True)]
    assert {_path(begun(answer)) for answer in answers} == {_path(first)}
    for each, url in zip(pair, urls, strict=True):
        assert invocations(each.browser, url).count(_path(first)) == 1
        assert angle(each.browser, WRIST) == pytest.approx(start + turn, abs=STILL_RAD)


def test_the_same_request_at_both_gateways_at_once(pair: tuple[Gateway, Gateway]) -> None:
    """Repeatedly: one motion each time."""
    urls = [of_joint(each.browser, WRIST, LF.RotateBy) for each in pair]
    begin, turns = angle(pair[0].browser, WRIST), 4
    before = set(invocations(pair[0].browser, urls[0]))
    turn = 0.05 if begin < 0 else -0.05
    for _ in range(turns):
        fields = _key() | {"prefer": "wait=30"}
        answers = at_once(
            [
                lambda each=each, url=url, fields=fields: post(each.browser, url, radian(turn), **fields)
                for each, url in zip(pair, urls, strict=True)
            ]
        )
        assert len({_path(begun(answer)) for answer in answers}) == 1
    for each, url in zip(pair, urls, strict=True):
        eventually(lambda each=each, url=url: len({*invocations(each.browser, url)} - before) == turns, "each once")
        assert angle(each.browser, WRIST) == pytest.approx(begin + turns * turn, abs=turns * 0.005)


def test_a_key_stands_for_one_request(pair: tuple[Gateway, Gateway]) -> None:
    """Another body, or the same for another joint, gets 422 at both gateways, and nothing moves."""
    one, other = pair
    key, url, target = _key(), of_joint(one.browser, WRIST), angle(one.browser, WRIST)
    begun(put(one.browser, url, radian(target), prefer="wait=30", **key))
    for each in pair:
        answer = put(each.browser, of_joint(each.browser, WRIST), radian(target + 0.3), **key)
        assert problem(answer) == (422, "key-reused")
        assert problem(put(each.browser, of_joint(each.browser, LIFT), radian(target), **key)) == (422, "key-reused")
    assert angle(other.browser, WRIST) == pytest.approx(target, abs=STILL_RAD)


def test_a_repeated_request_that_was_refused(pair: tuple[Gateway, Gateway]) -> None:
    """The robot is not asked again: it is refused at both gateways, even if it would be possible by now."""
    one, other = pair
    key, start = _key(), angle(one.browser, WRIST)
    wrong = radian(start + 0.4, expecting(f"/ur5/{WRIST}", start + 0.2, 0.05))
    for each in (one, other, one):
        assert problem(put(each.browser, of_joint(each.browser, WRIST), wrong, **key)) == (409, "changed")
    begun(put(one.browser, of_joint(one.browser, WRIST), radian(start + 0.2), prefer="wait=30"))
    for each in pair:
        assert problem(put(each.browser, of_joint(each.browser, WRIST), wrong, **key)) == (409, "changed")
    assert angle(one.browser, WRIST) == pytest.approx(start + 0.2, abs=STILL_RAD)


def test_a_repeated_request_that_nobody_answered(pair: tuple[Gateway, Gateway]) -> None:
    """504 again, with the same Location, until that is settled; unknown at both gateways."""
    key = _key()

    def ask(each: Gateway) -> httpx.Response:
        return put(each.browser, of_joint(each.browser, "elbow", robot="toy"), radian(0.5), **key)

    asked = [ask(pair[0])]
    at_all([*pair], lambda each: state_at(each, asked[0].headers["location"]) == LF.unknown, "silence")
    asked += [ask(each) for each in pair]
    assert {problem(answer) for answer in asked} == {(504, "agent-silent")}
    (path,) = {_path(answer.headers["location"]) for answer in asked}
    for each in pair:
        assert invocations(each.browser, of_joint(each.browser, "elbow", robot="toy")).count(path) == 1


def test_a_key_is_used_up_by_an_invocation_that_is_deleted(pair: tuple[Gateway, Gateway]) -> None:
    """409 at both gateways: what was executed and deleted is not executed again."""
    one, _ = pair
    key, start = _key(), angle(one.browser, WRIST)
    url = of_joint(one.browser, WRIST, LF.RotateBy)
    invocation = begun(post(one.browser, url, radian(0.1 if start < 0 else -0.1), prefer="wait=30", **key))
    reached = angle(one.browser, WRIST)
    assert one.browser.http.delete(invocation).status_code == 204
    for each in pair:
        again = of_joint(each.browser, WRIST, LF.RotateBy)
        assert post(each.browser, again, radian(0.1 if start < 0 else -0.1), **key).status_code == 409
    assert angle(one.browser, WRIST) == pytest.approx(reached, abs=STILL_RAD)


# -- one motion ends another ----------------------------------------------------------------------------------------


def test_a_motion_from_elsewhere_preempts(pair: tuple[Gateway, Gateway]) -> None:
    """Each names the other at both gateways, and a request waiting for the first gets a response."""
    one, other = pair
    fields = {"prefer": "wait=60"}
    target = _far(one.browser, PAN)
    url = of_joint(one.browser, PAN)
    with pool(1) as workers:
        waiting = workers.submit(lambda: put(one.browser, url, slowly(target), **fields))
        moving(other.browser, PAN)
        second = begun(put(other.browser, of_joint(other.browser, PAN), radian(angle(other.browser, PAN)), **fields))
        first = begun(waiting.result())
    at_all([one, other], lambda each: state_at(each, first) == LF.preempted, "a preempted motion")
    at_all([one, other], lambda each: state_at(each, second) == LF.succeeded, "the one that preempted")
    for each in pair:
        old, new = (URIRef(each.here(url)) for url in (first, second))
        eventually(lambda each=each, old=old, new=new: _named(each, old, LF.preemptedBy) == {new}, "who preempted")
        eventually(lambda each=each, old=old, new=new: _named(each, new, LF.preempts) == {old}, "what it preempted")


def _named(each: Gateway, invocation: URIRef, predicate: URIRef) -> set[object]:
    return set(each.browser.page(str(invocation)).graph.objects(invocation, predicate))


def test_facts_known_to_one_gateway_are_shared(pair: tuple[Gateway, Gateway]) -> None:
    """Durations and preempted motions are known to one gateway only, and both learn of the end at once."""
    one, _ = pair
    url, target = of_joint(one.browser, WRIST), angle(one.browser, WRIST)
    urls = [begun(put(one.browser, url, radian(target), prefer="wait=30")) for _ in range(5)]
    for each, invocation in itertools.product(pair, urls):
        iri = URIRef(each.here(invocation))
        eventually(lambda each=each, iri=iri: _named(each, iri, LF.duration), "how long it took")


def test_a_precondition_is_judged_where_the_robot_is(pair: tuple[Gateway, Gateway]) -> None:
    """If it holds, the joint moves. If not, 409 says so, and nothing moves."""
    one, other = pair
    start, lift = angle(one.browser, WRIST), angle(one.browser, LIFT)
    target = start + (0.3 if start < 0 else -0.3)
    url = of_joint(other.browser, WRIST)
    for joint, expected in ((WRIST, start + 0.2), (LIFT, lift - 0.2), (WRIST, target)):
        answer = put(other.browser, url, radian(target, expecting(f"/ur5/{joint}", expected, 0.05)))
        assert problem(answer) == (409, "changed")
        assert joint in answer.json()["detail"]
    assert angle(one.browser, WRIST) == pytest.approx(start, abs=STILL_RAD)
    both = expecting(f"/ur5/{WRIST}", start, 0.05) + expecting(f"/ur5/{LIFT}", lift, 0.05)
    begun(put(other.browser, url, radian(target, both), prefer="wait=30"))
    assert angle(one.browser, WRIST) == pytest.approx(target, abs=STILL_RAD)


# -- nothing late ---------------------------------------------------------------------------------------------------


def test_a_command_that_comes_late_never_runs(stage: Hub, memory: Servers) -> None:
    """The agent hangs: 504, and the invocation is unknown.

    It continues too late: nothing moves, and the invocation fails.
    """
    with arm(stage.endpoint, "--lease-ms", "30000") as agent, gateway(stage, "--redis-url", memory.url) as one:
        all_see([one])
        browser, url = one.browser, of_joint(one.browser, WRIST)
        begun(put(browser, url, radian(0.2), prefer="wait=30"))
        agent.send(signal.SIGSTOP)
        try:
            late = put(browser, url, radian(1.2))
            assert problem(late) == (504, "agent-silent")
            invocation = late.headers["location"]
            assert browser.page(invocation).one(LF.state) == LF.unknown
        finally:
            agent.send(signal.SIGCONT)
        eventually(lambda: "stale" in agent.output, "a refusal of what came late")
        assert ended(browser, invocation).one(LF.state) == LF.failed
        assert angle(browser, WRIST) == pytest.approx(0.2, abs=STILL_RAD)
        begun(put(browser, url, radian(0.3), prefer="wait=30"))
        assert angle(browser, WRIST) == pytest.approx(0.3, abs=STILL_RAD)


def test_a_motion_of_a_robot_that_went_is_unknown_at_all(stage: Hub, memory: Servers) -> None:
    """Its agent is killed: every gateway says that the outcome is unknown."""
    with arm(stage.endpoint) as agent, gateways(stage, memory.url) as two:
        all_see(two)
        url = begun(put(two[0].browser, of_joint(two[0].browser, PAN), slowly(2.0)))
        at_all(two, lambda each: state_at(each, url) == LF.running, "the motion")
        agent.send(signal.SIGKILL)
        offline(two[0].browser, "ur5")
        at_all(two, lambda each: state_at(each, url) == LF.unknown, "an unknown end")
        assert "gone" in reason(two[0].browser.page(url))


@pytest.mark.parametrize("outage", ["killed", "hanging"])
def test_without_redis_nothing_begins_and_everything_stops(stage: Hub, memory: Servers, outage: str) -> None:
    """Motions get 503 and never run, not even later; stopping works, and is recorded once Redis is back."""
    node = memory.nodes[0]
    with arm(stage.endpoint), gateways(stage, memory.url) as two:
        all_see(two)
        one, other = two
        motion = begun(put(one.browser, of_joint(one.browser, PAN), slowly(2.0)))
        moving(one.browser, PAN)
        fields, url = _key(), of_joint(other.browser, WRIST)
        node.kill() if outage == "killed" else node.pause()
        try:
            answer = put(other.browser, url, radian(0.5), **fields)
            assert (problem(answer), answer.headers["retry-after"]) == ((503, "redis-unavailable"), "2")
            stop = begun(post(other.browser, of_robot(other.browser, LF.StopRobot), prefer="wait=30"))
            assert state_at(other, stop) == LF.succeeded
            assert ended(one.browser, motion).one(LF.state) == LF.cancelled
            assert angle(one.browser, WRIST) == pytest.approx(0.0, abs=STILL_RAD)
        finally:
            node.start() if outage == "killed" else node.resume()
        at_all(two, lambda each: state_at(each, stop) == LF.succeeded, "the stop")
        at_all(two, lambda each: state_at(each, motion) == LF.cancelled, "the motion that was stopped")
        again = eventually(lambda: _unless_away(put(other.browser, url, radian(0.5), **fields)), "Redis")
        assert ended(other.browser, begun(again)).one(LF.state) == LF.succeeded
        with gateway(stage, "--redis-url", memory.url) as third:
            all_see([third])
            assert state_at(third, stop) == LF.succeeded
            assert (state_at(third, motion), state_at(third, again.headers["location"])) == (LF.cancelled, LF.succeeded)


def _unless_away(answer: httpx.Response) -> httpx.Response | None:
    return None if answer.status_code == 503 else answer
