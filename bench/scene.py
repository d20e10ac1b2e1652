"""Common parts of the benchmarks: a gateway process, robots that they play, and process data from /proc."""

import contextlib
import json
import os
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import zenoh

from browser import Browser
from fake_robots import FakeRobot, open_session
from running import Process, process
from shared_fixtures import ROBOTS
from small_fleet import Place, live

READERS = Path(__file__).with_name("readers.py")


def cpu_s(pid: int) -> float:
    """Return the processor time of a process's threads, user and kernel; finer than ticks of 10 ms."""
    spent_ns = 0
    for path in Path(f"/proc/{pid}/task").glob("*/schedstat"):
        with contextlib.suppress(FileNotFoundError, ProcessLookupError):  # a thread that has just ended
            spent_ns += int(path.read_text().split()[0])
    return spent_ns / 1e9


def process_cpu_s(pid: int) -> float:
    """Return the processor time of a process, also of threads that have ended; in ticks of 10 ms."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def rss_kib(pid: int) -> int:
    status = Path(f"/proc/{pid}/status").read_text()
    return int(status.partition("VmRSS:")[2].split()[0])


def pid_of(child: Process) -> int:
    return child._child.pid


@dataclass(frozen=True)
class Scene:
    place: Place
    session: zenoh.Session
    pid: int

    @contextlib.contextmanager
    def robot(self, name: str, rate_hz: float) -> Iterator["Mover"]:
        mover = Mover(FakeRobot(self.session, name).appear(), rate_hz)
        with mover.moving():
            with browsing(self.place) as browser:
                live(browser, name)
            yield mover


def browsing(place: Place) -> contextlib.AbstractContextManager[Browser]:
    return contextlib.closing(Browser(place.root))


@contextlib.contextmanager
def scene(*flags: str) -> Iterator[Scene]:
    """Run a gateway without robots."""
    with tempfile.TemporaryDirectory() as state:
        place = Place(Path(state))
        with process(*place.command(), *flags) as gateway:
            gateway.said("serving")
            with open_session(place.zenoh) as session:
                yield Scene(place, session, pid_of(gateway))


@contextlib.contextmanager
def scene_of_robots(*flags: str) -> Iterator[tuple[Scene, Browser]]:
    """Run a gateway and the simulated robots of the demo, from the time when all of them are live."""
    with (
        scene(*flags) as place,
        process("-m", "linked_fleet_agent", *(f"--robot={name}" for name in ROBOTS), "--connect", place.place.zenoh),
        browsing(place.place) as browser,
    ):
        for name in ROBOTS:
            live(browser, name)
        yield place, browser


class Mover:
    """A robot with one joint, whose position is the frame's number times ``STEP``."""

    STEP = 0.001

    def __init__(self, actor: FakeRobot, rate_hz: float) -> None:
        self.actor, self.rate_hz = actor, rate_hz
        self.sent_ns: list[int] = []
        """Time of sending frame number ``i`` (CLOCK_MONOTONIC)."""
        self._stop = threading.Event()

    @contextlib.contextmanager
    def moving(self) -> Iterator[None]:
        thread = threading.Thread(target=self._run)
        thread.start()
        try:
            yield
        finally:
            self._stop.set()
            thread.join()

    def _run(self) -> None:
        begin = time.monotonic()
        while not self._stop.is_set():
            number = len(self.sent_ns)
            pause = begin + number / self.rate_hz - time.monotonic()
            if pause > 0:
                time.sleep(pause)
            self.sent_ns.append(time.monotonic_ns())
            self.actor.put("state", self.actor.frame((number * self.STEP,)))

    def latencies_ms(self, seen: Sequence[Sequence[tuple[int, float]]]) -> list[float]:
        """Return the times from sending a frame to the arrival of its message."""
        return [(at_ns - self.sent_ns[round(value / self.STEP)]) / 1e6 for reader in seen for at_ns, value in reader]


class Readers:
    """A child process with many subscribers."""

    def __init__(self, port: int, how: str, count: int, path: str) -> None:
        command = [sys.executable, "-P", str(READERS), str(port), how, str(count), path]
        self._child = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)  # noqa: S603
        assert self._child.stdin is not None and self._child.stdout is not None
        self._in, self._out = self._child.stdin, self._child.stdout
        assert self._out.readline() == "ready\n", "the readers did not get their first messages"

    def counted(self) -> dict[str, Any]:
        self._in.write("\n")
        self._in.flush()
        answer: dict[str, Any] = json.loads(self._out.readline())
        return answer

    def close(self) -> None:
        self._in.close()
        self._child.wait()
        self._out.close()
