"""The actions of a robot's components beside the motions of its joints: which begin, give way and must end.

Of two that move the same, the later one preempts the earlier. It begins once the earlier one has come to rest.
"""

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from functools import partial
from typing import Any

from linked_fleet_agent import safety
from linked_fleet_agent.components.declaration import Task
from linked_fleet_agent.components.host import Host
from linked_fleet_agent.components.input_stream import InputStream
from linked_fleet_agent.components.operations import MAX_RUNNING
from linked_fleet_agent.components.turns import Turn, Turns
from linked_fleet_agent.motion import Motions, Outcome
from linked_fleet_agent.wire.components import BASE, Operate, Sample
from linked_fleet_agent.wire.messages import Accepted, Refused, Reply, Stop

PATIENCE_S = 1.0
"""Time that what waits gives to joints for braking, beyond the stop time of an action."""


class Operating:
    """The actions of one robot's components. Times are those of the agent's monotonic clock."""

    def __init__(
        self,
        host: Host,
        motions: Motions,
        seen: safety.RecentIds,
        stops: safety.Stops,
        incarnation: int,
        monotonic_ns: Callable[[], int],
    ) -> None:
        self._host, self._operations, self._motions, self._turns = host, host.operations, motions, Turns()
        self._seen, self._stops, self._incarnation = seen, stops, incarnation
        self._monotonic_ns = monotonic_ns
        self._outcomes = list[Outcome]()

    @property
    def _now_s(self) -> float:
        return self._monotonic_ns() / 1e9

    def step(self) -> list[Outcome]:
        """Begin what can begin. Return the outcomes since the last call."""
        self._resume()
        if self._operations.idle and not (self._turns or self._outcomes):  # almost always
            return []
        now_s = self._now_s
        waited = self._turns.step(now_s, lambda: self._operations.overdue(now_s)) if self._turns else []
        outcomes, self._outcomes = [*self._outcomes, *waited, *self._operations.step(now_s)], []
        return outcomes

    def _resume(self) -> None:
        for id, name, task in self._host.unfinished():
            if id not in self._seen and len(self._operations) < MAX_RUNNING:
                self._seen.add(id)
                self._operations.resume(id, name, task, self._now_s)

    @property
    def fault(self) -> str:
        """A sentence about an action that goes on although it was told to end, or an empty string."""
        return self._operations.overdue(self._now_s) if len(self._operations) else ""

    def running_progress(self) -> list[Outcome]:
        return self._operations.running_progress()

    def refuse_motion(self, id: str) -> Refused | None:
        """Return the refusal of anything that moves the robot, or None."""
        why = self._host.prevents_motion or self.fault
        return Refused(id, "fault", why[:1024]) if why else None

    def judge(self, operate: Operate, refuse_now: Callable[[str], Refused | None]) -> Reply:
        """Check a request and begin what it asks for. ``refuse_now`` is asked if it moves something, with its id."""
        task = self._host.task_of(operate)
        if isinstance(task, Refused):
            return self._refuse_late(operate, ()) or task
        moves = task.declared.moves
        if (late := self._refuse_late(operate, moves)) is not None:
            return late
        given = self._host.input_of(operate, task)
        if isinstance(given, Refused):
            return given
        if (refusal := self._host.busy(operate) or (refuse_now(operate.id) if moves else None)) is not None:
            return refusal
        return self._rehearse(operate, task, given) if operate.rehearsal else self._start(operate, task, given)

    def _refuse_late(self, operate: Operate, moves: Iterable[str]) -> Refused | None:
        """Return the refusal of a request for another run, repeated or late, or None."""
        return safety.check_operate(
            operate, moves, now_ns=self._monotonic_ns(), incarnation=self._incarnation, seen=self._seen,
            stops=self._stops,
        )  # fmt: skip

    def _rehearse(self, operate: Operate, task: Task, given: Mapping[str, Any]) -> Reply:
        duration_s = 0.0
        if task.rehearse is not None:
            try:
                duration_s = min(max(float(task.rehearse(**given)), 0.0), 86_400.0)
            except Exception as error:  # noqa: BLE001 - a component may raise whatever its hardware library does
                return Refused(operate.id, "fault", f"it would not be done: {error or type(error).__name__}"[:1024])
        return Accepted(operate.id, duration_s, self._in_the_way(task.declared.moves), self._monotonic_ns())

    def _in_the_way(self, moves: Collection[str]) -> tuple[str, ...]:
        joints = [each for each in moves if each != BASE]
        before = (self._motions.preemptible_ids(joints), self._operations.blocking(moves), self._turns.waiting(moves))
        return tuple(dict.fromkeys(id for ids in before for id in ids))[:1024]

    def _start(self, operate: Operate, task: Task, given: Mapping[str, Any]) -> Accepted:
        self._seen.add(operate.id)
        moves, name = task.declared.moves, f"{operate.component}.{operate.action or operate.property}"
        preempted = self._in_the_way(moves)
        joints = [each for each in moves if each != BASE]
        replaced = self._operations.giving_over(name) if task.takes_over else []
        self._outcomes += self.give_way(operate.id, moves, replaced)
        standing = [] if replaced else joints
        self._outcomes += self._motions.release(standing, operate.id)

        def begin() -> list[Outcome]:
            self._motions.setpoints.release(joints)
            self._operations.begin(operate.id, name, task, given, self._now_s, self._stream(operate, task))
            return []

        self.begin_when_free(operate.id, moves, begin, standing, replaced)
        return Accepted(operate.id, 0.0, preempted, self._monotonic_ns())

    def _stream(self, operate: Operate, task: Task) -> InputStream | None:
        """Return the stream of an action that is opened as one."""
        if operate.stream is not True or task.declared.stream is None:
            return None
        return InputStream(task.declared.stream, self._host.reader_of(task), self._monotonic_ns())

    def hear(self, sample: Sample) -> None:
        """Take a sample of a stream. One of an action that has ended, or was told to, is ignored."""
        stream = self._operations.stream_of(sample.id) if sample.incarnation == self._incarnation else None
        if stream is not None:
            stream.offer(sample, self._monotonic_ns())
            self._operations.note_sample(sample.id)

    def give_way(self, successor: str, moves: Collection[str], replaced: Collection[str] = ()) -> list[Outcome]:
        """Preempt the actions that move one of these, and what waits to; ``successor`` takes over ``replaced``."""
        reason = f"replaced by command {successor}"
        self._operations.end(self._operations.blocking(moves), "preempted", reason, self._now_s, successor, replaced)
        return self._turns.end(self._turns.waiting(moves), "preempted", reason, successor)

    def blocking(self, moves: Collection[str]) -> list[str]:
        """Return the ids of the running actions and of what waits that would be preempted."""
        return [*self._operations.blocking(moves), *self._turns.waiting(moves)]

    def begin_when_free(
        self,
        id: str,
        moves: Collection[str],
        begin: Callable[[], Iterable[Outcome]],
        standing: Sequence[str] = (),
        replaced: Collection[str] = (),
    ) -> None:
        """Begin now, or when no action moves one of these and the setpoints of ``standing`` joints are at rest.

        Actions in ``replaced`` may still be moving.
        """
        free = partial(self._is_free, (id, *replaced), tuple(moves), standing)
        if free():
            self._outcomes += begin()
            return
        until_s = self._now_s + self._operations.stop_s(self._operations.blocking(moves)) + PATIENCE_S
        self._outcomes.append(self._turns.add(Turn(id, frozenset(moves), free, begin, until_s)))

    def _is_free(self, besides: Collection[str], moves: Sequence[str], standing: Sequence[str]) -> bool:
        return not self._operations.blocking(moves, besides) and self._motions.stands(standing)

    def hold(self, reason: str) -> list[Outcome]:
        """End everything that moves, or waits to move, the robot. It fails with ``reason``."""
        self._operations.end(self._operations.moving, "failed", reason, self._now_s)
        return self._turns.end(self._turns.waiting(), "failed", reason)

    def stoppable(self, stop: Stop, joints: Collection[str]) -> list[str]:
        """Return the ids of what a stop would end: one command, what moves ``joints``, or all that moves."""
        if stop.command:
            return [stop.command]
        moves = None if not stop.joints else joints
        running = self._operations.moving if moves is None else self._operations.blocking(moves)
        return [*running, *self._turns.waiting(moves)]

    def known(self, ids: Iterable[str]) -> list[str]:
        """Return those of these that run or wait."""
        here = {*self._operations.running, *self._turns.waiting()}
        return [each for each in ids if each in here]

    def stop(self, stop: Stop, ids: Collection[str]) -> list[Outcome]:
        """Cancel these."""
        reason = stop.reason or "stopped"
        self._operations.end(ids, "cancelled", reason, self._now_s, stop.id)
        return self._turns.end(ids, "cancelled", reason, stop.id)

    def stop_s(self, ids: Iterable[str]) -> float:
        return self._operations.stop_s(ids)

    def still_running(self, ids: Iterable[str]) -> list[str]:
        """Return a sentence for each of these that has not ended."""
        return self._operations.names(ids)

    def fail_all(self, reason: str) -> list[Outcome]:
        waiting = self._turns.end(self._turns.waiting(), "failed", reason)
        return [*self._outcomes, *waiting, *self._operations.fail_all(reason, self._now_s)]
