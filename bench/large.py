"""The root of a thousand robots: how long its description holds the event loop, its size and its time."""

import contextlib
import os
import signal
import tempfile
import time
from pathlib import Path
from statistics import median

from bench.scene import cpu_s, pid_of
from bench.table import Row, bounded, known
from bench.timed_gateway import SAID
from bench.varied import Client
from fake_robots import many_robots, open_session
from running import Process, eventually, process
from small_fleet import Place

ROBOTS, REQUESTS = 1000, 20
MOST_MS = 5.0
_FORMS = {"Turtle": "text/turtle", "HTML": "text/html"}


def rows(seconds: float, robots: int = ROBOTS, requests: int = REQUESTS) -> list[Row]:
    """Measure on asyncio's event loop, while each robot sends a new position once a second."""
    with tempfile.TemporaryDirectory() as folder:
        place = Place(Path(folder))
        arguments = place.command()[2:]
        with process("-m", "bench.timed_gateway", *arguments, "--requests-per-client", "0") as gateway:
            gateway.said("serving")
            return _measure(gateway, place, seconds, robots, requests)


def _measure(gateway: Process, place: Place, seconds: float, robots: int, requests: int) -> list[Row]:
    with open_session(place.zenoh) as session, many_robots(session, robots):
        eventually(lambda: _listed(place.root) == robots, f"{robots} robots")
        _longest_ms(gateway)
        spent_s = cpu_s(pid_of(gateway))
        time.sleep(seconds)
        idle = (cpu_s(pid_of(gateway)) - spent_s) / seconds
        found = [known(f"{robots:,} robots, no requests: longest callback", "ms CPU", _longest_ms(gateway))]
        for form, media_type in _FORMS.items():
            found += _form(gateway, place.root, f"root of {robots:,} robots, {form}", media_type, requests, idle)
    return found


def _form(gateway: Process, root: str, name: str, media_type: str, requests: int, idle: float) -> list[Row]:
    """Request the root by distinct clients, one after the other; ``idle``: share of a processor without requests."""
    _longest_ms(gateway)
    took, longest, size = list[float](), list[float](), 0
    cpu, begin = cpu_s(pid_of(gateway)), time.monotonic()
    for seed in range(requests):
        with contextlib.closing(Client(root, seed, accepted=(media_type,))) as client:
            asked = time.perf_counter()
            status, content = client.ask("GET", "/")
            took.append((time.perf_counter() - asked) * 1e3)
            assert status == 200
            size = len(content)
        longest.append(_longest_ms(gateway))
    spent = cpu_s(pid_of(gateway)) - cpu - idle * (time.monotonic() - begin)
    return [
        bounded(f"{name}: longest callback of the event loop", "ms CPU", max(longest), MOST_MS),
        known(f"{name}: longest callback while one is answered, p50", "ms CPU", median(longest)),
        known(f"{name}: size as sent to a client that takes gzip", "kB", size / 1e3),
        known(f"{name}: p50", "ms", median(took)),
        known(f"{name}: processor of the gateway", "ms CPU", max(0.0, spent) * 1e3 / requests),
    ]


def _listed(root: str) -> int:
    with contextlib.closing(Client(root, accepted=("text/html",), encodings="identity")) as client:
        return client.ask("GET", "/")[1].count(b'<li class="card robot"')


def _longest_ms(gateway: Process) -> float:
    """Return the longest callback since the last call."""
    said = gateway.output.count(SAID)
    os.kill(pid_of(gateway), signal.SIGUSR1)
    eventually(lambda: gateway.output.count(SAID) > said and gateway.output.endswith("\n"), "the longest callback")
    return float(gateway.output.rpartition(SAID)[2].split()[0])
