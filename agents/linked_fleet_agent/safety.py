"""Checks of commands before anything moves. Pure: clocks and facts are passed in; recent ids and stops are kept."""

import math
from collections import OrderedDict
from collections.abc import Container, Iterable, Iterator, Mapping
from itertools import pairwise

import msgspec

from linked_fleet_agent.plan import joints_of
from linked_fleet_agent.robot import JointFacts, Limits
from linked_fleet_agent.wire.components import Operate
from linked_fleet_agent.wire.messages import Accepted, Command, Expectation, Follow, Move, RefusalCode, Refused, Stop

# A target computed in degrees or by inverse kinematics may exceed its limit by rounding. That much is clamped silently.
ROUNDING = 1e-6
MAX_REMEMBERED = 4096
# Most positions in one ``Follow``, so that checking it does not delay the robot.
MAX_POSITIONS = 16_384
MIN_STEP_S = 1e-3
# A position further from zero (rad or m) is treated as a mistake.
FARTHEST = 1e6
# A joint that is further outside its limits is not moved back.
MAX_OUTSIDE_RAD, MAX_OUTSIDE_M = 0.5, 0.1


class RecentIds:
    """The ids of the last accepted commands, so that none runs twice.

    Memory is bounded: at most ``capacity`` ids are kept. A replayed command whose id was forgotten is stale, unless
    more than ``capacity`` commands were accepted within its time to live (60 s at most).
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


class Stops:
    """Times of stops by joint (monotonic, in ns), so that no motion requested before a stop runs after it.

    The last ``MAX_REMEMBERED`` commands that were cancelled by id are known too.
    """

    def __init__(self) -> None:
        self._stopped_ns: dict[str, int] = {}
        self._cancelled = RecentIds()

    def record(self, joints: Iterable[str], now_ns: int) -> None:
        self._stopped_ns.update(dict.fromkeys(joints, now_ns))

    def cancel(self, command_id: str) -> None:
        self._cancelled.add(command_id)

    def later_stop(self, command: Command | Operate, moved: Iterable[str]) -> str:
        """Return a sentence about a stop executed after ``command`` was requested; empty if there is none.

        ``moved`` is what it moves.
        """
        if command.id in self._cancelled:
            return f"the command {command.id!r} was cancelled before it arrived"
        for name in moved:
            if command.seen_ns <= self._stopped_ns.get(name, -1):
                return f"the robot was stopped after the command was requested ({name!r}); send a new one to move it"
        return ""


def check_command(
    command: Command,
    *,
    now_ns: int,
    incarnation: int,
    joints: Mapping[str, JointFacts],
    seen: Container[str],
    stops: Stops,
) -> Accepted | Refused:
    """Return Accepted, or Refused with the first problem found. ``now_ns`` is the agent's own monotonic clock."""
    targets = list(_targets(command.motion))
    problem = (
        _contradiction(command.motion)
        or _wrong_run(command, incarnation, seen)
        or _late(command, now_ns, stops, joints_of(command.motion))
        or next(filter(None, (_wrong_joint(name, joints) for name in dict(targets))), None)
        or next(filter(None, (_unknown(name, joints) for name in command.expects)), None)
        or next(filter(None, (_beyond(joints[name], target) for name, target in targets)), None)
    )
    return Accepted(command.id, at_ns=now_ns) if problem is None else Refused(command.id, problem[0], problem[1][:1024])


def check_operate(
    operate: Operate, moves: Iterable[str], *, now_ns: int, incarnation: int, seen: Container[str], stops: Stops
) -> Refused | None:
    """Return the refusal of an action that is for another run, repeated or late, or None."""
    problem = _wrong_run(operate, incarnation, seen) or _late(operate, now_ns, stops, moves)
    return None if problem is None else Refused(operate.id, problem[0], problem[1][:1024])


def position_mismatch(
    expects: Mapping[str, Expectation], measured: Mapping[str, float], joints: Mapping[str, JointFacts]
) -> str:
    """Return a sentence about the first joint that is not at its expected position; empty if all are.

    NaN never matches.
    """
    for name, expected in expects.items():
        off = joints[name].difference(measured[name], expected.position)
        if not abs(off) <= expected.tolerance:
            unit = joints[name].unit
            return (
                f"{name!r} was expected at {expected.position:.6g} {unit}, give or take {expected.tolerance:.6g} "
                f"{unit}, but is at {measured[name]:.6g} {unit}"
            )
    return ""


def far_outside(names: Iterable[str], measured: Mapping[str, float], joints: Mapping[str, JointFacts]) -> str:
    """Return a sentence about the first joint that is too far outside its limits to be moved; empty if none is."""
    for name in names:
        joint = joints[name]
        stops = joint.limits if joint.stops == (None, None) else Limits(*joint.stops)
        outside = abs(stops.clamp(measured[name]) - measured[name])
        if outside > (MAX_OUTSIDE_M if joint.linear else MAX_OUTSIDE_RAD):
            return (
                f"{name!r} is measured at {measured[name]:.6g} {joint.unit}, {outside:.3g} {joint.unit} outside its "
                "limits: check its sensor and the limits in its description"
            )
    return ""


