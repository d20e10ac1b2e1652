"""Steps of runs at the gateway that carries them out: their actions are invoked, watched and cancelled."""

import asyncio
import logging
import time
from collections.abc import Callable, Collection
from contextlib import suppress

from msgspec.structs import replace

from linked_fleet_base.errors import NotReadYet
from linked_fleet_gateway.api import (
    Busy,
    Core,
    FleetError,
    Invocation,
    RedisUnavailable,
    RequestEvent,
    cancel_tasks,
    robot_of,
)
from linked_fleet_gateway.extensions.missions.conditions import Conditions
from linked_fleet_gateway.extensions.missions.mission import Invoke, Wait, step_at
from linked_fleet_gateway.extensions.missions.progress import with_step
from linked_fleet_gateway.extensions.missions.record import ENDED, OVER, Run, StepRun, StepState
from linked_fleet_gateway.extensions.missions.runs import RETRY_S, Runs
from linked_fleet_gateway.extensions.missions.targets import Targets
from linked_fleet_gateway.extensions.rules.rule_invocation import NoAction
from linked_fleet_gateway.faces import invocation_path
from linked_fleet_state.invocation import NOT_BEGUN

log = logging.getLogger(__name__)

_STATES: dict[str, StepState] = {"succeeded": "succeeded", "cancelled": "cancelled", "unknown": "unknown"}
_WAITS = ("waiting",)
_MOST_ATTEMPTS = 5
MEETING_S = 60.0
"""Time after the start of a gateway in which robots, and their components, may still come."""
_ABSENT_S = 20.0
"""Time in that in which the action of a step is looked for."""


