"""Progress of runs: the states of its steps decide which ones begin, and which ones are cancelled. Pure.

A run is a function of its record alone, so that a gateway that takes over decides as the one before would have.
"""

from collections.abc import Collection
from dataclasses import dataclass, field
from datetime import UTC, datetime

from msgspec.structs import replace

from linked_fleet_gateway.extensions.missions.mission import (
    Confirm,
    FirstOf,
    Invoke,
    Notify,
    Parallel,
    Repeat,
    Sequence,
    Step,
    Wait,
    step_at,
    walk,
)
from linked_fleet_gateway.extensions.missions.record import ENDED, OVER, Phase, Run, StepRun, StepState

ROOT = "0"
MOST_NOTES = 50
_GOOD: frozenset[StepState] = frozenset({"succeeded", "skipped"})


@dataclass
class _Next:
    """The work that is due: leaves to begin, and running leaves to cancel, by path."""

    begin: list[tuple[str, Step]] = field(default_factory=list)
    cancel: list[str] = field(default_factory=list)
    rounds: dict[str, int] = field(default_factory=dict)
    """Rounds of repeating steps that are complete."""


def settle(run: Run, now_ns: int) -> tuple[Run, list[str]]:
    """Return the run after all that follows from its steps, and the leaves to cancel.

    A paused or blocked run begins nothing. A run that is ``ending`` cancels what runs, and is over once nothing does.
    """
    while True:
        settled, cancel = _settle_once(run, now_ns)
        if settled == run:
            return run, cancel
        run = settled


def _settle_once(run: Run, now_ns: int) -> tuple[Run, list[str]]:
    todo = _Next()
    if run.phase in OVER:
        return run, []
    run = _elapsed(run, now_ns)
    if run.phase == "ending":
        open_ = [path for path, each in run.steps.items() if each.state not in ENDED]
        if any(run.steps[path].state != "unknown" for path in open_):
            return run, open_
        assert run.outcome
        return replace(run, phase=run.outcome, ended_ns=now_ns), []
    state = _tick(run.mission.step, ROOT, run, todo)
    if state in ENDED and all(each.state in ENDED for each in run.steps.values()):
        return _ended(run, state, now_ns), []
    if run.phase == "running":
        for path, rounds in todo.rounds.items():
            run = _round_over(run, path, rounds)
        for path, step in todo.begin:
            run = _begin(run, path, step, 1, now_ns)
    return run, todo.cancel


def _elapsed(run: Run, now_ns: int) -> Run:
    """Return the run with the ends of its waits that are due."""
    due = {path: each for path, each in run.steps.items() if each.state == "waiting" and 0 < each.due_ns <= now_ns}
    for path, each in due.items():
        step = step_at(run.mission.step, path)
        late = isinstance(step, Wait) and bool(step.condition)
        reason = f"the condition had no answer within {step.within:g} s" if isinstance(step, Wait) and late else ""
        ended = replace(each, state="failed" if late else "succeeded", ended_ns=now_ns, reason=reason)
        run = with_step(run, path, ended)
    return run


def _begin(run: Run, path: str, step: Step, attempt: int, now_ns: int) -> Run:
    """Return the run with a leaf that has begun. An action is still to be invoked."""
    begun = StepRun("starting", attempt, began_ns=now_ns)
    if isinstance(step, Notify):
        run = replace(run, notes=(*run.notes, step.text)[-MOST_NOTES:])
        begun = replace(begun, state="succeeded", ended_ns=now_ns)
    elif isinstance(step, Wait):
        begun = replace(begun, state="waiting", due_ns=due_ns(step, now_ns))
    elif isinstance(step, Confirm):
        begun = replace(begun, state="waiting", reason=step.text)
    return with_step(run, path, begun)


def due_ns(step: Wait, now_ns: int) -> int:
    """Return when a wait that begins now ends, or when it fails. Raises ValueError for a time that is none."""
    if step.until:
        at = datetime.fromisoformat(step.until)
        return max(round((at if at.tzinfo else at.replace(tzinfo=UTC)).timestamp() * 1e9), 1)
    return now_ns + round((step.within if step.condition else step.seconds or 0.0) * 1e9)


def with_step(run: Run, path: str, said: StepRun) -> Run:
    """Return the run with another state of a leaf."""
    return replace(run, steps={**run.steps, path: said})


def _round_over(run: Run, path: str, rounds: int) -> Run:
    """Return the run after a round of a repeating step. The steps of the last round stay."""
    step, inside = step_at(run.mission.step, path), f"{path}.0#"
    if not isinstance(step, Repeat) or rounds >= step.times:
        return replace(run, rounds={**run.rounds, path: rounds})
    steps = {each: said for each, said in run.steps.items() if not each.startswith(inside)}
    inner = {each: said for each, said in run.rounds.items() if not each.startswith(inside)}
    return replace(run, rounds={**inner, path: rounds}, steps=steps)


