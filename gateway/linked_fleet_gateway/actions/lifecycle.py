"""The life of an invocation, from its registration over the agent's reply and progress to its end.

``Waiters`` lets requests wait until an invocation meets a condition.
"""

import asyncio
import logging
import time
import uuid
from collections.abc import Awaitable, Callable, Coroutine, Iterable
from types import TracebackType
from typing import Self

from linked_fleet_agent.wire.messages import WIRE_VERSION, Accepted, Progress, Refused, Reply, Stop
from linked_fleet_base.errors import AgentTimeout, Conflict
from linked_fleet_gateway.actions.refusals import unanswered_stop
from linked_fleet_gateway.actions.replicated_invocations import ReplicatedInvocations
from linked_fleet_gateway.actions.stop_delivery import ANSWER_TIMEOUT_S
from linked_fleet_gateway.actions.store import ActionStore
from linked_fleet_gateway.resources.invocation import invocation_path
from linked_fleet_gateway.subscriptions.live import Live
from linked_fleet_runtime.background import cancel_tasks, supervised
from linked_fleet_runtime.metrics import CommandMetrics
from linked_fleet_state.invocation import NOT_BEGUN, has_ended, reported_state
from linked_fleet_state.invocations import FLEET, Invocation, InvocationState

log = logging.getLogger(__name__)


class Waiters:
    """Wakes waiters at every change of their invocation."""

    def __init__(self) -> None:
        self._events: dict[str, asyncio.Event] = {}
        self._shutting_down = False

    def shut_down(self) -> None:
        """Release all optional waits, because this gateway ends and others continue."""
        self._shutting_down = True
        for event in self._events.values():
            event.set()
        self._events.clear()

    async def wait_until_or_shutdown(
        self, invocation: Invocation, condition: Callable[[Invocation], bool], timeout_s: float
    ) -> bool:
        """Wait like ``wait_until``, or until the gateway ends. Return True if the condition holds then."""
        await self.wait_until(invocation, lambda one: self._shutting_down or condition(one), timeout_s)
        return condition(invocation)

    async def wait_until(
        self, invocation: Invocation, condition: Callable[[Invocation], bool], timeout_s: float
    ) -> bool:
        """Wait until the condition holds. Return False after ``timeout_s``."""
        try:
            async with asyncio.timeout(timeout_s):
                while not condition(invocation):
                    await self._events.setdefault(invocation.id, asyncio.Event()).wait()
        except TimeoutError:
            return False
        return True

    def wake(self, invocation: Invocation) -> None:
        event = self._events.pop(invocation.id, None)
        if event is not None:
            event.set()


REPORT_TIMEOUT_S = 15.0
"""Time after the answer, or after a report of progress, in which an invocation must be reported again."""
RESUME_TIMEOUT_S = 120.0
"""The same of an operation with which another gateway goes on."""
_FINAL_PROGRESS_S = 1.0  # the end of a motion may arrive after the answer to a stop
_EXPIRY_INTERVAL_S = 1.0
_PATIENCE = 3.0  # factor of the duration stated by the agent, after which a motion is given up
_OWED = "the stop is sent again until the robot answers"
_SILENT = f"unknown: no answer; {_OWED}"


