"""The least there can be, beside which the gateway is measured: each a process of its own, and a few lines of Python.

``python -m bench.references bare PORT SIZE`` is Starlette that answers with constant bytes; ``robot ENDPOINT RATE`` says
states to Zenoh and answers questions there; with the files of authority, certificate and key on a tls or quic link.
"""

import contextlib
import json
import os
import struct
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Any, NamedTuple

import uvicorn
import zenoh
from running import eventually
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import Route

from agents.wire.trust import Credentials

_ROOT = Path(__file__).resolve().parents[1]
STATE, QUESTION = "raw/state", "raw/question"
SENT = struct.Struct("<q")
"""With which a payload begins: when it was sent, CLOCK_MONOTONIC, ns."""
_FRAME = 480
"""Bytes of a state of twenty joints."""
BARE = f"bare Starlette ({'httptools' if find_spec('httptools') else 'h11'})"


class Partner:
    """A child process that says ready when it is, and ends with its input."""

    def __init__(self, *arguments: str) -> None:
        environment = {**os.environ, "PYTHONPATH": f"{_ROOT}:{_ROOT / 'tests'}:{_ROOT / 'tests/requirements'}"}
        self._child = subprocess.Popen(  # noqa: S603
            [sys.executable, "-u", *arguments], cwd=_ROOT, env=environment,
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


class Beat:
    """Does something so many times a second in a thread of its own, from now on."""

    def __init__(self, rate_hz: float, act: Callable[[], None]) -> None:
        self._rate_hz, self._act, self._ended = rate_hz, act, threading.Event()
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def _run(self) -> None:
        begin, number = time.monotonic(), 0
        while not self._ended.wait(max(0.0, begin + number / self._rate_hz - time.monotonic())):
            self._act()
            number += 1

    def close(self) -> None:
        self._ended.set()
        self._thread.join()


def session(mode: str, listen: str = "", connect: str = "", trust: Sequence[str] = ()) -> zenoh.Session:
    """As agents' and gateways' are. ``trust`` are files: the authority, and the certificate and key of this end."""
    config = zenoh.Config()
    values: dict[str, object] = {
        "mode": mode,
        "listen/endpoints": [listen] if listen else [],
        "connect/endpoints": [connect] if connect else [],
        "connect/timeout_ms": -1,
        "connect/retry": {"period_init_ms": 20, "period_max_ms": 200, "period_increase_factor": 1.5},
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
    }
    if trust:
        values |= Credentials(*trust).configuration()
    for key, value in values.items():
        config.insert_json5(key, json.dumps(value))
    return zenoh.open(config)


class Wire(NamedTuple):
    """From the sending of each state to its arrival; from each question to its answer."""

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
    """Zenoh alone from process to process: ``far`` says how Python is run where the robot is."""
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


def fsync_ms(count: int = 50, size: int = 300) -> list[float]:
    """How long it takes until so many bytes more are on the disk on which states are kept."""
    took = []
    with tempfile.TemporaryDirectory() as folder, Path(folder, "log").open("ab", buffering=0) as log:
        for _ in range(count):
            begin = time.perf_counter()
            log.write(bytes(size))
            os.fdatasync(log.fileno())
            took.append((time.perf_counter() - begin) * 1e3)
    return took


# -- the processes ----------------------------------------------------------------------------------------------------


def bare(port: str, size: str) -> None:
    body = b"x" * int(size)

    async def read(_: Request) -> Response:
        return Response(body, media_type="text/turtle")

    async def unchanged(_: Request) -> Response:
        return Response(status_code=304)

    async def take(request: Request) -> Response:
        await request.body()
        return Response(status_code=204)

    app = Starlette(routes=[Route("/", read), Route("/unchanged", unchanged), Route("/", take, methods=["POST"])])
    uvicorn.run(app, port=int(port), loop="uvloop", access_log=False)


def robot(endpoint: str, rate_hz: str, *trust: str) -> None:
    """What an agent says on the wire, as it says it, and an answer to each question."""
    with session("client", connect=endpoint, trust=trust) as there:
        there.declare_queryable(
            QUESTION, zenoh.handlers.Callback(lambda query: query.reply(QUESTION, b"yes"), indirect=False)
        )
        publisher = there.declare_publisher(
            STATE, congestion_control=zenoh.CongestionControl.DROP, priority=zenoh.Priority.DATA, express=False
        )

        def say() -> None:
            publisher.put(SENT.pack(time.monotonic_ns()) + bytes(_FRAME - SENT.size))

        with contextlib.closing(Beat(float(rate_hz), say)):
            print("ready", flush=True)
            sys.stdin.read()


if __name__ == "__main__":
    {"bare": bare, "robot": robot}[sys.argv[1]](*sys.argv[2:])
