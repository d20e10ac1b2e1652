"""The cost of a thousand robots for one gateway and for two: a table in Markdown, discussed in docs/SCALE.md.

joining          from the first presence token until each robot has a description and a value; checked ten times a
                 second
CPU, memory      of the first gateway; of the process of robots and router; the resident set, including shared files
taken            share of frames that no newer one replaced; sender and receiver count apart, so it can exceed 100
event loop held  longest and 99th percentile of answers to /health/live
age              from a robot's reading to the client; over HTTP it includes up to one period of the rate
command          from a POST that rotates a joint to the answer after acceptance, one after the other
Redis commands   as Redis counts them, including those in scripts and the gateways' background
"""

import argparse
import contextlib
import itertools
import os
import re
import statistics
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import TypeVar

from websockets.sync.client import connect as websocket

from bench.crowd import Probe, Scene, Size, stage
from bench.scene import cpu_s, rss_kib
from bench.synthetic import name_of
from commanding import TURTLE, radian
from running import eventually

Figures = dict[str, str]
T = TypeVar("T")
_VALUE = re.compile(rb'numericalValue "([^"]+)"')
_PAGES = (
    ("`/` as Turtle", "/", "text/turtle"),
    ("`/` as a page", "/", "text/html"),
    ("`/metrics`", "/metrics", "*/*"),
    ("`/{robot}/` as Turtle", f"/{name_of(0)}/", "text/turtle"),
    ("`/{robot}/` as a page", f"/{name_of(0)}/", "text/html"),
    ("`…/rotation` as Turtle", f"/{name_of(0)}/joint_0/rotation", "text/turtle"),
)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    for name, value in (("robots", 1000), ("joints", 18), ("models", 20), ("requests", 200)):
        parser.add_argument(f"--{name}", type=int, default=value)
    parser.add_argument("--seconds", type=float, default=4.0, help="of each measurement")
    parser.add_argument("--gateways", type=int, nargs="+", default=[1, 2], help="a column each")
    parser.add_argument("--rates", type=float, nargs="+", default=[1, 10, 100], help="frames a second and robot")
    asked = parser.parse_args()
    size = Size(asked.robots, asked.joints, asked.models, asked.seconds, asked.requests, asked.rates)
    load = Path("/proc/loadavg").read_text().split()[0]
    machine = f"{os.cpu_count()} processors, on which {load} processes were running before"
    print(f"{size.robots} robots of {size.joints} joints and {size.models} models, {machine}\n")
    print(table({f"{count} gateway{'s' * (count > 1)}": measure(size, count) for count in asked.gateways}))


