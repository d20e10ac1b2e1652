"""The control lease: one client at a time moves a robot, everybody may stop it, and a vanished client loses it."""

import signal
from collections.abc import Iterator

import httpx
import pytest

from browser import DCTERMS, HYBRIT, LF, VOM, Browser, Page
from commanding import (
    LIFT,
    PAN,
    PREFIXES,
    STILL_RAD,
    TURTLE,
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
from redis_servers import Servers
from running import eventually
from subscribers import events

pytestmark = pytest.mark.virtual
_LONG_S = 600
_taken: list[dict[str, str]] = []
"""Proofs of the leases that a test took; none outlives its test."""

_STRANGE = "<urn:uuid:00000000-0000-4000-8000-000000000000>"


@pytest.fixture
def pair(two: list[Gateway]) -> Iterator[tuple[Gateway, Gateway]]:
    one, other = two
    at_all(two, lambda each: _lease(each).one(LF.state) == LF.free, "a robot that nobody controls")
    yield one, other
    for fields in _taken:
        _release(one, **fields)
    _taken.clear()
    begun(post(one.browser, of_robot(one.browser, LF.StopRobot), prefer="wait=30"))


def _lease(gateway: Gateway) -> Page:
    return gateway.browser.page(str(gateway.browser.robot("ur5").one(LF.lease)))


def _take(gateway: Gateway, duration_s: float = _LONG_S, holder: str = "Ada", **fields: str) -> dict[str, str]:
    """Take or renew the lease; return the header field that proves it."""
    answer = put(gateway.browser, _lease(gateway).url, control(holder, duration_s), **fields)
    assert answer.status_code == 204, answer.text
    _taken.append({"lock-token": answer.headers["lock-token"]})
    return _taken[-1]


def _release(gateway: Gateway, **fields: str) -> httpx.Response:
    return gateway.browser.http.delete(_lease(gateway).url, headers=fields)


def _held_by(gateway: Gateway, holder: str | None) -> bool:
    page = _lease(gateway)
    if holder is None:
        return page.one(LF.state) == LF.free and (page.iri, LF.holder, None) not in page.graph
    return page.one(LF.state) == LF.held and str(page.graph.value(page.iri, LF.holder)) == holder


def _until(gateway: Gateway) -> str:
    page = _lease(gateway)
    return str(page.graph.value(page.iri, LF.expires))


def _tied(gateway: Gateway, joint: str, fields: dict[str, str], by: float = 3.0) -> str:
    """Begin a motion of half a minute that is tied to the lease; return its invocation."""
    start = angle(gateway.browser, joint)
    body = slowly(round(start - by if start > 0 else start + by, 3), f"; lf:tiedTo <{_lease(gateway).url}>")
    url = begun(put(gateway.browser, of_joint(gateway.browser, joint), body, **fields))
    moving(gateway.browser, joint)
    return url


def _let_go(gateway: Gateway, invocation: str) -> None:
    """Wait until the motion stops because its lease has ended, and the robot stands."""
    page = ended(gateway.browser, gateway.here(invocation))
    assert (page.one(LF.state), "lease" in reason(page)) == (LF.cancelled, True), page.response.text
    assert float(_done(page)) < 0.9


def _done(page: Page) -> str:
    (number,) = page.graph.objects(page.graph.value(page.iri, LF.progress), VOM.numericalValue)
    return str(number)


def _everything_that_moves(browser: Browser, joint: str) -> list[tuple[str, str, str]]:
    """Yield method, URL and body of requests that would move a joint."""
    where = f"lf:ofJoint </ur5/{joint}> ; vom:numericalValue 0.1 ; vom:unit unit:RAD"
    part = browser.part("ur5", joint)
    return [
        ("PUT", of_joint(browser, joint), radian(0.1)),
        ("POST", of_joint(browser, joint, LF.RotateBy), radian(0.1)),
        ("PUT", of_robot(browser, LF.MoveJoints), PREFIXES + f"<> lf:target [ {where} ] ."),
        (
            "POST",
            of_robot(browser, LF.FollowTrajectory),
            PREFIXES + f"<> lf:waypoint [ lf:atTime 9 ; lf:target [ {where} ] ] .",
        ),
        ("PUT", of_robot(browser, LF.AssumePose), PREFIXES + '<> lf:poseName "home" .'),
        (
            "PUT",
            str(part.one(LF.targetRotation)),
            PREFIXES + "<> lf:value [ vom:numericalValue 0.1 ; vom:unit unit:RAD ] .",
        ),
    ]


# -- who has it -----------------------------------------------------------------------------------------------------


def test_a_lease_is_seen_everywhere(pair: tuple[Gateway, Gateway]) -> None:
    """Both gateways show state, holder, duration and end, linked from the robot; the token is never shown."""
    one, other = pair
    with events(str(other.browser.robot("ur5").one(LF.lease))) as stream:
        first = stream.next()
        assert first.graph.value(first.iri, LF.state) == LF.free
        mine = _take(one, holder="Ada Lovelace")
        told = stream.next()
        assert str(told.graph.value(told.iri, LF.holder)) == "Ada Lovelace"
    at_all([one, other], lambda each: _held_by(each, "Ada Lovelace"), "the lease")
    pages = [_lease(each) for each in pair]
    for predicate in (DCTERMS.identifier, LF.leaseDuration, LF.expires):
        assert len({page.graph.value(page.iri, predicate) for page in pages}) == 1
        assert pages[0].graph.value(pages[0].iri, predicate) is not None
    secret = mine["lock-token"].strip("<>")
    assert not [page.url for page in pages if secret in page.response.text]
    assert _release(other, **mine).status_code == 204
    at_all([one, other], lambda each: _held_by(each, None), "nobody with control")


def test_only_the_holder_moves_the_robot(pair: tuple[Gateway, Gateway]) -> None:
    """All motions of others get 409 with the holder and the end, at both gateways, also when rehearsed."""
    one, other = pair
    begun(put(one.browser, of_joint(one.browser, WRIST), radian(0.5), prefer="wait=30"))
    mine = _take(one)
    at_all([one, other], lambda each: _held_by(each, "Ada"), "the lease")
    for each in pair:
        for method, url, body in _everything_that_moves(each.browser, WRIST):
            for fields in ({}, {"lock-token": _STRANGE}, {"prefer": "dry-run"}):
                answer = each.browser.http.request(method, url, content=body, headers=TURTLE | fields)
                assert problem(answer) == (409, "controlled"), url
                assert answer.json()["holder"] == "Ada"
                assert answer.json()["expires"] > "2"
    assert angle(other.browser, WRIST) == pytest.approx(0.5, abs=STILL_RAD)
    for each, target in zip(pair, (0.6, 0.7), strict=True):
        begun(put(each.browser, of_joint(each.browser, WRIST), radian(target), prefer="wait=30", **mine))
        assert angle(other.browser, WRIST) == pytest.approx(target, abs=STILL_RAD)
    assert _release(one, **mine).status_code == 204
    begun(put(other.browser, of_joint(other.browser, WRIST), radian(0.5), prefer="wait=30"))


def test_only_the_holder_renews_and_releases(pair: tuple[Gateway, Gateway]) -> None:
    """At any gateway; renewing keeps the token and extends the lease. Another token, or none, gets 409 or 400."""
    one, other = pair
    mine = _take(one, duration_s=300)
    until = _until(one)
    for fields in ({}, {"lock-token": _STRANGE}):
        answer = put(other.browser, _lease(other).url, control("Bob", 5), **fields)
        assert problem(answer) == (409, "controlled")
    assert problem(_release(other, **{"lock-token": _STRANGE})) == (409, "controlled")
    assert problem(_release(other)) == (400, "bad-request")
    assert _take(other, duration_s=900, **mine) == mine
    at_all([one, other], lambda each: _until(each) > until, "a later end")
    assert _held_by(one, "Ada")
    assert _release(other, **mine).status_code == 204
    assert problem(_release(other, **mine)) == (404, "not-found")


def test_a_lease_expires_by_itself(pair: tuple[Gateway, Gateway]) -> None:
    """It is free at both gateways, its token is invalid, and the next holder gets a new token."""
    one, other = pair
    old = _take(one, duration_s=1)
    at_all([one, other], lambda each: _held_by(each, None), "nobody with control")
    begun(put(other.browser, of_joint(other.browser, WRIST), radian(angle(other.browser, WRIST)), prefer="wait=30"))
    new = _take(other, holder="Bob")
    assert new != old
    assert problem(put(one.browser, of_joint(one.browser, WRIST), radian(0), **old)) == (409, "controlled")
    assert _release(one, **old).status_code == 409
    assert _release(one, **new).status_code == 204


@pytest.mark.parametrize("how", ["stop", "hold", "stopAll", "cancel", "delete"])
def test_everybody_may_stop(pair: tuple[Gateway, Gateway], how: str) -> None:
    """The motion ends and the lease stays, also if another client holds it."""
    one, other = pair
    mine = _take(one)
    start = angle(one.browser, PAN)
    body = slowly(start + (3 if start < 0 else -3))
    motion = begun(put(one.browser, of_joint(one.browser, PAN), body, **mine))
    moving(other.browser, PAN)
    eventually(lambda: state_at(other, motion) == LF.running, "the motion at the other gateway")
    browser, here = other.browser, other.here(motion)
    if how == "delete":
        assert browser.http.delete(here).status_code == 204
        at_all([one, other], lambda each: state_at(each, motion) is None, "no invocation")
        eventually(lambda: not _tasks(other), "a robot without task")
    else:
        url = {
            "stop": lambda: of_robot(browser, LF.StopRobot),
            "hold": lambda: of_joint(browser, PAN, LF.Hold),
            "stopAll": lambda: stop_all(browser),
            "cancel": lambda: str(browser.page(here).one(HYBRIT.action)),
        }[how]()
        assert post(browser, url).status_code == 204
        assert ended(one.browser, motion).one(LF.state) == LF.cancelled
    assert _held_by(other, "Ada")
    assert _release(one, **mine).status_code == 204


def _tasks(gateway: Gateway) -> set[object]:
    robot = gateway.browser.robot("ur5")
    return set(robot.graph.objects(robot.iri, LF.currentTask))


# -- motions that are tied to it ------------------------------------------------------------------------------------


def test_a_tied_motion_stops_when_the_lease_ends(pair: tuple[Gateway, Gateway]) -> None:
    """When it expires because its client vanished, and when it is released, at any gateway."""
    one, other = pair
    for taking, moved in ((one, one), (one, other), (other, one)):
        mine = _take(taking, duration_s=3)
        _let_go(one, _tied(moved, PAN, mine))
        mine = _take(taking)
        invocation = _tied(moved, PAN, mine)
        assert _release(other, **mine).status_code == 204
        _let_go(other, invocation)


def test_a_tied_motion_continues_while_the_lease_is_renewed(pair: tuple[Gateway, Gateway]) -> None:
    """To its end, longer than the initial lease; an untied motion continues without the lease."""
    one, other = pair
    target = angle(one.browser, WRIST) + (1.2 if angle(one.browser, WRIST) < 0 else -1.2)
    mine = _take(one, duration_s=2)
    body = slowly(target, f"; lf:tiedTo <{_lease(other).url}>", speed=0.3)
    url = begun(put(other.browser, of_joint(other.browser, WRIST), body, **mine))

    def over() -> bool:
        _take(other, duration_s=2, **mine)
        return state_at(other, url) == LF.succeeded

    eventually(over, "the end of the motion")
    assert angle(one.browser, WRIST) == pytest.approx(target, abs=STILL_RAD)
    back = slowly(target + (1.2 if target < 0 else -1.2), speed=0.3)
    untied = begun(put(other.browser, of_joint(other.browser, WRIST), back, **mine))
    assert _release(one, **mine).status_code == 204
    assert ended(one.browser, one.here(untied)).one(LF.state) == LF.succeeded


def test_nothing_is_tied_to_a_lease_that_is_not_held(pair: tuple[Gateway, Gateway]) -> None:
    """409, and 422 for the lease of another robot. Nothing moves."""
    one, other = pair
    start = angle(one.browser, WRIST)
    url = of_joint(one.browser, WRIST)
    lease = _lease(one).url
    answer = put(one.browser, url, radian(start + 0.3, f"; lf:tiedTo <{lease}>"))
    assert problem(answer) == (409, "conflict")
    toy = str(one.browser.robot("toy").one(LF.lease))
    answer = put(one.browser, url, radian(start + 0.3, f"; lf:tiedTo <{toy}>"))
    assert problem(answer) == (422, "unprocessable-content")
    mine = _take(other, duration_s=1)
    at_all([one, other], lambda each: _held_by(each, None), "a lease that is over")
    answer = put(one.browser, url, radian(start + 0.3, f"; lf:tiedTo <{lease}>"), **mine)
    assert problem(answer) == (409, "conflict")
    assert angle(other.browser, WRIST) == pytest.approx(start, abs=STILL_RAD)


# -- what outlives gateways and Redis -------------------------------------------------------------------------------


def test_a_lease_outlives_its_gateway(memory: Servers) -> None:
    """After SIGKILL it is held when the gateway is back, its token is valid, and nobody else moves the robot."""
    shared = ("--redis-url", memory.url)
    with hub() as stage, arm(stage.endpoint):
        with gateway(stage, *shared) as one:
            all_see([one])
            mine = _take(one)
            one.process.send(signal.SIGKILL)
        with gateway(stage, *shared) as back:
            all_see([back])
            at_all([back], lambda each: _held_by(each, "Ada"), "the lease, once the robot is known")
            assert problem(put(back.browser, of_joint(back.browser, WRIST), radian(0.2)))[1] == "controlled"
            begun(put(back.browser, of_joint(back.browser, WRIST), radian(0.2), prefer="wait=30", **mine))
            assert _release(back, **mine).status_code == 204


def test_a_tied_motion_stops_after_its_gateway_was_killed(memory: Servers) -> None:
    """The other gateway watches the lease: the motion continues while it is renewed, and then stops."""
    with hub() as stage, arm(stage.endpoint), gateway(stage, "--redis-url", memory.url) as other:
        with gateway(stage, "--redis-url", memory.url) as one:
            all_see([one, other])
            mine = _take(one, duration_s=3)
            invocation = _tied(one, PAN, mine)
            one.process.send(signal.SIGKILL)
        _take(other, duration_s=3, **mine)
        assert state_at(other, invocation) == LF.running
        _let_go(other, invocation)


@pytest.mark.parametrize("outage", ["killed", "hanging"])
def test_a_tied_motion_stops_during_an_outage_of_redis(memory: Servers, outage: str) -> None:
    """Nobody can renew the lease: it ends on time. Requests for control get 503 meanwhile."""
    node = memory.nodes[0]
    with hub() as stage, arm(stage.endpoint), gateways(stage, memory.url) as found:
        all_see(found)
        one, other = found
        mine = _take(one, duration_s=4)
        invocation = _tied(one, LIFT, mine, by=-3.0)
        eventually(lambda: state_at(other, invocation) == LF.running, "the motion at the other gateway")
        node.kill() if outage == "killed" else node.pause()
        try:
            renewed = put(other.browser, str(other.browser.robot("ur5").one(LF.lease)), control("Ada", 2), **mine)
            assert problem(renewed) == (503, "redis-unavailable")
            _let_go(one, invocation)
            _let_go(other, invocation)
            at_all(found, lambda each: _held_by(each, None), "nobody with control")
        finally:
            node.start() if outage == "killed" else node.resume()
        eventually(lambda: put(one.browser, _lease(one).url, control("Bob", 60)).status_code == 204, "Redis")
        at_all(found, lambda each: _held_by(each, "Bob"), "the next lease")
