"""Runs of missions, carried out by one gateway at a time, which another one follows when it dies (flow "missions").

A run is a record that all gateways share. Each step of it is a conditional write that names the record before: of two
gateways that believe to carry it out, one is refused. A leaf is recorded as *starting* before its action is invoked,
with an idempotency key of its own, so that who goes on invokes it again and gets the same invocation.
"""

import asyncio
import logging
import time
from collections.abc import Collection
from contextlib import suppress

from msgspec.structs import replace

from linked_fleet_gateway.api import (
    Call,
    Conflict,
    Core,
    FleetError,
    Invocation,
    Operation,
    RedisUnavailable,
    cancel_tasks,
    supervised,
)
from linked_fleet_gateway.extensions.missions.control import Control
from linked_fleet_gateway.extensions.missions.mission import Wait, step_at
from linked_fleet_gateway.extensions.missions.progress import ending, progress_of, settle
from linked_fleet_gateway.extensions.missions.record import ENDED, OVER, Phase, Run
from linked_fleet_gateway.extensions.missions.runs import RETRY_S, Runs
from linked_fleet_gateway.extensions.missions.steps import Steps
from linked_fleet_gateway.serving import Caller

log = logging.getLogger(__name__)

SILENT_S = 15.0
"""Time without a report of its gateway after which another one goes on with a run."""
_FORGOTTEN_S = 120.0  # without an invocation, which may not have been heard of yet
_LOOK_S = 2.0
_CHECK_S = 0.5  # between two evaluations of a condition
KEPT = 200
"""Runs that are over and kept."""


class MissionFailedError(FleetError):
    """The run has failed, for the reason in the text."""

    status, code, title = 409, "mission-failed", "The mission failed"


