"""Plans: the trajectories of all joints of a command, computed before anything moves. Pure; SI units."""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from linked_fleet_agent.robot import JointFacts
from linked_fleet_agent.trajectory import Trajectory, brake, reach, reach_in, through_waypoints
from linked_fleet_agent.urdf.cruise import RAMP_S, SPEED_SHARE, cruise_of
from linked_fleet_agent.wire.messages import Follow, Move

MAX_DURATION_S = 86_400.0
# A joint that is further outside its limits moves back at this share of its speed. Less is due to its sensor or load.
OUTSIDE_SHARE, _OUTSIDE_RAD, _OUTSIDE_M = 0.25, 0.02, 0.002
# A slower motion would not be visible.
_SLOWEST = 1e-6
_ROUNDING = 1e-6
# A cubic that begins at velocity v and lasts T overshoots its ends by 4/27 v T at most; a ramp of t takes v t / 2 to
# brake.
_SWING = 27.0 / 8.0


class ImpossibleError(ValueError):
    """The joints cannot move as requested from their present state; the message says what is allowed."""


@dataclass(frozen=True)
class Start:
    """A joint with the position and velocity of its setpoint."""

    joint: JointFacts
    position: float
    velocity: float = 0.0


@dataclass(frozen=True)
class Plan:
    """The trajectory of each joint. All of them end after ``duration_s``."""

    trajectories: Mapping[str, Trajectory]
    duration_s: float


def joints_of(motion: Move | Follow) -> tuple[str, ...]:
    """Return the joints that ``motion`` moves."""
    return tuple(motion.targets) if isinstance(motion, Move) else motion.joints


def plan(motion: Move | Follow, scale: float, starts: Iterable[Start]) -> Plan:
    """Plan ``motion`` from the ``starts`` of its joints, in their order.

    Raises ImpossibleError if too fast or too slow.
    """
    made = _move(motion, scale, starts) if isinstance(motion, Move) else _follow(motion, scale, starts)
    if not made.duration_s <= MAX_DURATION_S:
        raise ImpossibleError(f"the motion would take {made.duration_s:.3g} s; {MAX_DURATION_S:g} s is the maximum")
    return made


def _move(move: Move, scale: float, starts: Iterable[Start]) -> Plan:
    """Plan a move. The slowest joint sets the duration for all."""
    cruises, found = {}, {}
    starts = tuple(starts)
    for start in starts:
        name, full = start.joint.name, cruise_from(start)
        cruise = cruises[name] = _visible(start.joint, min(full, SPEED_SHARE * move.speeds.get(name, math.inf)) * scale)
        ramp = (full if start.velocity else cruise) / RAMP_S
        limits, target = start.joint.limits, move.targets[name]
        found[name] = reach(start.position, start.velocity, target, cruise, ramp, limits)
    duration_s = max(trajectory.duration_s for trajectory in found.values())
    for start in starts:
        name, limits, target = start.joint.name, start.joint.limits, move.targets[start.joint.name]
        if found[name].duration_s < duration_s <= MAX_DURATION_S:
            ramp = cruise_from(start) / RAMP_S
            found[name] = reach_in(duration_s, start.position, start.velocity, target, cruises[name], ramp, limits)
    return Plan(found, duration_s)


def _follow(follow: Follow, scale: float, starts: Iterable[Start]) -> Plan:
    found, stretch, slowest = {}, 1.0, ""
    for column, start in enumerate(starts):
        positions = [row[column] for row in follow.positions]
        allowed = _visible(start.joint, cruise_from(start) * scale)
        _check_speed(start, allowed)
        trajectory = _path(start, follow.times_s, positions)
        needed = trajectory.maximum_speed
        if not needed <= allowed * (1.0 + _ROUNDING) and needed / allowed > stretch:
            stretch, unit = needed / allowed, start.joint.unit
            slowest = f"{start.joint.name} would need {needed:.4g} {unit}/s, and {allowed:.4g} {unit}/s are allowed"
        _check_extremes(start, trajectory)
        found[start.joint.name] = trajectory
    if slowest:
        factor = math.ceil(stretch * 1000.0) / 1000.0
        raise ImpossibleError(f"{slowest}; stretch all times by a factor of {factor:.3f}")
    return Plan(found, follow.times_s[-1])


def _path(start: Start, times_s: Sequence[float], positions: Sequence[float]) -> Trajectory:
    """Return a trajectory through ``positions``. A moving joint overshoots them by no more than its braking distance.

    A joint whose velocity would carry it further before the first position brakes first.
    """
    velocity, slope = start.velocity, (positions[0] - start.position) / times_s[0]
    monotone = velocity * slope >= 0.0 and abs(velocity) <= 3.0 * abs(slope)  # condition of Fritsch and Carlson
    braking = brake(start.position, velocity, cruise_of(start.joint) / RAMP_S, start.joint.limits)
    if monotone or times_s[0] <= _SWING * braking.duration_s:
        return through_waypoints(start.position, velocity, times_s, positions)
    rest_s = [time_s - braking.duration_s for time_s in times_s]
    return braking.concatenate(through_waypoints(braking.end, 0.0, rest_s, positions))


def _check_speed(start: Start, allowed: float) -> None:
    speed, unit = abs(start.velocity), start.joint.unit
    if speed > allowed * (1.0 + _ROUNDING):
        raise ImpossibleError(
            f"{start.joint.name} is still moving at {speed:.4g} {unit}/s, and {allowed:.4g} {unit}/s are allowed; "
            "stop it first"
        )


def _check_extremes(start: Start, trajectory: Trajectory) -> None:
    limits = start.joint.limits.including(start.position)
    for position in trajectory.extremes:
        if abs(limits.clamp(position) - position) > _ROUNDING:
            raise ImpossibleError(
                f"{start.joint.name} is still moving at {start.velocity:.4g} {start.joint.unit}/s and would pass "
                f"{position:.4g} {start.joint.unit}, beyond its limit; stop it first, or give it more time"
            )


def cruise_from(start: Start) -> float:
    """Return the highest setpoint speed of a joint, which is less if it starts outside its limits."""
    outside = abs(start.joint.limits.clamp(start.position) - start.position)
    far = outside > (_OUTSIDE_M if start.joint.linear else _OUTSIDE_RAD)
    return cruise_of(start.joint) * (OUTSIDE_SHARE if far else 1.0)


def _visible(joint: JointFacts, speed: float) -> float:
    if speed < _SLOWEST:
        raise ImpossibleError(f"{joint.name} would move at {speed:.3g} {joint.unit}/s, which is too slow")
    return speed
