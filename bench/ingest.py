"""The cost of frames that nobody watches, and the age of values read meanwhile.

The reference is a bare Zenoh session that stores the same frames in a dictionary.
"""

import argparse
import contextlib
import os
import re
import subprocess
import sys
import time
from collections.abc import Iterator
from typing import NamedTuple

import zenoh

from bench.crowd import Gateway, Probe, Scene, Size, stage
from bench.references import session_of_gateway
from bench.scene import cpu_s
from bench.synthetic import KEYS, name_of
from bench.table import Row

SIZE = Size(robots=1000, joints=18, models=20, rates_hz=(100,))
"""A frame of 18 joints has 472 bytes."""
_VALUE = re.compile('numericalValue "([^"]+)"')
MOST_US, AGE_MS = 6.0, 20.0
_SILENCE_S = 0.3


def rows(seconds: float, size: Size = SIZE) -> list[Row]:
    """Processor times are those of whole processes, so that other load of the machine matters little."""
    with stage(size, 1) as scene:
        one, (rate_hz,) = scene.gateways[0], size.rates_hz
        scene.crowd.ask(f"rate {rate_hz:g}")
        scene.crowd.ask("appear")
        one.meet(size.robots)
        with contextlib.closing(Bare(scene)) as bare:
            bare.heard()
            time.sleep(1.0)
            each, beside, sent, dropped = _paid(scene, one, seconds, bare)
            lost = _lost(scene, one, rate_hz, seconds, bare)
        with Probe(one, pause_s=0.02) as probe:
            time.sleep(seconds)
        ages = sorted(_ages_ms(scene, seconds))
    oldest = ages[len(ages) * 99 // 100]
    name = f"{size.robots} robots at {rate_hz:g} Hz: "
    return [
        Row(name + "frames sent", "1/s", sent / seconds, "", None, "", None),
        Row(name + "processor of the gateway for a frame", "µs", each, f"a callback into a dictionary: {beside:.2f} µs",
            each / beside, f"<= {MOST_US:g} µs: 0.6 of a core for 100,000/s", each <= MOST_US),
        Row(name + "frames that did not arrive", "%", lost.here, "", None, "none", lost.here == 0),
        Row(name + "frames that did not arrive at a bare callback", "%", lost.beside, "", None, "", None),
        Row(name + "frames late or of no run", "1/s", dropped / seconds, "", None, "none", dropped == 0),
        Row(name + "answer to /health/live, p99", "ms", probe.p99_ms, "", None, "", None),
        Row(name + "age of a value over HTTP, p99", "ms", oldest, f"the period: {1000 / rate_hz:g} ms",
            oldest * rate_hz / 1000, f"<= {AGE_MS:g} ms", oldest <= AGE_MS),
    ]  # fmt: skip


def _paid(scene: Scene, one: Gateway, seconds: float, bare: "Bare") -> tuple[float, float, int, float]:
    """Return microseconds per received frame of the gateway and of the bare session; frames sent and dropped."""
    scene.crowd.ask()
    heard, before, cpu = bare.heard(), one.numbers(), (cpu_s(one.pid), cpu_s(bare.pid))
    time.sleep(seconds)
    used_s, beside_s = (cpu_s(pid) - spent for pid, spent in zip((one.pid, bare.pid), cpu, strict=True))
    sent, after = scene.crowd.ask()["frames"], one.numbers()
    taken, dropped = (after[name] - before[name] for name in ("frames_taken_total", "frames_dropped_total"))
    return used_s / taken * 1e6, beside_s / (bare.heard() - heard) * 1e6, sent, dropped


class Lost(NamedTuple):
    """Percentage of sent frames that did not reach the gateway, and the bare session."""

    here: float
    beside: float


def _lost(scene: Scene, one: Gateway, rate_hz: float, seconds: float, bare: "Bare") -> Lost:
    """Measure between two silences, so that no frame is in transit; late frames count as received."""
    scene.crowd.ask("rate 0")
    before, heard = _silent(one), bare.heard()
    scene.crowd.ask()
    scene.crowd.ask(f"rate {rate_hz:g}")
    time.sleep(seconds)
    sent = scene.crowd.ask("rate 0")["frames"]
    came, heard = _silent(one) - before, bare.heard() - heard
    sent += scene.crowd.ask()["frames"]
    scene.crowd.ask(f"rate {rate_hz:g}")
    return Lost((1 - came / sent) * 100, (1 - heard / sent) * 100)


def _silent(one: Gateway) -> int:
    """Return the number of received frames, once no more arrive."""
    come = -1
    while (now := sum(round(one.numbers()[f"frames_{what}_total"]) for what in ("taken", "dropped"))) != come:
        come = now
        time.sleep(_SILENCE_S)
    return come


def _ages_ms(scene: Scene, seconds: float) -> Iterator[float]:
    """Yield the ages of values when they have been read, robot after robot."""
    one, end, number = scene.gateways[0], time.monotonic() + seconds, 0
    while time.monotonic() < end:
        number += 1
        said = _VALUE.search(one.get(f"/{name_of(number * 7 % scene.size.robots)}/joint_0/rotation").text)
        assert said is not None
        yield scene.crowd.age_ms(said[1], time.monotonic_ns())


class Bare:
    """Another process that receives the same frames."""

    def __init__(self, scene: Scene) -> None:
        command = [sys.executable, "-m", "bench.ingest", "--bare", scene.endpoint, "--robots", str(scene.size.robots)]
        around = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
        self._child = subprocess.Popen(  # noqa: S603
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=around
        )
        assert self._child.stdin is not None and self._child.stdout is not None
        self._in, self._out = self._child.stdin, self._child.stdout
        self.pid = self._child.pid

    def heard(self) -> int:
        """Return the frames so far; every robot has sent some."""
        self._in.write("\n")
        self._in.flush()
        return int(self._out.readline())

    def close(self) -> None:
        self._in.close()
        self._child.wait()
        self._out.close()


def hear(endpoint: str, robots: int) -> None:
    """Store the latest frame of each robot in a dictionary, until standard input ends."""
    latest, heard = dict[str, bytes](), 0

    def put(sample: zenoh.Sample) -> None:
        nonlocal heard
        heard += 1
        latest[str(sample.key_expr)] = sample.payload.to_bytes()

    with session_of_gateway(endpoint) as session:
        kept = [session.declare_keyexpr(KEYS.robot(name_of(number), "state")) for number in range(robots)]
        kept.append(session.declare_subscriber(KEYS.all_states, put))
        deadline = time.monotonic() + 20
        while len(latest) < robots and time.monotonic() < deadline:
            time.sleep(0.05)
        for _ in sys.stdin:
            print(heard, flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=4.0, help="of each measurement")
    parser.add_argument("--robots", type=int, default=SIZE.robots)
    parser.add_argument("--bare", metavar="ENDPOINT", help=argparse.SUPPRESS)
    asked = parser.parse_args()
    if asked.bare:
        hear(asked.bare, asked.robots)
        return
    print(f"{os.cpu_count()} processors, load {os.getloadavg()[0]:.1f} before")
    for row in rows(asked.seconds, Size(asked.robots, 18, 20, rates_hz=(100,))):
        print(row)


if __name__ == "__main__":
    main()
