"""What became of each invoked action. Times are wall nanoseconds: of the gateway, except started and ended, which the
agent reported (the gateway's own when a deadline ended the invocation)."""

import heapq
import re
from collections.abc import Iterable
from dataclasses import dataclass, field, fields
from enum import StrEnum

from agents.wire.messages import Progress

MAX_TERMINAL = 1000
FLEET = ""  # what stands for the robot of an invocation that is the whole fleet's

_WORD = re.compile(r"[a-z]*")


class InvocationState(StrEnum):
    """UNKNOWN: nobody answered the command, or the agent is gone; progress or the deadline will tell."""

    ACCEPTED = "accepted"
    RUNNING = "running"
    SUCCEEDED = "succeeded"
    FAILED = "failed"
    CANCELLED = "cancelled"
    PREEMPTED = "preempted"
    UNKNOWN = "unknown"

    @property
    def terminal(self) -> bool:
        return self in _TERMINAL


# From the best to the worst: what a fleet's invocation comes to is the worst of what its robots came to.
_TERMINAL = (
    InvocationState.SUCCEEDED,
    InvocationState.CANCELLED,
    InvocationState.PREEMPTED,
    InvocationState.FAILED,
)
_ENDS = {**{state.value: state for state in _TERMINAL}, "refused": InvocationState.FAILED}
_KNOWN = (InvocationState.ACCEPTED, InvocationState.RUNNING)
_GONE = "the agent is gone; the last known state was"


@dataclass
class Invocation:
    """One invocation of the action at ``action``, a path such as ``/baxter/right_s1/actions/rotate``.

    ``targets`` are the commanded and ``result`` the last measured positions by joint, in rad or m. ``client`` is who
    asked, as it is shown, ``body`` what was admitted, as N-Triples, ``lease`` the id of the lease that it ends with.
    ``duration_s`` is what the agent expects, ``progress`` the share that is done, 0 to 1; of the fleet's invocations
    the share of robots that have ended. ``facts`` are further numbers with the unit in their names (``residual_m``).
    ``preempts`` are the ids that it ended, ``preempted_by`` is the one that ended it.

    ``robots`` says of the fleet's invocations what each robot answered: a word, which is a state or ``refused``, and
    perhaps what a human should know, as in ``failed: the joint is blocked``. Any other word is an open end.
    """

    id: str
    robot: str
    action: str
    targets: dict[str, float]
    created_ns: int
    deadline_ns: int
    client: str = ""
    body: str = ""
    duration_s: float | None = None
    started_ns: int | None = None
    ended_ns: int | None = None
    state: InvocationState = InvocationState.ACCEPTED
    reason: str = ""
    progress: float = 0.0
    result: dict[str, float] = field(default_factory=dict)
    preempts: tuple[str, ...] = ()
    preempted_by: str = ""
    lease: str = ""
    facts: dict[str, float] = field(default_factory=dict)
    robots: dict[str, str] = field(default_factory=dict)


