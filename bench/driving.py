"""From the sample of a client to the component that applies it, over the gateway and its agent.

Measured for an action that nothing checks, and for a base and a joint of a robot with a placement: the gateway checks
the way of each sample of those.

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
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import httpx
import msgspec
from websockets.sync.client import ClientConnection, connect

from bench.beside import wire
from bench.played import run_played
from bench.table import Row, at_most, bounded, known, percentile
from linked_fleet_agent.components import Call, Component, StreamLimits, action
from linked_fleet_agent.components.driving import VelocityBase
from linked_fleet_agent.components.jogging import Jogging
from linked_fleet_agent.planar import STANDING, DriveLimits, Pose, Velocity
from linked_fleet_agent.robot import Facts
from linked_fleet_agent.robots.of_components import RobotOfComponents
from linked_fleet_agent.serving import run
from linked_fleet_agent.urdf import joints_of
from running import eventually, free_port, process
from small_fleet import Place

MOST_P50_MS, MOST_P99_MS = 3.0, 10.0
RATE_HZ = 60.0
SPEED, COUNTED = 0.05, 1e-9
"""The velocity of a sample (m/s or rad/s), and how much more each next one has, by which it is known again."""
LIMITS = DriveLimits(linear=1.0, angular=1.5, linear_acceleration=1.0, angular_acceleration=2.0)
URDF = """<robot name="robot">
<link name="base"><collision><origin xyz="0 0 0.2"/><geometry><box size="0.5 0.4 0.3"/></geometry></collision></link>
<link name="arm"><collision><origin xyz="0.2 0 0"/><geometry><box size="0.4 0.1 0.1"/></geometry></collision></link>
<joint name="turn" type="continuous"><parent link="base"/><child link="arm"/><origin xyz="0 0 0.5"/><axis xyz="0 0 1"/>
<limit velocity="2" effort="10"/></joint></robot>"""
PLACEMENT = """@prefix lf: <https://w3id.org/linked-fleet#> .
@prefix maths: <http://vocab.arvida.de/2015/06/maths/vocab#> .
@prefix vom: <http://vocab.arvida.de/2015/06/vom/vocab#> .
<> lf:position [ maths:x 0 ; maths:y 0 ; maths:z 0 ; vom:unit <http://qudt.org/vocab/unit/M> ] ."""

# -- the robot --------------------------------------------------------------------------------------------------------


class Applied:
    """When each sample was applied, by its number."""

    def __init__(self) -> None:
        self._at_ns = dict[int, int]()

    def note(self, velocity: float) -> None:
        if velocity:
            self._at_ns.setdefault(round((velocity - SPEED) / COUNTED), time.monotonic_ns())

    def take(self) -> dict[int, int]:
        taken, self._at_ns = self._at_ns, {}
        return taken


class Follower(Component, blocking=False):
    """An action that moves nothing."""

    def __init__(self, applied: Applied) -> None:
        self._applied = applied

    @action(stream=StreamLimits())
    async def follow(self, call: Call[None], velocity: float = 0.0) -> None:
        """Follow the samples."""
        if call.stream is None:
            return
        async for given in call.stream:
            if given is not None:
                self._applied.note(given.input["velocity"])


class Wheels(VelocityBase, limits=LIMITS):
    """A base that has at once each velocity that is sent."""

    corners = ((0.25, -0.2), (0.25, 0.2), (-0.25, 0.2), (-0.25, -0.2))

    def __init__(self, applied: Applied) -> None:
        super().__init__()
        self._applied, self._sent, self._at = applied, STANDING, Pose()

    def request(self, given: Mapping[str, Any], until_s: float) -> None:
        super().request(given, until_s)
        self._applied.note(given["linear"])

    def send(self, velocity: Velocity) -> None:
        self._sent = velocity

    def measure(self, elapsed_s: float) -> tuple[Pose, Velocity]:
        self._at = self._at.moved(self._sent.linear * elapsed_s, 0.0)
        return self._at, self._sent


def note_jogging(applied: Applied) -> None:
    """Note the samples of the component that the agent adds."""
    request = Jogging.request

    def noting(self: Jogging, given: Mapping[str, Any], until_s: float) -> None:
        request(self, given, until_s)
        applied.note(msgspec.to_builtins(given["velocities"]).get("turn", 0.0))

    Jogging.request = noting  # type: ignore[method-assign]


class Machine(RobotOfComponents):
    """A base that drives, with a joint that has at once each position that is set."""

    def __init__(self, applied: Applied) -> None:
        wheels, self._turn = Wheels(applied), 0.0
        reading = {"measure": lambda: (self._turn,), "measure_base": lambda: wheels.reading}
        super().__init__("Robot", Follower(applied), wheels, urdf=URDF, **reading)

    def describe(self) -> Facts:
        return Facts("Robot", URDF, joints_of(URDF), floating=True)

    def apply(self, setpoints: Mapping[str, float]) -> Mapping[str, float]:
        self._turn = setpoints.get("turn", self._turn)
        return setpoints


def play(endpoint: str) -> None:
    """Serve the robot, and answer lines of standard input."""
    applied = Applied()
    note_jogging(applied)

    def answer() -> None:
        for _ in sys.stdin:
            print(json.dumps(applied.take()), flush=True)

    threading.Thread(target=answer, daemon=True).start()
    sys.argv = [sys.argv[0], "--connect", endpoint]
    run("robot", Machine(applied))


# -- the client -------------------------------------------------------------------------------------------------------


class Driven(NamedTuple):
    """A stream: what it is called, its action, and the input for a velocity."""

    name: str
    action: str
    input_of: Callable[[float], Any]


UNCHECKED = Driven("the component that applies it", "follower/actions/follow", lambda each: {"velocity": each})
CHECKED = (
    Driven("a base with a placement", "mobile_base/actions/drive", lambda each: {"linear": each}),
    Driven("a jogged joint with a placement", "jogging/actions/jogJoints", lambda each: {"velocities": {"turn": each}}),
)


def rows(seconds: float) -> list[Row]:
    with _served() as (place, agent):
        taken_ms = {UNCHECKED: _drive(place, agent, UNCHECKED, seconds)}
        _put_placement(place)
        taken_ms |= {each: _drive(place, agent, each, seconds) for each in CHECKED}
    raw_ms = wire(f"tcp/127.0.0.1:{free_port()}", 100, seconds).states_ms
    return [row for each, ms in taken_ms.items() for row in _rows(each.name, ms, raw_ms, _count(seconds))]


def _rows(name: str, taken_ms: Sequence[float], raw_ms: Sequence[float], sent: int) -> list[Row]:
    what, beside_ms = f"from a sample ({RATE_HZ:g} Hz) to {name}", percentile(raw_ms, 0.5)
    return [
        at_most(f"{what}, p50", percentile(taken_ms, 0.5), "a frame on Zenoh", beside_ms, MOST_P50_MS),
        bounded(f"{what}, p99", "ms", percentile(taken_ms, 0.99), MOST_P99_MS),
        known("samples of these that were applied", "%", 100 * len(taken_ms) / sent),
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
                eventually(lambda: httpx.get(_url(place, UNCHECKED)).status_code == 200, "the robot")
                yield place, agent
            finally:
                agent.kill()
                agent.communicate()


def _count(seconds: float) -> int:
    return int(max(2.0, seconds) * RATE_HZ)


def _url(place: Place, driven: Driven) -> str:
    return f"{place.root}robot/{driven.action}"


def _rehearses(url: str, driven: Driven) -> bool:
    return httpx.post(url, json=driven.input_of(SPEED), headers={"prefer": "dry-run"}).status_code == 200


def _put_placement(place: Place) -> None:
    url = f"{place.root}robot/placement"
    httpx.put(url, content=PLACEMENT, headers={"content-type": "text/turtle"}).raise_for_status()


class _Stick:
    """A stream that sends back the newest time of the robot."""

    def __init__(self, socket: ClientConnection, driven: Driven) -> None:
        self._socket, self._driven = socket, driven
        self._told: dict[str, Any] = {}
        self.sent_ns = dict[int, int]()
        threading.Thread(target=self._hear, daemon=True).start()
        eventually(lambda: self._told.get("time"), "the time of the robot")

    def _hear(self) -> None:
        for message in self._socket:
            self._told = json.loads(message)

    def send(self, number: int) -> None:
        given = self._driven.input_of(SPEED + number * COUNTED)
        self.sent_ns[number] = time.monotonic_ns()
        self._socket.send(json.dumps({"seen": self._told["time"], "input": given}))

    def follows(self) -> bool:
        """Send a sample. Return True once samples are applied at full speed, which takes the shapes of the robot."""
        self.send(-1)
        return bool(self._told["applied"]) and not self._told["limitedBecause"]


def _drive(place: Place, agent: "subprocess.Popen[str]", driven: Driven, seconds: float) -> list[float]:
    """Send samples at a rate, and return the times that those took which were applied."""
    eventually(lambda: _rehearses(_url(place, driven), driven), "the shapes of the robot")
    with connect(_url(place, driven).replace("http", "ws", 1), subprotocols=["lf.drive"]) as socket:  # type: ignore[list-item]
        stick = _Stick(socket, driven)
        eventually(stick.follows, "the robot that follows")
        due = time.monotonic()
        for number in range(_count(seconds)):
            due += 1 / RATE_HZ
            time.sleep(max(0.0, due - time.monotonic()))
            stick.send(number)
        time.sleep(0.2)
    applied = {int(number): at_ns for number, at_ns in _applied(agent).items()}
    return [(at_ns - stick.sent_ns[number]) / 1e6 for number, at_ns in applied.items() if number >= 0]


def _applied(agent: "subprocess.Popen[str]") -> dict[str, int]:
    assert agent.stdin is not None
    assert agent.stdout is not None
    agent.stdin.write("\n")
    agent.stdin.flush()
    found: dict[str, int] = json.loads(agent.stdout.readline())
    return found


if __name__ == "__main__":
    run_played(__doc__, rows, play)
