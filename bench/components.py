"""The cost of components: values of many robots, GETs, a value on its way to a subscriber, joining, and shapes.

``python -m bench.components --play ENDPOINT`` plays robots. A line on its standard input is a number of components and
one of robots, which then appear, or a rate at which each of these publishes values, all of them changed.
"""

import contextlib
import itertools
import json
import os
import signal
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import httpx
import msgspec
from msgspec import Raw
from msgspec.structs import asdict, replace
from websockets.sync.client import connect

import fake_robots
from bench.answers import MEDIA_TYPES, browse, listed, read_all, typical_response
from bench.beside import BARE, bare, wire
from bench.crowd import Crowd, Size
from bench.played import run_played
from bench.scene import cpu_s, pid_of
from bench.table import Row, at_least, at_most, bounded, known, percentile, within
from bench.timed_gateway import SAID
from linked_fleet_agent.wire.codec import decode, encode
from linked_fleet_agent.wire.components import (
    COMPONENTS_VERSION,
    MAX_PROPERTIES,
    DescriptionWithComponents,
    Measured,
    Values,
)
from linked_fleet_agent.wire.messages import Description
from linked_fleet_agent.wire.schema import MAX_MEMBERS, Schema
from linked_fleet_gateway.app.main import settle
from linked_fleet_gateway.extensions.components.declarations import Input
from linked_fleet_gateway.extensions.components.places import place_of
from running import Process, eventually, free_port, process
from small_fleet import Place

ROBOTS, COMPONENTS, NUMBERS, RATE_HZ = 200, 4, 5, 10.0
MOST_SHARE, MOST_JOINING_MS, MOST_CALLBACK_MS, MOST_COMPILING_MS, MOST_MS = 0.5, 20.0, 5.0, 5.0, 1.0
_MOST_COMPONENTS, _JOINING, _COMPILED = 64, 9, 25
_MEMBERS = {f"value-{number}": number for number in range(MAX_MEMBERS)}
_SETTLED_S = 1.0


def rows(seconds: float) -> list[Row]:
    with _gateway() as (place, pid), contextlib.closing(Players(place)) as players:
        players.appear(COMPONENTS, ROBOTS)
        eventually(partial(_has_value, place, ROBOTS - 1), "the last robot with values")
        time.sleep(_SETTLED_S)
        still = _share(pid, seconds)
        players.publish(RATE_HZ)
        time.sleep(_SETTLED_S)
        changing = _share(pid, seconds)
        players.publish(1.0)
        ours, theirs, size = _answers(place, pid, seconds)
        players.publish(0.0)
        told_ms = _told_ms(place, players, max(20, int(50 * seconds)))
    raw_ms = wire(f"tcp/127.0.0.1:{free_port()}", 100, seconds).states_ms
    what = f"{ROBOTS} robots publish {COMPONENTS * NUMBERS} changed values at {RATE_HZ:g} Hz: processor"
    return [
        known(f"{ROBOTS} robots with {COMPONENTS * NUMBERS} values each that do not change: processor", "cores", still),
        bounded(what, "cores", changing, MOST_SHARE),
        known(f"GET of a random value of a component: {BARE}", "1/CPU s", theirs),
        at_least("GET of a random value of a component, read before", "1/CPU s", ours, f"{BARE}, {size} bytes", theirs,
                 0.6),
        at_most("from a robot's value to its subscriber, p50", percentile(told_ms, 0.5), "a frame on Zenoh",
                percentile(raw_ms, 0.5), MOST_MS),
        _without_components(seconds),
        *_joining(),
        *_compiling(),
    ]  # fmt: skip


@contextlib.contextmanager
def _gateway() -> Iterator[tuple[Place, int]]:
    with tempfile.TemporaryDirectory() as state:
        place = Place(Path(state))
        with process(*place.command(), "--requests-per-client", "0") as gateway:
            gateway.said("serving")
            yield place, pid_of(gateway)


def _without_components(seconds: float) -> Row:
    """Return the row of robots that declare none, beside a gateway without the extension that gets the same frames."""
    endpoint, found = f"tcp/127.0.0.1:{free_port()}", list[float]()
    off = ((), ("--extensions-off", "components"))
    with contextlib.ExitStack() as stack:
        crowd = stack.enter_context(contextlib.closing(Crowd(endpoint, Size(ROBOTS, 6, 1))))
        pids = list[int]()
        for more in off:
            state = stack.enter_context(tempfile.TemporaryDirectory())
            words = ("-m", "linked_fleet_gateway", "--port", str(free_port()), "--zenoh-connect", endpoint)
            gateway = stack.enter_context(process(*words, "--state-dir", state, *more))
            gateway.said("serving")
            pids.append(pid_of(gateway))
        crowd.ask("appear")
        crowd.ask(f"rate {RATE_HZ:g}")
        time.sleep(10 * _SETTLED_S)  # descriptions are read
        spent = [cpu_s(pid) for pid in pids]
        time.sleep(took_s := max(10.0, 10 * seconds))
        found += [(cpu_s(pid) - before) / took_s * 1e3 for pid, before in zip(pids, spent, strict=True)]
    what = f"{ROBOTS} robots without components at {RATE_HZ:g} Hz: processor in a second"
    return within(what, found[0], "without the extension", found[1], 1.1)


