"""The process tree of the demo: start, readiness and end.

The demo does not use settings of other fleets in the environment.
"""

import argparse
import http.client
import json
import re
import shlex
import signal
import socket
import sys
import time
import urllib.request
from dataclasses import dataclass, field
from pathlib import Path
from types import FrameType

from linked_fleet_demo.child import SIGNALS, Child, print_line, signals_held_back
from linked_fleet_demo.state import own_folder

ROBOTS = ("baxter", "ur5", "panda", "tiago", "go2", "pmb2")
SWAYING = "ur5:shoulder_pan_joint"
_CONTACTS = "contacts"
# Side by side, all facing along x; the transport base in front, out of reach of all arms. Positions of the root link
# frame in metre; for the go2 that of its odometry frame.
PLACES = {
    "tiago": (0.0, -2.4, 0.0), "baxter": (0.0, 0.0, 0.93), "ur5": (0.0, 2.4, 0.0), "panda": (0.0, 4.0, 0.0),
    "go2": (0.0, -4.0, 0.0), "pmb2": (2.0, -1.2, 0.0),
}  # fmt: skip
HOST = "127.0.0.1"
_READY_TIMEOUT_S = 30.0  # after this the address is printed although robots are missing
GRACE_S = 5.0  # a whole fleet takes little more than a second on an idle machine
POLL_S = 0.1
MOST_RESTARTS = 5  # of a gateway that somebody kills
_LATER_S = 0.5  # period of looks after the robots once the address is printed
_ONLINE = re.compile(
    r"^<([^>]+)> <https://w3id\.org/linked-fleet#presence> <https://w3id\.org/linked-fleet#online> \.$", re.M
)
_PLACEMENT_S = 35.0  # the answer waits for the check of motions, which starts within 30 s
_PLACEMENT = re.compile(r"<https://w3id\.org/linked-fleet#placement> <([^>]+)> \.$", re.M)
_UNKNOWN = "<https://w3id.org/linked-fleet#unknown>"


class Stopped(BaseException):
    """The user has asked the demo to end; raised in all its waits."""


def port_problem(port: int) -> str | None:
    """Return None if the demo can serve on ``port``, else one line with the reason."""
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((HOST, port))
            probe.listen()
        except OSError as error:
            return (
                f"cannot serve on {HOST}:{port}: {error.strerror}; use another port: --port 8123, or make "
                "demo PORT=8123"
            )
    return None


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind((HOST, 0))
        return int(probe.getsockname()[1])


def robots_online(root: str) -> set[str]:
    """Return the IRIs of robots that the fleet's root says are online. Raises OSError if it does not answer."""
    return set(_ONLINE.findall(_get(root)))


def set_placement(robot: str, where: tuple[float, float, float]) -> None:
    """Set the placement of a robot in the world, unless an earlier demo has set it. Raises OSError."""
    x, y, z = where
    body = f"""@prefix lf: <https://w3id.org/linked-fleet#> . @prefix unit: <http://qudt.org/vocab/unit/> .
@prefix maths: <http://vocab.arvida.de/2015/06/maths/vocab#> .
@prefix vom: <http://vocab.arvida.de/2015/06/vom/vocab#> .
<> lf:position [ maths:x {x} ; maths:y {y} ; maths:z {z} ; vom:unit unit:M ] ."""
    for placement in _PLACEMENT.findall(_get(robot)):
        if _UNKNOWN in _get(placement):
            headers = {"Content-Type": "text/turtle"}
            request = urllib.request.Request(placement, body.encode(), headers, method="PUT")  # noqa: S310
            _OPENER.open(request, timeout=_PLACEMENT_S).close()


def is_ready(root: str) -> bool:
    """Return True if the gateway is ready and its collision checks of all robots are prepared."""
    try:
        answer = json.loads(_get(root + "health/ready"))
    except (OSError, http.client.HTTPException, ValueError):
        return False
    return not any("prepared" in warning for warning in answer.get("warnings", ()))


