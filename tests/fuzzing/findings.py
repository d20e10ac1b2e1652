"""The findings of a target, and the loop for targets without processes."""

import logging
import signal
import time
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from random import Random
from types import FrameType

from bench.scene import rss_kib
from linked_fleet_runtime.log import TextFormatter

EPISODE = 500
"""Inputs that share a state. Each episode starts anew, so that its inputs alone reproduce a finding."""
SLOWEST_S = 5.0
"""Limit of processor time for one input of a target without processes; the slowest takes some 50 ms."""
GROWTH_KIB = 48 * 1024
"""Limit of a process's growth after its warm-up, independent of the number of inputs."""
_MOST_TOLD = 20


@dataclass(frozen=True)
class Finding:
    """What went wrong, and the command that reproduces it."""

    what: str
    command: str
    detail: str


@dataclass
class Tally:
    """The result of a run of one target. Similar findings are merged and counted."""

    target: str
    seed: int
    inputs: int = 0
    seconds: float = 0.0
    findings: dict[str, Finding] = field(default_factory=dict)
    repeats: dict[str, int] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)

    def found(self, what: str, first: int, count: int, detail: str) -> None:
        self.repeats[what] = self.repeats.get(what, 0) + 1
        if what not in self.findings and len(self.findings) < _MOST_TOLD:
            command = f"python -m fuzzing --only {self.target} --seed {self.seed} --first {first} --count {count}"
            self.findings[what] = Finding(what, command, detail[:4000])

    def grew(self, warm_kib: int, end_kib: int, who: str) -> None:
        """Record the memory of a process, and a finding if it is too much."""
        self.notes.append(f"{who} {warm_kib / 1024:.0f} → {end_kib / 1024:.0f} MiB")
        if end_kib - warm_kib > GROWTH_KIB:
            self.found(f"{who} grew", 0, self.inputs, f"from {warm_kib} KiB after its warm-up to {end_kib} KiB")


class _Log(logging.Handler):
    """Formats log records without writing them; an error while formatting, or a logged error, is a finding."""

    def emit(self, record: logging.LogRecord) -> None:
        self.format(record)
        if record.levelno >= logging.ERROR:
            raise LoggedError(self.format(record))


@contextmanager
def _listening() -> Iterator[None]:
    logger, handler = logging.getLogger(), _Log()
    before, logger.handlers = logger.handlers, [handler]
    handler.setFormatter(TextFormatter())
    try:
        yield
    finally:
        logger.handlers = before


class LoggedError(AssertionError):
    """An error was logged, but not raised."""


class TooSlowError(Exception):
    """An input took more than SLOWEST_S of processor time."""


def random_of(seed: int, index: int) -> Random:
    """Return the random generator of one input, which depends only on its number."""
    return Random(seed << 40 | index)


@contextmanager
def _bounded_time() -> Iterator[Callable[[], None]]:
    """Yield a function that restarts the time limit."""

    def ring(number: int, frame: FrameType | None) -> None:
        raise TooSlowError(f"more than {SLOWEST_S:g} s of processor time")

    before = signal.signal(signal.SIGVTALRM, ring)
    try:
        yield lambda: signal.setitimer(signal.ITIMER_VIRTUAL, SLOWEST_S) and None
    finally:
        signal.setitimer(signal.ITIMER_VIRTUAL, 0)
        signal.signal(signal.SIGVTALRM, before)


def in_process(target: str, count: int, seed: int, first: int, begin: Callable[[], Callable[[Random], None]]) -> Tally:
    """``begin`` creates the state of an episode and returns a function for one input; any exception is a finding."""
    tally, started, warm_kib = Tally(target, seed), time.monotonic(), 0
    take: Callable[[Random], None] | None = None
    with _listening(), _bounded_time() as wind_up:
        for index in range(first, first + count):
            if take is None or index % EPISODE == 0:
                take = begin()
            if index - first == count // 3:
                warm_kib = rss_kib_of_self()
            wind_up()
            try:
                take(random_of(seed, index))
            except Exception as error:  # noqa: BLE001 (targets catch permitted exceptions)
                from_ = index - index % EPISODE
                tally.found(_name(error), from_, index - from_ + 1, "".join(traceback.format_exception(error)))
            tally.inputs += 1
    tally.seconds = time.monotonic() - started
    tally.grew(warm_kib, rss_kib_of_self(), "this process")
    return tally


def rss_kib_of_self() -> int:
    return rss_kib(int(Path("/proc/self").readlink().name))


def _name(error: Exception) -> str:
    """Return the place of an error, by which repeated findings are merged."""
    last = traceback.extract_tb(error.__traceback__)[-1]
    said = str(error).splitlines()[0][:120] if str(error) else ""
    place = f"{Path(last.filename).name}:{last.lineno}"
    return f"{type(error).__name__} at {place}" + (f": {said}" if isinstance(error, AssertionError) else "")
