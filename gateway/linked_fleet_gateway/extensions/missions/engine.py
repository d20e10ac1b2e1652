"""Runs of missions, carried out by one gateway at a time, which another one follows when it dies (flow "missions").

A run is a record that all gateways share. Each step of it is a conditional write that names the record before: of two
gateways that believe to carry it out, one is refused. A leaf is recorded as *starting* before its action is invoked,
with an idempotency key of its own, so that who goes on invokes it again and gets the same invocation.
"""

import asyncio
import logging
import time
from collections.abc import Callable, Collection, Iterable
from contextlib import suppress

from msgspec.structs import replace

from linked_fleet_gateway.api import (
    Busy,
    Call,
    Conflict,
    Core,
    FleetError,
    Invocation,
    NotFound,
    Operation,
    RedisUnavailable,
    RequestEvent,
    Table,
    cancel_tasks,
    robot_of,
    supervised,
)
from linked_fleet_gateway.extensions.missions.conditions import Conditions
from linked_fleet_gateway.extensions.missions.mission import Invoke, Wait, step_at
from linked_fleet_gateway.extensions.missions.progress import ending, progress_of, settle, with_step
from linked_fleet_gateway.extensions.missions.record import ENDED, OVER, Phase, Run, StepRun, StepState
from linked_fleet_gateway.extensions.missions.targets import Targets
from linked_fleet_gateway.faces import invocation_path
from linked_fleet_gateway.serving import Caller

log = logging.getLogger(__name__)

SILENT_S = 15.0
"""Time without a report of its gateway after which another one goes on with a run."""
_RESUME_S = 120.0  # the deadline of an operation that resumes, after its last report
_LOOK_S = 2.0
_RETRY_S = 1.0
_CHECK_S = 0.5  # between two evaluations of a condition
KEPT = 200
"""Runs that are over and kept."""
_STATES: dict[str, StepState] = {"succeeded": "succeeded", "cancelled": "cancelled", "unknown": "unknown"}

Change = Callable[[Run], Run]


class MissionFailedError(FleetError):
    """The run has failed, for the reason in the text."""

    status, code, title = 409, "mission-failed", "The mission failed"


