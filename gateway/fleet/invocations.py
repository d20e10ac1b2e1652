"""What became of each invoked action. Times are wall nanoseconds: of the gateway, except started and ended, which the
agent reported (the gateway's own when a deadline ended the invocation)."""

from dataclasses import dataclass, field
from enum import StrEnum

from agents.wire.messages import Progress

MAX_TERMINAL = 1000


class InvocationState(StrEnum):
    """UNKNOWN: nobody answered the command, or the agent is gone; progress or the deadline will tell."""

    ACCEPTED = "accepted"
    RUNNING = "running"
    SUCCEEDED = "succeeded"
    FAILED = "failed"
    PREEMPTED = "preempted"
    UNKNOWN = "unknown"

    @property
    def terminal(self) -> bool:
        return self in (InvocationState.SUCCEEDED, InvocationState.FAILED, InvocationState.PREEMPTED)


@dataclass
class Invocation:
    """One invocation of the action at ``action``, a path such as ``/baxter/right_s1/actions/rotate``.

    ``targets`` are the commanded and ``result`` the last measured positions by joint, in rad or m.
    """

    id: str
    robot: str
    action: str
    targets: dict[str, float]
    created_ns: int
    deadline_ns: int
    started_ns: int | None = None
    ended_ns: int | None = None
    state: InvocationState = InvocationState.ACCEPTED
    reason: str = ""
    result: dict[str, float] = field(default_factory=dict)


class Invocations:
    """All invocations that are not over, and the last thousand that are."""

    def __init__(self) -> None:
        self._all: dict[str, Invocation] = {}

    def add(self, invocation: Invocation) -> None:
        """Remember an invocation. Raises ValueError when its id is taken."""
        if invocation.id in self._all:
            raise ValueError(f"invocation {invocation.id!r} exists already")
        self._all[invocation.id] = invocation
        over = [one.id for one in self._all.values() if one.state.terminal]
        for identifier in over[:-MAX_TERMINAL]:
            del self._all[identifier]

    def get(self, id: str) -> Invocation | None:
        return self._all.get(id)

    def remove(self, id: str) -> Invocation | None:
        """Forget an invocation; None when there is none of that id."""
        return self._all.pop(id, None)

    def of(self, action: str) -> list[Invocation]:
        """Those of one action, newest first."""
        return [one for one in reversed(self._all.values()) if one.action == action]

    def of_robot(self, robot: str) -> list[Invocation]:
        """Those of one robot, newest first."""
        return [one for one in reversed(self._all.values()) if one.robot == robot]

    def apply(self, robot: str, progress: Progress) -> Invocation | None:
        """Take news from a robot; None when it concerns nothing that is open: another's id, or one that is over."""
        invocation = self._all.get(progress.id)
        if invocation is None or invocation.robot != robot or invocation.state.terminal:
            return None
        invocation.state = InvocationState(progress.state)
        invocation.reason = progress.reason
        invocation.result = dict(progress.positions)
        if invocation.started_ns is None:
            invocation.started_ns = progress.wall_ns
        if invocation.state.terminal:
            invocation.ended_ns = progress.wall_ns
        return invocation

    def lose(self, robot: str) -> list[Invocation]:
        """Nobody knows any more what became of the open ones of a robot whose agent is gone; return them."""
        known = (InvocationState.ACCEPTED, InvocationState.RUNNING)
        lost = [one for one in self.of_robot(robot) if one.state in known]
        for one in lost:
            one.reason = f"the agent is gone; the last known state was {one.state}"
            one.state = InvocationState.UNKNOWN
        return lost

    def expire(self, now_ns: int) -> list[Invocation]:
        """Fail what is still open after its deadline and return it."""
        late = [one for one in self._all.values() if not one.state.terminal and now_ns > one.deadline_ns]
        for one in late:
            one.reason = f"the robot reported no end before the deadline; the last known state was {one.state}"
            one.state = InvocationState.FAILED
            one.ended_ns = now_ns
        return late
