"""From the sample of a client to the component that applies it, over the gateway and its agent.

``python -m bench.driving --play ENDPOINT`` is the agent. A line on its standard input asks for the times since then.
"""

import contextlib
import json
import os
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import httpx
from websockets.sync.client import connect

from bench.beside import wire
from bench.played import run_played
from bench.table import Row, at_most, bounded, known, percentile
from linked_fleet_agent.components import Call, Component, StreamLimits, action
from linked_fleet_agent.robots.of_components import RobotOfComponents
from linked_fleet_agent.serving import run
from running import eventually, free_port, process
from small_fleet import Place

MOST_P50_MS, MOST_P99_MS = 3.0, 10.0
RATE_HZ = 60.0


class Follower(Component, blocking=False):
    """Notes how long each sample has taken; its input is the time at which it was sent."""

    def __init__(self) -> None:
        self.taken_ms = list[float]()

    @action(stream=StreamLimits())
    async def follow(self, call: Call[float], at: float = 0.0) -> None:
        """Follow the samples."""
        if call.stream is None:
            return
        async for given in call.stream:
            if given is not None:
                self.taken_ms.append((time.monotonic_ns() / 1e9 - given.input["at"]) * 1e3)


def rows(seconds: float) -> list[Row]:
    with _served() as (place, agent):
        taken_ms = _drive(place, agent, seconds)
    raw_ms = wire(f"tcp/127.0.0.1:{free_port()}", 100, seconds).states_ms
    what = f"from a sample ({RATE_HZ:g} Hz) to the component that applies it"
    return [
        at_most(f"{what}, p50", percentile(taken_ms, 0.5), "a frame on Zenoh", percentile(raw_ms, 0.5), MOST_P50_MS),
        bounded(f"{what}, p99", "ms", percentile(taken_ms, 0.99), MOST_P99_MS),
        known("samples of these that were applied", "%", 100 * len(taken_ms) / _count(seconds)),
    ]


@contextlib.contextmanager
def _served() -> Iterator[tuple[Place, "subprocess.Popen[str]"]]:
    with tempfile.TemporaryDirectory() as state:
        place = Place(Path(state))
        with process(*place.command()) as gateway:
            gateway.said("serving")
            command = [sys.executable, "-m", "bench.driving", "--play", place.zenoh]
            around = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
            agent = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=around)  # noqa: S603
            try:
                eventually(lambda: httpx.get(_action(place)).status_code == 200, "the robot")
                yield place, agent
            finally:
                agent.kill()
                agent.communicate()


def _count(seconds: float) -> int:
    return int(max(2.0, seconds) * RATE_HZ)


def _action(place: Place) -> str:
    return f"{place.root}robot/follower/actions/follow"


def _drive(place: Place, agent: "subprocess.Popen[str]", seconds: float) -> list[float]:
    """Send back the newest time of the robot at a rate, and return the times that the samples took."""
    newest: dict[str, float] = {}

    def hear() -> None:
        for message in socket:
            newest["seen"] = json.loads(message)["time"]

    url = _action(place).replace("http", "ws", 1)
    with connect(url, subprotocols=["lf.drive"]) as socket:  # type: ignore[list-item]
        hearing = threading.Thread(target=hear, daemon=True)
        hearing.start()
        eventually(lambda: newest.get("seen"), "the time of the robot")
        due = time.monotonic()
        for _ in range(_count(seconds)):
            due += 1 / RATE_HZ
            time.sleep(max(0.0, due - time.monotonic()))
            socket.send(json.dumps({"seen": newest["seen"], "input": {"at": time.monotonic_ns() / 1e9}}))
        time.sleep(0.2)
        assert agent.stdin is not None
        assert agent.stdout is not None
        agent.stdin.write("\n")
        agent.stdin.flush()
        found: list[float] = json.loads(agent.stdout.readline())
    return found


def play(endpoint: str) -> None:
    """Serve the robot, and answer lines of standard input."""
    follower = Follower()

    def answer() -> None:
        for _ in sys.stdin:
            taken, follower.taken_ms = follower.taken_ms, []
            print(json.dumps(taken), flush=True)

    threading.Thread(target=answer, daemon=True).start()
    sys.argv = [sys.argv[0], "--connect", endpoint]
    run("robot", RobotOfComponents("Robot", follower))


if __name__ == "__main__":
    run_played(__doc__, rows, play)
