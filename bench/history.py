"""Measures the history on disk: bytes a day, and the time of its writer, for fleets at their rates.

Robots move all the time, each value with noise, which is the most that a robot can cost. The frames of one simulated
hour are written in batches of a second, as a gateway does.
"""

import math
import random
import tempfile
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from bench.table import Row, bounded, known
from linked_fleet_agent.wire.codec import encode_state
from linked_fleet_agent.wire.messages import State
from linked_fleet_gateway.extensions.history.archive import Archive
from linked_fleet_gateway.extensions.history.segment import Layout
from linked_fleet_gateway.extensions.history.shelf import size_of

FLEETS = {"5 robots": (6, 7, 2, 6, 12), "100 robots": (6,) * 100}
"""Joints of each robot."""
RATE_HZ, DISK_HZ = 10, 2.0
S = 10**9
MOST_GB, MOST_CORES = 4.0, 0.05
"""The default bound of the history on disk; of a processor."""


def frame(stamp_ns: int, joints: int, second: float, noise: random.Random) -> bytes:
    def row(scale: float) -> tuple[float, ...]:
        return tuple(scale * math.sin(second * (0.3 + 0.1 * n)) + noise.gauss(0, 1e-5 * scale) for n in range(joints))

    return encode_state(
        State(
            incarnation=1, sequence=stamp_ns // S, monotonic_ns=stamp_ns, wall_ns=stamp_ns, positions=row(1),
            velocities=row(0.5), efforts=row(20),
        )
    )  # fmt: skip


class Measured(NamedTuple):
    """Bytes and the processor of the writer in a day; the time to read a minute, and an instant, of a robot."""

    day_gb: float
    processor: float
    minute_ms: float
    instant_ms: float


def measured(joints: Sequence[int], minutes: int) -> Measured:
    noise, now_ns = random.Random(1), 1_800_000_000 * S  # noqa: S311
    begin_ns = now_ns
    with tempfile.TemporaryDirectory() as folder:
        archive = Archive(Path(folder), 86_400.0, 10**11, DISK_HZ, now_ns=lambda: now_ns)
        for number, count in enumerate(joints):
            archive.begin(Layout(f"r{number}", tuple(f"j{n}" for n in range(count)), False, "<robot/>" * 1000))
        spent_s = 0.0
        for second in range(60 * minutes):
            for part in range(RATE_HZ):
                stamp_ns = now_ns + part * S // RATE_HZ
                for number, count in enumerate(joints):
                    archive.add(f"r{number}", frame(stamp_ns, count, second + part / RATE_HZ, noise))
            now_ns += S
            batch, begun_s = archive._take(), time.thread_time()
            archive.write(batch, float(second))
            spent_s += time.thread_time() - begun_s
        archive.close()
        size = sum(size_of(each) for each in Path(folder).glob("*.sqlite"))
        begun_s = time.perf_counter()
        archive.shelf.read("r3", begin_ns, begin_ns + 60 * S, 10**4)
        minute_s, begun_s = time.perf_counter() - begun_s, time.perf_counter()
        archive.shelf.at("r3", begin_ns + 30 * S)
        instant_s = time.perf_counter() - begun_s
    return Measured(size / minutes * 1440 / 1e9, spent_s / (60 * minutes), 1e3 * minute_s, 1e3 * instant_s)


def rows(seconds: float = 0.0, minutes: int = 10, fleets: Mapping[str, Sequence[int]] = FLEETS) -> list[Row]:
    """Return the figures; ``seconds`` is ignored, since the time is simulated."""
    found = list[Row]()
    for name, joints in fleets.items():
        known_of = measured(joints, minutes)
        found += [
            bounded(f"history on disk, {name} that always move, in a day", "GB", known_of.day_gb, MOST_GB),
            bounded(f"its writer, {name}", "cores", known_of.processor, MOST_CORES),
            known(f"a minute of a robot read from disk, {name}", "ms", known_of.minute_ms),
            known(f"an instant of a robot read from disk, {name}", "ms", known_of.instant_ms),
        ]
    return found


def main() -> None:
    for row in rows():
        print(f"{row.name}: {row.value:.3g} {row.unit} {row.goal}")


if __name__ == "__main__":
    main()
