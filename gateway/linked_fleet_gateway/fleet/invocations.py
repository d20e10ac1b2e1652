"""The invocations of actions. Times are wall nanoseconds: of the gateway, except started and ended, which the
agent reported (the gateway's own when a deadline ended the invocation)."""

from bisect import bisect_left, insort_right
from collections.abc import Iterable
from dataclasses import fields
from itertools import islice

from linked_fleet_agent.wire.messages import Progress
from linked_fleet_gateway.fleet.invocation import FLEET, Invocation, InvocationState, gather, has_ended, merged, word
from linked_fleet_gateway.fleet.target_index import Commanded

__all__ = ["FLEET", "MAX_TERMINAL", "Invocation", "InvocationState", "Invocations"]

MAX_TERMINAL = 1000

_KNOWN = (InvocationState.ACCEPTED, InvocationState.RUNNING)
_GONE = "the agent is gone; the last known state was"


class Invocations:
    """All invocations that are not over, and of each robot the last thousand that are."""

    def __init__(self) -> None:
        self._all: dict[str, Invocation] = {}
        self._of_action: dict[str, dict[str, Invocation]] = {}
        self._of_robot: dict[str, list[Invocation]] = {}  # oldest first
        self._open: dict[str, dict[str, Invocation]] = {}  # by robot; some that have ended since, until they are seen
        self._open_by: dict[str, dict[str, Invocation]] = {}  # motions by client, in the same way
        self._commanded = Commanded()

    def add(self, invocation: Invocation) -> None:
        """Remember an invocation. Raises ValueError when its id is taken."""
        if invocation.id in self._all:
            raise ValueError(f"invocation {invocation.id!r} exists already")
        self._all[invocation.id] = invocation
        for index, key in self._places(invocation):
            index.setdefault(key, {})[invocation.id] = invocation
        insort_right(self._of_robot.setdefault(invocation.robot, []), invocation, key=_begun)
        self._commanded.add(invocation)
        self._forget(invocation.robot)

    def put(self, invocation: Invocation) -> Invocation | None:
        """Take over what another gateway wrote; the invocation as it is remembered now, None when that is no news.

        One that is remembered stays the same object, whose fields change. Nothing that is known is lost to an older
        copy.
        """
        held = self._all.get(invocation.id)
        if held is None:
            self.add(invocation)
            return self._all.get(invocation.id)
        if (held.robot, held.action) != (invocation.robot, invocation.action):
            return None
        whole = merged(held, invocation)
        if whole == held:
            return None
        for each in fields(Invocation):
            setattr(held, each.name, getattr(whole, each.name))
        self._reopen(held)
        return held

    @property
    def open(self) -> int:
        """How many have not ended."""
        return sum(not one.state.terminal for held in list(self._open.values()) for one in list(held.values()))

    def get(self, id: str) -> Invocation | None:
        return self._all.get(id)

    def remove(self, id: str) -> Invocation | None:
        """Forget an invocation; None when there is none of that id."""
        invocation = self._all.pop(id, None)
        if invocation is not None:
            self._commanded.remove(invocation)
            self._drop_of_robot(invocation)
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
        return self._of_robot.get(robot, [])[::-1]

    def last_motion_ns(self, robot: str) -> int | None:
        """When the last motion of one robot ended, of those that it accepted; None if none is remembered."""
        for one in reversed(self._of_robot.get(robot, [])):
            if one.stops is None and one.ended_ns is not None and one.accepted:
                return one.ended_ns
        return None

    def open_of(self, robot: str) -> list[Invocation]:
        """Those of one robot, or of the fleet as a whole, that are not over, newest first."""
        return _newest_first(_still_open(self._open, robot).values())

    def motions_by(self, client: str) -> int:
        """How many motions that ``client`` asked for are not over; halts do not count."""
        return len(_still_open(self._open_by, client))

    def apply(self, robot: str, progress: Progress) -> Invocation | None:
        """Take news from a robot; None when it concerns nothing that is open: another's id, or one that is over.

        One that failed because nothing was heard of it is open again, or ends as the robot says.
        """
        invocation = self._all.get(progress.id)
        if invocation is None or invocation.over:
            return None
        if invocation.robot == robot:
            _advance(invocation, progress)
        elif invocation.robot == FLEET and robot in invocation.robots and not has_ended(invocation.robots[robot]):
            invocation.robots[robot] = f"{progress.state}: {progress.reason}" if progress.reason else progress.state
            invocation.state = InvocationState.RUNNING
            gather(invocation)
        else:
            return None
        if invocation.started_ns is None:
            invocation.started_ns = progress.wall_ns
        invocation.expired = False
        invocation.ended_ns = progress.wall_ns if invocation.state.terminal else None
        self._reopen(invocation)
        return invocation

    def answer(self, invocation: Invocation, robot: str, answer: str) -> None:
        """Note what a robot answered to an invocation of the fleet, unless it has told how it ended already."""
        if not invocation.state.terminal and not has_ended(invocation.robots.get(robot, "")):
            invocation.robots[robot] = answer
            gather(invocation)

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
            if not has_ended(part) and word(part) != InvocationState.UNKNOWN:
                one.robots[robot] = f"{InvocationState.UNKNOWN}: {_GONE} {word(part)}"
                gather(one)
                lost.append(one)
        return lost

    def late(self, now_ns: int) -> list[Invocation]:
        """The invocations that are open after their deadline."""
        return [
            one for robot in list(self._open) for one in _still_open(self._open, robot).values()
            if now_ns > one.deadline_ns
        ]  # fmt: skip

    def expire(self, invocation: Invocation, now_ns: int) -> None:
        """Fail one of which nobody has reported the end."""
        invocation.reason = (
            f"the robot reported no end before the deadline; the last known state was {invocation.state}"
        )
        invocation.state, invocation.expired, invocation.ended_ns = InvocationState.FAILED, True, now_ns

    def outlived(self, robot: str, incarnation: int, now_ns: int) -> list[Invocation]:
        """Fail what earlier runs of the agent were asked for and return it: the present run knows nothing of it."""
        old = [one for one in self.open_of(robot) if 0 < one.incarnation < incarnation]
        for one in old:
            one.reason = f"the agent was started anew; the last known state was {one.state}"
            one.state, one.ended_ns = InvocationState.FAILED, now_ns
        return old

    def targets(self, robot: str, incarnation: int | None) -> dict[str, float]:
        """The last commanded positions of the joints of a robot (rad or m) in its present run, as far as that holds."""
        return {} if incarnation is None else self._commanded.targets(robot, incarnation, self._all)

    def _reopen(self, invocation: Invocation) -> None:
        if not invocation.state.terminal:
            for index, key in self._open_places(invocation):
                index.setdefault(key, {})[invocation.id] = invocation

    def _drop_of_robot(self, invocation: Invocation) -> None:
        held = self._of_robot[invocation.robot]
        del held[held.index(invocation, bisect_left(held, invocation.created_ns, key=_begun))]
        if not held:
            del self._of_robot[invocation.robot]

    def _places(self, invocation: Invocation) -> tuple[tuple[dict[str, dict[str, Invocation]], str], ...]:
        """The indexes and the key in each under which it is found."""
        return (self._of_action, invocation.action), *self._open_places(invocation)

    def _open_places(self, invocation: Invocation) -> tuple[tuple[dict[str, dict[str, Invocation]], str], ...]:
        of_robot, by_client = (self._open, invocation.robot), (self._open_by, invocation.client)
        return (of_robot, by_client) if invocation.stops is None else (of_robot,)

    def _forget(self, robot: str) -> None:
        """Drop the oldest that are over, if there are more than a thousand."""
        held = self._of_robot[robot]
        if len(held) <= MAX_TERMINAL:
            return
        still = _still_open(self._open, robot)
        excess = len(held) - len(still) - MAX_TERMINAL
        over = (one for one in held if one.id not in still)
        for one in list(islice(over, max(0, excess))):
            self.remove(one.id)


def _still_open(index: dict[str, dict[str, Invocation]], key: str) -> dict[str, Invocation]:
    """The invocations that are indexed under a key, without those that have ended since by another's write."""
    still = {id: one for id, one in index.get(key, {}).items() if not one.state.terminal}
    if still:
        index[key] = still
    else:
        index.pop(key, None)
    return still


def _advance(invocation: Invocation, progress: Progress) -> None:
    invocation.state = InvocationState(progress.state)
    invocation.reason = progress.reason
    invocation.result = dict(progress.positions)
    invocation.progress = progress.progress
    invocation.preempted_by = progress.successor or invocation.preempted_by


def _newest_first(invocations: Iterable[Invocation]) -> list[Invocation]:
    return sorted(reversed(list(invocations)), key=_begun, reverse=True)


def _begun(invocation: Invocation) -> int:
    return invocation.created_ns