def _get(iri: str) -> str:
    request = urllib.request.Request(iri, headers={"Accept": "application/n-triples"})  # noqa: S310 (http alone)
    with _OPENER.open(request, timeout=2) as answer:
        text: str = answer.read().decode()
        return text


_OPENER = urllib.request.build_opener(urllib.request.ProxyHandler({}))  # no proxy for loopback


@dataclass
class Demo:
    """The processes of a demo: a gateway, an agent for each robot, and one that stops robots which touch something.

    Each demo on a machine is a fleet of its own.
    """

    port: int
    zenoh: str
    state: Path
    redis_url: str = ""
    cors_origins: str = ""
    children: list[Child] = field(default_factory=list)
    online: set[str] = field(default_factory=set)
    placed: set[str] = field(default_factory=set)
    restarts: int = 0

    @property
    def root(self) -> str:
        return f"http://{HOST}:{self.port}/"

    @property
    def fleet(self) -> list[str]:
        return ["--namespace", f"demo-{self.port}"]

    def run(self) -> int:
        """Start the tree and watch it until the gateway or all agents have ended. Return an exit code."""
        print_line(
            f"Starting the gateway and {len(ROBOTS)} simulated robots: {', '.join(ROBOTS)}. Loading their models ..."
        )
        self._start_gateway()
        for robot in ROBOTS:
            self._start_agent(robot)
        self._start(
            _CONTACTS,
            "linked_fleet_demo.contacts",
            ["--url", self.root, "--connect", self.zenoh, *self.fleet, *ROBOTS],
            {},
        )
        deadline: float | None = time.monotonic() + _READY_TIMEOUT_S
        while True:
            code = self._ended()
            if code is not None:
                return code
            ready = (len(self.placed) < len(ROBOTS) or deadline is not None) and self._is_ready()
            if deadline is not None and (ready or time.monotonic() > deadline):
                deadline = None
                print_line(_welcome(self.root, self._lack()))
            time.sleep(POLL_S if deadline is not None else _LATER_S)

    def _start_gateway(self) -> None:
        # Callbacks to this machine are allowed for first experiments.
        listening = ["--host", HOST, "--port", str(self.port), "--zenoh-listen", self.zenoh]
        allowed = ["--callback-allow", "127.0.0.0/8,::1/128", "--cors-origins", self.cors_origins]
        environment = {"REDIS_URL": self.redis_url} if self.redis_url else {}
        arguments = [*listening, *self.fleet, *allowed, "--state-dir", str(self.state)]
        self._start("gateway", "linked_fleet_gateway", arguments, environment)

    def _start_agent(self, robot: str) -> None:
        swaying = ["--sway", SWAYING] if SWAYING.startswith(f"{robot}:") else []
        self._start(robot, "linked_fleet_agent", ["--robot", robot, "--connect", self.zenoh, *self.fleet, *swaying], {})

    def _start(self, name: str, module: str, arguments: list[str], environment: dict[str, str]) -> None:
        with signals_held_back():  # no signal may arrive between a child's start and its registration
            self.children.append(Child(name, module, arguments, environment))

    def _ended(self) -> int | None:
        """Report children that have ended by themselves. Return an exit code if the demo ends with them."""
        for child in list(self.children):
            code = child.process.poll()
            if code is None:
                continue
            child.wait(time.monotonic())
            self.children.remove(child)
            if child.name == "gateway" and code < 0 and self.restarts < MOST_RESTARTS:
                self.restarts += 1
                print_line(f"The gateway process was ended by signal {-code} and is started again; robots go on.")
                self._start_gateway()
                continue
            goes_on = child.name != "gateway" and any(each.name in ROBOTS for each in self.children)
            print_line(_farewell(child, code, goes_on))
            if not goes_on:
                return code if code >= 0 else 128 - code
        return None

    def _is_ready(self) -> bool:
        """Welcome and place the robots that have come. Return True if all are there and motions are prepared."""
        try:
            for iri in sorted(robots_online(self.root) - self.online):
                self.online.add(iri)
                print_line(f"{iri} is online")
            for iri in sorted(self.online - self.placed):
                set_placement(iri, PLACES[iri.rstrip("/").rpartition("/")[2]])
                self.placed.add(iri)
        except (OSError, http.client.HTTPException, ValueError):
            return False
        return len(self.placed) == len(ROBOTS) and is_ready(self.root)

    def _lack(self) -> str:
        """Return what the fleet still lacks, empty if nothing."""
        missing, lost = len(ROBOTS) - len(self.online), len(self.online - self.placed)
        if missing:
            return f"{missing} of {len(ROBOTS)} robots are not online yet"
        if lost:
            return f"{lost} of {len(ROBOTS)} robots could not be placed in the world"
        return "" if is_ready(self.root) else "motions are still being prepared"


