"""Delivery of stops: each is owed until its agent confirms it, and sent again whenever that agent is heard from.

The memory of this process suffices for that. What it owes is also in Redis, so that another gateway sends the stop if
this one dies, or if that one hears the robot and this one does not. Nothing waits for Redis. A gateway that missed a
confirmation sends the stop once more.
"""

import asyncio
import logging
import time
from collections.abc import Callable, Collection
from functools import partial
from types import TracebackType
from typing import Self

from linked_fleet_agent.wire.messages import Accepted, Refused, Reply, Stop
from linked_fleet_gateway.actions.owed_stop_table import OwedStopTable
from linked_fleet_gateway.actions.refusals import name_some, owed_stop_refusal
from linked_fleet_gateway.subscriptions.live import Live
from linked_fleet_identity.rights import View
from linked_fleet_runtime.background import cancel_tasks, run_last_step, supervised
from linked_fleet_state.owed_stops import Key, OwedStop, OwedStops

log = logging.getLogger(__name__)

ANSWER_TIMEOUT_S = 2.0
_PAUSE_S = 0.1
"""Pause after an unanswered repetition, before the next one at a frame of the robot."""
_WRITE_AFTER_S = 0.05
"""Delay before an owed stop is written to Redis, because most are confirmed within milliseconds."""
_AT_ONCE = 500  # written together


