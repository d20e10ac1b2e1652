"""The running actions of a robot's components.

Each runs as a task of the event loop, or in a thread of its own. Actions that move something end when they are stopped;
one that ignores its cancellation for longer than its stop time is a fault of the robot until it ends. Times are
monotonic seconds and are passed in.
"""

import asyncio
import logging
import math
import threading
from collections.abc import Awaitable, Callable, Container, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

import msgspec

from linked_fleet_agent.components.call import Call, CancelledActionError, EndUnknownError
from linked_fleet_agent.components.declaration import Task
from linked_fleet_agent.components.input_stream import InputStream
from linked_fleet_agent.motion import Outcome, State
from linked_fleet_agent.wire.components import BASE, MAX_FEEDBACK_BYTES, MAX_RESULT_BYTES, read_value
from linked_fleet_agent.wire.schema import Schema

_log = logging.getLogger(__name__)

MAX_RUNNING = 64
FEEDBACK_S = 0.1
"""Least time between two feedbacks of an action."""


@dataclass
class _Operation:
    id: str
    name: str
    task: Task
    deadline_s: float
    progress: float = 0.0
    reason: str = ""
    feedback: bytes | None = None
    told_s: float = -FEEDBACK_S
    news: bool = False
    ending: tuple[State, str, str] | None = None
    """State, reason and successor of one that was told to end."""
    overdue_s: float | None = None
    """Time from which one that was told to end is overdue."""
    cancel: Callable[[bool], None] = field(default=lambda replaced: None)
    stream: InputStream | None = None
    call: Call[Any] | None = None

    @property
    def resumes(self) -> bool:
        return self.task.resume is not None

    @property
    def moves(self) -> frozenset[str]:
        return frozenset(self.task.declared.moves)

    @property
    def joints(self) -> tuple[str, ...]:
        return tuple(each for each in self.task.declared.moves if each != BASE)

    def outcome(self, state: State, reason: str = "", successor: str = "", result: bytes | None = None) -> Outcome:
        progress = 1.0 if state == "succeeded" else self.progress
        counts = None if self.stream is None else self.stream.counts
        return Outcome(self.id, state, self.joints, reason[:1024], progress, successor, self.feedback, result, counts)


