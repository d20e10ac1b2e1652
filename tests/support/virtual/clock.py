"""A clock that only a test advances, replacing those of the module ``time``."""

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from datetime import datetime, tzinfo
from typing import Self
from unittest import mock

from virtual.confined import confined

_EPOCH_NS = 1_893_456_000_000_000_000  # 2030-01-01T00:00:00Z


class Datetime(datetime):
    """A ``datetime`` that reads the module ``time``, for libraries in which a test replaces it."""

    @classmethod
    def now(cls, tz: tzinfo | None = None) -> Self:
        return cls.fromtimestamp(time.time(), tz)


class Clock:
    """Monotonic and wall time in nanoseconds. Wall clocks can be stepped: for all, or for a single process."""

    def __init__(self) -> None:
        self.monotonic_ns = 1_000_000_000_000
        self.wall_ahead_ns = _EPOCH_NS - self.monotonic_ns

    @property
    def monotonic_s(self) -> float:
        return self.monotonic_ns / 1e9

    @property
    def wall_ns(self) -> int:
        process = confined()
        return self.monotonic_ns + self.wall_ahead_ns + (0 if process is None else process.wall_ahead_ns)

    def advance_to(self, monotonic_s: float) -> None:
        """Advance to a time, by at least one nanosecond, so that a due timer always sees that it is due."""
        self.monotonic_ns = max(self.monotonic_ns + 1, round(monotonic_s * 1e9))

    def step_wall(self, by_s: float) -> None:
        """Step the wall clock forward or back, as an operator or NTP does."""
        self.wall_ahead_ns += round(by_s * 1e9)

    @contextmanager
    def patched(self, sleep: Callable[[float], None]) -> Iterator[None]:
        """Make the module ``time`` read this clock; ``time.sleep`` calls ``sleep``.

        Another thread, which an earlier test may have left, sleeps in real time.
        Names that were imported from ``time`` earlier, as by ``threading`` and pytest, keep the real clock.
        """
        readings: dict[str, Callable[..., float]] = {
            "time": lambda: self.wall_ns / 1e9,
            "time_ns": lambda: self.wall_ns,
            "monotonic": lambda: self.monotonic_s,
            "monotonic_ns": lambda: self.monotonic_ns,
            "perf_counter": lambda: self.monotonic_s,
            "perf_counter_ns": lambda: self.monotonic_ns,
            "clock_gettime_ns": lambda clock: self.monotonic_ns,
        }
        own, really = threading.get_ident(), time.sleep

        def pause(seconds: float) -> None:
            (sleep if threading.get_ident() == own else really)(seconds)

        with mock.patch.multiple(time, **readings, sleep=pause):
            yield
