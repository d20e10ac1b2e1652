"""The stream of inputs of a running action, as the agent judges it and as the method of the action reads it.

Times are nanoseconds or seconds of the agent's monotonic clock, and are passed in: nobody else's clock decides what is
late. There is no queue: of several samples that arrive before the method reads, it gets the newest.
"""

import asyncio
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple, Self

from msgspec.structs import replace

from linked_fleet_agent.wire.components import Sample, StreamLimits
from linked_fleet_agent.wire.messages import StreamCounts


class Given(NamedTuple):
    """An input of a stream, by parameter of the action. It holds until ``until_s``."""

    input: Mapping[str, Any]
    until_s: float


Read = Callable[[bytes], Mapping[str, Any] | None]
"""Returns an input by parameter, or None if it violates the schema."""


class InputStream:
    """Judges samples, and yields what may be applied; for one event loop.

    As an asynchronous iterator it yields the newest ``Given``, and None once when the last one does not hold any more:
    the action then brings to rest what it moves, and goes on with the next one.
    """

    def __init__(self, limits: StreamLimits, read: Read, now_ns: int) -> None:
        self.limits, self._read = limits, read
        self.counts = StreamCounts()
        self._number = -1
        self._heard_ns = self._applied_ns = now_ns
        self._next: Given | None = None
        self._has_next = False
        self._woken: asyncio.Future[None] | None = None

    def offer(self, sample: Sample, now_ns: int) -> bool:
        """Judge a sample. Return True if it is applied."""
        self._heard_ns = max(self._heard_ns, now_ns)
        found = self._verdict(sample, now_ns)
        given = self._read(bytes(sample.input)) if found == "applied" else None
        found = "invalid" if found == "applied" and given is None else found
        self.counts = replace(self.counts, **{found: getattr(self.counts, found) + 1})
        if given is None:
            return False
        self._number, self._applied_ns = sample.number, now_ns
        self.counts = replace(self.counts, silent=False)
        self._yield(Given(given, now_ns / 1e9 + self.limits.silence_s))
        return True

    def _verdict(self, sample: Sample, now_ns: int) -> str:
        """Return the name of the count that a sample belongs to."""
        if sample.seen_ns > now_ns:
            return "future"
        if now_ns - sample.seen_ns > self.limits.age_s * 1e9:
            return "late"
        return "applied" if sample.number > self._number else "reordered"

    def step(self, now_ns: int) -> str:
        """Notice silence. Return a sentence once the stream has to end, else an empty string. Called in each tick."""
        if not self.counts.silent and now_ns - self._applied_ns > self.limits.silence_s * 1e9:
            self.counts = replace(self.counts, silent=True)
            self._yield(None)
        if now_ns - self._heard_ns > self.limits.end_s * 1e9:
            return f"no sample came for {self.limits.end_s:g} s"
        return ""

    def _yield(self, given: Given | None) -> None:
        self._next, self._has_next = given, True
        if self._woken is not None and not self._woken.done():
            self._woken.set_result(None)

    def __aiter__(self) -> Self:
        return self

    async def __anext__(self) -> Given | None:
        while not self._has_next:
            self._woken = asyncio.get_running_loop().create_future()
            await self._woken
        self._has_next = False
        return self._next