class Operations:
    """The running actions of one robot. For its event loop only, but for what methods of components call."""

    def __init__(self) -> None:
        self._running: dict[str, _Operation] = {}
        self._outcomes: list[Outcome] = []
        self._tasks: set[asyncio.Task[None]] = set()

    def __len__(self) -> int:
        return len(self._running)

    @property
    def idle(self) -> bool:
        """True if nothing runs, and all ends have been returned."""
        return not (self._running or self._outcomes)

    def begin(
        self,
        id: str,
        name: str,
        task: Task,
        given: Mapping[str, Any],
        now_s: float,
        stream: InputStream | None = None,
    ) -> None:
        """Begin an action; ``name`` is that of its component and its own, ``given`` its input by parameter."""
        self._begin(id, name, task, task.run, given, task.takes_call, now_s, stream)

    def resume(self, id: str, name: str, task: Task, now_s: float) -> None:
        """Take up a run that an earlier agent has begun."""
        assert task.resume is not None
        self._begin(id, name, task, task.resume, {}, True, now_s)

    def _begin(
        self,
        id: str,
        name: str,
        task: Task,
        run: Callable[..., Any],
        given: Mapping[str, Any],
        takes_call: bool,
        now_s: float,
        stream: InputStream | None = None,
    ) -> None:
        until_s = now_s + task.declared.duration_s if stream is None else math.inf
        operation = _Operation(id, name, task, until_s, stream=stream)
        loop = asyncio.get_running_loop()

        def report(progress: float | None, reason: str, feedback: bytes | None) -> None:
            loop.call_soon_threadsafe(self._note, operation, progress, reason, feedback)

        call = Call[Any](id, report, stream)
        arguments = {**given, "call": call} if takes_call else dict(given)
        self._running[id] = operation
        self._outcomes.append(operation.outcome("running"))
        running = asyncio.ensure_future(run(**arguments)) if task.is_async else _in_thread(name, task, arguments)

        def cancel(replaced: bool) -> None:
            call.cancel(replaced)
            if task.is_async:
                running.cancel()

        operation.cancel, operation.call = cancel, call
        watching = loop.create_task(self._watch(operation, running), name=f"operation {id}")
        self._tasks.add(watching)
        watching.add_done_callback(self._tasks.discard)

    def stream_of(self, id: str) -> InputStream | None:
        """Return the stream of a running action that has not been told to end."""
        operation = self._running.get(id)
        return None if operation is None or operation.ending is not None else operation.stream

    def giving_over(self, name: str) -> list[str]:
        """Return the ids of the runs of an action that have not been told to end."""
        return [each.id for each in self._running.values() if each.name == name and each.ending is None]

    def blocking(self, moves: Iterable[str], besides: Container[str] = ()) -> list[str]:
        """Return the ids of the running actions that move one of these, but for ``besides``."""
        wanted = frozenset(moves)
        return [each.id for each in self._running.values() if each.moves & wanted and each.id not in besides]

    def end(
        self,
        ids: Iterable[str],
        state: State,
        reason: str,
        now_s: float,
        successor: str = "",
        replaced: Container[str] = (),
    ) -> None:
        """Tell actions to end, with the state that they have then. One that was told before keeps its state.

        ``replaced`` are those whose successor takes over.
        """
        for operation in [self._running[each] for each in ids if each in self._running]:
            if operation.ending is None:
                operation.ending = (state, reason, successor)
                operation.overdue_s = now_s + operation.task.declared.stop_s
                operation.cancel(operation.id in replaced)

    @property
    def running(self) -> list[str]:
        return list(self._running)

    @property
    def moving(self) -> list[str]:
        """The ids of the actions that move something."""
        return [each.id for each in self._running.values() if each.task.declared.moves]

    def overdue(self, now_s: float) -> str:
        """Return a sentence about a moving action that goes on although it was told to end, or an empty string."""
        for each in self._running.values():
            if each.overdue_s is not None and each.task.declared.moves and now_s > each.overdue_s:
                return (
                    f"{each.name} was told to end {now_s - each.overdue_s + each.task.declared.stop_s:.1f} s ago and "
                    f"goes on; its stop time is {each.task.declared.stop_s:g} s"
                )
        return ""

    def names(self, ids: Iterable[str]) -> list[str]:
        """Return a sentence for each of these that still runs."""
        return [f"{self._running[each].name} has not ended" for each in ids if each in self._running]

    def stop_s(self, ids: Iterable[str]) -> float:
        """Return how long these actions may go on after they were told to end."""
        return max((self._running[each].task.declared.stop_s for each in ids if each in self._running), default=0.0)

    def step(self, now_s: float) -> list[Outcome]:
        """Return the ends and the feedback since the last call, and end actions that take too long."""
        for operation in list(self._running.values()):
            if now_s > operation.deadline_s and operation.ending is None:
                limit_s = operation.task.declared.duration_s
                self.end([operation.id], "failed", f"it did not end within the {limit_s:g} s that it may take", now_s)
            if operation.stream is not None and operation.ending is None:
                self._step_stream(operation, operation.stream, now_s)
        outcomes, self._outcomes = [*self._outcomes, *self._feedback(now_s)], []
        return outcomes

    def _step_stream(self, operation: _Operation, stream: InputStream, now_s: float) -> None:
        before = stream.counts
        if ended := stream.step(round(now_s * 1e9)):
            self.end([operation.id], "failed", ended, now_s)
        operation.news = operation.news or stream.counts is not before

    def note_sample(self, id: str) -> None:
        """Let the counts of a stream be published."""
        if (operation := self._running.get(id)) is not None:
            operation.news = True

    def _feedback(self, now_s: float) -> Iterator[Outcome]:
        for operation in self._running.values():
            if operation.news and now_s - operation.told_s >= FEEDBACK_S:
                operation.news, operation.told_s = False, now_s
                yield operation.outcome("running", operation.reason)

    def running_progress(self) -> list[Outcome]:
        """Return the progress of every running action."""
        return [each.outcome("running", each.reason) for each in self._running.values()]

    def fail_all(self, reason: str, now_s: float) -> list[Outcome]:
        """End all actions, without waiting for them. Return their ends. Those that resume go on, and have none."""
        operations = list(self._running.values())
        for operation in operations:
            if operation.resumes and operation.call is not None:
                operation.call.goes_on = True
        self.end(list(self._running), "failed", reason, now_s)
        for operation in operations:
            # One that brakes when it is cancelled waits for ticks that do not come any more.
            asyncio.get_running_loop().call_soon(operation.cancel, False)
        self._running.clear()
        return [*self._outcomes, *(each.outcome("failed", reason) for each in operations if not each.resumes)]

    def _note(self, operation: _Operation, progress: float | None, reason: str, feedback: bytes | None) -> None:
        if feedback is not None:
            if said := _violation(operation.task.declared.feedback, feedback, MAX_FEEDBACK_BYTES):
                _log.warning("%s: feedback is dropped: %s", operation.name, said)
                return
            operation.feedback = feedback
        else:
            operation.progress = operation.progress if progress is None else progress
            operation.reason = reason
        operation.news = True

    async def _watch(self, operation: _Operation, running: "Awaitable[Any]") -> None:
        known = True
        try:
            outcome = _succeeded(operation, await running)
        except (CancelledActionError, asyncio.CancelledError):
            outcome = operation.outcome("failed", "it ended as if it had been cancelled")
        except EndUnknownError as error:
            known, outcome = False, operation.outcome("failed", str(error))
            _log.warning("%s: %s", operation.name, error)
        except Exception as error:  # noqa: BLE001 - a component may raise whatever its hardware library does
            if operation.ending is None:
                _log_failure(operation.name, error)
            outcome = operation.outcome("failed", f"{error or type(error).__name__}")
        if operation.ending is not None and known:
            outcome = operation.outcome(*operation.ending)
        if self._running.pop(operation.id, None) is not None:
            self._outcomes.append(outcome)


