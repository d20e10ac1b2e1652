"""The processes of benchmarks with thousands of robots: robots, gateways, Redis, and a probe."""

import contextlib
import http.client
import json
import os
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import httpx
import redis
from prometheus_client.parser import text_string_to_metric_families

from bench.scene import pid_of
from redis_servers import Server
from running import PATIENCE_S, ROOT, free_port, process

_PAUSE_S = 0.1  # so that the gateway is not busy with these requests


@dataclass(frozen=True)
class Size:
    """The size of a run.

    Robots, joints of each, different URDFs, seconds of each measurement, requests of each kind,
    namespaces that share the robots.
    """

    robots: int = 1000
    joints: int = 18
    models: int = 20
    seconds: float = 4.0
    requests: int = 200
    rates_hz: Sequence[float] = (1, 10, 100)
    namespaces: int = 1


class Crowd:
    """The process with the robots: the router at ``endpoint``, or a client of it if ``place`` is given.

    ``place`` is the number of its first robot, and how many namespaces there are. ``within`` goes before its arguments
    of Python, to start it elsewhere.
    """

    def __init__(self, endpoint: str, size: Size, place: Sequence[int] = (), within: Sequence[str] = ()) -> None:
        numbers = map(str, (size.robots, size.joints, size.models, *place))
        command = [sys.executable, *within, "-m", "bench.synthetic", endpoint, *numbers]
        environment = {**os.environ, "PYTHONPATH": str(ROOT)}
        self._child = subprocess.Popen(  # noqa: S603
            command, cwd=ROOT, env=environment, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )
        assert self._child.stdin is not None and self._child.stdout is not None
        self._in, self._out = self._child.stdin, self._child.stdout
        self.epoch_ns: int = json.loads(self._out.readline())["epoch_ns"]

    def ask(self, line: str = "") -> dict[str, Any]:
        self._in.write(line + "\n")
        self._in.flush()
        answer: dict[str, Any] = json.loads(self._out.readline())
        return answer

    def age_ms(self, value: str, now_ns: int) -> float:
        """Return the age of a frame at ``now_ns``; ``value`` is its position of the first joint."""
        return (now_ns - self.epoch_ns) / 1e6 - float(value) * 1e3

    def close(self) -> None:
        self._in.close()
        self._child.wait()
        self._out.close()

    def kill(self) -> None:
        """End the process without a regular shutdown."""
        self._child.kill()
        self.close()


@dataclass
class Gateway:
    """A gateway process with a client."""

    port: int
    pid: int = 0
    http: httpx.Client = field(default_factory=lambda: httpx.Client(timeout=60))

    def get(self, path: str, accept: str = "text/turtle") -> httpx.Response:
        answer = self.http.get(f"http://127.0.0.1:{self.port}{path}", headers={"accept": accept})
        return answer.raise_for_status()

    def numbers(self) -> dict[str, float]:
        """Return the values of /metrics; for metrics labelled by robot, their count."""
        found: dict[str, float] = {}
        for family in text_string_to_metric_families(self.get("/metrics", "*/*").text):
            for sample in family.samples:
                name = sample.name.removeprefix("linked_fleet_")
                bound = sample.labels.get("le")
                if name == "robot_frame_age_seconds":
                    found[name] = found.get(name, 0) + 1
                elif bound is None or not sample.labels.keys() - {"le"}:
                    found[name if bound is None else f"{name} {float(bound)}"] = sample.value
        return found

    def meet(self, robots: int) -> None:
        """Wait until each robot has a description and a value."""
        deadline = time.monotonic() + PATIENCE_S
        while self.numbers().get("robot_frame_age_seconds", 0) < robots:
            assert time.monotonic() < deadline, f"never happened: {robots} robots"
            time.sleep(_PAUSE_S)


@dataclass
class Scene:
    size: Size
    crowd: Crowd
    store: redis.Redis
    gateways: list[Gateway]
    restart: Callable[[], Gateway]
    """End the first gateway, and start another in its place."""
    endpoint: str
    """Endpoint of the router."""

    def redis(self) -> dict[str, Any]:
        found: dict[str, Any] = self.store.info()
        return found


@contextlib.contextmanager
def stage(size: Size, count: int) -> Iterator[Scene]:
    """Run Redis, the router with robots that have not appeared yet, and gateways that are ready."""
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    with contextlib.ExitStack() as stack:
        server = Server(Path(stack.enter_context(tempfile.TemporaryDirectory())))
        stack.callback(server.discard)
        server.start()
        store = stack.enter_context(redis.Redis(port=server.port))
        crowd = stack.enter_context(contextlib.closing(Crowd(endpoint, size)))
        first = stack.enter_context(contextlib.ExitStack())

        def start(where: contextlib.ExitStack) -> Gateway:
            port = free_port()
            shared = ("--zenoh-connect", endpoint, "--redis-url", server.url, "--requests-per-client", "0")
            child = where.enter_context(process("-m", "linked_fleet_gateway", "--port", str(port), *shared))
            one = Gateway(port, pid_of(child))
            where.callback(one.http.close)
            if where is first:
                scene.gateways[:1] = [one]
            child.said("serving")
            return one

        def restart() -> Gateway:
            first.close()
            return start(first)

        scene = Scene(size, crowd, store, [], restart, endpoint)
        start(first)
        scene.gateways += [start(stack) for _ in range(count - 1)]
        yield scene


class Probe:
    """Requests something cheap repeatedly, which shows how long others wait for the event loop."""

    def __init__(self, one: Gateway, pause_s: float = 0.002) -> None:
        self._connection = http.client.HTTPConnection("127.0.0.1", one.port)
        self._pause_s = pause_s
        self._took_ms: list[float] = []
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run)

    def __enter__(self) -> "Probe":
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ended.set()
        self._thread.join()
        self._connection.close()

    @property
    def worst_ms(self) -> float:
        return max(self._took_ms)

    @property
    def p99_ms(self) -> float:
        return sorted(self._took_ms)[len(self._took_ms) * 99 // 100]

    def _run(self) -> None:
        while True:
            begin = time.perf_counter()
            self._connection.request("GET", "/health/live")
            self._connection.getresponse().read()
            self._took_ms.append((time.perf_counter() - begin) * 1e3)
            if self._ended.wait(self._pause_s):
                return
