"""Trapezoidal velocity profiles of one joint. Pure; rad, rad/s or m, m/s, and seconds.

A joint cruises at CRUISE_SHARE of its URDF velocity limit at most, so that the real joint with its lag and ripple stays
below the limit. The cruise speed is also capped at a value for machines among people.
"""

import math

from linked_fleet_agent.robot import JointFacts, Limits
from linked_fleet_agent.trajectory import Trajectory, accelerating, hold

CRUISE_SHARE = 0.8
MAX_CRUISE_RAD_S, MAX_CRUISE_M_S = 1.5, 0.25
# For joints whose URDF states no velocity limit.
UNKNOWN_CRUISE_RAD_S, UNKNOWN_CRUISE_M_S = 0.5, 0.05
RAMP_S = 0.4
# Shorter distances are rounding errors.
_NO_WAY = 1e-12


def cruise_of(joint: JointFacts) -> float:
    """Return the highest setpoint speed of ``joint``, in rad/s or m/s."""
    limit = joint.limits.velocity
    if limit is None:
        return UNKNOWN_CRUISE_M_S if joint.linear else UNKNOWN_CRUISE_RAD_S
    return min(CRUISE_SHARE * limit, MAX_CRUISE_M_S if joint.linear else MAX_CRUISE_RAD_S)


def brake(position: float, velocity: float, acceleration: float, limits: Limits) -> Trajectory:
    """Come to rest with ``acceleration``, or with a higher one if a limit is nearer."""
    if velocity == 0.0:
        return hold(position)
    end = limits.clamp(position + velocity * abs(velocity) / (2.0 * acceleration))
    if abs(end - position) <= _NO_WAY:
        return hold(position)
    slowing = velocity * abs(velocity) / (2.0 * (end - position))
    return accelerating(position, velocity, [(abs(velocity) / slowing, -math.copysign(slowing, velocity))], end)


def reach(
    position: float, velocity: float, target: float, cruise: float, acceleration: float, limits: Limits
) -> Trajectory:
    """Plan from ``position`` at ``velocity`` to rest at ``target``, as fast as ``cruise`` and ``acceleration`` allow.

    A joint that moves the other way, or too fast to stop at the target, brakes first. One above ``cruise`` slows down.
    """
    way, stopping = target - position, velocity * velocity / (2.0 * acceleration)
    if velocity != 0.0 and stopping > math.copysign(1.0, velocity) * way + _NO_WAY:
        braking = brake(position, velocity, acceleration, limits)
        return braking.then(reach(braking.end, 0.0, target, cruise, acceleration, limits))
    if abs(way) <= _NO_WAY:
        return hold(target)
    sign, speed = math.copysign(1.0, way), abs(velocity)
    if speed > cruise:
        cruising_s = max(0.0, abs(way) - stopping) / cruise
        phases = [((speed - cruise) / acceleration, -1.0), (cruising_s, 0.0), (cruise / acceleration, -1.0)]
    else:
        peak = min(cruise, math.sqrt(acceleration * abs(way) + speed * speed / 2.0))
        cruising_s = max(0.0, abs(way) - peak * peak / acceleration + stopping) / peak
        phases = [((peak - speed) / acceleration, 1.0), (cruising_s, 0.0), (peak / acceleration, -1.0)]
    signed = [(duration_s, direction * sign * acceleration) for duration_s, direction in phases]
    return accelerating(position, velocity, signed, target)


def reach_in(
    duration_s: float, position: float, velocity: float, target: float, cruise: float, ramp: float, limits: Limits
) -> Trajectory:
    """Plan like ``reach``, but slowed to take ``duration_s``; ``ramp`` is the acceleration of a joint that already
    moves.

    Joints at rest all ramp for the same time, so that together they move straight in joint space.
    """
    way = abs(target - position)
    if velocity == 0.0:
        if way <= _NO_WAY:
            return hold(target)
        trapezoid = duration_s >= 2.0 * RAMP_S
        slow = way / (duration_s - RAMP_S) if trapezoid else 4.0 * way * RAMP_S / (duration_s * duration_s)
        return reach(position, 0.0, target, min(slow, cruise), min(slow, cruise) / RAMP_S, limits)
    low, high = 0.0, cruise
    for _ in range(40):  # bisection: a slower cruise takes longer
        middle = (low + high) / 2.0
        if reach(position, velocity, target, middle, ramp, limits).duration_s > duration_s:
            low = middle
        else:
            high = middle
    return reach(position, velocity, target, high, ramp, limits)