def _log_failure(name: str, error: Exception) -> None:
    """Log one line for what the robot says (ValueError), and where it comes from for anything else."""
    if type(error) is ValueError:
        _log.warning("%s failed: %s", name, error)
    else:
        _log.error("%s failed", name, exc_info=error)


def _succeeded(operation: _Operation, result: Any) -> Outcome:
    schema = operation.task.declared.result
    if schema is None:
        return operation.outcome("succeeded")
    payload = msgspec.json.encode(result)
    if said := _violation(schema, payload, MAX_RESULT_BYTES):
        return operation.outcome("failed", f"it has ended, but its result is not what it declares: {said}")
    return operation.outcome("succeeded", result=payload)


def _violation(schema: Schema | None, payload: bytes, most_bytes: int) -> str:
    if schema is None:
        return "none is declared"
    value, said = read_value(schema, payload, most_bytes)
    return said or ("null is none" if value is None else "")


def _in_thread(name: str, task: Task, arguments: Mapping[str, Any]) -> "asyncio.Future[Any]":
    """Run a method in a thread of its own, which does not keep the process alive."""
    loop = asyncio.get_running_loop()
    done: asyncio.Future[Any] = loop.create_future()

    def settle(result: Any, error: BaseException | None) -> None:
        if not done.done():
            done.set_exception(error) if error is not None else done.set_result(result)

    def run() -> None:
        result, error = None, None
        try:
            result = task.run(**arguments)
        except BaseException as raised:  # noqa: BLE001 - whatever it is belongs to the caller
            error = raised
        try:
            loop.call_soon_threadsafe(settle, result, error)
        except RuntimeError:  # the loop is closed, and nobody waits
            _log.info("%s has ended after its agent", name)

    threading.Thread(target=run, name=name, daemon=True).start()
    return done
