"""Faults: what a sensor that flaps a thousand times a second costs a gateway, and what it writes to Redis.

Each flap is two messages of a component, which tell of a protective stop and of its end. They are decoded, looked at
and counted as in a gateway; the records are in a real Valkey server.
"""

import argparse
import asyncio
import os
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any, cast

import msgspec

from bench.table import Row, bounded, known, markdown
from flapping import Flapping
from gateway_fixtures import Bench
from linked_fleet_base.faults import Faults
from linked_fleet_gateway.extensions.faults.fault import Fault
from linked_fleet_gateway.extensions.faults.kinds import policy_of
from linked_fleet_gateway.extensions.faults.ledger import ROUND_S, Ledger
from linked_fleet_gateway.extensions.faults.signals import Signals
from linked_fleet_gateway.extensions.faults.watch import FRAMES_S, Watch
from linked_fleet_runtime.table import StoredRecords, Table
from redis_servers import single

FLAPS_HZ, LASTS_S, TICK_S = 1000, 20.0, 0.01
ROBOTS, ROUNDS = 1000, 5
MOST_SHARE, MOST_STILL = 0.10, 0.02


class _Core:
    """The part of the gateway that the watch of faults asks."""

    def __init__(self, robots: Any) -> None:
        self.robots, self.faults = robots, Faults()


def rows() -> Iterator[Row]:
    with tempfile.TemporaryDirectory() as folder, single(Path(folder)) as memory:
        yield from asyncio.run(_flapping(memory.url))
    yield known("the messages of that alone, share of a core", "", _messages())
    yield bounded(f"looks at {ROBOTS} robots that are well, share of a core", "", _still(), MOST_STILL)


async def _flapping(url: str) -> list[Row]:
    bench = Bench()
    here, signals, writes = Flapping(bench), Signals(policy_of), list[str]()
    watch = Watch(cast(Any, _Core(bench.fleet.robots)), signals, lambda id: None)
    stored = StoredRecords(url, "bench", "faults", "faults")
    table = Table(stored, "faults", msgspec.json.encode, msgspec.json.Decoder(Fault).decode,
                  lambda id, before, after: writes.append(id))  # fmt: skip
    async with table:
        ledger = Ledger(table, signals, lambda: True, lambda trouble: True, 3600, 1000)
        begun_s, spent_s, flaps, round_s = time.monotonic(), time.process_time(), 0, time.monotonic()
        while time.monotonic() - begun_s < LASTS_S:
            while flaps < (time.monotonic() - begun_s) * FLAPS_HZ:
                flaps += 1
                for stopped in (True, False):
                    here.say("mode", protectiveStop=stopped)
                    watch.hear_values("r")
            if time.monotonic() - round_s >= ROUND_S:
                round_s = time.monotonic()
                await ledger.round()
            await asyncio.sleep(TICK_S)
        lasted_s, spent_s = time.monotonic() - begun_s, time.process_time() - spent_s
        (fault,) = table.known.values()
    return [
        bounded(f"{FLAPS_HZ} flaps a second of a sensor, share of a core", "", spent_s / lasted_s, MOST_SHARE),
        bounded("faults of that", "", 1, 1),
        known("its count at the last write, of the flaps", "", fault.count / flaps),
        known("writes a second", "Hz", len(writes) / lasted_s),
    ]


def _messages() -> float:
    """Return the share of a core that making and decoding the messages takes by itself."""
    here = Flapping(Bench())
    spent_s = time.process_time()
    for _ in range(FLAPS_HZ):
        here.say("mode", protectiveStop=True)
        here.say("mode", protectiveStop=False)
    return time.process_time() - spent_s


def _still() -> float:
    """Return the share of a core that looking at robots takes to which nothing happens."""
    bench = Bench()
    for number in range(ROBOTS):
        bench.robot({"pan": ("continuous", "")}, name=f"r{number}")
    watch = Watch(cast(Any, _Core(bench.fleet.robots)), Signals(policy_of), lambda id: None)
    asyncio.run(watch.look())
    per_round_s = _looks(watch, later_s=0.0)
    with_frames_s = _looks(watch, later_s=FRAMES_S)
    return per_round_s / ROUND_S + (with_frames_s - per_round_s) / FRAMES_S


def _looks(watch: Watch, later_s: float) -> float:
    """Return the processor time of a look, ``later_s`` after the one before."""
    spent_s = 0.0
    for _ in range(ROUNDS):
        time.sleep(later_s)
        begun_s = time.process_time()
        asyncio.run(watch.look())
        spent_s += time.process_time() - begun_s
    return spent_s / ROUNDS


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m bench.faults", description=__doc__)
    parser.parse_args()
    print(f"{os.cpu_count()} processors, load {os.getloadavg()[0]:.1f} before")
    print(markdown(list(rows())))


if __name__ == "__main__":
    main()
