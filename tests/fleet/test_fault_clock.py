"""Wall clocks jump by an hour, of a gateway or of a robot: what runs goes on, nothing is lost, nothing moves by it."""

import contextlib
import signal
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest
from browser import LF, Browser
from commanding import PAN, TURTLE, WRIST, angle, begun, control, ended, moving, of_joint, problem, put, radian, slowly
from receivers import CallbackReceiver, receiving
from redis_servers import single
from running import Process, eventually, free_port, process
from several import Gateway, Hub, arrived, deliveries, gateway, hub
from small_fleet import live, offline
from subscribers import Socket

pytestmark = pytest.mark.fleet
HOUR_S = 3600.0


class Clock:
    """The wall clock of one process."""

    def __init__(self, file: Path) -> None:
        self._file = file
        self.step(0.0)

    def step(self, ahead_s: float) -> None:
        other = self._file.with_suffix(".new")
        other.write_text(str(ahead_s))
        other.replace(self._file)  # in one step: it is read all the time

    def process(self, *command: str) -> contextlib.AbstractContextManager[Process]:
        return process("tests/stepped_clock.py", str(self._file), *command)


@dataclass
class Scene:
    stage: Hub
    clock: Clock
    at: Gateway
    other: Gateway
    receiver: CallbackReceiver


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Scene]:
    """Two gateways with one memory, of which the first has a clock that can be set, and a simulated robot."""
    folder, port = tmp_path_factory.mktemp("clock"), free_port()
    clock = Clock(folder / "ahead")
    with (
        hub() as stage,
        single(folder / "redis") as memory,
        receiving() as receiver,
        process("-m", "agents", "--robot=ur5", "--connect", stage.endpoint),
        gateway(stage, "--redis-url", memory.url) as other,
        clock.process(
            *("-m", "gateway", "--port", str(port), "--zenoh-connect", stage.endpoint),
            *("--redis-url", memory.url, "--callback-allow", "127.0.0.0/8"),
        ) as running,
        contextlib.closing(Browser(f"http://127.0.0.1:{port}/")) as browser,
    ):
        running.said("serving")
        at = Gateway(running, browser)
        at.meet(stage)
        for each in (at, other):
            live(each.browser, "ur5")
        yield Scene(stage, clock, at, other, receiver)
        assert "Traceback" not in running.output + other.process.output


@pytest.mark.parametrize("jump_s", [HOUR_S, -HOUR_S])
def test_the_clock_of_a_gateway_jumps(scene: Scene, jump_s: float) -> None:
    """Motion, lease, stream and callback are as if nothing had happened, and so is what begins afterwards."""
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
        scene.clock.step(jump_s)
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
            scene.clock.step(0.0)
            at.browser.http.delete(lease, headers=proof)


@pytest.mark.parametrize("jump_s", [HOUR_S, -HOUR_S])
def test_the_clock_of_a_robot_jumps(scene: Scene, tmp_path: Path, jump_s: float) -> None:
    """It moves on, takes commands, and is found again although its next run seems to be before the last one."""
    clock, browser = Clock(tmp_path / "ahead"), scene.other.browser
    command = ("-m", "agents", "--robot=second=ur5", "--connect", scene.stage.endpoint)
    with clock.process(*command) as agent:
        live(browser, "second")
        motion = begun(put(browser, of_joint(browser, PAN, robot="second"), slowly(0.5, speed=0.2)))
        moving(browser, PAN, "second")
        clock.step(jump_s)
        assert ended(browser, motion).one(LF.state) == LF.succeeded
        begun(put(browser, of_joint(browser, WRIST, robot="second"), radian(0.3), prefer="wait=30"))
        agent.send(signal.SIGKILL)
        offline(browser, "second")
    with clock.process(*command):
        live(browser, "second")
        begun(put(browser, of_joint(browser, WRIST, robot="second"), radian(-0.3), prefer="wait=30"))
        assert angle(browser, WRIST, "second") == pytest.approx(-0.3, abs=0.02)
    eventually(lambda: offline(browser, "second"), "its end")
