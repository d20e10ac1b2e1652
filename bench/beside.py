"""References measured in the same run as the gateway: Zenoh between processes, plain Starlette, the disk."""

import contextlib
import json
import os
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple
from urllib.parse import unquote

import zenoh

from bench.references import QUESTION, SENT, STATE, session
from bench.scene import pid_of
from linked_fleet_valkey.server import EmbeddedRedis
from running import ROOT, eventually, free_port, process

BARE = "bare Starlette (httptools)"


class Constant(NamedTuple):
    """A constant response; its body has so many bytes."""

    status: int
    fields: Mapping[str, str]
    size: int


@contextlib.contextmanager
def bare(size: int, answers: Mapping[str, Constant] | None = None) -> Iterator[tuple[str, int]]:
    """Run plain Starlette; yield a URL (GET returns ``size`` bytes, POST is accepted) and the process id.

    ``answers``: further constant responses by path.
    """
    port = free_port()
    with process("-m", "bench.references", "bare", str(port), str(size), json.dumps(answers or {})) as child:
        child.said("running on")
        yield f"http://127.0.0.1:{port}/", pid_of(child)


class Partner:
    """A child process that prints "ready", and ends when its input ends."""

    def __init__(self, *arguments: str) -> None:
        environment = {**os.environ, "PYTHONPATH": f"{ROOT}:{ROOT / 'tests'}:{ROOT / 'tests/support'}"}
        self._child = subprocess.Popen(  # noqa: S603
            [sys.executable, "-u", *arguments], cwd=ROOT, env=environment,
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
        )  # fmt: skip
        assert self._child.stdin is not None and self._child.stdout is not None
        self._in, self._out = self._child.stdin, self._child.stdout
        said = self._out.readline()
        assert said == "ready\n", f"{arguments} said {said!r}"

    def close(self) -> None:
        self._in.close()
        self._child.wait()
        self._out.close()


class Wire(NamedTuple):
    """Latencies: from sending a state to its arrival, and from a question to its answer."""

    states_ms: list[float]
    answers_ms: list[float]


def wire(
    endpoint: str,
    rate_hz: float,
    seconds: float,
    far: Callable[..., Sequence[str]] = lambda *words: words,
    here: Sequence[str] = (),
    there: Sequence[str] = (),
) -> Wire:
    """Measure plain Zenoh between processes; ``far`` wraps the command line of Python on the robot's side."""
    states, answers = list[float](), list[float]()

    def take(sample: zenoh.Sample) -> None:
        states.append((time.monotonic_ns() - SENT.unpack_from(sample.payload.to_bytes())[0]) / 1e6)

    with session("router", listen=endpoint, trust=here) as near:
        near.declare_subscriber(STATE, zenoh.handlers.Callback(take, indirect=False))
        command = far("-m", "bench.references", "robot", endpoint, str(rate_hz), *there)
        with contextlib.closing(Partner(*command)):
            eventually(lambda: states and list(near.get(QUESTION)), "a state and an answer")
            states.clear()
            time.sleep(seconds)
            found = states[:]
            end = time.monotonic() + seconds
            while time.monotonic() < end:
                begin = time.perf_counter()
                assert len(list(near.get(QUESTION, payload=bytes(200)))) == 1
                answers.append((time.perf_counter() - begin) * 1e3)
    return Wire(found, answers)


def stored_ms(state: Path, seconds: float, size: int = 600) -> list[float]:
    """Return the times in ms of writes by the embedded server of a gateway, each on its disk when it is answered."""
    words = (b"SET", b"bench", bytes(size))
    asked = b"*%d\r\n" % len(words) + b"".join(b"$%d\r\n%b\r\n" % (len(word), word) for word in words)
    took, end = list[float](), time.monotonic() + seconds
    with socket.socket(socket.AF_UNIX) as connection:
        connection.connect(unquote(EmbeddedRedis(state).url.removeprefix("unix://")))
        while time.monotonic() < end:
            begin = time.perf_counter()
            connection.sendall(asked)
            assert connection.recv(1 << 10) == b"+OK\r\n"
            took.append((time.perf_counter() - begin) * 1e3)
        connection.sendall(b"DEL bench\r\n")
        assert connection.recv(1 << 10) == b":1\r\n"
    return took