class Engine:
    """Carries out runs; an async context manager."""

    def __init__(self, core: Core, runs: Runs, steps: Steps) -> None:
        self._core, self._runs, self._steps = core, runs, steps
        self._control = Control(core)
        self._drivers: dict[str, asyncio.Task[None]] = {}
        self._ending: set[asyncio.Task[None]] = set()
        self._looking: list[asyncio.Task[None]] = []
        self._since_ns = time.time_ns()

    async def __aenter__(self) -> "Engine":
        failed = "runs of gateways that have died are not continued"
        self._looking = [supervised(self._look, "look for runs", log, failed, _LOOK_S)]
        return self

    async def __aexit__(self, *_: object) -> None:
        drivers = list(self._drivers)
        await cancel_tasks([*self._looking, *self._drivers.values(), *self._ending])
        await self._steps.close()
        for id in drivers:
            with suppress(RedisUnavailable):
                await self._runs.change(id, lambda run: replace(run, owner="") if run.owner == self._core.run else run)

    # -- what people ask for ----------------------------------------------------------------------------------------

    async def begin(self, call: Call, run: Run) -> None:
        """Carry out a new run, until it is over, as the operation ``call``. Raises Controlled, MissionFailedError."""
        run = await self._control.take(run)
        if not await self._runs.replace(call.id, replace(run, owner=self._core.run)):
            raise Conflict("The run has begun already.")
        with suppress(RedisUnavailable):  # it is tried again
            await self._control.keep(call.id, run)
        call.accept()
        await self._carry_on(call)

    def stop(self, robots: Collection[str] | None) -> None:
        """End the runs that use robots which somebody stops; all runs for None."""
        for id, run in self._runs.known.items():
            used = run.robots if robots is None else [each for each in run.robots if each in robots]
            if run.phase in OVER or (robots is not None and not used) or id in self._runs.stopped:
                continue
            verb = "was" if len(used) == 1 else "were"
            whom = "all robots were" if robots is None else f"{', '.join(used)[:200]} {verb}"
            self._end_soon(id, "failed", f"{whom} stopped by a client")

    def _end_soon(self, id: str, outcome: Phase, reason: str) -> None:
        """Begin nothing more in a run, from now on, and record that it ends."""
        if id not in self._runs.stopped:
            self._runs.stopped.add(id)
            task = asyncio.create_task(self._end(id, outcome, reason), name=f"end run {id}")
            self._ending.add(task)
            task.add_done_callback(self._ending.discard)

    async def _end(self, id: str, outcome: Phase, reason: str) -> None:
        await self._runs.change_in_the_end(id, lambda run: ending(run, outcome, reason))
        self._runs.stopped.discard(id)

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
                await self._runs.replace(id, None)

    def _is_orphan(self, id: str, run: Run) -> bool:
        invocation, now_ns = self._core.live.invocations.get(id), time.time_ns()
        if invocation is None:
            return now_ns - max(run.began_ns, self._since_ns) > _FORGOTTEN_S * 1e9
        if not invocation.accepted:
            return now_ns - run.began_ns > 2 * SILENT_S * 1e9
        return not run.owner or self._core.silence_s(invocation) > SILENT_S

    async def _adopt(self, id: str, run: Run) -> None:
        invocation = self._core.live.invocations.get(id)
        if invocation is None or invocation.is_final or not invocation.accepted:
            reason = "its invocation is no longer known" if invocation is None else invocation.reason
            await self._runs.replace(id, replace(run, phase="failed", reason=reason, ended_ns=time.time_ns()))
            return
        if await self._runs.replace(id, replace(run, owner=self._core.run)):
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
            self._runs.sleep(call.id)
        run = self._runs.known.get(call.id)
        if run is not None and run.phase not in OVER and run.owner != self._core.run:
            call.hand_over()  # this gateway was away for so long that another one has gone on
            return
        if run is not None and run.phase == "cancelled":
            raise asyncio.CancelledError
        if run is None or run.phase != "succeeded":
            raise MissionFailedError(run.reason or "a step failed" if run is not None else "its record is gone")

    async def _drive(self, call: Call) -> None:
        awake = self._runs.waking(call.id)
        while True:
            awake.clear()
            try:
                wait_s = await self._advance(call)
            except RedisUnavailable:
                wait_s = RETRY_S
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
        seen = self._steps.observed(run, now_ns)
        settled, cancel = settle(seen, now_ns)
        if settled != run:
            if not await self._runs.replace(id, settled):
                return 0.0
            call.report(progress_of(settled), _said(settled))
        await self._control.keep(id, settled)
        if settled.phase in OVER:
            return None
        if settled.phase != "ending" and id not in self._runs.stopped:
            self._steps.start(id, settled)
        for path in cancel:
            await self._steps.cancel(id, settled, path)
        return await self._until_next(id, settled, now_ns)

    async def _until_next(self, id: str, run: Run, now_ns: int) -> float:
        waiting = {path: each for path, each in run.steps.items() if each.state == "waiting"}
        due = [each.due_ns for each in waiting.values() if each.due_ns]
        wait_s = min([_LOOK_S * 5, *(max(each - now_ns, 0) / 1e9 for each in due)])
        for path in waiting:
            step = step_at(run.mission.step, path)
            if isinstance(step, Wait) and step.condition and run.phase == "running":
                wait_s = min(wait_s, _CHECK_S)
                await self._steps.try_condition(id, run, path, step)
        return wait_s

    # -- news -------------------------------------------------------------------------------------------------------

    def hear(self, invocation: Invocation) -> None:
        """Take note of a change of an invocation."""
        if (id := self._runs.of_invocation(invocation)) is not None:
            self._runs.wake(id)

    def changed(self, id: str, before: Run | None, after: Run | None) -> None:
        """Take note of a record that has changed here or at another gateway."""
        self._runs.note(id, after)
        self._core.mark_changed("/mission-runs", f"/mission-runs/{id}")
        self._runs.wake(id)


def _said(run: Run) -> str:
    """Return what a run does, for people."""
    running = [step_at(run.mission.step, path) for path, each in run.steps.items() if each.state not in ENDED]
    named = ", ".join(each.title or each.name for each in running if each.title or each.name)
    return run.reason or named[:200]
