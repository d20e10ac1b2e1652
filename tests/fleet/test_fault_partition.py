"""A partition between robots and gateway: the robot holds, and commands sent during it never run afterwards.

The robot is simulated in the test, so that every step of MuJoCo is seen, on the simulator's own clock.
"""

import asyncio
import contextlib
import signal
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import httpx
import pytest
from pyoxigraph import NamedNode

from browser import LF, Browser
from commanding import (
    PAN,
    STILL_RAD,
    WRIST,
    angle,
    begun,
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
from gateway_group import hub
from linked_fleet_gateway.actions.guards import Guards
from parallel import pool
from running import Process, eventually, process
from simulated_robots import RESTING_RAD_S, SimulatedRobot, simulated
from small_fleet import Place, live, offline
from virtual.zenoh_proxy import ZenohProxy, zenoh_proxy

pytestmark = pytest.mark.virtual


@dataclass
class Scene:
    gateway: Process
    browser: Browser
    robot: SimulatedRobot
    way: ZenohProxy

    def rests(self) -> list[float]:
        """Wait until the robot stands; return the setpoints of its servos."""
        eventually(lambda: self.robot.speed() < RESTING_RAD_S, "a robot that stands")
        return self.robot.setpoints()

    def lives(self, seconds: float) -> None:
        """Wait for so much of the robot's own time."""
        start = self.robot.data.time
        eventually(lambda: self.robot.data.time > start + seconds, "the robot's time")


@pytest.fixture
def scene(tmp_path: Path) -> Iterator[Scene]:
    place = Place(tmp_path)
    with (
        place.gateway() as (gateway, browser),
        zenoh_proxy(place.zenoh, gateway) as between,
        simulated(between.endpoint, "ur5") as robots,
    ):
        live(browser, "ur5")
        robots["ur5"].watch()
        yield Scene(gateway, browser, robots["ur5"], between)
        robots["ur5"].check_limits()
        between.heal()
        assert "Traceback" not in gateway.output


def _far(scene: Scene) -> str:
    """Begin a motion of many seconds; return its invocation."""
    invocation = begun(put(scene.browser, of_joint(scene.browser, PAN), slowly(3.0, speed=0.3)))
    moving(scene.browser, PAN)
    return invocation


def test_a_robot_that_is_cut_off_holds_and_serves_again(scene: Scene) -> None:
    """Its motion has failed, it stands, and stays there after the partition until it is commanded again."""
    motion = _far(scene)
    scene.way.cut()
    held = scene.rests()
    assert scene.robot.positions()[PAN] < 2.5
    offline(scene.browser, "ur5")
    assert scene.browser.page(motion).one(LF.state) == LF.unknown
    answer = put(scene.browser, of_joint(scene.browser, WRIST), radian(0.5))
    assert (answer.status_code, answer.json()["type"].rpartition("#")[2]) == (503, "offline")
    scene.way.heal()
    live(scene.browser, "ur5")
    page = ended(scene.browser, motion)
    assert page.one(LF.state) == LF.failed
    assert "gateway lost" in str(page.graph.value(page.iri, LF.reason))
    scene.lives(1.0)
    assert scene.robot.setpoints() == held
    begun(put(scene.browser, of_joint(scene.browser, WRIST), radian(0.5), prefer="wait=30"))
    assert scene.robot.positions()[WRIST] == pytest.approx(0.5, abs=0.01)


def test_commands_during_a_partition_never_run(scene: Scene) -> None:
    """Commands wait in the connection, arrive after the partition, and are all refused as late."""
    actions = [of_joint(scene.browser, joint) for joint in (WRIST, PAN, "elbow_joint")]
    before = scene.rests()
    scene.way.cut()
    with pool(len(actions)) as threads, contextlib.ExitStack() as clients:
        browsers = [clients.enter_context(contextlib.closing(Browser(scene.browser.root))) for _ in actions]
        asked = [threads.submit(put, one, action, radian(1.0)) for one, action in zip(browsers, actions, strict=True)]
        answers: list[httpx.Response] = [each.result() for each in asked]
    # It is unknown whether it runs, or the robot is known to be gone; no response claims that it runs.
    assert {answer.status_code for answer in answers} <= {503, 504}
    offline(scene.browser, "ur5")
    scene.lives(5.0)
    scene.way.heal()
    live(scene.browser, "ur5")
    scene.lives(2.0)
    assert scene.robot.setpoints() == before
    for answer in answers:
        if answer.status_code == 504:
            assert ended(scene.browser, answer.headers["location"]).one(LF.state) == LF.failed
    scene.robot.check_limits()


def test_a_robot_can_be_stopped_after_a_partition(scene: Scene) -> None:
    """A stop during the partition reports that the robot did not answer; afterwards it can be stopped."""
    _far(scene)
    scene.way.cut()
    stop = of_robot(scene.browser, LF.StopRobot)
    answer = post(scene.browser, stop)
    assert answer.status_code in (503, 504)
    scene.rests()
    scene.way.heal()
    live(scene.browser, "ur5")
    done = eventually(lambda: _unless_silent(post(scene.browser, stop, prefer="wait=30")), "an answer")
    assert scene.browser.page(begun(done)).one(LF.state) == LF.succeeded


def _unless_silent(answer: httpx.Response) -> httpx.Response | None:
    return None if answer.status_code in (503, 504) else answer


def test_a_gateway_that_freezes_is_lost_and_executes_nothing_when_it_goes_on(scene: Scene) -> None:
    """Its connections stay open and are full: the robot holds, and commands sent meanwhile are late."""
    _far(scene)
    action = of_joint(scene.browser, WRIST)
    scene.gateway.send(signal.SIGSTOP)
    try:
        held = scene.rests()
        with pool(1) as thread, contextlib.closing(Browser(scene.browser.root)) as late:
            asked = thread.submit(put, late, action, radian(1.0))
            scene.lives(5.0)
            scene.gateway.send(signal.SIGCONT)
            assert asked.result().status_code != 204
    finally:
        scene.gateway.send(signal.SIGCONT)
    live(scene.browser, "ur5")
    scene.lives(1.0)
    assert scene.robot.setpoints() == held
    begun(put(scene.browser, action, radian(0.5), prefer="wait=30"))
    assert scene.robot.positions()[WRIST] == pytest.approx(0.5, abs=0.01)


def test_a_motion_is_late_after_its_gateway_froze_while_it_was_checked(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Another gateway keeps the robot from holding. A check may take time, of which the freeze is no part."""

    async def findings(*_: object) -> dict[NamedNode, bool]:
        await asyncio.sleep(1.0)  # the gateway freezes in it
        await asyncio.sleep(3.0)  # it finds its robots again
        return {}

    monkeypatch.setattr(Guards, "findings", findings)
    with hub() as between, contextlib.ExitStack() as running:
        gateways, browsers = list[Process](), list[Browser]()
        for place in (Place(tmp_path / "freezes"), Place(tmp_path / "serves")):
            command = ("-m", "linked_fleet_gateway", "--port", str(place.port), "--state-dir", str(place.state))
            gateways.append(running.enter_context(process(*command, "--zenoh-connect", between.endpoint)))
            browsers.append(running.enter_context(contextlib.closing(Browser(place.root))))
            gateways[-1].said("serving")
        running.enter_context(process("-m", "linked_fleet_agent", "--robot=ur5", "--connect", between.endpoint))
        for browser in browsers:
            live(browser, "ur5")
        action = of_joint(browsers[0], PAN)
        with pool(1) as thread:
            asked = thread.submit(put, browsers[0], action, radian(1.0))
            time.sleep(0.5)
            gateways[0].send(signal.SIGSTOP)
            time.sleep(30.0)
            gateways[0].send(signal.SIGCONT)
            assert problem(asked.result()) == (409, "refused")
        assert "stale" in asked.result().json()["detail"]
        assert angle(browsers[1], PAN) == pytest.approx(0.0, abs=STILL_RAD)
        begun(put(browsers[0], action, radian(0.5)))