class StopDelivery:
    """Sends stops and remembers them until they are confirmed; an async context manager.

    ``on_late_reply`` is called with robot, stop and reply when a repeated stop is answered.
    """

    def __init__(self, live: Live, table: OwedStopTable) -> None:
        self._live, self._table = live, table
        self._owed = OwedStops()
        self._replies: dict[str, dict[str, Reply]] = {}
        """The replies to stops whose caller waits for them, by id of the stop and robot."""
        self._heard: dict[str, asyncio.Event] = {}
        """Set when the robot was heard from, for each robot with a task that repeats its stops."""
        self._repeating: set[asyncio.Task[None]] = set()
        self._unwritten: dict[Key, None] = {}
        self._written: set[Key] = set()
        self._to_write = asyncio.Event()
        self._tasks: list[asyncio.Task[None]] = []
        self.on_late_reply: Callable[[str, Stop, Reply], None] = lambda robot, stop, reply: None
        live.on_heard = self._hear

    async def __aenter__(self) -> Self:
        self._tasks = [supervised(self._write, "write owed stops", log, "owed stops are not shared", 0.0)]
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        await cancel_tasks([*self._tasks, *self._repeating])
        if self._unwritten:
            await run_last_step(self._write_all(), log, "the last owed stops could not be shared")

    # -- sending ----------------------------------------------------------------------------------------------------

    async def send(self, robots: Collection[str] | None, stop: Stop) -> dict[str, Reply]:
        """Stop robots, or all of them. Return the replies that arrive within ``ANSWER_TIMEOUT_S``, by robot.

        The robots without a reply are owed the stop, and those that are offline too.
        """
        asked, asked_ns = self.known_robots() if robots is None else tuple(robots), time.time_ns()
        for robot in asked:
            self._owe(OwedStop(robot, stop, asked_ns))
        replies = self._replies[stop.id] = {}
        try:
            await self._live.halt(robots, stop, ANSWER_TIMEOUT_S, partial(self._note_reply, stop))
        finally:
            del self._replies[stop.id]
            for robot in asked:
                self._expect(robot)
        silent = [robot for robot in asked if robot not in replies and self.is_owed(robot, stop.id)]
        if silent:
            log.warning("stop %s is not confirmed and sent again when heard from: %s", stop.id, name_some(silent))
        return replies

    def reached(self, named: tuple[str, ...] | None, stops: View) -> tuple[str, ...] | None:
        """Return the robots of a stop that a caller may stop; None for all, known or not."""
        if named is not None or stops.includes_all:
            return named
        return tuple(name for name in self.known_robots() if stops.includes(name))

    def known_robots(self) -> tuple[str, ...]:
        """Return all robots that are known, or that this gateway has not met yet and another one has moved."""
        return tuple(dict.fromkeys((*self._live.fleet.robots, *self._live.invocations.robots_with_open())))

    def owes(self, robot: str) -> bool:
        """Return True if the robot has not confirmed some stop."""
        return robot in self._owed

    def is_owed(self, robot: str, id: str) -> bool:
        """Return True if the robot is owed the stop of this id, or of the motion of this id."""
        return any(id in (each.stop.id, each.stop.command) for each in self._owed.of_robot(robot))

    @property
    def robot_count(self) -> int:
        """Number of robots that are owed a stop."""
        return len(self._owed)

    def check_motion(self, robot: str) -> None:
        """Raise StopOwed if a motion of the robot would overtake a stop that its agent has not confirmed."""
        owed = self._owed.of_robot(robot)
        if owed:
            raise owed_stop_refusal(robot, owed[0].asked_ns)

    def note_progress(self, robot: str, id: str) -> None:
        """Note that a robot reports on the command or stop of this id, which confirms a stop."""
        self._settle((robot, id))

    # -- other gateways ---------------------------------------------------------------------------------------------

    async def load(self) -> None:
        """Adopt the stops that other runs of gateways owe. Raises RedisUnavailable."""
        for owed in await self._table.read_all():
            self._adopt(owed)
        self._unwritten |= dict.fromkeys(key for key in self._written if self._owed.get(key) is not None)
        self._to_write.set()

    async def refresh(self, key: Key) -> None:
        """Read what another gateway has changed. Raises RedisUnavailable."""
        owed = await self._table.read(key)
        if owed is not None:
            self._adopt(owed)
        elif key not in self._unwritten and self._remove(key):
            self._written.discard(key)
            log.info("stop %s of %s was confirmed to another gateway", key[1], key[0])

    def _adopt(self, owed: OwedStop) -> None:
        if owed.key in self._unwritten or self._owed.get(owed.key) is not None:
            return
        self._written.add(owed.key)
        self._drop(self._owed.add(owed))
        robot = self._live.fleet.robots.get(owed.robot)
        if robot is not None and robot.online:
            self._hear(owed.robot)
        else:
            self._expect(owed.robot)

    async def _write(self) -> None:
        await self._to_write.wait()
        await asyncio.sleep(_WRITE_AFTER_S)
        self._to_write.clear()
        await self._write_all()

    async def _write_all(self) -> None:
        """Write what is owed and has not been written, and remove what has been written and is settled."""
        while self._unwritten:
            keys = list(self._unwritten)[:_AT_ONCE]
            owed = [each for each in map(self._owed.get, keys) if each is not None]
            settled = [key for key in keys if key in self._written and self._owed.get(key) is None]
            self._written.update(each.key for each in owed)
            try:
                await self._table.write(owed)
                await self._table.remove(settled)
            except BaseException:  # also cancellation
                self._to_write.set()
                raise
            self._written.difference_update(settled)
            for key in keys:
                if (self._owed.get(key) is None) == (key not in self._written):  # unless it was settled meanwhile
                    del self._unwritten[key]

    # -- memory -----------------------------------------------------------------------------------------------------

    def _owe(self, owed: OwedStop) -> None:
        self._drop(self._owed.add(owed))
        self._change(owed.key)

    def _drop(self, replaced: Collection[Key]) -> None:
        for key in replaced:
            self._change(key)

    def _change(self, key: Key) -> None:
        self._unwritten[key] = None
        self._to_write.set()

    def _settle(self, key: Key) -> None:
        if self._remove(key):
            self._change(key)

    def _remove(self, key: Key) -> bool:
        settled, heard = self._owed.settle(key) is not None, self._heard.get(key[0])
        if heard is not None and key[0] not in self._owed:
            heard.set()  # the task that repeats them ends
        return settled

    def _note_reply(self, stop: Stop, robot: str, reply: Reply) -> None:
        """Settle a stop that its agent has answered. A refusal settles it too: repeating it would change nothing."""
        self._settle((robot, stop.id))
        waiting = self._replies.get(stop.id)
        if waiting is not None:
            if not isinstance(waiting.get(robot), Accepted):
                waiting[robot] = reply
            return
        if isinstance(reply, Refused):
            log.error("%s refuses the repeated stop %s: %s", robot, stop.id, reply.reason)
        else:
            log.warning("%s has confirmed the repeated stop %s", robot, stop.id)
        self.on_late_reply(robot, stop, reply)

    # -- repetition -------------------------------------------------------------------------------------------------

    def _hear(self, robot: str) -> None:
        """Send owed stops of a robot that was heard from."""
        heard = self._heard.get(robot)
        if heard is not None:
            heard.set()
        if heard is not None or robot not in self._owed:
            return
        self._heard[robot] = asyncio.Event()
        task = asyncio.create_task(self._repeat(robot), name=f"stop {robot} again")
        self._repeating.add(task)
        task.add_done_callback(self._ended)

    def _expect(self, robot: str) -> None:
        """Let the next frame of the robot count as hearing from it, if it is owed a stop."""
        if robot in self._owed:
            self._live.hear_next_frame(robot)

    async def _repeat(self, robot: str) -> None:
        """Send the owed stops of a robot at once, and again at each sign of life until it has confirmed them."""
        heard = self._heard[robot]
        try:
            while True:
                heard.clear()
                for owed in self._owed.of_robot(robot):
                    await self._live.halt((robot,), owed.stop, ANSWER_TIMEOUT_S, partial(self._note_reply, owed.stop))
                if robot not in self._owed:
                    return
                await asyncio.sleep(_PAUSE_S)
                self._expect(robot)
                await heard.wait()
        finally:
            del self._heard[robot]
            self._expect(robot)

    def _ended(self, task: asyncio.Task[None]) -> None:
        self._repeating.discard(task)
        if not task.cancelled() and (error := task.exception()) is not None:
            log.error("a stop could not be sent again", exc_info=error)