class Steps:
    """Takes the steps of runs that are carried out here."""

    def __init__(self, core: Core, runs: Runs, targets: Targets, conditions: Conditions) -> None:
        self._core, self._runs, self._targets, self._conditions = core, runs, targets, conditions
        self._starting: dict[tuple[str, str, int], asyncio.Task[None]] = {}
        self._meets_until_s = time.monotonic() + MEETING_S

    async def close(self) -> None:
        """End what is being invoked; who goes on invokes it again with the same key."""
        await cancel_tasks(list(self._starting.values()))

    async def try_condition(self, id: str, run: Run, path: str, step: Wait) -> None:
        """End a step that waits for a condition, if that holds. Raises RedisUnavailable."""
        try:
            holds = await self._conditions.holds(step.condition, run.base, self._targets.identity(run.creator))
        except Busy:
            return
        except FleetError as error:
            await self._put(id, path, "failed", f"the condition cannot be evaluated: {error.detail}")
            return
        if holds:
            await self._put(id, path, "succeeded")

    def observed(self, run: Run, now_ns: int) -> Run:
        """Return the run with what is known of the invocations of its steps."""
        for path, each in run.steps.items():
            if each.invocation and each.state not in ENDED:
                invocation = self._core.live.invocations.get(each.invocation.rpartition("/")[2])
                run = with_step(run, path, _after(each, invocation, now_ns))
        return run

    def start(self, id: str, run: Run) -> None:
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
        gives_up_s = min(self._meets_until_s, time.monotonic() + _ABSENT_S)
        while self._may_start(id, path, each.attempt):
            try:
                invocation = await self._targets.invoke(id, run, path, each.attempt, step)
            except (RedisUnavailable, NotReadYet, Busy):  # asked again with the same key
                await asyncio.sleep(RETRY_S)
                continue
            except FleetError as error:
                if isinstance(error, NoAction) and time.monotonic() < gives_up_s:
                    # A gateway that has just begun goes on with a run, and has not met the robot or its components.
                    await asyncio.sleep(RETRY_S)
                    continue
                at = error.headers.get("location", "")
                state: StepState = "unknown" if at else "failed"
                self._tell(id, run, path, error.status, at, error.detail)
                await self._record(id, path, each.attempt, state, at, error.detail)
            except Exception:  # of whatever kind: the run must not wait for a step that nobody takes
                log.exception("step %s of run %s could not be taken", path, id)
                await self._record(id, path, each.attempt, "failed", "", "the gateway failed; its log has the reason")
            else:
                self._runs.note_invocation(id, invocation.id)
                self._tell(id, run, path, 202, invocation_path(invocation))
                await self._record(id, path, each.attempt, "running", invocation_path(invocation), "")
            return

    def _tell(self, id: str, run: Run, path: str, status: int, invocation: str, reason: str = "") -> None:
        """Tell the audit what a mission has asked for in the name of who runs it."""
        robot, who = robot_of(invocation) or "", run.creator.identity or run.creator.client
        at = f"/mission-runs/{id}#{path}"
        self._core.tell_of_request(RequestEvent(who, "MISSION", at, robot, status, created=invocation, reason=reason))

    def _may_start(self, id: str, path: str, attempt: int) -> bool:
        run = self._runs.known.get(id)
        if run is None or id in self._runs.stopped or run.phase in OVER or run.phase == "ending":
            return False
        held = run.steps.get(path)
        return held is not None and held.state == "starting" and held.attempt == attempt

    async def _record(self, id: str, path: str, attempt: int, state: StepState, invocation: str, reason: str) -> None:
        """Record what became of the start of a step, whatever has happened meanwhile."""

        def said(held: StepRun) -> StepRun:
            if held.attempt != attempt or held.state not in ("starting", "unknown"):
                return held
            ended_ns = time.time_ns() if state in ENDED else 0
            return replace(held, state=state, invocation=invocation, reason=reason, ended_ns=ended_ns)

        await self._runs.change_in_the_end(id, lambda run: _changed(run, path, said))

    async def _put(self, id: str, path: str, state: StepState, reason: str = "", of: Collection[str] = _WAITS) -> None:
        """End a step that is in one of the states ``of``. Raises RedisUnavailable."""

        def said(held: StepRun) -> StepRun:
            return held if held.state not in of else replace(held, state=state, reason=reason, ended_ns=time.time_ns())

        await self._runs.change(id, lambda run: _changed(run, path, said))
        self._runs.wake(id)

    async def cancel(self, id: str, run: Run, path: str) -> None:
        """Cancel a step. One whose action is being invoked is cancelled once that is known. Raises RedisUnavailable."""
        each = run.steps[path]
        if each.state == "waiting" or (each.state == "starting" and (id, path, each.attempt) not in self._starting):
            await self._put(id, path, "cancelled", each.reason, of=("waiting", "starting"))
        elif each.invocation:
            with suppress(FleetError):  # it is asked for again
                await self._core.cancel(each.invocation.rpartition("/")[2], run.reason or "another step has decided")


def _changed(run: Run, path: str, said: Callable[[StepRun], StepRun]) -> Run:
    """Return the run with another state of a leaf, if it has that leaf."""
    held = run.steps.get(path)
    return run if held is None else with_step(run, path, said(held))


def _after(each: StepRun, invocation: Invocation | None, now_ns: int) -> StepRun:
    """Return a step after what is known of its invocation.

    One that never reached its robot, because a gateway died before, is taken again: that is still at most once.
    """
    if invocation is None:
        return replace(each, state="unknown", reason="its invocation is no longer known")
    if invocation.state.terminal and invocation.expired:
        return replace(each, state="unknown", reason=invocation.reason)
    if not invocation.state.terminal:
        state: StepState = "unknown" if invocation.state == "unknown" else "running"
        return replace(each, state=state, reason=invocation.reason if state == "unknown" else "")
    if invocation.refused == NOT_BEGUN and each.attempt < _MOST_ATTEMPTS:
        return StepRun("starting", each.attempt + 1, began_ns=each.began_ns)
    state = _STATES.get(invocation.state.value, "failed")
    return replace(
        each, state=state, reason=invocation.reason, ended_ns=invocation.ended_ns or now_ns, result=invocation.outcome
    )
