"""Start of the gateway and of the demo, warm, and the memory of the gateway and its worker processes in the demo.

Each start has another port; one start before fills the caches of the disk, the bytecode of Python and the shapes for
collision checks.
"""

import contextlib
import http.client
import json
import os
import re
import signal
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import NamedTuple
from urllib.parse import urlsplit

import httpx

from bench.footprint import LIBRARIES
from bench.scene import rss_kib
from bench.table import Row, bounded, known
from browser import LF, Browser
from linked_fleet_demo.tree import ROBOTS, robots_online
from running import PATIENCE_S, ROOT, eventually, free_port
from small_fleet import Place

STARTS = 5
MOST_START_S, MOST_DEMO_S, MOST_MB = 0.5, 4.0, 110.0
_DEMO = f"demo of {len(ROBOTS)} robots"
_LAST_LINE = "Ctrl-C ends the demo."
_COMMAND = re.compile(r"^ +curl (?:-N -H 'Accept: (?P<accept>[^']+)' )?(?P<url>http\S+)$", re.M)
_ROTATION = re.compile(r"curl -i -H 'Content-Type: text/turtle' (?P<url>http\S+) --data '(?P<body>[^']+)'")
_PER_S = os.sysconf("SC_CLK_TCK")


class Started(NamedTuple):
    """Seconds by the clock and of the processor."""

    clock_s: float
    cpu_s: float


def rows(_: float, starts: int = STARTS) -> list[Row]:
    """Return medians of ``starts`` starts of the gateway, and the figures of one warm start of the demo."""
    libraries = _median([_libraries() for _ in range(starts + 1)][1:])
    gateway = _median([_gateway() for _ in range(starts + 1)][1:])
    beside = "its libraries and a Zenoh session alone"
    with tempfile.TemporaryDirectory() as state:
        with _demo(state):
            pass
        with _demo(state) as demo:
            found = _memory(demo)
    name = "start of the gateway until its first response"
    return [
        known(f"{beside}: start", "s", libraries.clock_s),
        known(f"{beside}: start, processor", "s CPU", libraries.cpu_s),
        _beside(name, "s", gateway.clock_s, beside, libraries.clock_s),
        _beside(f"{name}: processor", "s CPU", gateway.cpu_s, beside, libraries.cpu_s),
        bounded(f"start of the {_DEMO} until its commands work", "s", demo.clock_s, MOST_DEMO_S),
        *found,
    ]


def _beside(name: str, unit: str, value: float, reference: str, beside: float) -> Row:
    return Row(name, unit, value, reference, value / beside, f"<= {MOST_START_S:g} {unit}", value <= MOST_START_S)


def _median(found: list[Started]) -> Started:
    return Started(*map(statistics.median, zip(*found, strict=True)))


def _environment(**more: str) -> Mapping[str, str]:
    """Return the environment of a user: Python writes bytecode, so that only the first start compiles modules."""
    kept = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
    return kept | {"PYTHONPATH": str(ROOT)} | more


def _libraries() -> Started:
    begin = time.monotonic()
    with _child("-c", LIBRARIES) as child:
        assert child.stdout is not None and child.stdout.readline(), "it ended at once"
        return Started(time.monotonic() - begin, _spent_s(child.pid))


def _gateway() -> Started:
    """Start a gateway without robots and with a new state; its first response is that of the fleet in Turtle."""
    with tempfile.TemporaryDirectory() as state:
        place, begin = Place(Path(state)), time.monotonic()
        with _child(*place.command()) as child:
            _first_response(place.root)
            return Started(time.monotonic() - begin, _spent_s(child.pid))


def _first_response(root: str) -> None:
    deadline = time.monotonic() + PATIENCE_S
    while True:
        try:
            connection = http.client.HTTPConnection(urlsplit(root).netloc)
            connection.request("GET", "/", headers={"accept": "text/turtle"})
            answer = connection.getresponse()
            answer.read()
        except ConnectionError:
            assert time.monotonic() < deadline, "the gateway does not answer"
            time.sleep(0.002)  # it is starting; polling faster would take the processor from it
        else:
            assert answer.status == 200
            connection.close()
            return


