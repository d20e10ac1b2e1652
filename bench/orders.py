"""The queue: what a thousand waiting orders and fifty running ones cost a gateway, and how they hold its event loop.

Each running order lasts ten seconds, so that five end and five begin in a second. Half of the orders name their robot,
the other half take any of the fifty. Each robot sends a new position once a second.
"""

import argparse
import contextlib
import os
import signal
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import httpx

from bench.scene import cpu_s, pid_of
from bench.table import Row, bounded, known, markdown
from bench.timed_gateway import SAID
from fake_robots import many_robots, open_session
from running import Process, eventually, process
from small_fleet import Place

WAITING, RUNNING, LASTS_S = 1000, 50, 10
MOST_SHARE, MOST_CALLBACK_MS = 0.5, 5.0
_FLAGS = ("--requests-per-client", "0", "--queue-per-client", "5000", "--queue-most", "5000")


def rows(seconds: float = 30.0, waiting: int = WAITING, running: int = RUNNING) -> Iterator[Row]:
    """Measure on asyncio's event loop."""
    with tempfile.TemporaryDirectory() as folder:
        place = Place(Path(folder))
        with process("-m", "bench.timed_gateway", *place.command()[2:], *_FLAGS) as gateway:
            gateway.said("serving")
            with open_session(place.zenoh) as session, many_robots(session, running), httpx.Client() as http:
                robots = _robots(http, place.root, running)
                idle = _share(gateway, seconds / 3)
                _fill(http, place.root, robots, waiting + 7 * running)
                eventually(lambda: _count(http, place.root, "running") >= running * 0.9, "the first orders run")
                longest_ms(gateway)
                share, held_ms = _share(gateway, seconds), longest_ms(gateway)
                name = f"{_count(http, place.root, 'waiting'):.0f} orders wait, {running} run"
                yield known("the gateway without orders", "cores", idle)
                yield bounded(f"{name}: processor of the gateway", "cores", share, MOST_SHARE)
                yield bounded(f"{name}: longest callback of the event loop", "ms CPU", held_ms, MOST_CALLBACK_MS)
                yield from _readings(gateway, http, place.root)


def _readings(gateway: Process, http: httpx.Client, root: str) -> Iterator[Row]:
    for form in ("text/turtle", "text/html"):
        longest_ms(gateway)
        begun_s = time.perf_counter()
        http.get(root + "queue", headers={"accept": form}, timeout=60).raise_for_status()
        took_ms = (time.perf_counter() - begun_s) * 1e3
        yield known(f"GET of the queue as {form}: longest callback", "ms CPU", longest_ms(gateway))
        yield known(f"GET of the queue as {form}", "ms", took_ms)


def _robots(http: httpx.Client, root: str, count: int) -> list[str]:
    def online() -> int:
        return http.get(root, headers={"accept": "text/turtle"}).text.count("lf:presence lf:online")

    eventually(lambda: online() == count, f"{count} robots")
    return [f"{root}robot-{number:04}/" for number in range(count)]


def _fill(http: httpx.Client, root: str, robots: list[str], orders: int) -> None:
    said = {
        "title": "wait",
        "parameters": [{"name": "robot", "type": "iri"}],
        "step": {"type": "wait", "seconds": LASTS_S},
    }
    mission = http.post(root + "missions", json=said).raise_for_status().headers["location"]
    for number in range(orders):
        robot = robots[number % len(robots)]
        which = {"input": {"robot": robot}} if number % 2 else {"choice": {"parameter": "robot", "robots": robots}}
        http.post(root + "queue", json={"mission": mission, **which}).raise_for_status()


def _count(http: httpx.Client, root: str, state: str) -> float:
    begin = f'linked_fleet_orders{{state="{state}"}} '
    lines = http.get(root + "metrics").text.splitlines()
    return sum(float(line.removeprefix(begin)) for line in lines if line.startswith(begin))


def _share(gateway: Process, seconds: float) -> float:
    """Return the share of a processor that the gateway takes."""
    spent_s, begun_s = cpu_s(pid_of(gateway)), time.monotonic()
    time.sleep(seconds)
    return (cpu_s(pid_of(gateway)) - spent_s) / (time.monotonic() - begun_s)


def longest_ms(gateway: Process) -> float:
    """Return the longest callback since the last call."""
    said = gateway.output.count(SAID)
    os.kill(pid_of(gateway), signal.SIGUSR1)
    eventually(lambda: gateway.output.count(SAID) > said and gateway.output.endswith("\n"), "the longest callback")
    return float(gateway.output.rpartition(SAID)[2].split()[0])


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m bench.orders", description=__doc__)
    parser.add_argument("--seconds", type=float, default=30.0)
    arguments = parser.parse_args()
    print(f"{os.cpu_count()} processors, load {os.getloadavg()[0]:.1f} before")
    with contextlib.suppress(KeyboardInterrupt):
        print(markdown(list(rows(arguments.seconds))))


if __name__ == "__main__":
    main()
