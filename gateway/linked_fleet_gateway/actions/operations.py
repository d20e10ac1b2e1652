"""Operations: actions that are no motion of joints, carried out by a coroutine of the gateway that accepted them.

The gateway reports on its operations to the others by moving their deadline. If it dies, another one ends them when
the deadline passes, as it ends motions whose robot reports nothing.
"""

import asyncio
import logging
import time
import uuid
from collections.abc import AsyncIterator, Awaitable, Callable, Collection, Iterable
from contextlib import asynccontextmanager
from dataclasses import dataclass

from msgspec.structs import replace
from pyoxigraph import Triple

from linked_fleet_base.errors import FleetError, Offline, OperationTimeout
from linked_fleet_gateway.actions.lifecycle import REPORT_TIMEOUT_S, Lifecycle
from linked_fleet_gateway.actions.opening import Opening
from linked_fleet_gateway.actions.plan import Caller
from linked_fleet_gateway.actions.stop_delivery import ANSWER_TIMEOUT_S
from linked_fleet_gateway.actions.store import kept_token
from linked_fleet_gateway.resources.invocation import output_ntriples
from linked_fleet_gateway.subscriptions.live import Live
from linked_fleet_rdf.graph import Graph, Node
from linked_fleet_runtime.background import cancel_tasks
from linked_fleet_state.invocations import FLEET, Invocation, InvocationState
from linked_fleet_state.robot import Robot

log = logging.getLogger(__name__)

_REPORT_S = REPORT_TIMEOUT_S / 3
_ASK_AGAIN_S = 0.5  # until the gateway that carries out an operation has cancelled it
STOPPED = "its robot was stopped"


def describe_nothing(graph: Graph, node: Node) -> None:
    """Add no statement about a rehearsal."""


@dataclass(frozen=True)
class Operation:
    """The plan of an action that is no motion of joints. ``duration_s`` is what a rehearsal says that it takes.

    ``run`` carries it out. It calls ``Call.accept`` once nothing prevents it any more; an error before that refuses the
    request. It is cancelled by a client, by a stop of its robot, and when the gateway ends. ``rehearse``, if given,
    returns the duration instead, and raises the errors by which the caller is refused. It comes before ``run``, too,
    and may take longer than ``run`` may before it accepts. ``dry_run``, if given, takes its place for a request that
    only rehearses, may take more time, and also returns a function that adds statements about the node of the
    rehearsal. An operation that ``resumes`` does not end with its gateway: its extension lets another gateway go on
    with it (``Core.resume``). ``about`` are robots that an operation of the fleet tells of: its invocation is shown to
    its client, and to those who may see all of them.
    """

    run: Callable[["Call"], Awaitable[None]]
    duration_s: float = 0.0
    rehearse: Callable[[Caller], Awaitable[float]] | None = None
    resumes: bool = False
    dry_run: Callable[[Caller], Awaitable[tuple[float, Callable[[Graph, Node], None]]]] | None = None
    about: tuple[str, ...] = ()

    async def takes_s(self, caller: Caller) -> float:
        """Return how long it would take. Raises the errors by which it would be refused."""
        return self.duration_s if self.rehearse is None else await self.rehearse(caller)

    async def rehearsed(self, caller: Caller) -> tuple[float, Callable[[Graph, Node], None]]:
        """Return how long it would take, and what to say about its rehearsal. Raises as ``takes_s``."""
        if self.dry_run is not None:
            return await self.dry_run(caller)
        return await self.takes_s(caller), describe_nothing