class Lifecycle:
    """Applies to invocations what agents report, stores each state and announces it; an async context manager."""

    def __init__(self, live: Live, store: ActionStore) -> None:
        self._live, self._store = live, store
        self.waiters = Waiters()
        self.replicated_state = ReplicatedInvocations(live, store, self.stop_motion, self.waiters.wake)
        self.stops = self.replicated_state.stops
        self.stops.on_late_reply = self._record_late_reply
        self.command_metrics = CommandMetrics()
        self._tasks: list[asyncio.Task[None]] = []
        self._judging: set[asyncio.Task[None]] = set()
        self._asked: set[str] = set()
        """The late invocations whose agents are being asked."""
        live.on_progress, live.on_lost = self._progressed, self._lost
        # Set by whoever carries out operations: cancels one, and returns whether it has ended.
        self.cancel_operation: Callable[[Invocation, str], Awaitable[bool]] = _cancel_nothing

    async def __aenter__(self) -> Self:
        await self.replicated_state.__aenter__()
        self._tasks = [supervised(self._expire, "expire invocations", log, "what is late stays open", 0.0)]
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        await cancel_tasks([*self._tasks, *self._judging])
        await self.replicated_state.__aexit__(kind, error, trace)

    # -- states -----------------------------------------------------------------------------------------------------

    def register(self, invocation: Invocation) -> Invocation:
        """Register an invocation, unless a repeated request has registered it meanwhile. Return the registered one."""
        self.replicated_state.mark_own(invocation)
        known = self._live.invocations.get(invocation.id)
        if known is None:
            self._live.invocations.add(invocation)
            self._live.fan_out.add_resource(invocation_path(invocation))
        self._announce(known or invocation)
        return known or invocation

    def record_acceptance(self, invocation: Invocation, accepted: Accepted) -> None:
        """Record that the agent has accepted the command, with the duration that it expects."""
        invocation.duration_s = accepted.duration_s
        invocation.preempts = accepted.preempts
        if not invocation.state.terminal:
            patience_s = accepted.duration_s * _PATIENCE + REPORT_TIMEOUT_S
            invocation.deadline_ns = max(invocation.deadline_ns, invocation.created_ns + int(patience_s * 1e9))
        self.replicated_state.save(invocation)
        self._announce(invocation)

    def record_refusal(self, invocation: Invocation, reply: Refused) -> None:
        """Record that the agent has refused the command."""
        invocation.refused = reply.code
        self.fail(invocation, reply.reason)

    def fail(self, invocation: Invocation, reason: str) -> None:
        """End an invocation as failed."""
        self.end(invocation, InvocationState.FAILED, reason)

    def end(self, invocation: Invocation, state: InvocationState, reason: str) -> None:
        """End an invocation in a terminal state."""
        invocation.state, invocation.reason, invocation.ended_ns = state, reason, time.time_ns()
        self._settle(invocation)

    def report_operation(self, invocation: Invocation) -> None:
        """Tell all gateways how far an operation of this gateway is, and that it is carried on."""
        invocation.deadline_ns = time.time_ns() + _patience_ns(invocation)
        self.replicated_state.save(invocation)
        self._announce(invocation)

    def silence_s(self, invocation: Invocation) -> float:
        """Return how long nobody has reported on an operation, in seconds."""
        return (time.time_ns() + _patience_ns(invocation) - invocation.deadline_ns) / 1e9

    def ask_to_cancel(self, invocation: Invocation, reason: str) -> None:
        """Ask the gateway that carries out an operation to cancel it."""
        invocation.cancelling = invocation.cancelling or reason
        self.replicated_state.save(invocation)
        self._announce(invocation)

    def mark_unknown(self, invocation: Invocation) -> None:
        """Record that the agent has not replied, unless it has reported on the invocation meanwhile."""
        if invocation.state is InvocationState.ACCEPTED:
            invocation.state = InvocationState.UNKNOWN
            settles = "progress or the deadline will settle it" if invocation.stops is None else _OWED
            invocation.reason = f"the agent gave no answer; {settles}"
            self.replicated_state.save(invocation)
            self._announce(invocation)

    def record_fleet_replies(
        self, invocation: Invocation, online: Iterable[str], replies: dict[str, Reply]
    ) -> tuple[list[str], list[str]]:
        """Record the replies of robots to a stop of the fleet; a robot without reply stays unknown.

        Return the robots that have not answered, and those that have. A report on the stop is an answer too.
        """
        unanswered = [name for name in online if name not in replies and self._is_silent(invocation, name)]
        for name in unanswered:
            self._live.invocations.answer(invocation, name, _SILENT)
        for name, reply in replies.items():
            self._record_part(invocation, name, reply)
        accepted = [reply for reply in replies.values() if isinstance(reply, Accepted)]
        invocation.preempts = tuple(id for reply in accepted for id in reply.preempts)
        invocation.duration_s = max((reply.duration_s for reply in accepted), default=0.0)
        if not invocation.robots:
            invocation.state, invocation.progress = InvocationState.SUCCEEDED, 1.0
            invocation.reason, invocation.ended_ns = "no robot is online", time.time_ns()
        if invocation.state.terminal:
            self._settle(invocation)
        else:
            self._announce(invocation)
        return unanswered, [name for name in invocation.robots if name not in unanswered]

    def _is_silent(self, invocation: Invocation, robot: str) -> bool:
        """Return True if a robot without a reply has not reported on its part of a stop of the fleet either."""
        return self.stops.owes(robot) and not _is_reported(invocation.robots.get(robot, ""))

    def _record_part(self, invocation: Invocation, robot: str, reply: Reply) -> None:
        """Record the reply of a robot to a stop of the fleet, unless it has reported more already."""
        if isinstance(reply, Refused):
            self._live.invocations.answer(invocation, robot, f"refused: {reply.reason}")
        elif not _is_reported(invocation.robots.get(robot, "")):
            self._live.invocations.answer(invocation, robot, InvocationState.ACCEPTED.value)

    def _record_late_reply(self, robot: str, stop: Stop, reply: Reply) -> None:
        """Record the reply to a stop that was sent again."""
        self.command_metrics.count_reply(robot, reply)
        invocation = self._live.invocations.get(stop.command or stop.id)
        if invocation is None or invocation.is_final:
            return
        if stop.command:
            self._judge(self._judge_stop(invocation, reply))
        elif invocation.robot == FLEET:
            if isinstance(reply, Accepted):
                invocation.preempts += tuple(id for id in reply.preempts if id not in invocation.preempts)
            self._record_part(invocation, robot, reply)
            self._announce(invocation)
        elif isinstance(reply, Refused):
            self.record_refusal(invocation, reply)
        else:
            self.record_acceptance(invocation, reply)

    def _judge(self, judging: Coroutine[None, None, None]) -> None:
        task = asyncio.create_task(judging, name="judge a stop")
        self._judging.add(task)
        task.add_done_callback(self._judging.discard)

    def _settle(self, invocation: Invocation) -> None:
        self.replicated_state.store_end(invocation)
        self._announce(invocation)

    def _announce(self, invocation: Invocation) -> None:
        self._live.mark_invocation_changed(invocation)
        self.waiters.wake(invocation)

    # -- requests ---------------------------------------------------------------------------------------------------

    async def cancel(self, invocation: Invocation, reason: str = "cancelled by a client") -> None:
        """Stop the motion of an invocation. Raises Conflict if it is over, StopUnanswered without a reply."""
        if invocation.state.terminal:
            raise Conflict(f"The invocation has ended already: it {invocation.state}.")
        if invocation.operation:
            if not await self.cancel_operation(invocation, reason):
                raise AgentTimeout("The gateway that carries out this operation has not cancelled it yet; ask again.")
            return
        if invocation.robot == FLEET:
            raise Conflict("Stopping cannot be cancelled; a new motion of a robot ends it.")
        if await self.stop_motion(invocation, reason) is None:
            raise unanswered_stop([invocation.robot], [], "")

    async def delete(self, invocation: Invocation) -> None:
        """Stop an invocation if it is not over, and delete it."""
        if not invocation.state.terminal:
            await self.cancel(invocation, "its invocation is deleted")
            await self._ended(invocation, ANSWER_TIMEOUT_S)
        await self._store.delete(invocation)
        self.replicated_state.forget(invocation.id)

    async def _ended(self, invocation: Invocation, timeout_s: float) -> bool:
        """Wait until the invocation has ended. Return False after ``timeout_s``."""
        return await self.waiters.wait_until(invocation, lambda one: one.state.terminal, timeout_s)

    async def stop_motion(self, invocation: Invocation, reason: str) -> Reply | None:
        """Stop the motion of an invocation. Return the agent's reply, if any.

        An agent that does not know the motion will never start it; an end that has happened is reported.
        """
        stop = Stop(version=WIRE_VERSION, id=str(uuid.uuid4()), command=invocation.id, reason=reason)
        reply = (await self.stops.send((invocation.robot,), stop)).get(invocation.robot)
        self.command_metrics.count_reply(invocation.robot, reply)
        await self._judge_stop(invocation, reply)
        return reply

    async def _judge_stop(self, invocation: Invocation, reply: Reply | None, refused: str = "") -> None:
        """Fail a motion whose agent has accepted its stop and does not know it."""
        unknown = isinstance(reply, Accepted) and invocation.id not in reply.preempts
        if unknown and invocation.stops is None and not await self._ended(invocation, _FINAL_PROGRESS_S):
            invocation.refused = refused
            self.fail(invocation, "the agent knows no such motion")

    # -- reports ----------------------------------------------------------------------------------------------------

    def _progressed(self, robot: str, progress: Progress) -> None:
        self.stops.note_progress(robot, progress.id)
        invocation = self._live.invocations.get(progress.id)
        if invocation is None:
            self.replicated_state.fetch_soon(robot, progress)
            return
        before, guessed, far = invocation.state, invocation.expired, _tenths(invocation)
        if self._live.invocations.apply(robot, progress) is None:
            return
        if invocation.state.terminal:
            self._settle(invocation)
            return
        # A motion that the robot reports as running is not over, however long it takes.
        invocation.deadline_ns = max(invocation.deadline_ns, time.time_ns() + int(REPORT_TIMEOUT_S * 1e9))
        if guessed:
            self.replicated_state.save(invocation)
            self._announce(invocation)
        elif invocation.state is not before or _tenths(invocation) != far:
            self._announce(invocation)
        else:
            self._live.fan_out.mark_changed(invocation_path(invocation))

    def _lost(self, robot: str) -> None:
        for invocation in self._live.invocations.mark_unknown(robot):
            self._announce(invocation)

    async def _expire(self) -> None:
        """Fail invocations without a reported end, and those of earlier runs of an agent."""
        await asyncio.sleep(_EXPIRY_INTERVAL_S)
        invocations, now_ns = self._live.invocations, time.time_ns()
        for robot in self._live.fleet.robots.values():
            for invocation in invocations.fail_earlier_runs(robot.name, robot.incarnation or 0, now_ns):
                self._settle(invocation)
        for invocation in sorted(invocations.overdue(now_ns), key=self.replicated_state.is_own, reverse=True):
            if await self.replicated_state.is_late(invocation) and invocation.id not in self._asked:
                if _may_not_have_begun(invocation) and self._is_online(invocation.robot):
                    self._judge(self._ask(invocation))
                else:
                    self._expire_one(invocation)

    async def _ask(self, invocation: Invocation) -> None:
        """Ask an agent what became of a command of whose acceptance no gateway knows: perhaps its gateway has died.

        One that the agent does not know has not begun, and never will. The stop by which this is asked is not owed: an
        agent without an answer leaves the command as it is, and takes others.
        """
        self._asked.add(invocation.id)
        reason = "nobody knows whether it had begun"
        stop = Stop(version=WIRE_VERSION, id=str(uuid.uuid4()), command=invocation.id, reason=reason)
        try:
            replies = await self._live.link.stop((invocation.robot,), stop, ANSWER_TIMEOUT_S)
            await self._judge_stop(invocation, replies.get(invocation.robot), NOT_BEGUN)
        finally:
            self._asked.discard(invocation.id)
        if not invocation.state.terminal:
            self._expire_one(invocation)

    def _expire_one(self, invocation: Invocation) -> None:
        self._live.invocations.expire(invocation, time.time_ns())
        if self.stops.is_owed(invocation.robot, invocation.id):
            invocation.reason += f"; {_OWED}"
        self._settle(invocation)

    def _is_online(self, robot: str) -> bool:
        known = self._live.fleet.robots.get(robot)
        return known is not None and known.online


def _tenths(invocation: Invocation) -> int:
    """Return how far an invocation is, as its fleet shows it."""
    return int(10 * invocation.progress)


def _may_not_have_begun(invocation: Invocation) -> bool:
    """Return True if an invocation is one of a robot that its agent may not know."""
    is_command = not invocation.operation and invocation.robot != FLEET and invocation.stops is None
    return is_command and not invocation.accepted


def _patience_ns(operation: Invocation) -> int:
    """Return the time after a report in which an operation must be reported again."""
    return int((RESUME_TIMEOUT_S if operation.resumes else REPORT_TIMEOUT_S) * 1e9)


async def _cancel_nothing(invocation: Invocation, reason: str) -> bool:
    return False


def _is_reported(part: str) -> bool:
    """Return True if a robot has reported on its part of a stop of the fleet, or refused it."""
    return has_ended(part) or reported_state(part) == InvocationState.RUNNING
