"""The process tree of the demo: start, readiness and end.

The demo does not use settings of other fleets in the environment.
"""

import argparse
import ctypes
import http.client
import json
import os
import re
import signal
import socket
import subprocess
import sys
import threading
import time
import urllib.request
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType
from typing import IO

ROBOTS = ("baxter", "ur5", "panda", "tiago", "go2")
SWAYING = "ur5:shoulder_pan_joint"
# Side by side, all facing along x: position of the root link frame in metre; for the go2 that of its odometry frame.
PLACES = {
    "tiago": (0.0, -2.4, 0.0), "baxter": (0.0, 0.0, 0.93), "ur5": (0.0, 2.4, 0.0), "panda": (0.0, 4.0, 0.0),
    "go2": (0.0, -4.0, 0.0),
}  # fmt: skip
HOST = "127.0.0.1"
_READY_TIMEOUT_S = 30.0  # after this the address is printed although robots are missing
GRACE_S = 5.0  # a whole fleet takes little more than a second on an idle machine
POLL_S = 0.1
_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
_ONLINE = re.compile(
    r"^<([^>]+)> <https://w3id\.org/linked-fleet#presence> <https://w3id\.org/linked-fleet#online> \.$", re.M
)
_PLACEMENT = re.compile(r"<https://w3id\.org/linked-fleet#placement> <([^>]+)> \.$", re.M)
_UNKNOWN = "<https://w3id.org/linked-fleet#unknown>"
# Log lines that a demonstration does not need.
_CHATTER = re.compile(r"\S+ \S+ (DEBUG |INFO )")
_PDEATHSIG = 1  # PR_SET_PDEATHSIG of Linux's prctl


class Stopped(BaseException):
    """The user has asked the demo to end; raised in all its waits."""


class Child:
    """A process of the tree. Its output, from warnings upward, is printed line by line with its name."""

    def __init__(self, name: str, arguments: list[str]) -> None:
        self.name = name
        self.told_to_end = False  # from then on only its exit code is reported
        self.process = subprocess.Popen(  # noqa: S603 our own modules, no shell
            [sys.executable, "-m", *arguments],
            env={key: value for key, value in os.environ.items() if not key.startswith(("LINKED_FLEET_", "REDIS_"))},
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            errors="replace",
            preexec_fn=_preparation(),
        )
        assert self.process.stdout is not None
        self._reader = threading.Thread(target=self._pass_on, args=(self.process.stdout,), daemon=True)
        self._reader.start()

    def _pass_on(self, lines: IO[str]) -> None:
        with lines:
            for line in lines:
                if not (self.told_to_end or _CHATTER.match(line)):
                    print_line(f"{self.name:>7} | {line.rstrip()}")

    def end(self) -> None:
        self.told_to_end = True
        self.process.terminate()

    def wait(self, deadline: float) -> bool:
        """Return True if the process has ended and its output is printed before ``deadline``."""
        try:
            self.process.wait(max(0.0, deadline - time.monotonic()))
        except subprocess.TimeoutExpired:
            return False
        self._reader.join(0.2)
        return True


def _preparation() -> Callable[[], None]:
    """Return the function that a child runs before its program. Symbols are looked up here, before the fork."""
    prctl = ctypes.CDLL(None).prctl if sys.platform == "linux" else None
    parent = os.getpid()

    def prepare() -> None:
        # Ctrl-C reaches the whole process group and would end a loading child with a traceback. The demo handles it and
        # sends SIGTERM to its children.
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        for number in (
            signal.SIGTERM,
            signal.SIGHUP,
        ):  # otherwise an inherited handler would run here, before the program
            signal.signal(number, signal.SIG_DFL)
        signal.pthread_sigmask(signal.SIG_UNBLOCK, _SIGNALS)  # blocked by the parent during the start
        if prctl is not None:  # the kernel ends the child when the demo is killed
            prctl(_PDEATHSIG, signal.SIGTERM, 0, 0, 0)
            if os.getppid() != parent:
                os.kill(os.getpid(), signal.SIGTERM)

    return prepare


