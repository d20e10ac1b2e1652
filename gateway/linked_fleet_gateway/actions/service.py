"""Execution of actions: plan → stored invocation → command → agent's reply → progress → end (flow "action")."""

import asyncio
import logging
import time
import uuid
from collections.abc import Callable
from types import TracebackType
from typing import Self

from msgspec.structs import replace as replace_struct
from pyoxigraph import NamedNode

from linked_fleet_agent.wire.components import Operate
from linked_fleet_agent.wire.messages import WIRE_VERSION, Command, Refused, Reply, Stop
from linked_fleet_base.errors import Busy, FleetError, MotionRefused, Unimplemented
from linked_fleet_gateway.actions.action_handlers import HANDLERS, Handler, Plan
from linked_fleet_gateway.actions.guards import Guards, Paths, limited, unchecked
from linked_fleet_gateway.actions.lifecycle import REPORT_TIMEOUT_S, Lifecycle
from linked_fleet_gateway.actions.opening import Opening
from linked_fleet_gateway.actions.operations import Operations
from linked_fleet_gateway.actions.plan import (
    Act,
    ActionRequest,
    Caller,
    DeferredPlan,
    Halt,
    Motion,
    build_command,
)
from linked_fleet_gateway.actions.refusals import (
    TICK_S,
    MotionQuota,
    StallDetector,
    agent_refusal,
    agent_timeout,
    required_lease_id,
    translate_store_errors,
    unanswered_stop,
)
from linked_fleet_gateway.actions.rehearsals import Rehearsals
from linked_fleet_gateway.actions.stop_delivery import ANSWER_TIMEOUT_S
from linked_fleet_gateway.actions.store import ActionStore
from linked_fleet_gateway.resources.action_offer import Offer
from linked_fleet_gateway.resources.invocation import invocation_path
from linked_fleet_gateway.subscriptions.live import Live
from linked_fleet_link.fleet_link import NoAnswer
from linked_fleet_runtime.background import cancel_tasks, supervised
from linked_fleet_state.invocations import FLEET, Invocation, InvocationState

log = logging.getLogger(__name__)

MAX_WAITING_PLANS = 16  # of at most 100 ms each