class Call:
    """One invocation of an operation, as seen by the coroutine that carries it out."""

    def __init__(self, invocation: Invocation, lifecycle: Lifecycle, caller: Caller) -> None:
        self._invocation, self._lifecycle = invocation, lifecycle
        self.expected_s = 0.0
        """Its duration as far as its plan knows."""
        token = kept_token(caller.lease_token)
        self.caller = replace(caller, lease_token=token, idempotency_key="", request_digest="", body="")
        """The caller, for whom further actions can be invoked (``Core.invoke``), also by another gateway later."""
        self.is_handed_over = False
        self.begun = asyncio.Event()
        """Set once it has been rehearsed, or has ended."""
        self.answered = asyncio.Event()
        """Set once it is accepted, or has ended."""

    @property
    def id(self) -> str:
        """The id of the invocation, a UUID."""
        return self._invocation.id

    @property
    def client(self) -> str:
        """The displayed name of the caller."""
        return self._invocation.client

    @property
    def cancelling(self) -> str:
        """The reason of whoever has asked to cancel it; empty if it is cancelled because the gateway ends."""
        return self._invocation.cancelling

    def hand_over(self) -> None:
        """Let the invocation stay as it is when the operation returns here, because another gateway goes on with it."""
        self.is_handed_over = True

    def accept(self, duration_s: float = 0.0) -> None:
        """Accept the request, which is then answered. ``duration_s``: how long it is expected to take."""
        invocation = self._invocation
        invocation.duration_s, invocation.started_ns = duration_s or self.expected_s, time.time_ns()
        invocation.state = InvocationState.RUNNING
        self._lifecycle.report_operation(invocation)
        self.answered.set()

    def report(self, progress: float, reason: str = "") -> None:
        """Report progress, 0 to 1, and what is being done, to everybody who watches the invocation."""
        self._invocation.progress, self._invocation.reason = min(max(progress, 0.0), 1.0), reason
        self._lifecycle.report_operation(self._invocation)

    def set_output(self, triples: Iterable[Triple], root: Node) -> None:
        """Set the statements about ``root`` that the invocation has as its ``lf:output``. Raises ValueError if long."""
        self._invocation.output = output_ntriples(triples, root)


