"""Discovery of agents by their liveliness tokens and descriptions.

A token costs its sender nothing, so its cost here is bounded, in memory and in queries, by
``linked_fleet_state.presence``. Robots that have described themselves before, and robots that send frames, have queues
of their own. Sending a query takes Zenoh time proportional to the number of tokens, a few milliseconds for 10,000, so
queries are paced by the time that they take.
"""

import asyncio
import logging
from collections.abc import Awaitable, Callable, Coroutine, Sequence
from contextlib import suppress

from linked_fleet_agent.wire.messages import Description
from linked_fleet_runtime.background import cancel_tasks
from linked_fleet_state.answers import read_description
from linked_fleet_state.events import Appeared, Described, DescriptionRejected, Event, Vanished
from linked_fleet_state.presence import Bounds, DescriptionQueue, Presence, PresenceCheck, Token

_log = logging.getLogger(__name__)

FEW = Bounds(open=64, repeated=16, repeats_hz=50)
MANY = Bounds(open=256, repeated=16, repeats_hz=50)
MAX_KNOWN = 20_000
SILENT_QUESTIONS = 3  # before a robot without a description is called faulty
_STARTS = 8  # queries started in one callback, for each queue
_SHARE = 0.25  # share of a processor for sending queries, unless one takes longer than _SHARE * _IDLE_S
_TICK_S = 0.004
_IDLE_S = 0.05
_HASTE_S = 1.0  # delay before a robot that has described itself this recently is queried for its next run
_LEAVING_S = 0.05  # agents and gateways withdraw tokens and declare them again (agents/linked_fleet_agent/gateways.py)
_RELIST_S = 5.0
_RENEW_S = 5.0  # between two renewals of the gateway's declarations
_MAX_REASON = 500
_MANY = 64  # robots without a description that cause a log message, repeated at each doubling

Judge = Callable[[bytes | str, str], list[Description] | None]
Ask = Callable[[str, Judge], Awaitable[None]]
"""Query the agents of a robot, and pass each reply to the judge until it returns a result. Raises TimeoutError."""
ListTokens = Callable[[], Awaitable[tuple[Sequence[Token], bool]]]
"""Returns all present tokens, the highest run of each robot first, and True if the list is certainly complete."""


