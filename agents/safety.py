"""Whether a command may move this robot now. Pure: clocks and facts are passed in, nothing is kept but command ids."""

import math
from collections import OrderedDict
from collections.abc import Container, Mapping

from agents.robot import JointFacts
from agents.wire.messages import Accepted, Command, RefusalCode, Refused

# A target computed in degrees or by inverse kinematics may miss its limit by rounding; that much is clamped silently.
ROUNDING = 1e-6
MAX_REMEMBERED = 4096


class Remembered:
    """The ids of the last accepted commands, so that none runs twice.

    Memory is bounded: the oldest of ``capacity`` ids is forgotten. The same bytes sent again after that are stale
    unless more than ``capacity`` commands were accepted within their time to live (60 s at most).
    """

    def __init__(self, capacity: int = MAX_REMEMBERED) -> None:
        self._capacity = capacity
        self._ids: OrderedDict[str, None] = OrderedDict()

    def __contains__(self, command_id: object) -> bool:
        return command_id in self._ids

    def __len__(self) -> int:
        return len(self._ids)

    def add(self, command_id: str) -> None:
        self._ids[command_id] = None
        while len(self._ids) > self._capacity:
            self._ids.popitem(last=False)


def judge(
    command: Command,
    *,
    now_ns: int,
    incarnation: int,
    joints: Mapping[str, JointFacts],
    seen: Container[str],
) -> Accepted | Refused:
    """Accept, or refuse with the first thing that is wrong. ``now_ns`` is the agent's own monotonic clock."""
    problem = (
        _wrong_run(command, incarnation, seen)
        or _late(command, now_ns)
        or next(filter(None, (_wrong_target(*item, joints) for item in command.motion.targets.items())), None)
    )
    return Accepted(command.id) if problem is None else Refused(command.id, problem[0], problem[1][:1024])


def clamp(targets: Mapping[str, float], joints: Mapping[str, JointFacts]) -> dict[str, float]:
    """Accepted targets, none outside the limits of its joint."""
    return {name: joints[name].limits.clamp(target) for name, target in targets.items()}


_Problem = tuple[RefusalCode, str] | None


def _wrong_run(command: Command, incarnation: int, seen: Container[str]) -> _Problem:
    if command.incarnation != incarnation:
        return "incarnation", f"the command is for run {command.incarnation}, but this is run {incarnation}"
    if command.id in seen:
        return "repeated", f"a command with the id {command.id!r} was accepted before; every command needs its own id"
    return None


def _late(command: Command, now_ns: int) -> _Problem:
    age_ns = now_ns - command.seen_ns
    if age_ns < 0:
        return "stale", f"seen_ns is {-age_ns} ns ahead of this agent's monotonic clock; take it from a state frame"
    if age_ns > command.time_to_live_ns:
        return (
            "stale",
            f"the command is {age_ns / 1e6:.0f} ms old, its time to live {command.time_to_live_ns / 1e6:g} ms",
        )
    return None


def _wrong_target(name: str, target: float, joints: Mapping[str, JointFacts]) -> _Problem:
    joint = joints.get(name)
    if joint is None:
        return "unknown-joint", f"{name!r} is no movable joint of this robot; its joints are {', '.join(joints)}"
    if joint.mimics is not None:
        return "unknown-joint", f"{name!r} follows {joint.mimics!r} and takes no command; move that joint"
    if not math.isfinite(target):
        return "limits", f"the target {target} of {name!r} is not a finite number"
    return _beyond(joint, target)


def _beyond(joint: JointFacts, target: float) -> _Problem:
    unit, limits = "m" if joint.linear else "rad", joint.limits
    if limits.lower is not None and target < limits.lower - ROUNDING:
        return "limits", f"{target:g} {unit} is below the lower limit {limits.lower:g} {unit} of {joint.name!r}"
    if limits.upper is not None and target > limits.upper + ROUNDING:
        return "limits", f"{target:g} {unit} is above the upper limit {limits.upper:g} {unit} of {joint.name!r}"
    return None
