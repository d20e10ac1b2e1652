"""Memory that subscriptions leave behind in the gateway: one row per thousand."""

import argparse
import asyncio
import contextlib
import time
from collections.abc import Iterator
from typing import NamedTuple

from bench.scene import cpu_s, rss_kib, scene
from bench.table import Row, known
from browser import Browser
from fake_robots import FakeRobot
from small_fleet import live
from tests.fleet.test_subscription_memory import Client, emptied

STEP = 1000
_MOST_MIB = 2.0


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cycles", type=int, default=10_000)
    parser.add_argument("--way", choices=("all", "websocket", "events", "callback"), default="all")
    arguments = parser.parse_args()
    print(f"{'cycles':>8}{'RSS MiB':>10}{'cycles/s':>10}{'CPU ms a cycle':>16}")
    for step in cycles(arguments.cycles // STEP, STEP, arguments.way):
        print(f"{step.done:8}{step.rss_mib:10.1f}{step.rate:10.0f}{step.cpu_ms:16.2f}", flush=True)


def rows(_: float, steps: int = 3, size: int = STEP) -> list[Row]:
    """Return rows without the one-time growth at the first subscriptions."""
    found = list(cycles(steps, size))
    grown = found[-1].rss_mib - found[0].rss_mib
    name = f"memory after {steps * size:,} subscriptions that came and went"
    return [
        Row(f"{name}, more than after {size:,}", "MiB", grown, "", None, "<= 2 MiB", grown <= _MOST_MIB),
        known("CPU of a subscription that comes and goes", "ms", found[-1].cpu_ms),
    ]


class Step(NamedTuple):
    """Figures after so many cycles; rate and processor time of the last ones."""

    done: int
    rss_mib: float
    rate: float
    cpu_ms: float


def cycles(steps: int, size: int, way: str = "all") -> Iterator[Step]:
    with scene("--requests-per-client", "0") as place, contextlib.closing(Browser(place.place.root)) as browser:
        FakeRobot(place.session, "toy").appear().stand(0.25)
        live(browser, "toy")
        client = Client(f"{place.place.root}toy/elbow/rotation")
        for number in range(1, steps + 1):
            begin, cpu = time.monotonic(), cpu_s(place.pid)
            asyncio.run(client.run(size, way))
            cpu, seconds = cpu_s(place.pid) - cpu, time.monotonic() - begin
            emptied(browser, f"{place.place.root}toy/elbow/subscriptions")
            yield Step(number * size, rss_kib(place.pid) / 1024, size / seconds, cpu / size * 1000)


if __name__ == "__main__":
    main()
