"""One robot floods its keys: frames and progress of others still arrive, and HTTP responds."""

import contextlib
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest
import zenoh

from browser import LF, ROS, Browser
from commanding import WRIST, angle, begun, of_joint, of_robot, post, put, radian
from fake_robots import FakeRobot
from fake_robots import open_session as session_at
from linked_fleet_agent.wire.codec import encode
from linked_fleet_agent.wire.messages import WIRE_VERSION, Progress
from running import eventually
from small_fleet import Place, live
from subscribers import Socket

pytestmark = [pytest.mark.processes, pytest.mark.test_all]


@contextlib.contextmanager
def flooding(session: zenoh.Session, loud: FakeRobot, kind: str) -> Iterator[None]:
    """Let the robot send the same message as fast as it can, in a thread."""
    end = threading.Event()
    told = Progress(version=WIRE_VERSION, id="x", incarnation=loud.incarnation, state="running", wall_ns=1)
    said = {"progress": encode(told), "nonsense": b"\xff" * 60_000, "too much": bytes(200_000)}

    def shout() -> None:
        while not end.is_set():
            payload = said.get(kind) or loud.frame([0.5])
            loud.put("progress" if kind == "progress" else "state", payload)

    thread = threading.Thread(target=shout)
    thread.start()
    try:
        yield
    finally:
        end.set()
        thread.join()


@pytest.mark.parametrize("kind", ["frames", "nonsense", "progress", "too much"])
def test_a_flood_starves_nobody(tmp_path: Path, kind: str) -> None:
    """Meanwhile another robot can be moved, seen and stopped."""
    place = Place(tmp_path)
    with place.gateway() as (gateway, browser), place.ur5(), session_at(place.zenoh) as session:
        loud = FakeRobot(session, "loud").appear()
        live(browser, "ur5")
        with flooding(session, loud, kind):
            _is_moved_and_stopped(browser)
        live(browser, "ur5")
        assert "Traceback" not in gateway.output


def _is_moved_and_stopped(browser: Browser) -> None:
    rotation = str(browser.part("ur5", WRIST).one(ROS.rotation))
    turn, halt = of_joint(browser, WRIST), of_robot(browser, LF.StopRobot)
    target = angle(browser, WRIST) + 0.2
    with Socket(rotation) as watching:
        watching.next()
        motion = begun(put(browser, turn, radian(target), prefer="wait=30"))
        eventually(lambda: watching.next().angle == pytest.approx(target, abs=0.01), "the place in the stream")
        assert browser.page(motion).one(LF.state) == LF.succeeded
        stop = begun(post(browser, halt, prefer="wait=30"))
        assert browser.page(stop).one(LF.state) == LF.succeeded
