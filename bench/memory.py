"""What subscriptions that come and go leave in the gateway's memory: one row for each thousand of them."""

import argparse
import asyncio
import contextlib
import time

from actor import Actor
from browser import Browser
from small_fleet import live

from bench.scene import cpu_s, rss_kib, scene
from tests.fleet.test_subscription_memory import Client, emptied

STEP = 1000


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cycles", type=int, default=10_000)
    parser.add_argument("--way", choices=("all", "websocket", "events", "callback"), default="all")
    arguments = parser.parse_args()
    with scene() as place, contextlib.closing(Browser(place.place.root)) as browser:
        Actor(place.session, "toy").appear().stand(0.25)
        live(browser, "toy")
        client = Client(f"{place.place.root}toy/elbow/rotation")
        print(f"{'cycles':>8}{'RSS MiB':>10}{'cycles/s':>10}{'CPU ms a cycle':>16}")
        for done in range(STEP, arguments.cycles + 1, STEP):
            begin, cpu = time.monotonic(), cpu_s(place.pid)
            asyncio.run(client.run(STEP, arguments.way))
            cpu, seconds = cpu_s(place.pid) - cpu, time.monotonic() - begin
            emptied(browser, f"{place.place.root}toy/elbow/subscriptions")
            rss = rss_kib(place.pid) / 1024
            print(f"{done:8}{rss:10.1f}{STEP / seconds:10.0f}{cpu / STEP * 1000:16.2f}", flush=True)


if __name__ == "__main__":
    main()
