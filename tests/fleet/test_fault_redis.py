"""Redis serves badly or not at all: what needs it is refused, all else goes on, what was accepted is there later."""

import contextlib
import os
import subprocess
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import httpx
import pytest
from browser import LF, Browser
from commanding import (
    PAN,
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
from forwarder import way
from receivers import CallbackReceiver, receiving
from redis_servers import Server, Servers, single
from running import eventually
from several import Gateway, Hub, arrived, deliveries, gateway, gateways, hub
from small_fleet import live
from subscribers import Socket

pytestmark = pytest.mark.fleet


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


def _configured(**values: str) -> Callable[[Server], None]:
    def change(node: Server) -> None:
        for name, value in values.items():
            assert node.ask("CONFIG SET", name.replace("_", "-"), value) == "+OK"

    return change


def _said(*words: str) -> Callable[[Server], None]:
    def say(node: Server) -> None:
        assert node.ask(*words) == "+OK"

    return say


_OUTAGES = {
    "full": (_configured(maxmemory="1", maxmemory_policy="noeviction"), _configured(maxmemory="0")),
    # Of a master that is not there: a replica that takes no writes and serves what it has.
    "read-only": (_said("REPLICAOF 127.0.0.1 1"), _said("REPLICAOF NO ONE")),
    "without its replicas": (_configured(min_replicas_to_write="1"), _configured(min_replicas_to_write="0")),
    "hanging on writes": (_said("CLIENT PAUSE 600000 WRITE"), _said("CLIENT UNPAUSE")),
    "frozen": (Server.pause, Server.resume),
}


def _lease(browser: Browser) -> str:
    return str(browser.robot("ur5").one(LF.lease))


def _far(browser: Browser) -> float:
    """A position that is two radians away."""
    present = angle(browser, PAN)
    return present - 2.0 if present > 0 else present + 2.0


@pytest.mark.parametrize("outage", _OUTAGES)
def test_what_needs_redis_is_refused_and_all_else_goes_on(scene: Scene, outage: str) -> None:
    """Reading, streams and stops go on; motions, callbacks and leases are 503 and leave nothing behind."""
    (node,), at = scene.memory.nodes, scene.at
    begin, end = _OUTAGES[outage]
    path = f"/{outage.replace(' ', '-')}"
    kept = at.subscribed(scene.receiver.url(path))
    motion = begun(put(scene.browser, of_joint(scene.browser, PAN), slowly(_far(scene.browser))))
    moving(scene.browser, PAN)
    wrist = angle(scene.browser, WRIST)
    with Socket(at.rotation) as watching:
        assert watching.next().angle == scene.stage.angle
        begin(node)
        try:
            motion_refused = put(scene.browser, of_joint(scene.browser, WRIST), radian(wrist + 0.5))
            assert (problem(motion_refused), motion_refused.headers["retry-after"]) == ((503, "store-away"), "2")
            refused = [
                at.subscribe(scene.receiver.url("/refused")),
                put(scene.browser, _lease(scene.browser), control("me", 60)),
            ]
            assert [problem(each) for each in refused] == 2 * [(503, "store-away")]
            for _ in range(10):
                scene.stage.step()
                assert watching.next().angle == scene.stage.angle
            with Socket(at.rotation) as later:
                assert later.next().angle == scene.stage.angle
            stop = begun(post(scene.browser, of_robot(scene.browser, LF.StopRobot), prefer="wait=30"))
            assert scene.browser.page(stop).one(LF.state) == LF.succeeded
            assert ended(scene.browser, motion).one(LF.state) == LF.cancelled
            assert angle(scene.browser, WRIST) == pytest.approx(wrist, abs=STILL_RAD)
        finally:
            end(node)
    again = eventually(
        lambda: _unless_away(put(scene.browser, of_joint(scene.browser, WRIST), radian(wrist + 0.1))), "Redis"
    )
    assert ended(scene.browser, begun(again)).one(LF.state) == LF.succeeded
    scene.stage.step()
    arrived(scene.receiver, path, scene.stage.angle)
    deliveries(scene.receiver.log(path, "POST"))
    assert scene.receiver.log("/refused") == []
    assert eventually(lambda: _unless_away(scene.browser.http.delete(kept)), "Redis").status_code == 204
    eventually(lambda: at.listed() == set(), "an empty container")
    # What was stopped, and the stop, are as they were also for those who come later.
    with gateway(scene.stage, "--redis-url", scene.memory.url) as other:
        live(other.browser, "ur5")
        for iri, state in ((motion, LF.cancelled), (stop, LF.succeeded)):
            eventually(lambda iri=iri, state=state: _state(other, iri) == state, f"{iri} remembered")


def _state(at: Gateway, iri: str) -> object:
    answer = at.get(at.here(iri))
    return at.browser.page(at.here(iri)).one(LF.state) if answer.status_code == 200 else None


def _unless_away(answer: httpx.Response) -> httpx.Response | None:
    return None if answer.status_code == 503 else answer


def test_a_slow_redis_delays_what_needs_it_and_nothing_else(scene: Scene) -> None:
    """A tenth of a second for each answer: motions and callbacks are accepted, streams lose nothing."""
    (node,) = scene.memory.nodes
    with way(node.port) as between, gateway(scene.stage, "--redis-url", f"redis://127.0.0.1:{between.port}") as at:
        live(at.browser, "ur5")
        between.delay_s = 0.05
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
        assert "Traceback" not in at.process.output


# -- no room on the disk --------------------------------------------------------------------------------------------


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """A file system of its own with little room."""
    folder = tmp_path / "disk"
    folder.mkdir()
    mounted = subprocess.run(("mount", "-t", "tmpfs", "-o", "size=4m", "none", folder), capture_output=True, text=True)
    if mounted.returncode:
        pytest.skip(f"a file system of a test's own cannot be mounted here: {mounted.stderr.strip()}")
    try:
        yield folder
    finally:
        subprocess.run(("umount", "-l", folder), check=True)


def test_a_full_disk_loses_nothing_that_was_accepted(small_disk: Path) -> None:
    """The gateway's own server cannot write: callbacks are refused until there is room, and streams go on."""
    with hub() as stage, receiving() as receiver, gateway(stage, state=small_disk) as at:
        at.subscribed(receiver.url("/before"))
        receiver.wait(1)
        filler = small_disk / "filler"
        with filler.open("wb") as file, contextlib.suppress(OSError):
            while True:
                os.write(file.fileno(), bytes(4096))
        with Socket(at.rotation) as watching:
            watching.next()
            # What fits into the rest of a block is accepted, and stays.
            made = [f"/{number}" for number in range(20) if at.subscribe(receiver.url(f"/{number}")).status_code == 201]
            refused = at.subscribe(receiver.url("/refused"))
            assert (problem(refused), refused.headers["retry-after"]) == ((503, "store-away"), "2")
            for _ in range(10):
                stage.step()
                assert watching.next().angle == stage.angle
        filler.unlink()
        eventually(lambda: _unless_away(at.get(at.container)), "the server")
        stage.step()
        for path in ("/before", *made):
            arrived(receiver, path, stage.angle)
            deliveries(receiver.log(path, "POST"))
        eventually(lambda: len(at.listed()) == 1 + len(made), "what was accepted, and nothing else")
        assert receiver.log("/refused") == []
        assert "Traceback" not in at.process.output
