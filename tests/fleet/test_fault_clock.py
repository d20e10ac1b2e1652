"""The wall clock of a gateway or a robot jumps by an hour: motions continue, nothing is lost, nothing moves by it."""

import contextlib
import signal
from collections.abc import Iterator
from dataclasses import dataclass

import pytest

from browser import LF
from commanding import PAN, TURTLE, WRIST, angle, begun, control, ended, moving, of_joint, problem, put, radian, slowly
from gateway_group import Gateway, Hub, arrived, deliveries, gateway, hub
from receivers import CallbackReceiver, receiving
from redis_servers import single
from running import Process, eventually, process
from small_fleet import live, offline
from subscribers import Socket
from virtual.loop import current

pytestmark = pytest.mark.virtual
HOUR_S = 3600.0


@dataclass
class Scene:
    stage: Hub
    at: Gateway
    other: Gateway
    receiver: CallbackReceiver


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Scene]:
    """Run two gateways with one Redis, the first with a clock that can be set, and a simulated robot."""
    with (
        hub() as stage,
        single(tmp_path_factory.mktemp("clock")) as memory,
        receiving() as receiver,
        process("-m", "linked_fleet_agent", "--robot=ur5", "--connect", stage.endpoint),
        gateway(stage, "--redis-url", memory.url) as other,
        gateway(stage, "--redis-url", memory.url) as at,
    ):
        for each in (at, other):
            live(each.browser, "ur5")
        yield Scene(stage, at, other, receiver)
        assert "Traceback" not in at.process.output + other.process.output


def _step(one: Process, by_s: float) -> None:
    """Step the wall clock of one process."""
    one.step_wall(by_s)  # type: ignore[attr-defined]


@contextlib.contextmanager
def _started_ahead(by_s: float, *command: str) -> Iterator[Process]:
    """Run a process whose wall clock is off from its beginning."""
    loop = current()
    assert loop is not None
    loop.clock.step_wall(by_s)
    with process(*command) as one:  # it has read the clock, and no time has passed
        loop.clock.step_wall(-by_s)
        _step(one, by_s)
        yield one


@pytest.mark.parametrize("jump_s", [HOUR_S, -HOUR_S])
def test_the_clock_of_a_gateway_jumps(scene: Scene, jump_s: float) -> None:
    """Motion, lease, stream and callback continue, and new ones work."""
    at, other, path = scene.at, scene.other, f"/{jump_s}"
    kept = at.subscribed(scene.receiver.url(path))
    lease = str(at.browser.robot("ur5").one(LF.lease))
    taken = at.browser.http.put(lease, content=control("me", 600), headers=TURTLE)
    proof = {"lock-token": taken.headers["lock-token"]}
    present = angle(at.browser, PAN)
    target = present + (-1.0 if present > 0 else 1.0)
    motion = begun(put(at.browser, of_joint(at.browser, PAN), slowly(target, speed=0.2), **proof))
    moving(at.browser, PAN)
    with Socket(at.rotation) as watching:
        watching.next()
        _step(at.process, jump_s)
        try:
            for _ in range(20):
                scene.stage.step()
                assert watching.next().angle == scene.stage.angle
            for each in (at, other):
                refused = put(each.browser, of_joint(each.browser, WRIST), radian(0.5))
                assert problem(refused) == (409, "controlled")
            wrist = 0.2 if abs(angle(at.browser, WRIST)) < 0.1 else 0.0
            for each, value in ((at, wrist), (other, wrist + 0.1)):
                begun(put(each.browser, of_joint(each.browser, WRIST), radian(value), prefer="wait=30", **proof))
                assert angle(each.browser, WRIST) == pytest.approx(value, abs=0.02)
            for each in (at, other):
                assert ended(each.browser, each.here(motion)).one(LF.state) == LF.succeeded
            arrived(scene.receiver, path, scene.stage.angle)
            deliveries(scene.receiver.log(path, "POST"))
            assert at.listed() == other.listed()
            assert at.browser.http.delete(kept).status_code == 204
        finally:
            _step(at.process, -jump_s)
            at.browser.http.delete(lease, headers=proof)


@pytest.mark.parametrize("jump_s", [HOUR_S, -HOUR_S])
def test_the_clock_of_a_robot_jumps(scene: Scene, jump_s: float) -> None:
    """It keeps moving, accepts commands, and is found again although its next run seems older than the last one."""
    browser = scene.other.browser
    command = ("-m", "linked_fleet_agent", "--robot=second=ur5", "--connect", scene.stage.endpoint)
    with process(*command) as agent:
        live(browser, "second")
        motion = begun(put(browser, of_joint(browser, PAN, robot="second"), slowly(0.5, speed=0.2)))
        moving(browser, PAN, "second")
        _step(agent, jump_s)
        assert ended(browser, motion).one(LF.state) == LF.succeeded
        begun(put(browser, of_joint(browser, WRIST, robot="second"), radian(0.3), prefer="wait=30"))
        agent.send(signal.SIGKILL)
        offline(browser, "second")
    with _started_ahead(jump_s, *command):
        live(browser, "second")
        begun(put(browser, of_joint(browser, WRIST, robot="second"), radian(-0.3), prefer="wait=30"))
        assert angle(browser, WRIST, "second") == pytest.approx(-0.3, abs=0.02)
    eventually(lambda: offline(browser, "second"), "its end")