def check_stop(stop: Stop, joints: Mapping[str, JointFacts]) -> Refused | None:
    """Return the refusal of a stop that names an unknown joint, or None."""
    problem = next(filter(None, (_unknown(name, joints) for name in stop.joints)), None)
    return None if problem is None else Refused(stop.id, problem[0], problem[1][:1024])


def clamp(motion: Move | Follow, joints: Mapping[str, JointFacts]) -> Move | Follow:
    """Return an accepted motion with all targets clamped to the limits of their joints."""
    if isinstance(motion, Move):
        targets = {name: joints[name].limits.clamp(target) for name, target in motion.targets.items()}
        return msgspec.structs.replace(motion, targets=targets)
    limits = [joints[name].limits for name in motion.joints]
    rows = (tuple(limit.clamp(p) for limit, p in zip(limits, row, strict=True)) for row in motion.positions)
    return msgspec.structs.replace(motion, positions=tuple(rows))


_Problem = tuple[RefusalCode, str] | None


def _targets(motion: Move | Follow) -> Iterator[tuple[str, float]]:
    if isinstance(motion, Move):
        yield from motion.targets.items()
        return
    for name, column in zip(motion.joints, zip(*motion.positions, strict=False), strict=False):
        yield from ((name, position) for position in column if not math.isfinite(position))
        yield from ((name, min(column)), (name, max(column)))  # the extremes represent all positions of the joint


def _contradiction(motion: Move | Follow) -> _Problem:
    if isinstance(motion, Move):
        loose = [name for name in motion.speeds if name not in motion.targets]
        return ("malformed", f"{loose[0]!r} has a speed, but no target") if loose else None
    width, rows = len(motion.joints), len(motion.positions)
    if len(set(motion.joints)) < width:
        return "malformed", "a joint is named twice"
    if rows != len(motion.times_s):
        return "malformed", f"there are {rows} rows of positions, but {len(motion.times_s)} times"
    if any(len(row) != width for row in motion.positions):
        return "malformed", f"each row of positions must have one for each of the {width} joints"
    if width * rows > MAX_POSITIONS:
        return "malformed", f"{width * rows} positions are too many; {MAX_POSITIONS} may be in one motion"
    if any(later - earlier < MIN_STEP_S for earlier, later in pairwise((0.0, *motion.times_s))):
        return "malformed", f"times_s must begin at {MIN_STEP_S:g} s or later and increase by at least as much"
    return None


def _wrong_run(command: Command | Operate, incarnation: int, seen: Container[str]) -> _Problem:
    if command.incarnation != incarnation:
        return "incarnation", f"the command is for run {command.incarnation}, but this is run {incarnation}"
    if command.id in seen:
        return "repeated", f"a command with the id {command.id!r} was accepted before; every command needs its own id"
    return None


def _late(command: Command | Operate, now_ns: int, stops: Stops, moved: Iterable[str]) -> _Problem:
    age_ns = now_ns - command.seen_ns
    if age_ns < 0:
        return "stale", f"seen_ns is {-age_ns} ns ahead of this agent's monotonic clock; take it from a state frame"
    if age_ns > command.time_to_live_ns:
        return (
            "stale",
            f"the command is {age_ns / 1e6:.0f} ms old, its time to live {command.time_to_live_ns / 1e6:g} ms",
        )
    overtaken = stops.later_stop(command, moved)
    return ("stale", overtaken) if overtaken else None


def _unknown(name: str, joints: Mapping[str, JointFacts]) -> _Problem:
    if name in joints:
        return None
    return "unknown-joint", f"{name!r} is not a movable joint of this robot; its joints are {', '.join(joints)}"


def _wrong_joint(name: str, joints: Mapping[str, JointFacts]) -> _Problem:
    joint = joints.get(name)
    if joint is None:
        return _unknown(name, joints)
    if joint.mimics is not None:
        return "unknown-joint", f"{name!r} follows {joint.mimics!r} and takes no command; move that joint"
    if joint.passive:
        return "unknown-joint", f"{name!r} takes no command: {joint.refusal or 'it has no actuator'}"
    return None


def _beyond(joint: JointFacts, target: float) -> _Problem:
    unit, limits = joint.unit, joint.limits
    if joint.refusal:
        return "limits", f"{joint.name!r} is not moved: {joint.refusal}"
    if not math.isfinite(target):
        return "limits", f"the target {target} of {joint.name!r} is not a finite number"
    if abs(target) > FARTHEST:
        return "limits", f"{target:g} {unit} is further than {FARTHEST:g} {unit} from zero"
    if limits.lower is not None and target < limits.lower - ROUNDING:
        return "limits", f"{target:g} {unit} is below the lower limit {limits.lower:g} {unit} of {joint.name!r}"
    if limits.upper is not None and target > limits.upper + ROUNDING:
        return "limits", f"{target:g} {unit} is above the upper limit {limits.upper:g} {unit} of {joint.name!r}"
    return None