class Invocations:
    """All invocations that are not over, and of each robot the last thousand that are."""

    def __init__(self) -> None:
        self._all: dict[str, Invocation] = {}
        self._of_action: dict[str, dict[str, Invocation]] = {}
        self._of_robot: dict[str, dict[str, Invocation]] = {}
        self._open: dict[str, dict[str, Invocation]] = {}  # by robot; some that have ended since, until they are seen

    def add(self, invocation: Invocation) -> None:
        """Remember an invocation. Raises ValueError when its id is taken."""
        if invocation.id in self._all:
            raise ValueError(f"invocation {invocation.id!r} exists already")
        self._all[invocation.id] = invocation
        for index, key in self._places(invocation):
            index.setdefault(key, {})[invocation.id] = invocation
        self._forget(invocation.robot)

    def put(self, invocation: Invocation) -> Invocation | None:
        """Take over what another gateway wrote; the invocation as it is remembered now, None when that is no news.

        One that is remembered stays the same object, whose fields change. What has ended stays so, and what has begun
        does not go back to accepted.
        """
        held = self._all.get(invocation.id)
        if held is None:
            self.add(invocation)
            return self._all.get(invocation.id)
        moved = (held.robot, held.action) != (invocation.robot, invocation.action)
        if moved or held == invocation or _stage(invocation) < _stage(held):
            return None
        for each in fields(Invocation):
            setattr(held, each.name, getattr(invocation, each.name))
        return held

    def get(self, id: str) -> Invocation | None:
        return self._all.get(id)

    def remove(self, id: str) -> Invocation | None:
        """Forget an invocation; None when there is none of that id."""
        invocation = self._all.pop(id, None)
        if invocation is not None:
            for index, key in self._places(invocation):
                held = index.get(key, {})
                held.pop(id, None)
                if not held:
                    index.pop(key, None)
        return invocation

    def of(self, action: str) -> list[Invocation]:
        """Those of one action, newest first."""
        return _newest_first(self._of_action.get(action, {}).values())

    def of_robot(self, robot: str) -> list[Invocation]:
        """Those of one robot, newest first; of the fleet as a whole for ``FLEET``."""
        return _newest_first(self._of_robot.get(robot, {}).values())

    def open_of(self, robot: str) -> list[Invocation]:
        """Those of one robot, or of the fleet as a whole, that are not over, newest first."""
        return _newest_first(self._still_open(robot).values())

    def apply(self, robot: str, progress: Progress) -> Invocation | None:
        """Take news from a robot; None when it concerns nothing that is open: another's id, or one that is over."""
        invocation = self._all.get(progress.id)
        if invocation is None or invocation.state.terminal:
            return None
        if invocation.robot == robot:
            _advance(invocation, progress)
        elif invocation.robot == FLEET and robot in invocation.robots and not _ended(invocation.robots[robot]):
            invocation.robots[robot] = f"{progress.state}: {progress.reason}" if progress.reason else progress.state
            invocation.state = InvocationState.RUNNING
            _gather(invocation)
        else:
            return None
        if invocation.started_ns is None:
            invocation.started_ns = progress.wall_ns
        if invocation.state.terminal:
            invocation.ended_ns = progress.wall_ns
        return invocation

    def answer(self, invocation: Invocation, robot: str, answer: str) -> None:
        """Note what a robot answered to an invocation of the fleet, unless it has told how it ended already."""
        if not invocation.state.terminal and not _ended(invocation.robots.get(robot, "")):
            invocation.robots[robot] = answer
            _gather(invocation)

    def lose(self, robot: str) -> list[Invocation]:
        """Nobody knows any more what became of the open ones of a robot whose agent is gone; return them.

        Those of the fleet in which it has a part are among them; they are unknown when nobody else's part is open.
        """
        lost = [one for one in self.open_of(robot) if one.state in _KNOWN]
        for one in lost:
            one.reason = f"{_GONE} {one.state}"
            one.state = InvocationState.UNKNOWN
        for one in self.open_of(FLEET):
            part = one.robots.get(robot, InvocationState.UNKNOWN)
            if not _ended(part) and _word(part) != InvocationState.UNKNOWN:
                one.robots[robot] = f"{InvocationState.UNKNOWN}: {_GONE} {_word(part)}"
                _gather(one)
                lost.append(one)
        return lost

    def expire(self, now_ns: int) -> list[Invocation]:
        """Fail what is still open after its deadline and return it."""
        late = [
            one for robot in list(self._open) for one in self._still_open(robot).values() if now_ns > one.deadline_ns
        ]
        for one in late:
            one.reason = f"the robot reported no end before the deadline; the last known state was {one.state}"
            one.state = InvocationState.FAILED
            one.ended_ns = now_ns
        return late

    def _places(self, invocation: Invocation) -> tuple[tuple[dict[str, dict[str, Invocation]], str], ...]:
        """The indexes and the key in each under which it is found."""
        robot = invocation.robot
        return (self._of_action, invocation.action), (self._of_robot, robot), (self._open, robot)

    def _still_open(self, robot: str) -> dict[str, Invocation]:
        """The index without what has ended since, which others do by writing its state."""
        still = {id: one for id, one in self._open.get(robot, {}).items() if not one.state.terminal}
        if still:
            self._open[robot] = still
        else:
            self._open.pop(robot, None)
        return still

    def _forget(self, robot: str) -> None:
        """Drop the oldest that are over, if there are more than a thousand."""
        held = self._of_robot[robot]
        if len(held) <= MAX_TERMINAL:
            return
        still = self._still_open(robot)
        excess = len(held) - len(still) - MAX_TERMINAL
        if excess > 0:
            over = (one for one in held.values() if one.id not in still)
            for one in heapq.nsmallest(excess, over, key=lambda one: one.created_ns):
                self.remove(one.id)


def _advance(invocation: Invocation, progress: Progress) -> None:
    invocation.state = InvocationState(progress.state)
    invocation.reason = progress.reason
    invocation.result = dict(progress.positions)
    invocation.progress = progress.progress
    invocation.preempted_by = progress.successor or invocation.preempted_by


def _gather(invocation: Invocation) -> None:
    """What the answers of its robots make of the fleet's invocation."""
    words = [_word(answer) for answer in invocation.robots.values()]
    ended = [_ENDS[word] for word in words if word in _ENDS]
    invocation.progress = len(ended) / len(words)
    if len(ended) == len(words):
        worst = max(ended, key=_TERMINAL.index)
        invocation.state = worst
        all_well = worst is InvocationState.SUCCEEDED
        invocation.reason = "" if all_well else f"{ended.count(worst)} of {len(ended)} robots: {worst}"
    elif words.count(InvocationState.UNKNOWN) == len(words) - len(ended):
        invocation.state = InvocationState.UNKNOWN


def _word(answer: str) -> str:
    """The state that the answer of one robot begins with."""
    found = _WORD.match(answer)
    return found[0] if found else ""


def _ended(answer: str) -> bool:
    return _word(answer) in _ENDS


def _stage(invocation: Invocation) -> int:
    return 2 if invocation.state.terminal else int(invocation.state is not InvocationState.ACCEPTED)


def _newest_first(invocations: Iterable[Invocation]) -> list[Invocation]:
    return sorted(reversed(list(invocations)), key=lambda one: one.created_ns, reverse=True)