# -- the demo -------------------------------------------------------------------------------------------------------


class Demo(NamedTuple):
    """A demo whose commands have worked, after ``clock_s`` seconds."""

    root: str
    pid: int
    clock_s: float


@contextlib.contextmanager
def _demo(state: str) -> Iterator[Demo]:
    port, begin = free_port(), time.monotonic()
    with _child("-m", "linked_fleet_demo", "--port", str(port), TMPDIR=state) as child:
        assert child.stdout is not None
        said = ""
        for line in child.stdout:
            said += line
            if line.startswith(_LAST_LINE):
                break
        _follow(said)
        yield Demo(f"http://127.0.0.1:{port}/", child.pid, time.monotonic() - begin)


def _follow(said: str) -> None:
    """Send the requests of the commands that the demo has printed, and require that they succeed."""
    commands = list(_COMMAND.finditer(said))
    assert len(commands) == 3, said
    for command in commands:
        with httpx.stream("GET", command["url"], headers={"accept": command["accept"] or "*/*"}) as answer:
            assert answer.is_success and next(answer.iter_bytes()), command["url"]
    rotation = _ROTATION.search(said)
    assert rotation is not None, said
    headers = {"content-type": "text/turtle"}
    answer = httpx.post(rotation["url"], content=rotation["body"], headers=headers, timeout=PATIENCE_S)
    assert answer.status_code == 204, answer.text


def _memory(demo: Demo) -> list[Row]:
    """Measure before and after a query, for which another process starts."""
    gateway = next(pid for pid in _children(demo.pid) if "linked_fleet_gateway" in _command(pid))
    with contextlib.closing(Browser(demo.root)) as browser:
        for robot in sorted(robots_online(demo.root)):
            assert browser.page(robot).one(LF.presence) == LF.online
        rest = rss_kib(gateway) * 1.024e-3
        headers = {"content-type": "application/sparql-query", "accept": "application/sparql-results+json"}
        answer = httpx.post(demo.root + "query", content="ASK { ?robot a ?kind }", headers=headers, timeout=PATIENCE_S)
        assert json.loads(answer.text)["boolean"] is True
    name, ends = f"{_DEMO}, all extensions", "until it has been idle for five minutes"
    return [
        bounded(f"{name}: memory of the gateway", "MB", rest, MOST_MB),
        known(f"{name}: memory of its process that checks motions, {ends}", "MB", _worker_mb(gateway, "world")),
        known(f"{name}: memory of its process that answers queries, {ends}", "MB", _worker_mb(gateway, "query")),
    ]


def _worker_mb(gateway: int, extension: str) -> float:
    def found() -> list[int]:
        return [pid for pid in _children(gateway) if f"linked_fleet_gateway.extensions.{extension}." in _command(pid)]

    return rss_kib(eventually(found, f"a process of {extension}")[0]) * 1.024e-3


# -- processes ------------------------------------------------------------------------------------------------------


@contextlib.contextmanager
def _child(*arguments: str, **environment: str) -> Iterator[subprocess.Popen[str]]:
    child = subprocess.Popen(  # noqa: S603
        [sys.executable, *arguments], cwd=ROOT, env=_environment(**environment), text=True,
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL,
    )  # fmt: skip
    try:
        yield child
    finally:
        child.send_signal(signal.SIGTERM)
        child.communicate()


def _spent_s(pid: int) -> float:
    """Return the processor time of a process, threads that have ended included, in steps of 10 ms."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / _PER_S


def _children(pid: int) -> list[int]:
    found = [path.read_text().split() for path in Path(f"/proc/{pid}/task").glob("*/children")]
    return [int(each) for children in found for each in children]


def _command(pid: int) -> str:
    return Path(f"/proc/{pid}/cmdline").read_bytes().replace(b"\0", b" ").decode()


def main() -> None:
    for row in rows(1.0):
        print(row)


if __name__ == "__main__":
    main()