class Operations:
    """The operations of this gateway, and the cancelling of all."""

    def __init__(self, live: Live, lifecycle: Lifecycle, opening: Opening) -> None:
        self._live, self._lifecycle, self._opening = live, lifecycle, opening
        self._running: dict[str, asyncio.Task[None]] = {}
        self._ending = False
        lifecycle.cancel_operation = self.cancel
        live.add_invocation_listener(self._on_invocation)

    async def close(self) -> None:
        """End the operations of this gateway, which nobody could carry on."""
        self._ending = True
        self._live.remove_invocation_listener(self._on_invocation)
        await cancel_tasks(list(self._running.values()))

    async def operate(
        self, action: str, operation: Operation, robot: Robot | None, caller: Caller, *, is_stop: bool = False
    ) -> Invocation:
        """Start an operation of a robot, or of the fleet. Return the invocation once it has accepted the request.

        For a repeated key it is the first one. Raises the errors of the operation before it accepts, those of
        ``Opening.create``, and AgentTimeout if it neither accepts nor refuses. An operation that ``is_stop`` is begun
        whoever has the lease, and even without Redis.
        """
        if robot is not None and not robot.online and not is_stop:
            raise Offline(f"Robot {robot.name} is offline; its actions answer again once it is back.")
        now_ns = time.time_ns()
        invocation = Invocation(
            id=str(uuid.uuid4()),
            robot=FLEET if robot is None else robot.name,
            action=action,
            targets={},
            created_ns=now_ns,
            deadline_ns=now_ns + int(REPORT_TIMEOUT_S * 1e9),
            client=caller.name,
            body=caller.body,
            operation=True,
            resumes=operation.resumes,
            about=operation.about,
        )
        if is_stop:
            self._lifecycle.register(invocation)
            self._lifecycle.replicated_state.save_stop(invocation)
        else:
            invocation, is_new = await self._opening.create(invocation, caller)
            if not is_new:
                return await self._opening.first(robot, invocation)
        await self._start(invocation, operation, Call(invocation, self._lifecycle, caller), caller)
        return invocation

    def resume(self, id: str, operation: Operation, caller: Caller) -> bool:
        """Go on here with an operation that another gateway has accepted.

        Return False if it has ended, is unknown, or goes on here already.
        """
        invocation = self._live.invocations.get(id)
        if invocation is None or not invocation.operation or invocation.is_final or id in self._running:
            return False
        invocation.expired, invocation.ended_ns, started_ns = False, None, invocation.started_ns
        call = Call(invocation, self._lifecycle, caller)
        call.accept(invocation.duration_s or 0.0)
        invocation.started_ns = started_ns or invocation.started_ns
        self._begin(invocation, operation, call, caller, [])
        return True

    async def check(self, robot: Robot | None, caller: Caller) -> None:
        """Check if an operation would be begun now, for its rehearsal. Raises the errors of ``Opening.check``."""
        await self._opening.check(FLEET if robot is None else robot.name, caller)

    async def _start(self, invocation: Invocation, operation: Operation, call: Call, caller: Caller) -> None:
        """Carry out an operation; return once it has accepted or has ended. Raises the error by which it refuses."""
        refusals = list[FleetError]()
        task = self._begin(invocation, operation, call, caller, refusals)
        try:
            await call.begun.wait()
            async with asyncio.timeout(ANSWER_TIMEOUT_S):
                await call.answered.wait()
        except TimeoutError as error:
            await cancel_tasks([task])
            raise OperationTimeout(f"The operation was not accepted within {ANSWER_TIMEOUT_S:g} s.") from error
        if refusals:
            raise refusals[0]

    def _begin(
        self, invocation: Invocation, operation: Operation, call: Call, caller: Caller, refusals: list[FleetError]
    ) -> asyncio.Task[None]:
        run = self._run(call, invocation, operation, caller, refusals)
        task = asyncio.create_task(run, name=f"operation {invocation.id}")
        self._running[invocation.id] = task
        task.add_done_callback(lambda _: self._running.pop(invocation.id, None))
        return task

    async def _run(
        self, call: Call, invocation: Invocation, operation: Operation, caller: Caller, refusals: list[FleetError]
    ) -> None:
        try:
            async with self._reporting(invocation):
                if not call.answered.is_set():
                    call.expected_s = await operation.takes_s(caller)
                call.begun.set()
                await operation.run(call)
            if not call.is_handed_over:
                invocation.progress = 1.0
                self._lifecycle.end(invocation, InvocationState.SUCCEEDED, "")
        except asyncio.CancelledError:
            if operation.resumes and call.answered.is_set() and not invocation.cancelling:
                return  # another gateway goes on with it
            self._lifecycle.end(invocation, *self._cancelled(invocation, call))
        except FleetError as error:
            if not invocation.accepted:
                invocation.refused = error.code
                refusals.append(error)
            self._lifecycle.fail(invocation, error.detail)
        except Exception:
            # The boundary: whatever the code of an extension raises, the invocation ends and the caller is answered.
            log.exception("operation %s at %s failed", invocation.id, invocation.action)
            if not invocation.accepted:
                refusals.append(FleetError("The gateway failed to carry it out; its log has the reason."))
            self._lifecycle.fail(invocation, "the gateway failed to carry it out; its log has the reason")
        finally:
            call.begun.set()
            call.answered.set()

    def _cancelled(self, invocation: Invocation, call: Call) -> tuple[InvocationState, str]:
        if self._ending:
            return InvocationState.FAILED, "the gateway that carried it out has ended"
        if not call.answered.is_set():
            return InvocationState.FAILED, "it was not accepted in time"
        return InvocationState.CANCELLED, invocation.cancelling or "cancelled"

    @asynccontextmanager
    async def _reporting(self, invocation: Invocation) -> AsyncIterator[None]:
        async def report() -> None:
            while True:
                await asyncio.sleep(_REPORT_S)
                self._lifecycle.report_operation(invocation)

        task = asyncio.create_task(report(), name=f"report {invocation.id}")
        try:
            yield
        finally:
            task.cancel()

    # -- cancelling -------------------------------------------------------------------------------------------------

    async def cancel(self, invocation: Invocation, reason: str) -> bool:
        """Cancel an operation at whichever gateway. Return False if it has not ended within ``ANSWER_TIMEOUT_S``."""
        try:
            async with asyncio.timeout(ANSWER_TIMEOUT_S):
                while not invocation.state.terminal:
                    # Asked for again, because a report of the other gateway may have overwritten it in Redis.
                    self._lifecycle.ask_to_cancel(invocation, reason)
                    await self._lifecycle.waiters.wait_until(invocation, lambda one: one.state.terminal, _ASK_AGAIN_S)
        except TimeoutError:
            return False
        return True

    def stop_robots(self, robots: Collection[str] | None) -> None:
        """Cancel the operations of robots that are stopped; of all robots for None."""
        open_ = self._live.invocations.robots_with_open() if robots is None else robots
        for robot in open_:
            for one in self._live.invocations.open_of_robot(robot):
                if one.operation:
                    self._lifecycle.ask_to_cancel(one, STOPPED)

    def _on_invocation(self, invocation: Invocation) -> None:
        if invocation.cancelling and (task := self._running.get(invocation.id)) is not None:
            task.cancel()
