"""Watches motions that rely on each other's times: one that another would meet is cancelled, and its robot brakes.

While both keep their times, nothing is to be checked. Once one of them does not, because it is slower, stands, has
ended early or is lost, the rests of both are checked among the robots as they move now, that of the later one first.
"""

import asyncio
import logging
import time
from collections.abc import Callable, Mapping
from types import TracebackType
from typing import Self

from linked_fleet_base.errors import MotionRefused
from linked_fleet_gateway.api import Invocation, InvocationState, cancel_tasks, supervised
from linked_fleet_gateway.extensions.world.checks import Checks
from linked_fleet_gateway.extensions.world.collisions import Collides
from linked_fleet_gateway.extensions.world.in_time import Pair
from linked_fleet_gateway.extensions.world.path_watch import Cancel, end
from linked_fleet_gateway.extensions.world.schedules import START_S, Run
from linked_fleet_state.robot import Robot

log = logging.getLogger(__name__)

OFF_TIME = "it and another robot relied on each other's times, which one of them has not kept: "
"""The reason by which a motion is cancelled begins like this."""
LOOK_S = 0.1
_BEGINNING_S = START_S + 1.0
"""Within this time after its check, a motion has begun and its agent has said so."""

Get = Callable[[str], Invocation | None]


class MotionWatch:
    """An async context manager. ``get`` returns an invocation, ``cancel`` ends one for a reason (``Core.cancel``)."""

    def __init__(self, checks: Checks, robots: Mapping[str, Robot], get: Get, cancel: Cancel) -> None:
        self._checks, self._robots, self._get, self._cancel = checks, robots, get, cancel
        self._tasks = list[asyncio.Task[None]]()
        self._ending = dict[str, asyncio.Task[None]]()

    async def __aenter__(self) -> Self:
        self._tasks = [supervised(self._tick, "motions in time", log, "a motion in time is not watched", LOOK_S)]
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        await cancel_tasks([*self._tasks, *self._ending.values()])

    async def _tick(self) -> None:
        await asyncio.sleep(LOOK_S)
        await self.look()

    async def look(self) -> None:
        """Judge the motions that rely on each other anew, as far as they do not keep their times."""
        self._ending = {id: task for id, task in self._ending.items() if not task.done()}
        pairs = self._checks.pairs
        for pair, found_s in list(pairs.items()):
            running = [each for each in map(self._running, pair) if each is not None]
            if self._is_over(pair, running):
                del pairs[pair]
            elif not self._is_kept(pair, found_s):
                await self._judge(running)

    def _running(self, run: Run) -> Invocation | None:
        found = self._get(run.invocation)
        return None if found is None or found.state.terminal else found

    def _is_over(self, pair: Pair, running: list[Invocation]) -> bool:
        """Return True if none of two motions needs the times of the other any more.

        One that has succeeded stands where the other was found free of it, however late that is.
        """
        states = [None if (found := self._get(run.invocation)) is None else found.state for run in pair]
        return not running or InvocationState.SUCCEEDED in states

    def _is_kept(self, pair: Pair, found_s: float) -> bool:
        return self._keeps(pair.other) and (self._keeps(pair.one) or self._is_beginning(pair.one, found_s))

    def _keeps(self, run: Run) -> bool:
        robot = self._robots.get(run.robot)
        found = None if robot is None else self._checks.on_time(robot)
        return found is not None and found.run == run

    def _is_beginning(self, run: Run, found_s: float) -> bool:
        found = self._running(run)
        return found is not None and found.started_ns is None and time.monotonic() - found_s < _BEGINNING_S

    async def _judge(self, running: list[Invocation]) -> None:
        """End the first of these motions whose rest would meet something, or cannot be checked.

        The end is not awaited: a lost agent does not answer, and the other robot must not wait for that.
        """
        for motion in (each for each in running if each.id not in self._ending):
            try:
                await self._checks.check_rest(Run(motion.robot, motion.id))
            except MotionRefused as error:
                what = error.reason if isinstance(error, Collides) else "its rest could not be checked"
                ending = end(self._cancel, motion, OFF_TIME + what)
                self._ending[motion.id] = asyncio.create_task(ending, name=f"end {motion.id}")
                return