def print_line(text: str) -> None:
    try:
        print(text, flush=True)
    except OSError:  # the terminal is closed; the fleet runs on until a signal ends it
        sys.stdout = Path(os.devnull).open("w")  # noqa: SIM115


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
            _OPENER.open(request, timeout=2).close()


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


def run(root: str, children: list[Child], zenoh: str, cors_origins: str = "") -> int:
    """Start the tree and watch it until a child ends by itself. Return its exit code."""
    print_line(
        f"Starting the gateway and {len(ROBOTS)} simulated robots: {', '.join(ROBOTS)}. Loading their models ..."
    )
    port = root.rstrip("/").rpartition(":")[2]
    names = [word for robot in ROBOTS for word in ("--robot", robot)]
    namespace = f"demo-{port}"
    # Each demo on a machine is a fleet of its own. Callbacks to this machine are allowed for first experiments.
    of_gateway = ["--host", HOST, "--port", port, "--zenoh-listen", zenoh]
    of_gateway += ["--namespace", namespace, "--callback-allow", "127.0.0.0/8,::1/128"]
    of_gateway += ["--cors-origins", cors_origins]
    of_agents = [*names, "--connect", zenoh, "--namespace", namespace, "--sway", SWAYING]
    for name, module, arguments in (
        ("gateway", "linked_fleet_gateway", of_gateway),
        ("agents", "linked_fleet_agent", of_agents),
    ):
        with _signals_held_back():  # no signal may arrive between a child's start and its registration
            children.append(Child(name, [module, *arguments]))
    deadline: float | None = time.monotonic() + _READY_TIMEOUT_S
    seen: set[str] = set()
    while True:
        for child in children:
            code = child.process.poll()
            if code is not None:
                child.wait(time.monotonic())
                print_line(f"The {child.name} process has ended by itself (exit code {code}); the demo ends too.")
                return code if code >= 0 else 128 - code
        if deadline is not None:
            seen = _greet(root, seen)
            ready = len(seen) == len(ROBOTS) and is_ready(root)
            if ready or time.monotonic() > deadline:
                deadline = None
                print_line(_welcome(root, seen, ready))
        time.sleep(POLL_S)


def _greet(root: str, seen: set[str]) -> set[str]:
    try:
        online = robots_online(root)
        for iri in sorted(online - seen):
            set_placement(iri, PLACES[iri.rstrip("/").rpartition("/")[2]])
    except (OSError, http.client.HTTPException, ValueError):
        return seen
    for iri in sorted(online - seen):
        print_line(f"{iri} is online")
    return seen | online


def _welcome(root: str, seen: set[str], ready: bool) -> str:
    missing = len(ROBOTS) - len(seen)
    late = f"{missing} of {len(ROBOTS)} robots are not online yet" if missing else "motions are still being prepared"
    return f"""
The fleet is at {root}{"" if ready else f"  ({late})"}

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


@contextmanager
def _signals_held_back() -> Iterator[None]:
    signal.pthread_sigmask(signal.SIG_BLOCK, _SIGNALS)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_UNBLOCK, _SIGNALS)


def _ignore_signals() -> None:
    for number in _SIGNALS:
        signal.signal(number, signal.SIG_IGN)


def main() -> int:
    parser = argparse.ArgumentParser(prog="linked-fleet demo", description="Five simulated robots and their gateway.")
    parser.add_argument("--port", type=int, default=8000, help="port of the gateway on loopback")
    parser.add_argument("--cors-origins", default="", help="origins of other sites' pages that may use the fleet")
    arguments = parser.parse_args()
    port = arguments.port
    if not 0 < port < 65536:
        parser.error(f"a port is a number from 1 to 65535, not {port}")
    problem = port_problem(port)
    if problem is not None:
        print(f"demo: {problem}", file=sys.stderr)
        return 1
    children: list[Child] = []
    for number in _SIGNALS:
        signal.signal(number, _stop)
    try:
        return run(f"http://{HOST}:{port}/", children, f"tcp/{HOST}:{free_port()}", arguments.cors_origins)
    except Stopped:
        print_line("\nEnding the demo.")
        return 0
    finally:
        end(children)