def _has_value(place: Place, number: int) -> bool:
    answer = httpx.get(f"{place.root}{_name(number)}/part-0", headers={"accept": "application/json"})
    return answer.status_code == 200 and None not in answer.json().values()


def _share(pid: int, seconds: float) -> float:
    begin, spent = time.monotonic(), cpu_s(pid)
    time.sleep(max(2.0, seconds))
    return (cpu_s(pid) - spent) / (time.monotonic() - begin)


def _answers(place: Place, pid: int, seconds: float) -> tuple[float, float, int]:
    """Return answers a second of processor, those of a bare server with the median answer, and the size of that.

    The processor time that receiving the values takes meanwhile is subtracted.
    """
    paths = [(f"/{_name(robot)}/part-{part}/value-{number}",)
             for robot in range(40) for part in range(COMPONENTS) for number in range(NUMBERS)]  # fmt: skip
    for media_type in MEDIA_TYPES:
        read_all(place.root, [path for (path,) in paths], media_type)
    with tempfile.TemporaryDirectory() as folder:
        typical = typical_response(place.root, paths)
        with bare(1, {"/value": typical}) as (url, bare_pid):
            theirs = browse(url, bare_pid, seconds, listed(folder, "bare", [("/value",)] * len(paths))).per_cpu_s
            receiving = _share(pid, seconds)
            asked = browse(place.root, pid, seconds, listed(folder, "paths", paths))
    return asked.answers / (asked.cpu_s - receiving * asked.seconds), theirs, typical.size


def _told_ms(place: Place, players: "Players", count: int) -> list[float]:
    """Return the times from the publication of a value, which is its time, to the message at a WebSocket."""
    url = f"ws{place.root.removeprefix('http')}{_name(0)}/part-0/value-0"
    found = list[float]()
    with connect(url, subprotocols=["lf.json"]) as socket:  # type: ignore[list-item]
        socket.recv()
        for _ in range(count):
            players.publish_once()
            said = json.loads(socket.recv())
            found.append((time.monotonic_ns() / 1e9 - said["value"]) * 1e3)
            time.sleep(0.005)
    return found


def _joining() -> list[Row]:
    """Return the rows of one robot of 64 components: what it costs that it joins, and that it is read first."""
    costs, longest, first, described = list[float](), list[float](), list[float](), list[float]()
    with tempfile.TemporaryDirectory() as state:
        place = Place(Path(state))
        _, _, *words = place.command()
        with process("-m", "bench.timed_gateway", *words) as gateway:
            gateway.said("serving")
            pid = pid_of(gateway)
            with contextlib.closing(Players(place)) as players:
                time.sleep(_SETTLED_S)
                for number in range(_JOINING):
                    _longest_ms(gateway)
                    spent = cpu_s(pid)
                    players.appear(_MOST_COMPONENTS, number + 1)
                    eventually(partial(_joined, place, number), f"robot {number} with its components")
                    costs.append((cpu_s(pid) - spent) * 1e3)
                    longest.append(_longest_ms(gateway))
                    httpx.get(place.root + _name(number) + "/").raise_for_status()
                    time.sleep(0.1)  # the callback ends after its answer
                    first.append(_longest_ms(gateway))
                    httpx.get(f"{place.root}{_name(number)}/?as=td").raise_for_status()
                    time.sleep(0.1)
                    described.append(_longest_ms(gateway))
    name = f"a robot of {_MOST_COMPONENTS} components joins"
    return [
        bounded(f"{name}: processor of all threads", "ms", statistics.median(costs), MOST_JOINING_MS),
        bounded(f"{name}: longest callback of the event loop", "ms", statistics.median(longest), MOST_CALLBACK_MS),
        bounded(f"first GET of a robot of {_MOST_COMPONENTS} components: longest callback of the event loop", "ms",
                statistics.median(first), MOST_CALLBACK_MS),
        bounded(f"first Thing Description of a robot of {_MOST_COMPONENTS} components: longest callback of the event "
                "loop", "ms", statistics.median(described), MOST_CALLBACK_MS),
    ]  # fmt: skip


def _compiling() -> list[Row]:
    """Return the rows of the shape of an input of as many numbers as one may have: processor of a thread.

    Garbage is collected as in a gateway.
    """
    settle()
    what = f"the shape of an input of {MAX_MEMBERS} numbers"
    alike = dict.fromkeys(_MEMBERS, Schema(type="number", unit="M", minimum=0, maximum=0.1))
    differ = {each: Schema(type="number", unit="N", minimum=at / 8, maximum=at + 0.3) for each, at in _MEMBERS.items()}
    units = {each: replace(schema, unit="M") for each, schema in differ.items()}
    return [
        bounded(f"{what} with the same limits, in several units", "ms", _compiled_ms(alike), MOST_COMPILING_MS),
        bounded(f"{what} with limits of their own", "ms", _compiled_ms(differ), MOST_COMPILING_MS),
        bounded(f"{what} with limits of their own, in several units", "ms", _compiled_ms(units), MOST_COMPILING_MS),
    ]