class Discovery:
    """Discovery of runs. ``tell`` gets the events, except those that ``apply_token`` returns. Used on the event loop.

    ``appeared`` is called for each new run, ``redeclare`` if frames of a live robot do not arrive.
    """

    def __init__(
        self,
        ask: Ask,
        list_tokens: ListTokens,
        tell: Callable[[list[Event]], None],
        appeared: Callable[[], None],
        redeclare: Callable[[], Coroutine[None, None, None]],
    ) -> None:
        self._ask, self._list_tokens, self._tell, self._appeared = ask, list_tokens, tell, appeared
        self._redeclare, self._declared_s = redeclare, -_RENEW_S
        self._loop = asyncio.get_running_loop()
        self._presence = Presence()
        self._known, self._audible = DescriptionQueue(FEW), DescriptionQueue(FEW)
        self._strangers = DescriptionQueue(MANY)
        self._sending_s = self._paced_s = self._due_s = 0.0
        self._described_s: dict[str, float] = {}
        self._missing: dict[str, set[int]] = {}
        self._checks: dict[Token, PresenceCheck] = {}
        self._silent = set[Token]()
        self._leaving: dict[Token, asyncio.TimerHandle] = {}
        self._reported: dict[str, str] = {}
        self._gone: set[Token] | None = None
        self._many = _MANY
        # a thousand simultaneous descriptions are processed one by one, with turns for others between
        self._taking = asyncio.Lock()
        self._tasks: set[asyncio.Task[None]] = set()
        self._relisting: asyncio.Task[None] | None = None
        self._relist_due = False
        self._timer: asyncio.Handle | None = None  # uvloop's handle has no ``when``

    @property
    def undescribed_count(self) -> int:
        """Number of robots with a token and no description."""
        return self._presence.undescribed_count

    async def close(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
        for leaving in self._leaving.values():
            leaving.cancel()
        await cancel_tasks(self._tasks)

    def apply_token(self, token: Token, present: bool) -> list[Event]:
        """Apply a change of one token. A token that is declared again at once has not gone."""
        leaving = self._leaving.pop(token, None)
        if leaving is not None:
            leaving.cancel()
        if present:
            return self._add(token, evict=True)
        self._leaving[token] = self._loop.call_later(_LEAVING_S, self._leave, token)
        return []

    def _leave(self, token: Token) -> None:
        del self._leaving[token]
        self._tell(self._remove(token))

    def record_frame(self, robot: str) -> None:
        """Record a frame, perhaps of a robot without a description."""
        if robot in self._strangers:
            self._audible.add(robot, self._loop.time(), self._strangers.discard(robot))
            self._ask_soon(0)

    def verify_presence(self, check: PresenceCheck) -> None:
        """Query if a described run is alive. A run that does not answer is reported as vanished."""
        robot, run = check.token
        if check.token in self._presence and run not in self._missing.get(robot, ()):
            self._checks[check.token] = check
            self._missing.setdefault(robot, set()).add(run)
            self._known.add(robot, self._loop.time())
            self._ask_soon(0)

    def record_send_time(self, processor_s: float) -> None:
        """Record the processor time for sending a query, in seconds."""
        self._sending_s += (processor_s - self._sending_s) / 8

    def relist(self) -> None:
        """Schedule a comparison with all tokens, because some changes were lost."""
        self._relist_due = True
        if self._relisting is None:
            self._relisting = self._start(self._relist())

    def _add(self, token: Token, evict: bool) -> list[Event]:
        robot, run = token
        if token in self._presence:
            return []
        events = list[Event]()
        known = robot in self._described_s
        if self._presence.is_full and not known and not self._presence.runs(robot) and evict:
            events += self._evict()
        try:
            dropped = self._presence.add(token, known)
        except OverflowError:
            return events
        if dropped == token:
            return events
        if dropped is not None:
            events.append(Vanished(*dropped))
            self._unwant(*dropped)
        self._missing.setdefault(robot, set()).add(run)
        now_s = self._loop.time()
        hasty = now_s - self._described_s.get(robot, -_HASTE_S) < _HASTE_S
        self._queue(robot).add(robot, now_s, SILENT_QUESTIONS if hasty else 0)
        self._ask_soon(0)
        self._warn()
        self._appeared()
        return [*events, Appeared(robot, run)]

    def _remove(self, token: Token) -> list[Event]:
        robot, run = token
        if self._gone is not None:
            self._gone.add(token)
        if token not in self._presence:
            return []
        self._presence.remove(token)
        self._unwant(robot, run)
        if not self._presence.runs(robot):
            self._reported.pop(robot, None)
        if self._presence.incomplete:
            self.relist()
        self._warn()
        return [Vanished(robot, run)]

    def _evict(self) -> list[Event]:
        """Forget the robot that most often has not answered, although its token is present."""
        robot = self._strangers.most_failed()
        if robot is None:
            return []
        self._strangers.discard(robot)
        self._missing.pop(robot, None)
        self._reported.pop(robot, None)
        return [Vanished(robot, run) for run in self._presence.forget(robot)]

    # -- descriptions -------------------------------------------------------------------------------------------------

    def _queue(self, robot: str) -> DescriptionQueue:
        return self._known if robot in self._described_s else self._strangers

    def _ask_soon(self, delay_s: float) -> None:
        due_s = max(self._loop.time() + delay_s, self._paced_s)
        if self._timer is not None:
            if self._due_s <= due_s + _TICK_S:
                return
            self._timer.cancel()
        self._due_s, self._timer = due_s, self._loop.call_at(due_s, self._begin)

    def _begin(self) -> None:
        """Start queries, a few in one callback, so that a flood of tokens leaves time for other work."""
        self._timer, now_s, begun = None, self._loop.time(), 0
        queues = (self._known, self._audible, self._strangers)
        most = max(1, min(_STARTS, int(_SHARE * _TICK_S / self._sending_s))) if self._sending_s else _STARTS
        for queue in queues:
            for _ in range(most):
                robot = queue.take(now_s)
                if robot is None:
                    break
                begun += 1
                self._start(self._question(queue, robot))
        if begun or any(map(len, queues)):
            self._paced_s = now_s + min(_IDLE_S, begun * self._sending_s / _SHARE)
            self._ask_soon(_TICK_S if begun else _IDLE_S)

    async def _question(self, queue: DescriptionQueue, robot: str) -> None:
        reasons = [""]
        found = list[Description]()

        def judge(answer: bytes | str, _: str) -> list[Description] | None:
            missing = self._missing.get(robot, set())
            said, reason = read_description(answer, robot, self._presence.runs(robot))
            if said is None:
                reasons.append(reason)
            elif said.incarnation in missing:
                found.append(said)
            # Of the missing runs some, or all, may have gone meanwhile.
            return found if found and found[-1].incarnation >= max(missing, default=0) else None

        begin_s = self._loop.time()
        try:
            with suppress(TimeoutError):  # results found before a timeout count
                await self._ask(robot, judge)
            took_s = self._loop.time() - begin_s
            for said in found:
                async with self._taking:
                    self._take(said)
                    await asyncio.sleep(0)
        except Exception:
            # Whatever failed, the query must not keep its place in the queue. ``_ended`` logs the error.
            queue.requeue(robot, self._loop.time())
            raise
        missing = self._missing.get(robot)
        if not missing:
            queue.complete(robot, took_s)
            return
        asked = queue.requeue(robot, self._loop.time())
        if asked >= SILENT_QUESTIONS:
            self._give_up({(robot, run) for run in missing})
        if (robot, max(missing)) in self._checks:
            return
        reason = reasons[-1][:_MAX_REASON]
        told = self._reported.get(robot, "")
        # Silence may come from an agent under load; an invalid description is reported at once.
        if not found and asked and ((reason and reason != told) or (asked >= SILENT_QUESTIONS and not told)):
            reason = reason or "the agent is present but does not answer when asked for its description"
            self._reported[robot] = reason
            self._tell([DescriptionRejected(robot, max(missing), reason)])

    def _take(self, said: Description) -> None:
        robot, run = said.robot, said.incarnation
        if run not in self._missing.get(robot, ()):
            return  # the run ended while the query was running
        check, silent = self._checks.get((robot, run)), (robot, run) in self._silent
        self._unwant(robot, run)
        self._presence.describe(robot)
        self._reported.pop(robot, None)
        self._described_s.pop(robot, None)
        self._described_s[robot] = self._loop.time()
        if len(self._described_s) > MAX_KNOWN:
            del self._described_s[next(iter(self._described_s))]
        self._tell([Appeared(robot, run), Described(said)] if silent else [Described(said)])
        if check is not None and check.renew and self._loop.time() >= self._declared_s + _RENEW_S:
            _log.warning("robot %s answers and sends no frames: the gateway declares itself to Zenoh anew", robot)
            self._declared_s = self._loop.time()
            self._start(self._redeclare())

    def _give_up(self, runs: set[Token]) -> None:
        """Report runs as vanished that neither send nor answer. They are still queried while their token is present."""
        lost = self._checks.keys() & runs - self._silent
        self._silent |= lost
        if lost:
            self._tell([Vanished(*token) for token in lost])

    def _unwant(self, robot: str, run: int) -> None:
        self._checks.pop((robot, run), None)
        self._silent.discard((robot, run))
        missing = self._missing.get(robot, set())
        missing.discard(run)
        if not missing:
            self._missing.pop(robot, None)
            for queue in (self._known, self._audible, self._strangers):
                queue.discard(robot)

    # -- tokens that are not kept -------------------------------------------------------------------------------------

    async def _relist(self) -> None:
        try:
            while self._relist_due:  # again if a token went while the list was being processed
                await asyncio.sleep(_RELIST_S)
                self._relist_due = False
                await self._take_list()
        finally:
            self._gone, self._relisting = None, None

    async def _take_list(self) -> None:
        """Add refused or lost tokens while there is room, and remove those that are gone."""
        self._gone, before = set(), self._presence.tokens
        listed, complete = await self._list_tokens()
        gone, self._gone = self._gone, None
        self._presence.incomplete = False
        for token in before.difference(listed) if complete else ():
            await self._tell_of(self._remove(token))
        for token in listed:  # the highest run of each robot first
            if token not in gone:
                await self._tell_of(self._add(token, evict=False))

    async def _tell_of(self, events: list[Event]) -> None:
        if events:
            self._tell(events)
            await asyncio.sleep(0)

    def _warn(self) -> None:
        count = self._presence.undescribed_count
        if count >= self._many:
            self._many *= 2
            _log.warning("%d robots have a presence token and no description", count)
        elif count < _MANY:
            self._many = _MANY

    def _start(self, work: Coroutine[None, None, None]) -> asyncio.Task[None]:
        task = self._loop.create_task(work)
        self._tasks.add(task)
        task.add_done_callback(self._ended)
        return task

    def _ended(self, task: asyncio.Task[None]) -> None:
        self._tasks.discard(task)
        if not task.cancelled() and (error := task.exception()) is not None:
            _log.error("a question to an agent failed", exc_info=error)