def _ended(run: Run, state: StepState, now_ns: int) -> Run:
    if state in _GOOD:
        return replace(run, phase="succeeded", ended_ns=now_ns)
    reason = next((each.reason for each in reversed(list(run.steps.values())) if each.state == "failed"), "")
    if run.mission.holds:
        return replace(run, phase="blocked", reason=reason)
    return replace(run, phase="failed", reason=reason, ended_ns=now_ns)


def _tick(step: Step, path: str, run: Run, todo: _Next) -> StepState:
    """Return the state of a step, adding what is to be done below it."""
    match step:
        case Sequence():
            return _in_turn(step.steps, path, run, todo, goes_on=_GOOD, end="succeeded")
        case FirstOf():
            return _in_turn(step.steps, path, run, todo, goes_on=ENDED - _GOOD, end="failed")
        case Parallel():
            return _together(step, path, run, todo)
        case Repeat():
            return _rounds(step, path, run, todo)
    held = run.steps.get(path)
    if held is None:
        todo.begin.append((path, step))
        return "running"
    return held.state


def _in_turn(
    steps: tuple[Step, ...],
    path: str,
    run: Run,
    todo: _Next,
    *,
    goes_on: frozenset[StepState],
    end: StepState,
) -> StepState:
    for number, each in enumerate(steps):
        state = _tick(each, f"{path}.{number}", run, todo)
        if state not in goes_on:
            return state
    return end


def _together(step: Parallel, path: str, run: Run, todo: _Next) -> StepState:
    own = _Next()
    states = [_tick(each, f"{path}.{number}", run, own) for number, each in enumerate(step.steps)]
    good, bad = [each in _GOOD for each in states], [each in ENDED - _GOOD for each in states]
    decided = any(good) or all(bad) if step.anySuffices else any(bad) or all(good)
    if not decided:
        todo.begin += own.begin
        todo.cancel += own.cancel
        todo.rounds |= own.rounds
        return "running"
    if open_ := [each for each, said in run.steps.items() if _below(each, path) and said.state not in ENDED]:
        todo.cancel += open_
        return "running"
    return "succeeded" if (any(good) if step.anySuffices else all(good)) else "failed"


def _rounds(step: Repeat, path: str, run: Run, todo: _Next) -> StepState:
    done = run.rounds.get(path, 0)
    if done >= step.times:
        return "succeeded"
    state = _tick(step.step, f"{path}.0#{done}", run, todo)
    if state not in _GOOD:
        return state
    todo.rounds[path] = done + 1
    return "succeeded" if done + 1 >= step.times else "running"


def _below(path: str, above: str) -> bool:
    return path.startswith((above + ".", above + "#"))


# -- changes by people ------------------------------------------------------------------------------------------------


def ending(run: Run, outcome: Phase, reason: str) -> Run:
    """Return a run that ends once its running steps have ended. Nothing begins any more."""
    if run.phase in OVER or run.phase == "ending":
        return run
    return replace(run, phase="ending", outcome=outcome, reason=reason)


def retried(run: Run, path: str, now_ns: int) -> Run:
    """Return a run that takes a step again, with those that were cancelled because of it."""
    return _taken_again(run, [path], now_ns)


def skipped(run: Run, path: str, now_ns: int) -> Run:
    """Return a run that goes on as if a step had succeeded, with those that were cancelled because of it."""
    run = with_step(run, path, replace(run.steps[path], state="skipped", ended_ns=now_ns))
    return _taken_again(run, [], now_ns)


def confirmed(run: Run, path: str, good: bool, by: str, now_ns: int) -> Run:
    """Return a run in which somebody has confirmed what a step asks, or has denied it."""
    reason = f"{'confirmed' if good else 'denied'} by {by or 'somebody'}"
    state: StepState = "succeeded" if good else "failed"
    return with_step(run, path, replace(run.steps[path], state=state, reason=reason, ended_ns=now_ns))


def _taken_again(run: Run, paths: Collection[str], now_ns: int) -> Run:
    """Return a run that takes these steps again, and all that were cancelled."""
    for path, said in run.steps.items():
        if path in paths or said.state == "cancelled":
            run = _begin(run, path, step_at(run.mission.step, path), said.attempt + 1, now_ns)
    return replace(run, phase="running", reason="") if run.phase == "blocked" else run


def progress_of(run: Run) -> float:
    """Return the share of its steps that have ended, 0 to 1, as far as that is known."""
    leaves = sum(isinstance(each, Invoke | Wait | Confirm | Notify) for each, _ in walk(run.mission.step))
    ended = sum(each.state in ENDED for each in run.steps.values())
    return 1.0 if run.phase == "succeeded" else min(ended / max(leaves, 1), 0.99)