def _compiled_ms(members: dict[str, Schema]) -> float:
    place, costs = (
        place_of(Schema(type="object", properties=members), "http://example.org/r/vocabulary#x"),
        list[float](),
    )
    for _ in range(_COMPILED):
        begun_s = time.process_time()
        assert Input(place).validator
        costs.append((time.process_time() - begun_s) * 1e3)
    return statistics.median(costs)


def _joined(place: Place, number: int) -> bool:
    return httpx.head(f"{place.root}{_name(number)}/part-{_MOST_COMPONENTS - 1}").status_code == 200


def _longest_ms(gateway: Process) -> float:
    before = sum(SAID in each for each in gateway.lines)
    gateway.send(signal.SIGUSR1)
    eventually(lambda: sum(SAID in each for each in gateway.lines) > before, "the longest callback")
    return float([each for each in gateway.lines if SAID in each][-1].rpartition(" ")[2])


def _name(number: int) -> str:
    return f"robot-{number:03}"


class Players:
    """A child process that plays robots."""

    def __init__(self, place: Place) -> None:
        command = [sys.executable, "-m", "bench.components", "--play", place.zenoh]
        around = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
        self._child = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=around)  # noqa: S603
        assert self._child.stdin is not None and self._child.stdout is not None
        self._in, self._out = self._child.stdin, self._child.stdout
        assert self._out.readline() == "ready\n"

    def _ask(self, line: str) -> None:
        self._in.write(line + "\n")
        self._in.flush()
        assert self._out.readline() == "done\n"

    def appear(self, components: int, robots: int) -> None:
        self._ask(f"appear {components} {robots}")

    def publish(self, rate_hz: float) -> None:
        self._ask(f"rate {rate_hz:g}")

    def publish_once(self) -> None:
        self._ask("once")

    def close(self) -> None:
        self._in.close()
        self._child.wait()
        self._out.close()


class Robot:
    """A played robot. Its values are the time at which they were published, in seconds of CLOCK_MONOTONIC."""

    def __init__(self, actor: fake_robots.FakeRobot, components: int) -> None:
        self.actor, self._sequence, self._key = actor, itertools.count(1), fake_robots.KEYS.robot(actor.name, "values")
        self._numbers = min(NUMBERS, MAX_PROPERTIES // components)
        schema = {"schema": {"type": "number", "unit": "SEC"}}
        numbers = {f"value-{number}": schema for number in range(self._numbers)}
        self._names = [f"part-{number}" for number in range(components)]
        declared = msgspec.json.encode([{"name": name, "stale_s": 3600, "properties": numbers} for name in self._names])
        said = decode(actor.description(), Description)
        actor.keep(actor.session.declare_queryable(self._key, lambda query: query.reply(self._key, self._message(0))))
        actor.appear(encode(DescriptionWithComponents(**asdict(said), components=Raw(declared))))

    def _message(self, sequence: int) -> bytes:
        now_ns = time.monotonic_ns()
        values = {f"value-{number}": Raw(b"%.9f" % (now_ns / 1e9)) for number in range(self._numbers)}
        return encode(
            Values(
                version=COMPONENTS_VERSION, incarnation=self.actor.incarnation, sequence=sequence, monotonic_ns=now_ns,
                wall_ns=time.time_ns(),
                components={name: Measured(at_ns=now_ns, values=values) for name in self._names},
            )
        )  # fmt: skip

    def publish(self) -> None:
        self.actor.put("values", self._message(next(self._sequence)))


def play(endpoint: str) -> None:
    robots, rate_hz, ended = list[Robot](), [0.0], threading.Event()

    def publish() -> None:
        while not ended.is_set():
            begin = time.monotonic()
            if rate_hz[0]:
                for each in robots:
                    each.publish()
            ended.wait(max(0.001, (1 / rate_hz[0] if rate_hz[0] else 0.05) - (time.monotonic() - begin)))

    with fake_robots.open_session(endpoint) as session:
        thread = threading.Thread(target=publish)
        thread.start()
        print("ready", flush=True)
        for line in sys.stdin:
            what, *words = line.split()
            if what == "appear":
                components, count = map(int, words)
                robots += [
                    Robot(fake_robots.FakeRobot(session, _name(number)), components)
                    for number in range(len(robots), count)
                ]
            elif what == "rate":
                rate_hz[0] = float(words[0])
            else:
                robots[0].publish()
            print("done", flush=True)
        ended.set()
        thread.join()


if __name__ == "__main__":
    run_played(__doc__, rows, play)
