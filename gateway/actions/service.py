"""Actions carried out: plan → invocation, remembered → command → agent's word → progress → end (flow "action")."""

import asyncio
import logging
import time
import uuid
from collections.abc import Iterable
from dataclasses import dataclass
from types import TracebackType
from typing import Self

from agents.wire.messages import WIRE_VERSION, Accepted, Command, Progress, Refused, Reply, Stop
from gateway.actions.caller import Caller
from gateway.actions.memory import Memory
from gateway.actions.plan import Halt, Later, Motion
from gateway.actions.refusals import lease_of, refusal, refusals, silence
from gateway.actions.store import ActionStore
from gateway.ending import end
from gateway.errors import AgentSilent, Busy, Conflict, RefusedByAgent
from gateway.fleet.invocations import FLEET, Invocation, InvocationState
from gateway.graph.invocation import invocation_path
from gateway.link import NoAnswer
from gateway.live import Live

log = logging.getLogger(__name__)

TIME_TO_LIVE_NS = 2_000_000_000
MOST_PLANS = 16  # of at most 100 ms each
_ANSWER_TIMEOUT_S = 2.0
_SETTLING_S = 15.0
_EXPIRY_INTERVAL_S = 1.0
_PATIENCE = 3.0  # times the duration that the agent states, before a motion is given up
_SILENT = "unknown: no answer"


@dataclass(frozen=True)
class Rehearsed:
    """What would happen: how long it takes, and the invocations that it ends."""

    duration_s: float
    preempts: tuple[str, ...]