class Engine:
    """Carries out runs; an async context manager. ``runs`` are all runs by the id of their invocation."""

    def __init__(self, core: Core, runs: Table[Run], targets: Targets, conditions: Conditions) -> None:
        self._core, self._runs, self._targets, self._conditions = core, runs, targets, conditions
        self._drivers: dict[str, asyncio.Task[None]] = {}
        self._awake: dict[str, asyncio.Event] = {}
        self._starting: dict[tuple[str, str, int], asyncio.Task[None]] = {}
        self._ending: set[asyncio.Task[None]] = set()
        self._of_invocation: dict[str, str] = {}
        self._stopped: set[str] = set()
        """Runs that begin nothing any more, because their robots are stopped; before that is recorded."""
        self._looking: list[asyncio.Task[None]] = []
        self._since_ns = time.time_ns()

    async def __aenter__(self) -> "Engine":
        failed = "runs of gateways that have died are not continued"
        self._looking = [supervised(self._look, "look for runs", log, failed, _LOOK_S)]
        return self

    async def __aexit__(self, *_: object) -> None:
        drivers = list(self._drivers)
        await cancel_tasks([*self._looking, *self._drivers.values(), *self._starting.values(), *self._ending])
        for id in drivers:
            with suppress(RedisUnavailable):
                await self.change(id, lambda run: replace(run, owner="") if run.owner == self._core.run else run)

    # -- what people ask for ----------------------------------------------------------------------------------------

    async def begin(self, call: Call, run: Run) -> None:
        """Carry out a new run, until it is over, as the operation ``call``. Raises MissionFailedError."""
        if not await self._runs.change(call.id, replace(run, owner=self._core.run)):
            raise Conflict("The run has begun already.")
        call.accept()
        await self._carry_on(call)

    async def change(self, id: str, change: Change) -> Run:
        """Change the record of a run. Return it. Raises NotFound, RedisUnavailable, and errors of ``change``."""
        while (run := self._runs.known.get(id)) is not None:
            changed = change(run)
            if changed == run or await self._runs.change(id, changed):
                return changed
        raise NotFound("The run has been deleted.")

    def stop(self, robots: Collection[str] | None) -> None:
        """End the runs that use robots which somebody stops; all runs for None."""
        for id, run in self._runs.known.items():
            used = run.robots if robots is None else [each for each in run.robots if each in robots]
            if run.phase in OVER or (robots is not None and not used) or id in self._stopped:
                continue
            verb = "was" if len(used) == 1 else "were"
            whom = "all robots were" if robots is None else f"{', '.join(used)[:200]} {verb}"
            self._end_soon(id, "failed", f"{whom} stopped by a client")

    def _end_soon(self, id: str, outcome: Phase, reason: str) -> None:
        """Begin nothing more in a run, from now on, and record that it ends."""
        if id not in self._stopped:
            self._stopped.add(id)
            task = asyncio.create_task(self._end(id, outcome, reason), name=f"end run {id}")
            self._ending.add(task)
            task.add_done_callback(self._ending.discard)

    async def _end(self, id: str, outcome: Phase, reason: str) -> None:
        while True:
            try:
                await self.change(id, lambda run: ending(run, outcome, reason))
            except NotFound:
                pass
            except RedisUnavailable:  # nothing begins without Redis either
                await asyncio.sleep(_RETRY_S)
                continue
            self._stopped.discard(id)
            self.wake(id)
            return

    # -- runs of other gateways -------------------------------------------------------------------------------------

    async def _look(self) -> None:
        """Go on with runs whose gateway has gone, and forget the oldest ones."""
        for id, run in list(self._runs.known.items()):
            if run.phase not in OVER and id not in self._drivers and self._is_orphan(id, run):
                with suppress(RedisUnavailable):
                    await self._adopt(id, run)
        over = sorted((run.ended_ns, id) for id, run in self._runs.known.items() if run.phase in OVER)
        for _, id in over[:-KEPT]:
            with suppress(RedisUnavailable):
                await self._runs.change(id, None)

    def _is_orphan(self, id: str, run: Run) -> bool:
        invocation, now_ns = self._core.live.invocations.get(id), time.time_ns()
        if invocation is None:
            return now_ns - max(run.began_ns, self._since_ns) > _RESUME_S * 1e9
        if not invocation.accepted:
            return now_ns - run.began_ns > 2 * SILENT_S * 1e9
        reported_ns = invocation.deadline_ns - int(_RESUME_S * 1e9)
        return not run.owner or now_ns - reported_ns > SILENT_S * 1e9

    async def _adopt(self, id: str, run: Run) -> None:
        invocation = self._core.live.invocations.get(id)
        if invocation is None or invocation.is_final or not invocation.accepted:
            reason = "its invocation is no longer known" if invocation is None else invocation.reason
            await self._runs.change(id, replace(run, phase="failed", reason=reason, ended_ns=time.time_ns()))
            return
        if await self._runs.change(id, replace(run, owner=self._core.run)):
            log.info("run %s of %s goes on here", id, run.mission.title)
            caller = Caller(run.creator.client)
            self._core.resume(id, Operation(self._carry_on, resumes=True), caller)

    # -- carrying out -----------------------------------------------------------------------------------------------

    async def _carry_on(self, call: Call) -> None:
        """Wait until a run is over.

        Raises MissionFailedError, and CancelledError if the run was cancelled, or the gateway ends.
        """
        if call.cancelling:
            self._end_soon(call.id, "cancelled", call.cancelling)
        driver = self._drivers[call.id] = asyncio.create_task(self._drive(call), name=f"run {call.id}")
        try:
            while not driver.done():
                try:
                    await asyncio.shield(driver)
                except asyncio.CancelledError:
                    if driver.cancelled() or not call.cancelling:
                        raise
                    self._end_soon(call.id, "cancelled", call.cancelling)
        finally:
            driver.cancel()
            self._drivers.pop(call.id, None)
            self._awake.pop(call.id, None)
        run = self._runs.known.get(call.id)
        if run is not None and run.phase not in OVER and run.owner != self._core.run:
            call.hand_over()  # this gateway was away for so long that another one has gone on
            return
        if run is not None and run.phase == "cancelled":
            raise asyncio.CancelledError
        if run is None or run.phase != "succeeded":
            raise MissionFailedError(run.reason or "a step failed" if run is not None else "its record is gone")

    async def _drive(self, call: Call) -> None:
        id, awake = call.id, asyncio.Event()
        self._awake[id] = awake
        while True:
            awake.clear()
            try:
                wait_s = await self._advance(call)
            except RedisUnavailable:
                wait_s = _RETRY_S
            if wait_s is None:
                return
            with suppress(TimeoutError):
                async with asyncio.timeout(wait_s):
                    await awake.wait()

    async def _advance(self, call: Call) -> float | None:
        """Take all steps that can be taken now. Return how long nothing else happens by itself; None at the end."""
        id = call.id
        run = self._runs.known.get(id)
        if run is None or run.owner != self._core.run:
            return None
        now_ns = time.time_ns()
        seen = self._observed(run, now_ns)
        settled, cancel = settle(seen, now_ns)
        if settled != run:
            if not await self._runs.change(id, settled):
                return 0.0
            call.report(progress_of(settled), _said(settled))
        if settled.phase in OVER:
            return None
        if settled.phase != "ending" and id not in self._stopped:
            self._start(id, settled)
        for path in cancel:
            await self._cancel_step(id, settled, path)
        return await self._until_next(id, settled, now_ns)

    async def _until_next(self, id: str, run: Run, now_ns: int) -> float:
        waiting = {path: each for path, each in run.steps.items() if each.state == "waiting"}
        due = [each.due_ns for each in waiting.values() if each.due_ns]
        wait_s = min([_LOOK_S * 5, *(max(each - now_ns, 0) / 1e9 for each in due)])
        for path in waiting:
            step = step_at(run.mission.step, path)
            if isinstance(step, Wait) and step.condition and run.phase == "running":
                wait_s = min(wait_s, _CHECK_S)
                await self._try_condition(id, run, path, step)
        return wait_s

    async def _try_condition(self, id: str, run: Run, path: str, step: Wait) -> None:
        try:
            holds = await self._conditions.holds(step.condition, run.base, self._targets.identity(run.creator))
        except Busy:
            return
        except FleetError as error:
            await self._put(id, path, "failed", reason=f"the condition cannot be evaluated: {error.detail}")
            return
        if holds:
            await self._put(id, path, "succeeded")

    # -- steps ------------------------------------------------------------------------------------------------------

    def _observed(self, run: Run, now_ns: int) -> Run:
        """Return the run with what is known of the invocations of its steps."""
        for path, each in run.steps.items():
            if each.invocation and each.state not in ENDED:
                invocation = self._core.live.invocations.get(each.invocation.rpartition("/")[2])
                run = with_step(run, path, _after(each, invocation, now_ns))
        return run

    def _start(self, id: str, run: Run) -> None:
        """Invoke the actions of the leaves that are starting, each in a task of its own."""
        for path, each in run.steps.items():
            key = id, path, each.attempt
            if each.state != "starting" or key in self._starting:
                continue
            task = asyncio.create_task(self._invoke(id, run, path, each), name=f"step {path} of run {id}")
            self._starting[key] = task
            task.add_done_callback(lambda _, key=key: self._starting.pop(key, None))  # type: ignore[misc]

    async def _invoke(self, id: str, run: Run, path: str, each: StepRun) -> None:
        step = step_at(run.mission.step, path)
        assert isinstance(step, Invoke)
        while self._may_start(id, path, each.attempt):
            try:
                invocation = await self._targets.invoke(id, run, path, each.attempt, step)
            except (RedisUnavailable, Busy):  # asked again with the same key
                await asyncio.sleep(_RETRY_S)
                continue
            except FleetError as error:
                at = error.headers.get("location", "")
                state: StepState = "unknown" if at else "failed"
                self._tell(id, run, path, error.status, at)
                await self._record(id, path, each.attempt, state, at, error.detail)
            except Exception:  # of whatever kind: the run must not wait for a step that nobody takes
                log.exception("step %s of run %s could not be taken", path, id)
                await self._record(id, path, each.attempt, "failed", "", "the gateway failed; its log has the reason")
            else:
                self._of_invocation[invocation.id] = id
                self._tell(id, run, path, 202, invocation_path(invocation))
                await self._record(id, path, each.attempt, "running", invocation_path(invocation), "")
            return

    def _tell(self, id: str, run: Run, path: str, status: int, invocation: str) -> None:
        """Tell the audit what a mission has asked for in the name of who runs it."""
        robot, who = robot_of(invocation) or "", run.creator.identity or run.creator.client
        event = RequestEvent(who, "MISSION", f"/mission-runs/{id}#{path}", robot, status, created=invocation)
        self._core.tell_of_request(event)

    def _may_start(self, id: str, path: str, attempt: int) -> bool:
        run = self._runs.known.get(id)
        if run is None or id in self._stopped or run.phase in OVER or run.phase == "ending":
            return False
        held = run.steps.get(path)
        return held is not None and held.state == "starting" and held.attempt == attempt

    async def _record(self, id: str, path: str, attempt: int, state: StepState, invocation: str, reason: str) -> None:
        """Record what became of the start of a step, whatever has happened meanwhile."""

        def change(run: Run) -> Run:
            held = run.steps.get(path)
            if held is None or held.attempt != attempt or held.state not in ("starting", "unknown"):
                return run
            ended_ns = time.time_ns() if state in ENDED else 0
            said = replace(held, state=state, invocation=invocation, reason=reason, ended_ns=ended_ns)
            return with_step(run, path, said)

        while True:
            try:
                await self.change(id, change)
            except NotFound:
                pass
            except RedisUnavailable:
                await asyncio.sleep(_RETRY_S)
                continue
            self.wake(id)
            return

    async def _put(self, id: str, path: str, state: StepState, reason: str = "") -> None:
        def change(run: Run) -> Run:
            held = run.steps.get(path)
            if held is None or held.state != "waiting":
                return run
            return with_step(run, path, replace(held, state=state, reason=reason, ended_ns=time.time_ns()))

        await self.change(id, change)
        self.wake(id)

    async def _cancel_step(self, id: str, run: Run, path: str) -> None:
        each = run.steps[path]
        if each.state == "waiting" or (each.state == "starting" and (id, path, each.attempt) not in self._starting):
            await self._put_cancelled(id, path)
        elif each.invocation:
            with suppress(FleetError):  # it is asked for again
                await self._core.cancel(each.invocation.rpartition("/")[2], run.reason or "another step has decided")

    async def _put_cancelled(self, id: str, path: str) -> None:
        def change(run: Run) -> Run:
            held = run.steps.get(path)
            if held is None or held.state not in ("waiting", "starting"):
                return run
            return with_step(run, path, replace(held, state="cancelled", ended_ns=time.time_ns()))

        await self.change(id, change)
        self.wake(id)

    # -- news -------------------------------------------------------------------------------------------------------

    def wake(self, id: str) -> None:
        """Let a run that is carried out here go on, because something has changed."""
        if (event := self._awake.get(id)) is not None:
            event.set()

    def hear(self, invocation: Invocation) -> None:
        """Take note of a change of an invocation."""
        if (id := self._of_invocation.get(invocation.id)) is not None:
            if invocation.state.terminal:
                self._of_invocation.pop(invocation.id)
            self.wake(id)

    def changed(self, id: str, before: Run | None, after: Run | None) -> None:
        """Take note of a record that has changed here or at another gateway."""
        for each in _invocations(after):
            self._of_invocation.setdefault(each, id)
        self._core.mark_changed("/mission-runs", f"/mission-runs/{id}")
        self.wake(id)


def _invocations(run: Run | None) -> Iterable[str]:
    open_ = [] if run is None or run.phase in OVER else [one for one in run.steps.values() if one.state not in ENDED]
    return [each.invocation.rpartition("/")[2] for each in open_ if each.invocation]


def _after(each: StepRun, invocation: Invocation | None, now_ns: int) -> StepRun:
    """Return a step after what is known of its invocation."""
    if invocation is None:
        return replace(each, state="unknown", reason="its invocation is no longer known")
    if invocation.state.terminal and invocation.expired:
        return replace(each, state="unknown", reason=invocation.reason)
    if not invocation.state.terminal:
        state: StepState = "unknown" if invocation.state == "unknown" else "running"
        return replace(each, state=state, reason=invocation.reason if state == "unknown" else "")
    state = _STATES.get(invocation.state.value, "failed")
    return replace(
        each, state=state, reason=invocation.reason, ended_ns=invocation.ended_ns or now_ns, result=invocation.outcome
    )


def _said(run: Run) -> str:
    """Return what a run does, for people."""
    running = [step_at(run.mission.step, path) for path, each in run.steps.items() if each.state not in ENDED]
    named = ", ".join(each.title or each.name for each in running if each.title or each.name)
    return run.reason or named[:200]