def _farewell(child: Child, code: int, goes_on: bool) -> str:
    ended = f"The {child.name} process has ended by itself (exit code {code})"
    if not goes_on:
        return f"{ended}; the demo ends too."
    if child.name == _CONTACTS:
        return f"{ended}; simulated robots go through what they touch."
    return f"{ended}; the fleet shows the robot as offline. To start its agent again:\n  {shlex.join(child.command)}"


def _welcome(root: str, lack: str) -> str:
    return f"""
The fleet is at {root}{f"  ({lack})" if lack else ""}

Read it, or open the address in a browser:
  curl {root}
Watch a joint that moves:
  curl {root}ur5/shoulder_pan_joint/rotation
Follow its changes as server-sent events (until Ctrl-C):
  curl -N -H 'Accept: text/event-stream' {root}ur5/shoulder_pan_joint/rotation
Turn another joint to 20 degrees; Location in the response is the invocation:
  curl -i -H 'Content-Type: text/turtle' {root}baxter/right_s1/actions/rotate --data '
    @prefix maths: <http://vocab.arvida.de/2015/06/maths/vocab#> .
    @prefix vom: <http://vocab.arvida.de/2015/06/vom/vocab#> .
    [] a maths:Scalar ; vom:numericalValue 20 ; vom:unit maths:Degree .'

Ctrl-C ends the demo.
"""


def end(children: list[Child]) -> None:
    _ignore_signals()
    running = [child for child in children if child.process.poll() is None]
    for child in running:
        child.end()
    deadline = time.monotonic() + GRACE_S
    for child in running:
        if child.wait(deadline):
            if child.process.returncode not in (0, -signal.SIGTERM):
                print_line(f"The {child.name} process ended with exit code {child.process.returncode}.")
        else:
            print_line(f"The {child.name} process did not end in time and is killed.")
            child.process.kill()
            child.process.wait()


def _stop(_signal: int, _frame: FrameType | None) -> None:
    _ignore_signals()
    raise Stopped


def _ignore_signals() -> None:
    for number in SIGNALS:
        signal.signal(number, signal.SIG_IGN)


def main() -> int:
    parser = argparse.ArgumentParser(prog="linked-fleet demo", description="Six simulated robots and their gateway.")
    parser.add_argument("--port", type=int, default=8000, help="port of the gateway on loopback")
    parser.add_argument(
        "--redis-url",
        default="",
        help="Redis that keeps rules and objects; empty: kept until the demo ends",
    )
    parser.add_argument("--cors-origins", default="", help="origins of other sites' pages that may use the fleet")
    arguments = parser.parse_args()
    port = arguments.port
    if not 0 < port < 65536:
        parser.error(f"a port is a number from 1 to 65535, not {port}")
    problem = port_problem(port)
    if problem is not None:
        print(f"demo: {problem}", file=sys.stderr)
        return 1
    for number in SIGNALS:
        signal.signal(number, _stop)
    try:
        with own_folder() as state:
            return _run(Demo(port, f"tcp/{HOST}:{free_port()}", state, arguments.redis_url, arguments.cors_origins))
    except Stopped:
        print_line("\nEnding the demo.")
        return 0


def _run(demo: Demo) -> int:
    try:
        return demo.run()
    finally:
        end(demo.children)