class Actions:
    """Carries out plans, and keeps what became of them; an async context manager."""

    def __init__(self, live: Live, store: ActionStore) -> None:
        self._live, self._store = live, store
        self.memory = Memory(live, store, self._stop_one, self._over)
        self._ended: dict[str, asyncio.Event] = {}
        self._expiry: asyncio.Task[None] | None = None
        self._computing = asyncio.Semaphore(1)
        self._planning = 0
        live.on_progress, live.on_lost = self._progressed, self._lost

    async def __aenter__(self) -> Self:
        await self.memory.__aenter__()
        self._expiry = asyncio.create_task(self._expire_for_ever(), name="expire invocations")
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._expiry is not None:
            await end([self._expiry])
        await self.memory.__aexit__(kind, error, trace)

    # -- motions ----------------------------------------------------------------------------------------------------

    async def start(self, action: str, motion: Motion, caller: Caller) -> Invocation:
        """Have the robot begin, and return the invocation once its agent accepted; the first one for a repeated key.

        Raises Controlled when somebody else has the lease, Changed when the body's
        precondition does not hold, RefusedByAgent with the agent's reason, StoreAway, and AgentSilent when no answer
        came: then the invocation is "unknown" until progress or its deadline settles it.
        """
        robot = motion.robot
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
        )
        async with refusals():
            first = await self._store.open(invocation, token=caller.token, key=caller.key, digest=caller.digest)
            if first is not None:
                return await self._first(robot.name, first)
        self._begin(invocation)
        reply = await self._send(invocation, _command(invocation.id, motion))
        if isinstance(reply, Refused):
            self._refuse(invocation, reply.reason)
            raise refusal(robot, reply)
        self._accept(invocation, reply)
        return invocation

    async def compute(self, plan: Later) -> Motion:
        """Make a plan that takes milliseconds, in a thread; one after another, so that nobody gets all of the time.

        Busy when so many wait that a plan would be too late when its turn came.
        """
        if self._planning >= MOST_PLANS:
            raise Busy(f"{MOST_PLANS} plans are being made; ask again in a second.")
        self._planning += 1
        try:
            async with self._computing:
                return await asyncio.to_thread(plan.compute)
        finally:
            self._planning -= 1

    async def rehearse(self, motion: Motion, caller: Caller) -> Rehearsed:
        """What ``start`` would do; raises what it would raise."""
        robot = motion.robot
        async with refusals():
            await self._store.check(robot.name, caller.token, lease_of(robot) if motion.tied else "")
        try:
            command = _command(str(uuid.uuid4()), motion, rehearsal=True)
            reply = await self._live.link.command(robot.name, command, _ANSWER_TIMEOUT_S)
        except NoAnswer as error:
            raise AgentSilent(f"The agent of {robot.name} gave no answer: {error}.") from error
        if isinstance(reply, Refused):
            raise refusal(robot, reply)
        return Rehearsed(reply.duration_s, reply.preempts)

    async def _send(self, invocation: Invocation, command: Command) -> Reply:
        try:
            return await self._live.link.command(invocation.robot, command, _ANSWER_TIMEOUT_S)
        except NoAnswer as error:
            if invocation.state is InvocationState.ACCEPTED:
                invocation.state = InvocationState.UNKNOWN
                invocation.reason = "the agent gave no answer; progress or the deadline will settle it"
                self.memory.save(invocation)
                self._news(invocation)
            raise silence(invocation, str(error)) from error

    async def _first(self, robot: str, id: str) -> Invocation:
        """The invocation that a repeated request began, which gets the answer that the first one got."""
        invocation = await self.memory.fetch(robot, id)
        if invocation is None:
            raise Conflict("The first request with this Idempotency-Key has been answered, and its invocation deleted.")
        if invocation.state is InvocationState.UNKNOWN and invocation.started_ns is None:
            raise silence(invocation, "not to the first request with this Idempotency-Key either")
        if invocation.state is InvocationState.FAILED and invocation.started_ns is None:
            raise RefusedByAgent(f"The agent of {robot} refused the first request with this key: {invocation.reason}")
        return invocation

    def _accept(self, invocation: Invocation, accepted: Accepted) -> None:
        invocation.duration_s = accepted.duration_s
        invocation.preempts = accepted.preempts
        if not invocation.state.terminal:
            patience_s = accepted.duration_s * _PATIENCE + _SETTLING_S
            invocation.deadline_ns = invocation.created_ns + int(patience_s * 1e9)
            robot = self._live.fleet.robots[invocation.robot]
            robot.targets.update(invocation.targets)
        self.memory.save(invocation)
        self._news(invocation)

    def _refuse(self, invocation: Invocation, reason: str) -> None:
        invocation.state, invocation.reason, invocation.ended_ns = InvocationState.FAILED, reason, time.time_ns()
        self._settle(invocation)

    # -- halts ------------------------------------------------------------------------------------------------------

    async def halt(self, action: str, halt: Halt, caller: Caller) -> Invocation:
        """Stop robots, whoever has a lease and whether or not Redis is there; AgentSilent when one robot is silent."""
        fleet, now_ns = self._live.fleet.robots, time.time_ns()
        robot = FLEET if halt.robots is None else halt.robots[0]
        online = [name for name, each in fleet.items() if each.online] if halt.robots is None else []
        invocation = Invocation(
            id=str(uuid.uuid4()),
            robot=robot,
            action=action,
            targets={},
            created_ns=now_ns,
            deadline_ns=now_ns + int(_SETTLING_S * 1e9),
            client=caller.name,
            robots=dict.fromkeys(online, InvocationState.ACCEPTED.value),
        )
        self._begin(invocation)
        stop = Stop(version=WIRE_VERSION, id=invocation.id, joints=halt.joints, reason="stopped")
        replies = await self._live.halt(halt.robots, stop, _ANSWER_TIMEOUT_S)
        self.memory.record(invocation)
        if robot == FLEET:
            self._answered(invocation, online, replies)
            return invocation
        reply = replies.get(robot)
        if reply is None:
            self._unheard(invocation)
            raise silence(invocation, "it did not say that it stops")
        if isinstance(reply, Refused):
            self._refuse(invocation, reply.reason)
            raise refusal(fleet[robot], reply)
        self._accept(invocation, reply)
        return invocation

    async def rehearse_halt(self, halt: Halt) -> Rehearsed:
        """What ``halt`` would end."""
        stop = Stop(version=WIRE_VERSION, id=str(uuid.uuid4()), joints=halt.joints, rehearsal=True)
        replies = await self._live.link.stop(halt.robots, stop, _ANSWER_TIMEOUT_S)
        accepted = [reply for reply in replies.values() if isinstance(reply, Accepted)]
        if halt.robots is not None and not accepted:
            raise AgentSilent(f"The agent of {halt.robots[0]} gave no answer.")
        ends = tuple(id for reply in accepted for id in reply.preempts)
        return Rehearsed(max((reply.duration_s for reply in accepted), default=0.0), ends)

    def _answered(self, invocation: Invocation, online: Iterable[str], replies: dict[str, Reply]) -> None:
        """Note what each robot said, before any of them reports; a robot without answer stays unknown."""
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
            invocation.state, invocation.reason = InvocationState.UNKNOWN, "the agent gave no answer"
            self.memory.save(invocation)
            self._news(invocation)

    # -- invocations ------------------------------------------------------------------------------------------------

    async def cancel(self, invocation: Invocation, reason: str = "cancelled by a client") -> None:
        """Have the robot stop what the invocation began; Conflict when it is over, AgentSilent without an answer."""
        if invocation.state.terminal:
            raise Conflict(f"The invocation has ended already: it {invocation.state}.")
        if invocation.robot == FLEET:
            raise Conflict("Stopping cannot be cancelled; a new motion of a robot ends it.")
        reply = await self._stop_one(invocation, reason)
        if reply is None:
            raise AgentSilent(f"The agent of {invocation.robot} gave no answer; whether it stops is unknown.")

    async def remove(self, invocation: Invocation) -> None:
        """Stop it if it is not over, and forget it."""
        if not invocation.state.terminal:
            await self.cancel(invocation, "its invocation is deleted")
            await self.ended(invocation, _ANSWER_TIMEOUT_S)
        async with refusals():
            await self._store.delete(invocation)
        self.memory.forget(invocation)

    async def ended(self, invocation: Invocation, timeout_s: float) -> bool:
        """Wait until the invocation has ended; False when ``timeout_s`` passed before."""
        if invocation.state.terminal:
            return True
        event = self._ended.setdefault(invocation.id, asyncio.Event())
        try:
            async with asyncio.timeout(timeout_s):
                await event.wait()
        except TimeoutError:
            return False
        return True

    async def _stop_one(self, invocation: Invocation, reason: str) -> Reply | None:
        stop = Stop(version=WIRE_VERSION, id=str(uuid.uuid4()), command=invocation.id, reason=reason)
        replies = await self._live.link.stop((invocation.robot,), stop, _ANSWER_TIMEOUT_S)
        return replies.get(invocation.robot)

    # -- what the robots say ----------------------------------------------------------------------------------------

    def _progressed(self, robot: str, progress: Progress) -> None:
        invocation = self._live.invocations.get(progress.id)
        if invocation is None:
            self.memory.fetch_soon(robot, progress)
            return
        before = invocation.state
        if self._live.invocations.apply(robot, progress) is None:
            return
        if invocation.state.terminal:
            self._settle(invocation)
        elif invocation.state is not before:
            self._news(invocation)
        else:
            self._live.fan_out.touched(invocation_path(invocation))

    def _lost(self, robot: str) -> None:
        for invocation in self._live.invocations.lose(robot):
            self._news(invocation)

    async def _expire_for_ever(self) -> None:
        """Fail what nobody has reported the end of."""
        while True:
            await asyncio.sleep(_EXPIRY_INTERVAL_S)
            for invocation in self._live.invocations.expire(time.time_ns()):
                self._settle(invocation)

    def _begin(self, invocation: Invocation) -> None:
        self.memory.begun(invocation)
        self._live.invocations.add(invocation)
        self._live.fan_out.appeared(invocation_path(invocation))
        self._news(invocation)

    def _settle(self, invocation: Invocation) -> None:
        robot = self._live.fleet.robots.get(invocation.robot)
        if robot is not None and invocation.state is not InvocationState.SUCCEEDED:
            successor = self._live.invocations.get(invocation.preempted_by)
            onward = successor.targets if successor is not None else {}
            for joint, target in invocation.targets.items():
                # Nobody is on the way there any more.
                if robot.targets.get(joint) == target and onward.get(joint) != target:
                    del robot.targets[joint]
        self.memory.settle(invocation)
        self._news(invocation)
        self._over(invocation)

    def _over(self, invocation: Invocation) -> None:
        """Those who wait for it wait no longer."""
        event = self._ended.pop(invocation.id, None)
        if event is not None:
            event.set()

    def _news(self, invocation: Invocation) -> None:
        self._live.tell(invocation)


def _command(id: str, motion: Motion, *, rehearsal: bool = False) -> Command:
    """As of the moment at which it was asked for, however long it took since."""
    return Command(
        version=WIRE_VERSION,
        id=id,
        incarnation=motion.asked.incarnation,
        seen_ns=motion.asked.seen_ns,
        time_to_live_ns=TIME_TO_LIVE_NS,
        motion=motion.motion,
        scale=motion.scale,
        expects=dict(motion.expects),
        rehearsal=rehearsal,
    )
