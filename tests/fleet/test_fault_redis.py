"""Redis is slow or unavailable: what needs it is refused, the rest continues, and accepted data is there later."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import httpx
import pytest

from browser import LF, Browser
from commanding import (
    PAN,
    PREFIXES,
    STILL_RAD,
    WRIST,
    angle,
    arm,
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
    slowly,
)
from gateway_group import Gateway, Hub, arrived, deliveries, gateway, gateways, hub
from receivers import CallbackReceiver, receiving
from redis_servers import Servers, single
from rules_client import a_rule
from running import eventually
from small_fleet import live
from subscribers import Socket
from virtual.redis_servers import MemoryServer

pytestmark = pytest.mark.virtual


@dataclass
class Scene:
    stage: Hub
    memory: Servers
    at: Gateway
    receiver: CallbackReceiver

    @property
    def browser(self) -> Browser:
        return self.at.browser


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Scene]:
    folder = tmp_path_factory.mktemp("redis")
    with (
        hub() as stage,
        single(folder) as memory,
        receiving() as receiver,
        arm(stage.endpoint),
        gateways(stage, memory.url, 1) as (at,),
    ):
        live(at.browser, "ur5")
        yield Scene(stage, memory, at, receiver)
        assert "Traceback" not in at.process.output, at.process.output


def _fails(error: str) -> tuple[Callable[[MemoryServer], None], Callable[[MemoryServer], None]]:
    return lambda node: node.fail(error), lambda node: node.fail("")


_CRATE = """<> dcterms:title "crate" ; lf:position [ maths:x 9 ; maths:y 9 ; maths:z 0.5 ; vom:unit unit:M ] ;
  lf:geometry [ a lf:Sphere ; lf:radius [ vom:numericalValue 0.2 ; vom:unit unit:M ] ] ."""
_NEVER = "SELECT ?s { ?s ?p ?o FILTER(false) }"
_OUTAGES = {
    "full": _fails("OOM command not allowed when used memory > 'maxmemory'."),
    "read-only": _fails("READONLY You can't write against a read only replica."),
    "without its replicas": _fails("NOREPLICAS Not enough good replicas to write."),
    "frozen": (MemoryServer.pause, MemoryServer.resume),
}


def _lease(browser: Browser) -> str:
    return str(browser.robot("ur5").one(LF.lease))


def _far(browser: Browser) -> float:
    """Return a position two radians away."""
    present = angle(browser, PAN)
    return present - 2.0 if present > 0 else present + 2.0


@pytest.mark.parametrize("outage", _OUTAGES)
def test_an_outage_of_redis_refuses_only_what_needs_it(scene: Scene, outage: str) -> None:
    begin, end = _OUTAGES[outage]
    refused_and_remembered(scene, begin, end, f"/{outage.replace(' ', '-')}")


def refused_and_remembered(scene: Scene, begin: Callable[[Any], None], end: Callable[[Any], None], path: str) -> None:
    """Reading, streams and stops continue; motions, callbacks and leases get 503 and leave nothing behind."""
    (node,), at = scene.memory.nodes, scene.at
    kept = at.subscribed(scene.receiver.url(path))
    motion = begun(put(scene.browser, of_joint(scene.browser, PAN), slowly(_far(scene.browser))))
    moving(scene.browser, PAN)
    wrist = angle(scene.browser, WRIST)
    with Socket(at.rotation) as watching:
        assert watching.next().angle == scene.stage.angle
        begin(node)
        try:
            motion_refused = put(scene.browser, of_joint(scene.browser, WRIST), radian(wrist + 0.5))
            assert (problem(motion_refused), motion_refused.headers["retry-after"]) == ((503, "redis-unavailable"), "2")
            refused = [
                at.subscribe(scene.receiver.url("/refused")),
                put(scene.browser, _lease(scene.browser), control("me", 60)),
            ]
            for _ in range(10):
                scene.stage.step()
                assert watching.next().angle == scene.stage.angle
            with Socket(at.rotation) as later:
                assert later.next().angle == scene.stage.angle
            stop = begun(post(scene.browser, of_robot(scene.browser, LF.StopRobot), prefer="wait=30"))
            assert scene.browser.page(stop).one(LF.state) == LF.succeeded
            assert ended(scene.browser, motion).one(LF.state) == LF.cancelled
            assert angle(scene.browser, WRIST) == pytest.approx(wrist, abs=STILL_RAD)
            refused += _refused_by_others(scene.browser)
            assert [problem(each) for each in refused] == [(503, "redis-unavailable")] * len(refused)
            assert {each.json()["detail"] for each in refused} == {motion_refused.json()["detail"]}, "one sentence"
        finally:
            end(node)
    again = eventually(
        lambda: unless_away(put(scene.browser, of_joint(scene.browser, WRIST), radian(wrist + 0.1))), "Redis"
    )
    assert ended(scene.browser, begun(again)).one(LF.state) == LF.succeeded
    scene.stage.step()
    arrived(scene.receiver, path, scene.stage.angle)
    deliveries(scene.receiver.log(path, "POST"))
    assert scene.receiver.log("/refused") == []
    assert eventually(lambda: unless_away(scene.browser.http.delete(kept)), "Redis").status_code == 204
    eventually(lambda: at.listed() == set(), "an empty container")
    # A gateway that starts later shows the stopped motion and the stop unchanged, too.
    with gateway(scene.stage, "--redis-url", scene.memory.url) as other:
        live(other.browser, "ur5")
        for iri, state in ((motion, LF.cancelled), (stop, LF.succeeded)):
            eventually(lambda iri=iri, state=state: _state(other, iri) == state, f"{iri} remembered")


def _refused_by_others(browser: Browser) -> list[httpx.Response]:
    """Return the answers to writes of a setting, an object of the world, and a rule."""
    title = str(browser.robot("ur5").property(LF.TextProperty))
    return [
        put(browser, title, f'{PREFIXES}<> lf:value "never" .'),
        post(browser, f"{browser.root}world/objects", PREFIXES + _CRATE),
        post(browser, f"{browser.root}rules", a_rule(_NEVER, f"{browser.root}actions/stopAll")),
    ]


def _state(at: Gateway, iri: str) -> object:
    answer = at.get(at.here(iri))
    return at.browser.page(at.here(iri)).one(LF.state) if answer.status_code == 200 else None


def unless_away(answer: httpx.Response) -> httpx.Response | None:
    return None if answer.status_code == 503 else answer


def test_a_slow_redis_delays_what_needs_it_and_nothing_else(scene: Scene) -> None:
    """A tenth of a second for each answer: motions and callbacks are accepted, streams lose nothing."""
    node: Any = scene.memory.nodes[0]
    with gateway(scene.stage, "--redis-url", node.url) as at:
        live(at.browser, "ur5")
        node.slow(0.1)
        at.subscribed(scene.receiver.url("/slow"))
        with Socket(at.rotation) as watching:
            watching.next()
            motion = begun(put(at.browser, of_joint(at.browser, WRIST), radian(angle(at.browser, WRIST) + 0.2)))
            for _ in range(50):
                scene.stage.step()
                assert watching.next().angle == scene.stage.angle
            assert ended(at.browser, motion).one(LF.state) == LF.succeeded
        arrived(scene.receiver, "/slow", scene.stage.angle)
        deliveries(scene.receiver.log("/slow", "POST"))
        node.slow(0)
        assert "Traceback" not in at.process.output
