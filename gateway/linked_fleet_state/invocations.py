"""The invocations of actions, and the latest commanded target of each joint.

Times are gateway wall time in nanoseconds, except start and end, which the agent reports (the gateway's own time if a
deadline ended the invocation).
"""

from bisect import bisect_left, insort_left, insort_right
from collections.abc import Callable, Iterable, Sequence
from dataclasses import fields
from itertools import islice

from msgspec import UNSET

from linked_fleet_agent.wire.messages import Progress
from linked_fleet_state.invocation import (
    FLEET,
    Invocation,
    InvocationState,
    has_ended,
    merge_copies,
    reported_state,
    update_fleet_state,
)

# a refused or unknown stop stops nothing
_STOPPED = ("accepted", "running", "succeeded", "failed", "cancelled", "preempted")
_Held = dict[tuple[str, int], dict[str, list[Invocation]]]


class TargetIndex:
    """Stored motions and stops by robot, run of its agent and joint, in order of creation.

    Only constant fields of an invocation are copied when it is added; its state is read on access.
    """

    def __init__(self) -> None:
        self._motions: _Held = {}
        self._stops: _Held = {}  # key "" for stops of all joints
        self._removed_ns: dict[str, dict[str, int]] = {}  # by robot and joint: targets before this time stay invalid

    def add(self, invocation: Invocation) -> None:
        joints = self._of(invocation)
        for joint in joints_of(invocation):
            insort_left(joints.setdefault(joint, []), invocation, key=_begun)

    def remove(self, invocation: Invocation) -> None:
        """Remove an invocation. If it was accepted, earlier targets of its joints stay invalid."""
        joints = self._of(invocation)
        for joint in joints_of(invocation):
            held = joints[joint]
            place = bisect_left(held, invocation.created_ns, key=_begun)
            del held[next(at for at in range(place, len(held)) if held[at] is invocation)]
            if not held:
                del joints[joint]
        if not joints:
            (self._motions if _has_targets(invocation) else self._stops).pop(_run(invocation))
        removed = self._removed_ns.setdefault(invocation.robot, {})
        for joint in joints_of(invocation) if invocation.accepted else ():
            removed[joint] = max(removed.get(joint, 0), invocation.created_ns)

    def targets(
        self, robot: str, incarnation: int, successors: dict[str, Invocation], joints: Iterable[str] | None
    ) -> dict[str, float]:
        """Return valid targets of the present run in rad or m by joint; ``successors`` are all invocations by id.

        The target of a stopped or failed motion is not valid. ``joints`` are the joints to look at; all for None.
        """
        found, motions = {}, self._motions.get((robot, incarnation))
        if not motions:
            return {}
        robot_ns = self._stopped_ns(robot, incarnation, "")
        for joint in motions if joints is None else motions.keys() & joints:
            for motion in reversed(motions[joint]):
                if not motion.accepted or _ceded(motion, joint, successors):
                    continue
                valid = not motion.state.terminal or motion.state is InvocationState.SUCCEEDED
                if valid and motion.created_ns > max(robot_ns, self._stopped_ns(robot, incarnation, joint)):
                    found[joint] = motion.targets[joint]
                break
        return found

    def _stopped_ns(self, robot: str, incarnation: int, joint: str) -> int:
        """Return the gateway wall time of the last stop of exactly this joint; of the whole robot for ""."""
        removed, own = self._removed_ns.get(robot), self._stops.get((robot, incarnation))
        found = removed.get(joint, 0) if removed else 0
        if own and (held := own.get(joint)):
            found = max(found, _latest_ns(held, lambda stop: stop.accepted))
        fleet = self._stops.get((FLEET, 0))
        if fleet and (held := fleet.get(joint)):
            stopped = _latest_ns(held, lambda stop: reported_state(stop.robots.get(robot, "")) in _STOPPED)
            found = max(found, stopped)
        return found

    def _of(self, invocation: Invocation) -> dict[str, list[Invocation]]:
        index = self._motions if _has_targets(invocation) else self._stops
        return index.setdefault(_run(invocation), {})


def joints_of(invocation: Invocation) -> Iterable[str]:
    """Return the joints that it moves or stops; "" for all."""
    if invocation.stops is None:
        return invocation.moves or invocation.targets
    return invocation.stops or ("",)


def _has_targets(invocation: Invocation) -> bool:
    """Return True for a motion to known positions. An action of a component leaves its joints anywhere, as a stop."""
    return invocation.stops is None and not invocation.moves


def _begun(invocation: Invocation) -> int:
    return invocation.created_ns


def _run(invocation: Invocation) -> tuple[str, int]:
    return invocation.robot, 0 if invocation.robot == FLEET else invocation.incarnation


def _latest_ns(held: Sequence[Invocation], counts: Callable[[Invocation], bool]) -> int:
    return next((one.created_ns for one in reversed(held) if counts(one)), 0)


