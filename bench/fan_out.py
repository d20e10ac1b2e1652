"""Cost and latency of the fan-out, beside the least that is possible.

A robot moves one joint to the number of each frame, so that a message (1.3 kB of Turtle) tells when its frame was sent.
One process has all subscribers (bench/readers.py). Below each row are servers that send ready bytes of that size
(bench/limits.py): "bare uvloop" writes one framed buffer to every transport, "bare Starlette" awaits send_text for each
WebSocket. In the row of 500 values each subscriber has its own joint of 50 robots at 50 Hz. The last two rows are five
robots at 100 Hz without subscribers and with one.

  frames/s          sent; each is a change
  messages/s, MB/s  received by all subscribers
  CPU %, us/message processor of the gateway
  readers %         processor of the subscribers; near 100 they are the bottleneck
  p50 ms, p99 ms    from frame to message, at 20 subscribers
  of frames         share of messages that were not replaced by newer values; below a row, the gateway's share of the
                    messages per CPU second of that server
"""

import argparse
import contextlib
import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from bench import crowd
from bench.crowd import Size
from bench.scene import Mover, Readers, Scene, browsing, cpu_s, scene
from bench.synthetic import name_of
from bench.table import Row, at_least, at_most, known, percentile
from running import process
from small_fleet import live

_LIMITS = Path(__file__).with_name("limits.py")
_UNIT = "1/CPU s"
_SHARE = 0.7
_LATE_MS = 5.0
_RENDERED = 25_000
HEAD = (
    "subscribers",
    "frames/s",
    "messages/s",
    "MB/s",
    "CPU %",
    "us/message",
    "readers %",
    "p50 ms",
    "p99 ms",
    "of frames",
)


class Case(NamedTuple):
    """A number of subscribers of one value, and how often it changes."""

    how: str
    count: int
    rate_hz: float
    goal: bool = False

    @property
    def name(self) -> str:
        what = {"ws": "WebSocket", "sse": "event stream"}[self.how]
        return f"{self.count} {what}{'s' * (self.count > 1)}, {self.rate_hz:g} Hz"


CASES = (
    Case("ws", 1, 100),
    Case("ws", 500, 100),
    Case("ws", 500, 200, goal=True),
    Case("ws", 100, 500),
    Case("ws", 100, 2000),
    Case("sse", 100, 500, goal=True),
    Case("sse", 500, 100),
    Case("sse", 500, 200, goal=True),
    Case("sse", 100, 2000),
)


class Found(NamedTuple):
    """The results of so many seconds."""

    seconds: float
    cpu_s: float
    """Processor time of the server: all threads, user and kernel."""
    readers_s: float
    frames: int
    messages: int
    bytes: int
    late_ms: Sequence[float]

    @property
    def per_cpu_s(self) -> float:
        return self.messages / self.cpu_s if self.cpu_s else 0.0

    def late(self, share: float) -> float:
        return percentile(self.late_ms, share)

    def cells(self) -> Sequence[object]:
        return (
            f"{self.frames / self.seconds:.0f}" if self.frames else "",
            f"{self.messages / self.seconds:.0f}",
            f"{self.bytes / self.seconds / 1e6:.1f}",
            f"{self.cpu_s / self.seconds:.0%}",
            f"{self.cpu_s / max(1, self.messages) * 1e6:.1f}",
            f"{self.readers_s / self.seconds:.0%}",
            *((f"{self.late(0.5):.2f}", f"{self.late(0.99):.2f}") if self.late_ms else ()),
        )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=5.0, help="of each measurement")
    parser.add_argument("--only", default="", help="rows with this in their name")
    seconds, only = (args := parser.parse_args()).seconds, args.only
    print(
        f"{Path('/proc/loadavg').read_text().split()[0]} processes were running before, on {os.cpu_count()} processors"
    )
    line(*HEAD)
    for case in CASES:
        if only in case.name:
            found, bare, starlette = beside(case, seconds)
            line(case.name, *found.cells(), f"{found.messages / max(1, found.frames * case.count):.0%}")
            for name, other in (("bare uvloop", bare), ("bare Starlette", starlette)):
                line(f"  {name}", "", *other.cells()[1:], "", f"{found.per_cpu_s / other.per_cpu_s:.0%}")
    for count in (1, 20):
        if only in (name := f"{count} WebSockets on the subtree of Baxter"):
            with scene() as place:
                line(name, *subtree(place, count, seconds).cells())
    if only in (name := "500 WebSockets on 500 values, 50 Hz"):
        line(name, *distinct(seconds).cells())
    if only in "idle":
        idle(seconds)


def rows(seconds: float, cases: Sequence[Case] = CASES, robots: int = 50) -> list[Row]:
    """Return the rows of the fan-out. ``robots`` is the number of robots; one value of each has one subscriber."""
    found: list[Row] = []
    for case in (each for each in cases if each.goal):
        ours, bare, starlette = beside(case, seconds)
        name = f"messages to {case.name}"
        found += [
            at_least(name, _UNIT, ours.per_cpu_s, "one buffer to all by uvloop", bare.per_cpu_s, _SHARE),
            known(f"{name}, beside Starlette", _UNIT, ours.per_cpu_s, "bare Starlette", starlette.per_cpu_s),
            at_most(f"{name}: p99", ours.late(0.99), "one buffer to all by uvloop", bare.late(0.99), _LATE_MS),
            known(f"{name}: processor of the readers", "%", ours.readers_s / ours.seconds * 100),
        ]
    rendered = distinct(seconds, robots).per_cpu_s
    name, goal = f"messages to {10 * robots} WebSockets on {10 * robots} values, 50 Hz", f">= {_RENDERED:,}"
    return [*found, Row(name, _UNIT, rendered, "", None, goal, rendered >= _RENDERED)]


