"""Execution of actions: plan → stored invocation → command → agent's reply → progress → end (flow "action")."""

import asyncio
import logging
import time
import uuid
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from types import TracebackType
from typing import Protocol, Self

from pyoxigraph import NamedNode

from linked_fleet_agent.wire.messages import WIRE_VERSION, Accepted, Command, Progress, Refused, Reply, Stop
from linked_fleet_gateway.actions.handler_table import HANDLERS, Handler
from linked_fleet_gateway.actions.plan import ActionRequest, Caller, Halt, Later, Motion, Plan, command_of
from linked_fleet_gateway.actions.quota import Quota
from linked_fleet_gateway.actions.refusals import lease_of, refusal, refusals, repeated, silence
from linked_fleet_gateway.actions.replicated_invocations import Memory
from linked_fleet_gateway.actions.stall_detector import TICK_S, Alertness
from linked_fleet_gateway.actions.store import ActionStore, Full, StoreUnavailable
from linked_fleet_gateway.actions.waiting import Waiting
from linked_fleet_gateway.base.errors import AgentSilent, Busy, Conflict, MotionRefused
from linked_fleet_gateway.fleet.invocations import FLEET, Invocation, InvocationState
from linked_fleet_gateway.fleet.robot import Robot
from linked_fleet_gateway.identity.rights import ALL, View
from linked_fleet_gateway.link.fleet_link import NoAnswer
from linked_fleet_gateway.resources.action_offer import Offer
from linked_fleet_gateway.resources.invocation import invocation_path
from linked_fleet_gateway.runtime.background import end, supervised
from linked_fleet_gateway.runtime.metrics import Commands
from linked_fleet_gateway.subscriptions.live import Live

log = logging.getLogger(__name__)

MOST_PLANS = 16  # of at most 100 ms each
_ANSWER_TIMEOUT_S = 2.0
_SETTLING_S = 15.0
_LAST_WORD_S = 1.0  # the end of a motion may arrive after the answer to a stop
_EXPIRY_INTERVAL_S = 1.0
_PATIENCE = 3.0  # factor of the duration stated by the agent, after which a motion is given up
_SILENT = "unknown: no answer"


class MotionGuard(Protocol):
    """Checks motions for collisions and similar; ``sees`` limits what its errors may reveal."""

    async def ready(self, robot: Robot, sees: View) -> None:
        """Wait until motions of a robot can be checked. Raises MotionRefused if that takes too long."""

    async def free(self, motion: Motion, sees: View, own: str) -> bool:
        """Check the path of a motion. Return False if the robot has no placement. Raises MotionRefused.

        Other running motions are considered, except the invocation with the id ``own``.
        """


@dataclass(frozen=True)
class Rehearsed:
    """The result of a rehearsal: duration, and ids of the invocations that it would end.

    ``free``: as reported by guards.
    """

    duration_s: float
    preempts: tuple[str, ...]
    free: bool = False