def _ceded(motion: Invocation, joint: str, all_: dict[str, Invocation]) -> bool:
    """Return True if another motion has taken over the joint, whichever was requested first."""
    successor = all_.get(motion.preempted_by)
    return successor is not None and successor.stops is None and joint in successor.targets


__all__ = ["FLEET", "MAX_TERMINAL", "Invocation", "InvocationState", "Invocations"]

MAX_TERMINAL = 1000

_KNOWN = (InvocationState.ACCEPTED, InvocationState.RUNNING)
_GONE = "the agent is gone; the last known state was"


class Invocations:
    """All invocations that are not over, and the last ``MAX_TERMINAL`` of each robot that are."""

    def __init__(self) -> None:
        self._all: dict[str, Invocation] = {}
        self._of_action: dict[str, dict[str, Invocation]] = {}
        self._of_robot: dict[str, list[Invocation]] = {}  # oldest first
        self._open: dict[str, dict[str, Invocation]] = {}  # by robot; may contain ended ones until the next access
        self._open_by: dict[str, dict[str, Invocation]] = {}  # motions by client, likewise
        self._target_index = TargetIndex()

    def add(self, invocation: Invocation) -> None:
        """Add an invocation. Raises ValueError if its id exists."""
        if invocation.id in self._all:
            raise ValueError(f"invocation {invocation.id!r} exists already")
        self._all[invocation.id] = invocation
        for index, key in self._places(invocation):
            index.setdefault(key, {})[invocation.id] = invocation
        insort_right(self._of_robot.setdefault(invocation.robot, []), invocation, key=_begun)
        self._target_index.add(invocation)
        self._forget(invocation.robot)

    def put(self, invocation: Invocation) -> Invocation | None:
        """Merge what another gateway wrote. Return the stored invocation, or None if nothing has changed.

        A known invocation stays the same object, whose fields change. An older copy never overwrites newer facts.
        """
        held = self._all.get(invocation.id)
        if held is None:
            self.add(invocation)
            return self._all.get(invocation.id)
        if (held.robot, held.action) != (invocation.robot, invocation.action):
            return None
        whole = merge_copies(held, invocation)
        if whole == held:
            return None
        for each in fields(Invocation):
            setattr(held, each.name, getattr(whole, each.name))
        self._reopen(held)
        return held

    @property
    def open_count(self) -> int:
        """Number of invocations that have not ended."""
        return sum(not one.state.terminal for held in list(self._open.values()) for one in list(held.values()))

    def get(self, id: str) -> Invocation | None:
        return self._all.get(id)

    def remove(self, id: str) -> Invocation | None:
        """Remove an invocation; return None if there is none of that id."""
        invocation = self._all.pop(id, None)
        if invocation is not None:
            self._target_index.remove(invocation)
            self._drop_of_robot(invocation)
            for index, key in self._places(invocation):
                held = index.get(key, {})
                held.pop(id, None)
                if not held:
                    index.pop(key, None)
        return invocation

    def of_action(self, action: str) -> list[Invocation]:
        """Return the invocations of one action, newest first."""
        return _newest_first(self._of_action.get(action, {}).values())

    def open_of_action(self, action: str) -> list[Invocation]:
        """Return the invocations of one action that are not over, newest first."""
        return [one for one in self.of_action(action) if not one.state.terminal]

    def of_robot(self, robot: str) -> list[Invocation]:
        """Return the invocations of one robot, newest first; those of the fleet for ``FLEET``."""
        return self._of_robot.get(robot, [])[::-1]

    def last_motion_ns(self, robot: str) -> int | None:
        """Return the end of the last accepted motion of one robot (wall ns); None if none is stored."""
        for one in reversed(self._of_robot.get(robot, [])):
            if one.is_motion and one.ended_ns is not None and one.accepted:
                return one.ended_ns
        return None

    def open_of_robot(self, robot: str) -> list[Invocation]:
        """Return the invocations of one robot, or of ``FLEET``, that are not over, newest first."""
        return _newest_first(_still_open(self._open, robot).values())

    def open_below(self, path: str) -> list[Invocation]:
        """Return the invocations of actions of the thing at a path that are not over, newest first."""
        begin = f"{path}/actions/"
        return [one for one in self.open_of_robot(FLEET) if one.action.startswith(begin)]

    def robots_with_open(self) -> list[str]:
        """Return the robots with invocations that are not over."""
        return [robot for robot in list(self._open) if robot != FLEET and _still_open(self._open, robot)]

    def motions_by(self, client: str) -> int:
        """Return the number of running motions of ``client``; stops do not count."""
        return len(_still_open(self._open_by, client))

    def apply(self, robot: str, progress: Progress) -> Invocation | None:
        """Apply progress from a robot. Return None if the id is unknown or the invocation is over.

        An expired invocation is reopened, or ends as the robot reports.
        """
        invocation = self._all.get(progress.id)
        if invocation is None or invocation.is_final:
            return None
        if invocation.robot == robot:
            _advance(invocation, progress)
        elif invocation.robot == FLEET and robot in invocation.robots and not has_ended(invocation.robots[robot]):
            invocation.robots[robot] = f"{progress.state}: {progress.reason}" if progress.reason else progress.state
            invocation.state = InvocationState.RUNNING
            update_fleet_state(invocation)
        else:
            return None
        if invocation.started_ns is None:
            invocation.started_ns = progress.wall_ns
        invocation.expired = False
        invocation.ended_ns = progress.wall_ns if invocation.state.terminal else None
        self._reopen(invocation)
        return invocation

    def answer(self, invocation: Invocation, robot: str, answer: str) -> None:
        """Record a robot's answer to an invocation of the fleet, unless its end is already known."""
        if not invocation.state.terminal and not has_ended(invocation.robots.get(robot, "")):
            invocation.robots[robot] = answer
            update_fleet_state(invocation)

    def mark_unknown(self, robot: str) -> list[Invocation]:
        """Mark the open invocations of a robot whose agent has gone as unknown, and return them.

        Invocations of the fleet that involve it are included; they become unknown if no other robot's part is open.
        """
        lost = [one for one in self.open_of_robot(robot) if one.state in _KNOWN and not one.operation]
        for one in lost:
            one.reason = f"{_GONE} {one.state}"
            one.state = InvocationState.UNKNOWN
        for one in self.open_of_robot(FLEET):
            part = one.robots.get(robot, InvocationState.UNKNOWN)
            if not has_ended(part) and reported_state(part) != InvocationState.UNKNOWN:
                one.robots[robot] = f"{InvocationState.UNKNOWN}: {_GONE} {reported_state(part)}"
                update_fleet_state(one)
                lost.append(one)
        return lost

    def overdue(self, now_ns: int) -> list[Invocation]:
        """Return the open invocations past their deadline."""
        return [
            one for robot in list(self._open) for one in _still_open(self._open, robot).values()
            if now_ns > one.deadline_ns
        ]  # fmt: skip

    def expire(self, invocation: Invocation, now_ns: int) -> None:
        """Fail an invocation whose end nobody has reported."""
        who = "gateway" if invocation.operation else "robot"
        invocation.reason = (
            f"the {who} reported no end before the deadline; the last known state was {invocation.state}"
        )
        invocation.state, invocation.expired, invocation.ended_ns = InvocationState.FAILED, True, now_ns

    def fail_earlier_runs(self, robot: str, incarnation: int, now_ns: int) -> list[Invocation]:
        """Fail and return the invocations of earlier runs of the agent, which the present run does not know.

        Those that resume stay as they are: the present run tells how they end.
        """
        old = [one for one in self.open_of_robot(robot) if 0 < one.incarnation < incarnation and not one.resumes]
        for one in old:
            one.reason = f"the agent was started anew; the last known state was {one.state}"
            one.state, one.ended_ns = InvocationState.FAILED, now_ns
        return old

    def targets(self, robot: str, incarnation: int | None, joints: Iterable[str] | None = None) -> dict[str, float]:
        """Return the valid target positions of a robot's joints (rad or m) in its present run.

        ``joints`` are the joints to look at; all for None.
        """
        return {} if incarnation is None else self._target_index.targets(robot, incarnation, self._all, joints)

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
        """Return the indexes that contain the invocation, each with its key."""
        return (self._of_action, invocation.action), *self._open_places(invocation)

    def _open_places(self, invocation: Invocation) -> tuple[tuple[dict[str, dict[str, Invocation]], str], ...]:
        of_robot, by_client = (self._open, invocation.robot), (self._open_by, invocation.client)
        return (of_robot, by_client) if invocation.stops is None else (of_robot,)

    def _forget(self, robot: str) -> None:
        """Remove the oldest invocations that are over, beyond ``MAX_TERMINAL``."""
        held = self._of_robot[robot]
        if len(held) <= MAX_TERMINAL:
            return
        still = _still_open(self._open, robot)
        excess = len(held) - len(still) - MAX_TERMINAL
        over = (one for one in held if one.id not in still)
        for one in list(islice(over, max(0, excess))):
            self.remove(one.id)


def _still_open(index: dict[str, dict[str, Invocation]], key: str) -> dict[str, Invocation]:
    """Return the open invocations under a key, removing from the index those that have ended."""
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
    if progress.feedback is not UNSET:
        invocation.feedback = bytes(progress.feedback).decode()
    if progress.stream is not UNSET:
        invocation.stream = progress.stream
    if progress.result is not UNSET:
        invocation.outcome = bytes(progress.result).decode()


def _newest_first(invocations: Iterable[Invocation]) -> list[Invocation]:
    return sorted(reversed(list(invocations)), key=_begun, reverse=True)
