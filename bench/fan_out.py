"""What the fan-out costs and how late it is: one table (bench/README.md says how to read it)."""

import argparse
import contextlib
import os
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from running import process
from small_fleet import live

from bench.scene import Mover, Readers, Scene, browsing, cpu_s, scene

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


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=5.0, help="of each measurement")
    parser.add_argument("--only", default="", help="rows with this in their name")
    seconds, only = (args := parser.parse_args()).seconds, args.only
    print(
        f"{Path('/proc/loadavg').read_text().split()[0]} processes were running before, on {os.cpu_count()} processors"
    )
    row(*HEAD)
    for name, how, count, rate_hz in (
        ("1 WebSocket, 100 Hz", "ws", 1, 100),
        ("500 WebSockets, 200 Hz", "ws", 500, 200),
        ("100 WebSockets, 2 kHz", "ws", 100, 2000),
        ("100 event streams, 200 Hz", "sse", 100, 200),
        ("100 event streams, 2 kHz", "sse", 100, 2000),
    ):
        if only in name:
            with scene() as place, place.robot("mover", rate_hz) as mover:
                row(name, *fan_out(place, mover, how, count, seconds))
    for count in (1, 20):
        if only in (name := f"{count} WebSockets on the subtree of Baxter"):
            with scene() as place:
                row(name, *subtree(place, count, seconds))
    if only in "idle":
        idle(seconds)


def row(name: object, *cells: object) -> None:
    print(f"{name!s:40}" + "".join(f"{cell!s:>12}" for cell in cells), flush=True)


def fan_out(place: Scene, mover: Mover, how: str, count: int, seconds: float) -> Sequence[object]:
    with contextlib.closing(Readers(place.place.port, how, count, "/mover/elbow/rotation")) as readers:
        time.sleep(0.5)
        frames, found, cpu = measured(place, readers, seconds, mover)
        late = sorted(mover.latencies_ms(found["seen"]))
        ratio = found["messages"] / (frames * count)
        return (
            *figures(frames, found, cpu),
            f"{late[len(late) // 2]:.2f}",
            f"{late[len(late) * 99 // 100]:.2f}",
            f"{ratio:.0%}",
        )


def measured(place: Scene, readers: Readers, seconds: float, mover: Mover | None) -> tuple[int, dict[str, Any], float]:
    """Frames sent, what the readers counted, and the gateway's share of a processor."""
    first = readers.counted()
    frames, cpu = len(mover.sent_ns) if mover else 0, cpu_s(place.pid)
    time.sleep(seconds)
    cpu, frames = cpu_s(place.pid) - cpu, (len(mover.sent_ns) if mover else 0) - frames
    found = readers.counted()
    found["seconds"] = (found["at_ns"] - first["at_ns"]) / 1e9
    found["cpu_s"] -= first["cpu_s"]
    return frames, found, cpu / found["seconds"]


def figures(frames: int, found: dict[str, Any], cpu: float) -> Sequence[object]:
    seconds = found["seconds"]
    return (
        f"{frames / seconds:.0f}" if frames else "",
        f"{found['messages'] / seconds:.0f}",
        f"{found['bytes'] / seconds / 1e6:.1f}",
        f"{cpu:.0%}",
        f"{cpu * seconds / max(1, found['messages']) * 1e6:.1f}",
        f"{found['cpu_s'] / seconds:.0%}",
    )


def subtree(place: Scene, count: int, seconds: float) -> Sequence[object]:
    flags = ("--robot=baxter", "--sway=baxter:left_s0", f"--connect={place.place.zenoh}")
    with process("-m", "agents", *flags), browsing(place.place) as browser:
        path = live(browser, "baxter").url.removeprefix(place.place.root.rstrip("/"))
        with contextlib.closing(Readers(place.place.port, "ws", count, f"{path}?depth=subtree")) as readers:
            time.sleep(1)
            frames, found, cpu = measured(place, readers, seconds, None)
            return figures(frames, found, cpu)


def idle(seconds: float) -> None:
    """The gateway with five robots at 100 Hz: with no subscription, and with one to a value of one of them."""
    with scene() as place, contextlib.ExitStack() as stack:
        for number in range(5):
            stack.enter_context(place.robot(f"mover{number}", 100))
        time.sleep(1)
        cpu = cpu_s(place.pid)
        time.sleep(seconds)
        cpu = cpu_s(place.pid) - cpu
        row("5 robots, nobody subscribes", 500, "", "", f"{cpu / seconds:.1%}")
        path = "/mover0/elbow/rotation"
        with contextlib.closing(Readers(place.place.port, "ws", 1, path)) as readers:
            time.sleep(0.5)
            frames, found, share = measured(place, readers, seconds, None)
            row("5 robots, 1 WebSocket on a value", 500, *figures(frames, found, share)[1:])


if __name__ == "__main__":
    main()