class Actions:
    """Executes plans and keeps their invocations; an async context manager."""

    def __init__(self, live: Live, store: ActionStore, most_motions: int) -> None:
        self._live, self._store = live, store
        self._guards: list[MotionGuard] = []
        self.handlers: dict[NamedNode, Handler] = dict(HANDLERS)
        """The handler of each kind of action."""
        self._quota = Quota(live.invocations, most_motions)
        self.waiting = Waiting()
        self.memory = Memory(live, store, self.stop_one, self.waiting.wake)
        self._tasks: list[asyncio.Task[None]] = []
        self._alertness = Alertness()
        self._computing = asyncio.Semaphore(1)
        self._planning = 0
        self.commands = Commands()
        # Callback for stopped robots; None means every robot was stopped.
        self.on_stop: Callable[[tuple[str, ...] | None], None] = lambda robots: None
        live.on_progress, live.on_lost = self._progressed, self._lost

    async def __aenter__(self) -> Self:
        await self.memory.__aenter__()
        self._tasks = [
            supervised(self._expire, "expire invocations", log, "what is late stays open", 0.0),
            supervised(self._alertness.tick, "tick", log, "a pause of this process may go unnoticed", TICK_S),
        ]
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        await end(self._tasks)
        await self.memory.__aexit__(kind, error, trace)

    def add_guard(self, guard: MotionGuard) -> None:
        """Add a guard, which checks every motion before it is accepted."""
        self._guards.append(guard)

    # -- motions ----------------------------------------------------------------------------------------------------

    async def start(self, action: str, motion: Motion, caller: Caller) -> Invocation:
        """Start a motion. Return the invocation once its agent has accepted it; for a repeated key the first one.

        Raises Controlled if another caller has the lease, Changed if a precondition in the body does not hold,
        RefusedByAgent with the agent's reason, MotionRefused, TooManyInvocations, StoreAway, and AgentSilent without a
        reply: the invocation is then "unknown" until progress or its deadline resolves it.
        """
        robot, motion = motion.robot, await self._once_ready(motion, caller)
        if self._alertness.was_held_up():
            raise Busy("The gateway was held up, and this may have been asked for before: ask again.")
        now_ns = time.time_ns()
        invocation = Invocation(
            id=str(uuid.uuid4()),
            robot=robot.name,
            action=action,
            targets=dict(motion.targets),
            created_ns=now_ns,
            deadline_ns=now_ns + int((_ANSWER_TIMEOUT_S + _SETTLING_S) * 1e9),
            client=caller.name,
            body=caller.body,
            facts=dict(motion.facts),
            lease=lease_of(robot) if motion.tied else "",
            incarnation=motion.asked.incarnation,
        )
        with self._quota.beginning(caller.name) as full:
            async with refusals():
                try:
                    first = await self._open(invocation, caller, full)
                except StoreUnavailable:  # perhaps after it was executed
                    first = await self._open(invocation, caller, full)
                if first is not None:
                    return await self._first(robot, first)
            invocation = self._begin(invocation)
        motion = await self._check(invocation, motion, caller)
        reply = await self._send(invocation, command_of(invocation.id, motion))
        if isinstance(reply, Refused):
            self._refuse(invocation, reply)
            raise refusal(robot, reply)
        self._accept(invocation, reply)
        return invocation

    async def _once_ready(self, motion: Motion, caller: Caller) -> Motion:
        """Wait for the guards.

        Return the motion, which does not become stale by this wait; a stop still overrides it.
        """
        began_ns = time.monotonic_ns()
        for guard in self._guards:
            await guard.ready(motion.robot, caller.sees)
        return _later(motion, began_ns)

    async def _check(self, invocation: Invocation, motion: Motion, caller: Caller) -> Motion:
        """Check a motion that others can see already: of two concurrent ones, at least one sees the other."""
        began_ns = time.monotonic_ns()
        try:
            await self._is_free(motion, caller, invocation.id)
        except MotionRefused as error:
            invocation.refused = error.code
            self._fail(invocation, error.reason)
            raise
        return _later(motion, began_ns)

    async def _is_free(self, motion: Motion, caller: Caller, own: str) -> bool:
        """Return True if there are guards and all found the path free. Raises MotionRefused."""
        found = [await guard.free(motion, caller.sees, own) for guard in self._guards]
        return bool(found) and all(found)

    async def _open(self, invocation: Invocation, caller: Caller, full: bool) -> str | None:
        try:
            return await self._store.open(
                invocation, token=caller.token, key=caller.key, digest=caller.digest, full=full
            )
        except Full as error:
            raise self._quota.refusal(caller.name) from error

    def plan(self, asked: ActionRequest, offer: Offer) -> Plan:
        """Let the handler of an offered action create its plan. Raises the handler's errors."""
        return self.handlers[offer.definition.iri](asked)

    async def compute(self, plan: Later) -> Motion:
        """Compute a plan in a thread; one at a time, so that clients share the processor.

        Raises Busy if so many wait that the plan would be stale.
        """
        if self._planning >= MOST_PLANS:
            raise Busy(f"{MOST_PLANS} plans are being made; ask again.")
        self._planning += 1
        try:
            async with self._computing:
                return await asyncio.to_thread(plan.compute)
        finally:
            self._planning -= 1

    async def rehearse(self, motion: Motion, caller: Caller) -> Rehearsed:
        """Return the effect that ``start`` would have. Raises the same errors."""
        robot, motion = motion.robot, await self._once_ready(motion, caller)
        if self._quota.is_full(caller.name):
            raise self._quota.refusal(caller.name)
        async with refusals():
            await self._store.check(robot.name, caller.token, lease_of(robot) if motion.tied else "")
        began_ns = time.monotonic_ns()
        free = await self._is_free(motion, caller, "")
        motion = _later(motion, began_ns)
        try:
            command = command_of(str(uuid.uuid4()), motion, rehearsal=True)
            reply = await self._live.link.command(robot.name, command, _ANSWER_TIMEOUT_S)
        except NoAnswer as error:
            raise AgentSilent(f"The agent of {robot.name} gave no answer: {error}.") from error
        if isinstance(reply, Refused):
            raise refusal(robot, reply)
        return Rehearsed(reply.duration_s, reply.preempts, free)

    async def _send(self, invocation: Invocation, command: Command) -> Reply:
        try:
            with self.memory.asking(invocation):
                reply = await self._live.link.command(invocation.robot, command, _ANSWER_TIMEOUT_S)
        except NoAnswer as error:
            self.commands.replied(invocation.robot, None)
            self._unheard(invocation)
            raise silence(invocation, str(error)) from error
        self.commands.replied(invocation.robot, reply)
        return reply

    async def _first(self, robot: Robot, id: str) -> Invocation:
        """Return the invocation of an earlier request with the same key, once it was answered."""
        invocation = await self.memory.fetch(robot.name, id)
        if invocation is None:
            raise Conflict("The first request with this Idempotency-Key has been answered, and its invocation deleted.")
        await self.waiting.until(invocation, _is_answered, _ANSWER_TIMEOUT_S)
        repeated(robot, invocation)
        return invocation

    def _accept(self, invocation: Invocation, accepted: Accepted) -> None:
        invocation.duration_s = accepted.duration_s
        invocation.preempts = accepted.preempts
        if not invocation.state.terminal:
            patience_s = accepted.duration_s * _PATIENCE + _SETTLING_S
            invocation.deadline_ns = max(invocation.deadline_ns, invocation.created_ns + int(patience_s * 1e9))
        self.memory.save(invocation)
        self._news(invocation)

    def _refuse(self, invocation: Invocation, reply: Refused) -> None:
        invocation.refused = reply.code
        self._fail(invocation, reply.reason)

    def _fail(self, invocation: Invocation, reason: str) -> None:
        invocation.state, invocation.reason, invocation.ended_ns = InvocationState.FAILED, reason, time.time_ns()
        self._settle(invocation)

    # -- halts ------------------------------------------------------------------------------------------------------

    async def halt(self, action: str, halt: Halt, caller: Caller) -> Invocation:
        """Stop robots, whoever has a lease and even without Redis.

        Raises AgentSilent if a single robot does not answer.
        """
        fleet, now_ns = self._live.fleet.robots, time.time_ns()
        robot, asked = FLEET if halt.robots is None else halt.robots[0], self._reached(halt, caller.stops)
        if not halt.joints and not caller.rule:
            self.on_stop(asked)
        of_fleet = fleet if asked is None else asked
        online = [name for name in of_fleet if fleet[name].online] if halt.robots is None else []
        invocation = Invocation(
            id=str(uuid.uuid4()),
            robot=robot,
            action=action,
            targets={},
            created_ns=now_ns,
            deadline_ns=now_ns + int(_SETTLING_S * 1e9),
            client=caller.name,
            robots=dict.fromkeys(online, InvocationState.ACCEPTED.value),
            stops=halt.joints,
            incarnation=(fleet[robot].incarnation or 0) if robot in fleet else 0,
        )
        self._begin(invocation)
        stop = Stop(version=WIRE_VERSION, id=invocation.id, joints=halt.joints, reason="stopped")
        replies = await self._live.halt(asked, stop, _ANSWER_TIMEOUT_S)
        for name in {*(halt.robots or online), *replies}:
            self.commands.replied(name, replies.get(name))
        self.memory.record(invocation)
        if robot == FLEET:
            self._answered(invocation, online, replies)
            return invocation
        reply = replies.get(robot)
        if reply is None:
            self._unheard(invocation)
            raise silence(invocation, "it did not say that it stops")
        if isinstance(reply, Refused):
            self._refuse(invocation, reply)
            raise refusal(fleet[robot], reply)
        self._accept(invocation, reply)
        return invocation

    def _reached(self, halt: Halt, stops: View) -> tuple[str, ...] | None:
        """Return the robots that the caller may stop; None for all, known or not."""
        if halt.robots is not None or stops.all:
            return halt.robots
        return tuple(name for name in self._live.fleet.robots if stops.sees(name))

    async def rehearse_halt(self, halt: Halt, stops: View = ALL) -> Rehearsed:
        """Return the invocations that ``halt`` would end."""
        stop = Stop(version=WIRE_VERSION, id=str(uuid.uuid4()), joints=halt.joints, rehearsal=True)
        replies = await self._live.link.stop(self._reached(halt, stops), stop, _ANSWER_TIMEOUT_S)
        accepted = [reply for reply in replies.values() if isinstance(reply, Accepted)]
        if halt.robots is not None and not accepted:
            raise AgentSilent(f"The agent of {halt.robots[0]} gave no answer.")
        ends = tuple(id for reply in accepted for id in reply.preempts)
        return Rehearsed(max((reply.duration_s for reply in accepted), default=0.0), ends)

    def _answered(self, invocation: Invocation, online: Iterable[str], replies: dict[str, Reply]) -> None:
        """Record the replies of robots; one without reply stays unknown."""
        for name in (*online, *(name for name in replies if name not in invocation.robots)):
            reply = replies.get(name)
            if isinstance(reply, Refused):
                self._live.invocations.answer(invocation, name, f"refused: {reply.reason}")
            elif reply is None and invocation.robots.get(name) == InvocationState.ACCEPTED.value:
                self._live.invocations.answer(invocation, name, _SILENT)
            elif reply is not None:
                invocation.robots.setdefault(name, InvocationState.ACCEPTED.value)
        accepted = [reply for reply in replies.values() if isinstance(reply, Accepted)]
        invocation.preempts = tuple(id for reply in accepted for id in reply.preempts)
        invocation.duration_s = max((reply.duration_s for reply in accepted), default=0.0)
        if not invocation.robots:
            invocation.state, invocation.progress = InvocationState.SUCCEEDED, 1.0
            invocation.reason, invocation.ended_ns = "no robot is online", time.time_ns()
        if invocation.state.terminal:
            self._settle(invocation)
        else:
            self._news(invocation)

    def _unheard(self, invocation: Invocation) -> None:
        if invocation.state is InvocationState.ACCEPTED:
            invocation.state = InvocationState.UNKNOWN
            invocation.reason = "the agent gave no answer; progress or the deadline will settle it"
            self.memory.save(invocation)
            self._news(invocation)

    # -- invocations ------------------------------------------------------------------------------------------------

    async def cancel(self, invocation: Invocation, reason: str = "cancelled by a client") -> None:
        """Stop the motion of an invocation. Raises Conflict if it is over, AgentSilent without a reply."""
        if invocation.state.terminal:
            raise Conflict(f"The invocation has ended already: it {invocation.state}.")
        if invocation.robot == FLEET:
            raise Conflict("Stopping cannot be cancelled; a new motion of a robot ends it.")
        if await self.stop_one(invocation, reason) is None:
            raise AgentSilent(f"The agent of {invocation.robot} gave no answer; whether it stops is unknown.")

    async def remove(self, invocation: Invocation) -> None:
        """Stop an invocation if it is not over, and delete it."""
        if not invocation.state.terminal:
            await self.cancel(invocation, "its invocation is deleted")
            await self.ended(invocation, _ANSWER_TIMEOUT_S)
        async with refusals():
            await self._store.delete(invocation)
        self.memory.forget(invocation.id)

    async def ended(self, invocation: Invocation, timeout_s: float) -> bool:
        """Wait until the invocation has ended. Return False after ``timeout_s``."""
        return await self.waiting.until(invocation, lambda one: one.state.terminal, timeout_s)

    async def stop_one(self, invocation: Invocation, reason: str) -> Reply | None:
        """Stop the motion of an invocation. Return the agent's reply, if any.

        An agent that does not know the motion will never start it; an end that has just happened is reported.
        """
        stop = Stop(version=WIRE_VERSION, id=str(uuid.uuid4()), command=invocation.id, reason=reason)
        replies = await self._live.link.stop((invocation.robot,), stop, _ANSWER_TIMEOUT_S)
        reply = replies.get(invocation.robot)
        self.commands.replied(invocation.robot, reply)
        unknown = isinstance(reply, Accepted) and invocation.id not in reply.preempts
        if unknown and invocation.stops is None and not await self.ended(invocation, _LAST_WORD_S):
            self._fail(invocation, "the agent knows no such motion")
        return reply

    # -- what the robots say ----------------------------------------------------------------------------------------

    def _progressed(self, robot: str, progress: Progress) -> None:
        invocation = self._live.invocations.get(progress.id)
        if invocation is None:
            self.memory.fetch_soon(robot, progress)
            return
        before, guessed = invocation.state, invocation.expired
        if self._live.invocations.apply(robot, progress) is None:
            return
        if invocation.state.terminal:
            self._settle(invocation)
            return
        # A motion that the robot reports as running is not over, however long it takes.
        invocation.deadline_ns = max(invocation.deadline_ns, time.time_ns() + int(_SETTLING_S * 1e9))
        if guessed:
            self.memory.save(invocation)
            self._news(invocation)
        elif invocation.state is not before:
            self._news(invocation)
        else:
            self._live.fan_out.touched(invocation_path(invocation))

    def _lost(self, robot: str) -> None:
        for invocation in self._live.invocations.lose(robot):
            self._news(invocation)

    async def _expire(self) -> None:
        """Fail invocations without a reported end, and those of earlier runs of an agent."""
        await asyncio.sleep(_EXPIRY_INTERVAL_S)
        invocations, now_ns = self._live.invocations, time.time_ns()
        for robot in self._live.fleet.robots.values():
            for invocation in invocations.outlived(robot.name, robot.incarnation or 0, now_ns):
                self._settle(invocation)
        for invocation in sorted(invocations.late(now_ns), key=self.memory.owns, reverse=True):
            if await self.memory.is_late(invocation):
                invocations.expire(invocation, now_ns)
                self._settle(invocation)

    def _begin(self, invocation: Invocation) -> Invocation:
        """Register an invocation, unless a repeated request has registered it meanwhile."""
        self.memory.begun(invocation)
        known = self._live.invocations.get(invocation.id)
        if known is None:
            self._live.invocations.add(invocation)
            self._live.fan_out.appeared(invocation_path(invocation))
        self._news(known or invocation)
        return known or invocation

    def _settle(self, invocation: Invocation) -> None:
        self.memory.settle(invocation)
        self._news(invocation)

    def _news(self, invocation: Invocation) -> None:
        self._live.tell(invocation)
        self.waiting.wake(invocation)


def _is_answered(invocation: Invocation) -> bool:
    """Return True if the agent has answered, or has not in time."""
    return invocation.accepted or invocation.state is not InvocationState.ACCEPTED


def _later(motion: Motion, began_ns: int) -> Motion:
    """Return the motion with the time since ``began_ns`` (monotonic) added to its permitted delay."""
    waited_ns = motion.asked.waited_ns + time.monotonic_ns() - began_ns
    return replace(motion, asked=replace(motion.asked, waited_ns=waited_ns))
