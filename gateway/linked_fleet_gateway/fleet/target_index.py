"""An index of the last target positions of joints."""

from bisect import bisect_left, insort_left
from collections.abc import Callable, Iterable, Sequence

from linked_fleet_gateway.fleet.invocation import FLEET, Invocation, InvocationState, word

# a refused or unknown stop stops nothing
_STOPPED = ("accepted", "running", "succeeded", "failed", "cancelled", "preempted")
_Held = dict[tuple[str, int], dict[str, list[Invocation]]]


class Commanded:
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
            (self._motions if invocation.stops is None else self._stops).pop(_run(invocation))
        removed = self._removed_ns.setdefault(invocation.robot, {})
        for joint in joints_of(invocation) if invocation.accepted else ():
            removed[joint] = max(removed.get(joint, 0), invocation.created_ns)

    def targets(self, robot: str, incarnation: int, successors: dict[str, Invocation]) -> dict[str, float]:
        """Return valid targets of the present run in rad or m by joint; ``successors`` are all invocations by id.

        The target of a stopped or failed motion is not valid.
        """
        found = {}
        for joint, held in self._motions.get((robot, incarnation), {}).items():
            motion = next((one for one in reversed(held) if one.accepted and not _ceded(one, joint, successors)), None)
            if motion is None or (motion.state.terminal and motion.state is not InvocationState.SUCCEEDED):
                continue
            if motion.created_ns > self._stopped_ns(robot, incarnation, joint):
                found[joint] = motion.targets[joint]
        return found

    def _stopped_ns(self, robot: str, incarnation: int, joint: str) -> int:
        """Return the gateway wall time of the joint's last stop."""
        removed, own = self._removed_ns.get(robot, {}), self._stops.get((robot, incarnation), {})
        fleet = self._stops.get((FLEET, 0), {})
        return max(
            time
            for name in (joint, "")
            for time in (
                removed.get(name, 0),
                _latest_ns(own.get(name, ()), lambda stop: stop.accepted),
                _latest_ns(fleet.get(name, ()), lambda stop: word(stop.robots.get(robot, "")) in _STOPPED),
            )
        )

    def _of(self, invocation: Invocation) -> dict[str, list[Invocation]]:
        index = self._motions if invocation.stops is None else self._stops
        return index.setdefault(_run(invocation), {})


def joints_of(invocation: Invocation) -> Iterable[str]:
    """Return the joints that it moves or stops; "" for all."""
    return invocation.targets if invocation.stops is None else invocation.stops or ("",)


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
