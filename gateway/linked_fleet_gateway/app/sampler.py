"""Periodic measurements that cost nothing per frame: event loop lag and age of frames."""

import asyncio
import logging
import time
from types import TracebackType
from typing import Self

from linked_fleet_gateway.fleet.fleet import Fleet
from linked_fleet_gateway.runtime.background import end, sliced, supervised
from linked_fleet_gateway.runtime.metrics import Histogram

log = logging.getLogger(__name__)

_PERIOD_S = 0.25
_ROUND = 4  # periods between two samples of frames


class Sampler:
    """An async context manager. ``loop_lag`` is the lateness of timers of the event loop.

    ``frame_lag`` is the time from the agent's reading of its robot to the arrival at the gateway, sampled once a second
    for the latest frame of each robot; it includes the difference of both clocks.
    """

    def __init__(self, fleet: Fleet) -> None:
        self.loop_lag, self.frame_lag = Histogram(), Histogram()
        self._fleet = fleet
        self._seen: dict[str, tuple[int, int]] = {}
        self._tasks: list[asyncio.Task[None]] = []

    async def __aenter__(self) -> Self:
        self._tasks = [supervised(self._sample, "sample", log, "delays are not measured", 0.0)]
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        await end(self._tasks)

    async def _sample(self) -> None:
        for _ in range(_ROUND):
            due_s = time.monotonic() + _PERIOD_S
            await asyncio.sleep(_PERIOD_S)
            self.loop_lag.add(time.monotonic() - due_s)
        await self._look_at_frames()

    async def _look_at_frames(self) -> None:
        names = list(self._fleet.robots)
        for name in self._seen.keys() - set(names):
            del self._seen[name]
        async for name in sliced(names):
            robot = self._fleet.robots.get(name)
            if robot is None:
                continue  # forgotten meanwhile
            header, taken_ns = robot.header, robot.last_seen_ns
            if header is not None and taken_ns is not None:
                frame = (header.incarnation, header.sequence)
                if self._seen.get(robot.name) != frame:
                    self._seen[robot.name] = frame
                    self.frame_lag.add((taken_ns - header.wall_ns) / 1e9)