def line(name: object, *cells: object) -> None:
    print(f"{name!s:40}" + "".join(f"{cell!s:>12}" for cell in cells), flush=True)


def beside(case: Case, seconds: float) -> tuple[Found, Found, Found]:
    """Measure the gateway, and servers that send constant bytes of the same size as often: bare uvloop, Starlette."""
    ours = fan_out(case, seconds)
    size = ours.bytes // ours.messages
    return ours, limit("bare", case, size, seconds), limit("starlette", case, size, seconds)


def fan_out(case: Case, seconds: float) -> Found:
    with scene() as place, place.robot("mover", case.rate_hz) as mover:
        port, path = place.place.port, "/mover/elbow/rotation"
        with contextlib.closing(Readers(port, case.how, case.count, path)) as readers:
            time.sleep(0.5)
            return measured(place.pid, readers, seconds, mover.latencies_ms, mover)


def limit(kind: str, case: Case, size: int, seconds: float) -> Found:
    # -P: no module beside the script hides one of the standard library; 20: bytes of framing
    command = [sys.executable, "-P", str(_LIMITS), kind, case.how, str(case.rate_hz), str(size - 20)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as child:  # noqa: S603
        assert child.stdin is not None and child.stdout is not None
        with (
            child.stdin,
            contextlib.closing(Readers(int(child.stdout.readline()), case.how, case.count, "/")) as readers,
        ):
            time.sleep(0.5)
            return measured(child.pid, readers, seconds, _since_written)


def _since_written(seen: Sequence[Sequence[tuple[int, float]]]) -> list[float]:
    return [at_ns / 1e6 - value * 1e3 for reader in seen for at_ns, value in reader]


def measured(
    pid: int,
    readers: Readers,
    seconds: float,
    late_ms: Callable[[Any], list[float]] = lambda seen: [],
    mover: Mover | None = None,
) -> Found:
    first = readers.counted()
    frames, cpu = len(mover.sent_ns) if mover else 0, cpu_s(pid)
    time.sleep(seconds)
    cpu, frames = cpu_s(pid) - cpu, (len(mover.sent_ns) if mover else 0) - frames
    found = readers.counted()
    took_s, readers_s = (found["at_ns"] - first["at_ns"]) / 1e9, found["cpu_s"] - first["cpu_s"]
    return Found(took_s, cpu, readers_s, frames, found["messages"], found["bytes"], late_ms(found["seen"]))


def distinct(seconds: float, robots: int = 50) -> Found:
    """Measure as many values as subscribers: every message is rendered for one subscriber."""
    joints = 10
    paths = [f"/{name_of(robot)}/joint_{joint}/rotation" for joint in range(joints) for robot in range(robots)]
    with crowd.stage(Size(robots, joints, 1), 1) as place:
        place.crowd.ask(f"moving {joints}")
        place.crowd.ask("rate 1")
        place.crowd.ask("appear")
        (gateway,) = place.gateways
        gateway.meet(robots)
        place.crowd.ask("rate 50")
        with contextlib.closing(Readers(gateway.port, "ws", len(paths), ",".join(paths))) as readers:
            time.sleep(0.5)
            place.crowd.ask()
            found = measured(gateway.pid, readers, seconds)
            return found._replace(frames=place.crowd.ask()["frames"])


@contextlib.contextmanager
def swaying(place: Scene) -> Iterator[str]:
    """Run a simulated Baxter with one swaying joint; yield the joint's path."""
    flags = ("--robot=baxter", "--sway=baxter:left_s0", f"--connect={place.place.zenoh}")
    with process("-m", "linked_fleet_agent", *flags), browsing(place.place) as browser:
        yield live(browser, "baxter").url.removeprefix(place.place.root.rstrip("/"))


def subtree(place: Scene, count: int, seconds: float) -> Found:
    with contextlib.ExitStack() as stack:
        path = stack.enter_context(swaying(place))
        readers = Readers(place.place.port, "ws", count, f"{path}?depth=subtree")
        stack.enter_context(contextlib.closing(readers))
        time.sleep(1)
        return measured(place.pid, readers, seconds)


def idle(seconds: float) -> None:
    """Measure the gateway with five robots at 100 Hz: without a subscription, and with one."""
    with scene() as place, contextlib.ExitStack() as stack:
        for number in range(5):
            stack.enter_context(place.robot(f"mover{number}", 100))
        time.sleep(1)
        cpu = cpu_s(place.pid)
        time.sleep(seconds)
        cpu = cpu_s(place.pid) - cpu
        line("5 robots, nobody subscribes", 500, "", "", f"{cpu / seconds:.1%}")
        path = "/mover0/elbow/rotation"
        with contextlib.closing(Readers(place.place.port, "ws", 1, path)) as readers:
            time.sleep(0.5)
            line("5 robots, 1 WebSocket on a value", 500, *measured(place.pid, readers, seconds).cells()[1:])


if __name__ == "__main__":
    main()