def table(columns: dict[str, Figures]) -> str:
    rows = list(dict.fromkeys(itertools.chain(*columns.values())))
    lines = [("", *columns), ("---",) + ("--:",) * len(columns)]
    lines += [(row, *(column.get(row, "") for column in columns.values())) for row in rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def measure(size: Size, count: int) -> Figures:
    """Return all figures with so many gateways; those of a single gateway are of the first one."""
    figures: Figures = {}
    with stage(size, count) as scene:
        for part in (joining, *(partial(at_rate, rate_hz=rate_hz) for rate_hz in size.rates_hz), pages, returning):
            found = part(scene)
            figures |= found
            print(count, *found.items(), sep="\n  ", file=sys.stderr, flush=True)  # progress
    return figures


# -- what is measured -------------------------------------------------------------------------------------------------


def joining(scene: Scene) -> Figures:
    """Measure all robots joining at once."""
    robots = scene.size.robots
    before_kib, commands = [rss_kib(one.pid) for one in scene.gateways], scene.redis()["total_commands_processed"]
    cpu = cpu_s(scene.gateways[0].pid)
    with Probe(scene.gateways[0]) as probe:
        scene.crowd.ask("rate 1")
        came = scene.crowd.ask("appear")
        for one in scene.gateways:
            one.meet(robots)
        known_ns = time.monotonic_ns()
    cpu = cpu_s(scene.gateways[0].pid) - cpu
    grown_kib = rss_kib(scene.gateways[0].pid) - before_kib[0]
    asked = scene.crowd.ask()["asked"]
    commands = scene.redis()["total_commands_processed"] - commands
    return {
        "joining: from the first token until all can be browsed, s": f"{(known_ns - came['first_ns']) / 1e9:.2f}",
        "— of that, until the last token, s": f"{(came['last_ns'] - came['first_ns']) / 1e9:.2f}",
        "— CPU of the gateway a robot, ms": f"{cpu / robots * 1e3:.2f}",
        "— descriptions asked for, a robot and gateway": f"{asked / robots / len(scene.gateways):.2f}",
        "— event loop held at most, ms": f"{probe.worst_ms:.0f}",
        "— Redis commands a robot": f"{commands / robots:.1f}",
        "memory of the gateway with nobody, MiB": f"{before_kib[0] / 1024:.0f}",
        "— more with all, kB a robot": f"{grown_kib * 1.024 / robots:.0f}",
    }


def at_rate(scene: Scene, rate_hz: float) -> Figures:
    """Measure frames without readers, then the age of values, then commands."""
    scene.crowd.ask(f"rate {rate_hz}")
    time.sleep(min(1.0, scene.size.seconds))
    one = scene.gateways[0]
    scene.crowd.ask()
    before, cpu, calls, begin = one.numbers(), cpu_s(one.pid), _calls(scene), time.monotonic()
    robots_cpu = scene.crowd.ask()["cpu_s"]
    with Probe(one, pause_s=0.02) as probe:
        time.sleep(scene.size.seconds)
    seconds, found = time.monotonic() - begin, scene.crowd.ask()
    cpu, calls, after = cpu_s(one.pid) - cpu, _calls(scene) - calls, one.numbers()
    taken = after["frames_taken_total"] - before["frames_taken_total"]
    lost = after["frames_dropped_total"] - before["frames_dropped_total"]
    said = f"{rate_hz:g} Hz: "
    figures = {
        said + "frames sent, 1/s": f"{found['frames'] / seconds:.0f}",
        said + "taken, not replaced by a newer one, %": f"{taken / max(1, found['frames']) * 100:.0f}",
        said + "late or of no run, 1/s": f"{lost / seconds:.0f}",
        said + "CPU of the gateway, %": f"{cpu / seconds * 100:.0f}",
        said + "CPU of robots and router, %": f"{(found['cpu_s'] - robots_cpu) / seconds * 100:.0f}",
        said + "event loop held, p99 / most, ms": f"{probe.p99_ms:.1f} / {probe.worst_ms:.1f}",
        said + "Redis commands, 1/s": f"{calls / seconds:.0f}",
    }
    return figures | ages(scene, said) | commands(scene, said)


def ages(scene: Scene, said: str) -> Figures:
    """Measure ages of values, robot after robot: by HTTP when the response, by WebSocket when the message is there."""
    one, read = scene.gateways[0], list[float]()
    for name in _in_turn(scene.size):
        answer = one.get(f"/{name}/joint_0/rotation")
        read.append(scene.crowd.age_ms(_value(answer.content), time.monotonic_ns()))
    return {
        said + "age over HTTP, p50 / p99, ms": spread(read),
        said + "age over a WebSocket, p50 / p99, ms": spread(heard(scene)),
    }


def heard(scene: Scene, count: int = 20) -> list[float]:
    """Return the ages of messages on WebSockets of different robots, without each one's first message."""
    one, ages, ended = scene.gateways[0], list[float](), threading.Event()

    def listen(number: int) -> None:
        url = f"ws://127.0.0.1:{one.port}/{name_of(number % scene.size.robots)}/joint_0/rotation"
        with websocket(url, compression=None, proxy=None) as stream:
            stream.recv()
            while not ended.is_set():
                with contextlib.suppress(TimeoutError):
                    message = stream.recv(timeout=0.1)
                    now_ns = time.monotonic_ns()
                    said = message.encode() if isinstance(message, str) else message
                    ages.append(scene.crowd.age_ms(_value(said), now_ns))

    threads = [threading.Thread(target=listen, args=(number,)) for number in range(count)]
    for thread in threads:
        thread.start()
    time.sleep(scene.size.seconds / 2)
    eventually(lambda: ages, "a message")
    ended.set()
    for thread in threads:
        thread.join()
    return ages


def commands(scene: Scene, said: str) -> Figures:
    """Measure from the POST to the response after the agent's acceptance, robot after robot; then the data in Redis."""
    one, took = scene.gateways[0], list[float]()
    calls, memory, asked = _calls(scene), scene.redis()["used_memory"], 0
    for name in _in_turn(scene.size):
        url = f"http://127.0.0.1:{one.port}/{name}/joint_1/actions/rotate"
        begin = time.perf_counter()
        answer = one.http.post(url, content=radian(0.2), headers=TURTLE)
        assert answer.status_code in (204, 504), answer.text
        asked += 1
        if answer.status_code == 204:
            took.append((time.perf_counter() - begin) * 1e3)
    calls, memory = _calls(scene) - calls, scene.redis()["used_memory"] - memory
    return {
        said + "command, from POST to acceptance, p50 / p99, ms": spread(took),
        said + "— not answered by the agent within 2 s, %": f"{100 - len(took) / asked * 100:.0f}",
        said + "— Redis commands": f"{calls / asked:.1f}",
        said + "— Redis memory, kB": f"{memory / asked / 1e3:.1f}",
    }


def pages(scene: Scene, repeats: int = 5) -> Figures:
    """Measure response times, and the time in which nobody else is served; at one frame a second per robot."""
    figures = {}
    scene.crowd.ask("rate 1")
    one = scene.gateways[0]
    for name, path, accept in _PAGES:
        with Probe(one) as probe:
            took = [_timed(lambda path=path, accept=accept: one.get(path, accept))[1] * 1e3 for _ in range(repeats)]  # type: ignore[misc]
        size = len(one.get(path, accept).content) / 1e3
        held = f"{statistics.median(took):.0f} / {probe.worst_ms:.0f} / {size:.0f}"
        figures[f"{name}: answer / event loop held at most, ms / size, kB"] = held
    return figures


def returning(scene: Scene) -> Figures:
    """Measure another gateway replacing one while all robots are present, at 1 Hz."""
    grown_kib = rss_kib(scene.gateways[0].pid)
    begin = time.monotonic()
    one, ended = _timed(scene.restart)
    one.meet(scene.size.robots)
    return {
        "memory of the gateway after all that, MiB": f"{grown_kib / 1024:.0f}",
        "a gateway in the place of another: end and start until it serves, s": f"{ended:.2f}",
        "— until it has all robots, s": f"{time.monotonic() - begin:.2f}",
    }


def _in_turn(size: Size) -> Iterator[str]:
    """Yield names of robots, until the number of requests or the time is reached."""
    end = time.monotonic() + size.seconds
    for number in range(size.requests):
        if time.monotonic() < end:
            yield name_of(number * 7 % size.robots)


def _calls(scene: Scene) -> int:
    return int(scene.redis()["total_commands_processed"])


def _value(message: bytes) -> str:
    found = _VALUE.search(message)
    assert found is not None, message
    return found[1].decode()


def _timed(call: Callable[[], T]) -> tuple[T, float]:
    begin = time.perf_counter()
    return call(), time.perf_counter() - begin


def spread(values: Sequence[float]) -> str:
    """Return median and 99th percentile."""
    if not values:
        return "–"
    ordered = sorted(values)
    return f"{statistics.median(ordered):.1f} / {ordered[len(ordered) * 99 // 100]:.1f}"


if __name__ == "__main__":
    with contextlib.suppress(KeyboardInterrupt):
        main()