class Actions:
    """Executes plans and keeps their invocations; an async context manager."""

    def __init__(self, live: Live, store: ActionStore, max_motions: int) -> None:
        self._live, self._store = live, store
        self.guards = Guards(live.copies)
        self.handlers: dict[NamedNode, Handler] = dict(HANDLERS)
        """The handler of each kind of action."""
        self.lifecycle = Lifecycle(live, store)
        self._opening = Opening(store, self.lifecycle, MotionQuota(live.invocations, max_motions))
        self.operations = Operations(live, self.lifecycle, self._opening)
        self._tasks: list[asyncio.Task[None]] = []
        self._stalls = StallDetector()
        self.rehearsals = Rehearsals(live, self.guards, self.lifecycle, self._opening, self._stalls, self._ready)
        self._computing = asyncio.Semaphore(1)
        self._planning = 0
        self.stop_listeners: list[Callable[[tuple[str, ...] | None], None]] = []
        """Called with the robots that somebody stops; None for all."""

    async def __aenter__(self) -> Self:
        await self.lifecycle.__aenter__()
        self._tasks = [supervised(self._stalls.tick, "tick", log, "a pause of this process may go unnoticed", TICK_S)]
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        await cancel_tasks(self._tasks)
        await self.operations.close()
        await self.lifecycle.__aexit__(kind, error, trace)

    # -- motions ----------------------------------------------------------------------------------------------------

    async def start(self, action: str, motion: Motion, caller: Caller) -> Invocation:
        """Start a motion, or another request that its robot carries out.

        Return the invocation once its agent has accepted it; for a repeated key the first one.

        Raises Controlled if another caller has the lease, Changed if a precondition in the body does not hold,
        RefusedByAgent with the agent's reason, MotionRefused, also before an earlier stop is confirmed,
        TooManyInvocations, RedisUnavailable, and AgentTimeout without a reply: the invocation is then "unknown" until
        progress or its deadline resolves it.
        """
        robot, waited_ns = motion.robot, await self._ready(motion, caller)
        if self._stalls.stalled_recently():
            raise Busy("The gateway was held up, and this may have been asked for before: ask again.")
        if motion.moves:
            self.lifecycle.stops.check_motion(robot.name)
        now_ns, id = time.time_ns(), str(uuid.uuid4())
        paths = self.guards.paths(motion, caller, id)
        within_s = ANSWER_TIMEOUT_S + REPORT_TIMEOUT_S + (0.0 if paths is None else paths.most_s)
        invocation = Invocation(
            id=id,
            robot=robot.name,
            action=action,
            targets=dict(motion.targets),
            created_ns=now_ns,
            deadline_ns=now_ns + int(within_s * 1e9),
            client=caller.name,
            body=caller.body,
            facts=dict(motion.facts),
            lease=required_lease_id(robot) if motion.tied_to_lease else "",
            incarnation=motion.requested_at.incarnation,
            moves=motion.motion.moves if isinstance(motion.motion, Act) else (),
            resumes=isinstance(motion.motion, Act) and motion.motion.resumes,
        )
        began_ns = time.monotonic_ns()
        invocation, is_new = await self._opening.create(invocation, caller)
        if not is_new:
            return await self._opening.first(robot, invocation)
        if caller.rule:  # a program waits for Redis; a person would be surprised by a motion so late
            waited_ns += self._stalls.elapsed_ns(began_ns)
        lease = robot.lease
        motion, checking_ns = await self._check(invocation, motion, caller, paths)
        waited_ns += checking_ns
        if robot.lease != lease:
            await self._check_lease(invocation, caller)
        if motion.moves:
            self._check_stops(invocation)
        reply = await self._send(invocation, build_command(invocation.id, motion, waited_ns))
        if isinstance(reply, Refused):
            self.lifecycle.record_refusal(invocation, reply)
            raise agent_refusal(robot, reply)
        self.lifecycle.record_acceptance(invocation, reply)
        return invocation

    async def _ready(self, motion: Motion, caller: Caller) -> int:
        """Wait for the guards of what moves.

        Return the time in ns, by which the motion does not become stale; a stop still overrides it. It is 0 if this
        process was stalled meanwhile.
        """
        began_ns = time.monotonic_ns()
        if motion.moves:
            await self.guards.wait_until_ready(motion.robot, caller.visible_robots)
        return self._stalls.elapsed_ns(began_ns)

    async def _check(
        self, invocation: Invocation, motion: Motion, caller: Caller, paths: Paths | None
    ) -> tuple[Motion, int]:
        """Check a motion that others can see already: of two concurrent ones, at least one sees the other.

        Return the motion as the guards let it be, and the time in ns, as ``_ready`` does.
        """
        began_ns = time.monotonic_ns()
        try:
            motion, found = await self.guards.on_free_path(motion, caller, invocation.id, paths)
        except FleetError as error:
            self._record_guard(invocation, error)
            raise
        except Exception:  # of whatever kind: others have seen the motion, and it must not stay accepted
            self.lifecycle.fail(invocation, "it could not be checked")
            raise
        invocation.unchecked = unchecked(found)
        invocation.detour = motion.detour
        motion, invocation.limited = limited(motion, found)
        invocation.facts = dict(motion.facts)
        until_ns = max((each.until_ns for each in found.values()), default=0)
        return replace_struct(motion, until_ns=until_ns), self._stalls.elapsed_ns(began_ns)

    def _check_stops(self, invocation: Invocation) -> None:
        """Check, right before a motion is sent, that it overtakes no stop that was asked for meanwhile."""
        try:
            self.lifecycle.stops.check_motion(invocation.robot)
        except MotionRefused as error:
            self._record_guard(invocation, error)
            raise

    def _record_guard(self, invocation: Invocation, error: FleetError) -> None:
        invocation.refused = error.code
        self.lifecycle.fail(invocation, error.reason if isinstance(error, MotionRefused) else str(error.detail))

    async def _check_lease(self, invocation: Invocation, caller: Caller) -> None:
        """Check again if the caller may move the robot, because its lease has changed during the check of the motion.

        Raises as ``start``.
        """
        try:
            with translate_store_errors():
                await self._store.check_lease(invocation.robot, caller.lease_token, invocation.lease)
        except FleetError:
            self.lifecycle.fail(invocation, "control of the robot changed while the motion was checked")
            raise

    async def guarded(self, motion: Motion, caller: Caller, own_id: str) -> tuple[Motion, str]:
        """Return what the guards let a sample of the open invocation ``own_id`` be, and why it is slower, if it is.

        Raises MotionRefused.
        """
        return limited(motion, await self.guards.findings(motion, caller, own_id))

    def plan(self, request: ActionRequest, offer: Offer) -> Plan:
        """Let the handler of an offered action create its plan. Raises the handler's errors."""
        handler = offer.handler or self.handlers.get(offer.definition.iri)
        if handler is None:
            raise Unimplemented(f"No extension handles {offer.definition.iri.value}; Mount.handlers lacks it.")
        plan: Plan = handler(request)
        return plan

    async def compute(self, plan: DeferredPlan) -> Motion:
        """Compute a plan in a thread; one at a time, so that clients share the processor.

        The motion does not become stale by the time of its computation: the first one loads libraries, which takes
        seconds on a busy machine. Raises Busy if so many wait that the plan would be stale.
        """
        if self._planning >= MAX_WAITING_PLANS:
            raise Busy(f"{MAX_WAITING_PLANS} plans are being made; ask again.")
        self._planning += 1
        try:
            async with self._computing:
                began_ns = time.monotonic_ns()
                motion = await asyncio.to_thread(plan.compute)
                return replace_struct(motion, computing_ns=self._stalls.elapsed_ns(began_ns))
        finally:
            self._planning -= 1

    async def _send(self, invocation: Invocation, command: Command | Operate) -> Reply:
        try:
            with self.lifecycle.replicated_state.defer_end(invocation):
                reply = await self._live.link.command(invocation.robot, command, ANSWER_TIMEOUT_S)
        except NoAnswer as error:
            self.lifecycle.command_metrics.count_reply(invocation.robot, None)
            self.lifecycle.mark_unknown(invocation)
            raise agent_timeout(invocation, str(error)) from error
        self.lifecycle.command_metrics.count_reply(invocation.robot, reply)
        return reply

    # -- halts ------------------------------------------------------------------------------------------------------

    async def halt(self, action: str, halt: Halt, caller: Caller) -> Invocation:
        """Stop robots, whoever has a lease and even without Redis.

        Raises StopUnanswered, which names those that the caller may see, if a robot that is online does not answer. The
        stop is then sent again until it does.
        """
        fleet, now_ns = self._live.fleet.robots, time.time_ns()
        robot = FLEET if halt.robots is None else halt.robots[0]
        asked = self.lifecycle.stops.reached(halt.robots, caller.stoppable_robots)
        of_fleet = fleet if asked is None else asked
        online = [name for name in of_fleet if name in fleet and fleet[name].online] if halt.robots is None else []
        invocation = Invocation(
            id=str(uuid.uuid4()),
            robot=robot,
            action=action,
            targets={},
            created_ns=now_ns,
            deadline_ns=now_ns + int(REPORT_TIMEOUT_S * 1e9),
            client=caller.name,
            robots=dict.fromkeys(online, InvocationState.ACCEPTED.value),
            stops=halt.joints,
            incarnation=(fleet[robot].incarnation or 0) if robot in fleet else 0,
        )
        try:
            if not halt.joints and not caller.rule:
                for hear in self.stop_listeners:
                    hear(asked)
            self.lifecycle.register(invocation)
            if not halt.joints:
                self.operations.stop_robots(asked)
        except Exception:  # of an extension, for example: the stop is sent nevertheless
            log.exception("invocation %s: the stop is sent before others could hear of it", invocation.id)
        stop = Stop(version=WIRE_VERSION, id=invocation.id, joints=halt.joints, reason="stopped")
        replies = await self.lifecycle.stops.send(asked, stop)
        for name in {*(halt.robots or online), *replies}:
            self.lifecycle.command_metrics.count_reply(name, replies.get(name))
        self.lifecycle.replicated_state.save_stop(invocation)
        if robot == FLEET:
            unanswered, answered = self.lifecycle.record_fleet_replies(invocation, online, replies)
            if unanswered:
                sees, location = caller.visible_robots.includes, invocation_path(invocation)
                raise unanswered_stop([*filter(sees, unanswered)], [*filter(sees, answered)], location)
            return invocation
        reply = replies.get(robot)
        if reply is None and not invocation.accepted:  # a report on the stop is an answer too
            self.lifecycle.mark_unknown(invocation)
            raise unanswered_stop([robot], [], invocation_path(invocation))
        if reply is None:
            return invocation
        if isinstance(reply, Refused):
            self.lifecycle.record_refusal(invocation, reply)
            raise agent_refusal(fleet[robot], reply)
        self.lifecycle.record_acceptance(invocation, reply)
        return invocation
