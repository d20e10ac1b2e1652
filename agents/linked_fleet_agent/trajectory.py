"""Trajectories of one joint as sequences of cubics, and trapezoidal velocity profiles for them.

Pure; rad, rad/s or m, m/s, and seconds.
"""

import math
from bisect import bisect_right
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from operator import attrgetter
from typing import NamedTuple

from linked_fleet_agent.urdf.cruise import RAMP_S
from linked_fleet_agent.urdf.limits import Limits


class Segment(NamedTuple):
    """A cubic from ``start_s`` on: position, velocity, half the acceleration and a sixth of the jerk at its start."""

    start_s: float
    position: float
    velocity: float
    quadratic: float = 0.0
    cubic: float = 0.0

    def at(self, time_s: float) -> tuple[float, float]:
        """Return position and velocity ``time_s`` after the start of the segment."""
        position = self.position + time_s * (self.velocity + time_s * (self.quadratic + time_s * self.cubic))
        return position, self.velocity + time_s * (2.0 * self.quadratic + 3.0 * time_s * self.cubic)

    def maximum_speed(self, duration_s: float) -> float:
        """Return the highest speed within ``duration_s``: at one of the ends or where the acceleration is zero."""
        speeds = [abs(self.velocity), abs(self.at(duration_s)[1])]
        if self.cubic != 0.0 and 0.0 < (turn := -self.quadratic / (3.0 * self.cubic)) < duration_s:
            speeds.append(abs(self.at(turn)[1]))
        return max(speeds)

    def zero_velocity_times(self, duration_s: float) -> list[float]:
        """Return the times within ``duration_s`` at which the velocity is zero: candidates for extreme positions."""
        a, b, c = 3.0 * self.cubic, 2.0 * self.quadratic, self.velocity
        root = b * b - 4.0 * a * c
        if root < 0.0:
            return []
        # The numerically stable form of both roots; one of them is at infinity if the segment is not cubic.
        q = -(b + math.copysign(math.sqrt(root), b)) / 2.0
        times = [*([q / a] if a else []), *([c / q] if q else [])]
        return [time for time in times if 0.0 < time < duration_s]


_start = attrgetter("start_s")


@dataclass(frozen=True)
class Trajectory:
    """Segments in temporal order; the joint stands at ``end`` after ``duration_s``."""

    segments: tuple[Segment, ...]
    duration_s: float
    end: float

    def at(self, time_s: float) -> tuple[float, float]:
        """Return position and velocity at ``time_s`` ≥ 0."""
        if time_s >= self.duration_s:
            return self.end, 0.0
        segment = self.segments[bisect_right(self.segments, time_s, key=_start) - 1]
        return segment.at(time_s - segment.start_s)

    @property
    def maximum_speed(self) -> float:
        """The highest speed of the trajectory."""
        return max((segment.maximum_speed(duration_s) for segment, duration_s in self._lasting()), default=0.0)

    @property
    def extremes(self) -> tuple[float, float]:
        """The least and the greatest position of the trajectory."""
        found = [self.end]
        for segment, duration_s in self._lasting():
            found += [segment.at(time_s)[0] for time_s in (0.0, *segment.zero_velocity_times(duration_s))]
        return min(found), max(found)

    def concatenate(self, later: "Trajectory") -> "Trajectory":
        """Return this trajectory followed by ``later``."""
        moved = (segment._replace(start_s=segment.start_s + self.duration_s) for segment in later.segments)
        return Trajectory((*self.segments, *moved), self.duration_s + later.duration_s, later.end)

    def _lasting(self) -> Iterator[tuple[Segment, float]]:
        ends = [*(segment.start_s for segment in self.segments[1:]), self.duration_s]
        return zip(self.segments, (end - s.start_s for s, end in zip(self.segments, ends, strict=True)), strict=True)


def hold(position: float) -> Trajectory:
    """Stay at ``position`` from now on."""
    return Trajectory((), 0.0, position)


def from_accelerations(
    position: float, velocity: float, phases: Iterable[tuple[float, float]], end: float
) -> Trajectory:
    """Return phases of (duration, acceleration) in sequence. They must come to rest at ``end``, up to rounding."""
    segments, time_s = [], 0.0
    for duration_s, acceleration in phases:
        if duration_s > 0.0:
            segments.append(Segment(time_s, position, velocity, acceleration / 2.0))
            position, velocity = segments[-1].at(duration_s)
            time_s += duration_s
    return Trajectory(tuple(segments), time_s, end)


def through_waypoints(
    start: float, velocity: float, times_s: Sequence[float], positions: Sequence[float]
) -> Trajectory:
    """Return a trajectory from ``start`` at ``velocity`` through ``positions`` at increasing ``times_s`` > 0, ending at
    rest.

    A piecewise cubic with the slopes of Fritsch and Carlson (SIAM J. Numer. Anal. 17, 1980; weights of Fritsch and
    Butland, 1984). Between two waypoints it stays between their positions, unless the initial ``velocity`` carries it
    beyond (by up to 4/27 of the distance that this velocity covers in the time to the first waypoint).
    """
    times, values = (0.0, *times_s), (start, *positions)
    steps = [later - earlier for earlier, later in pairwise(times)]
    slopes = [(after - before) / step for (before, after), step in zip(pairwise(values), steps, strict=True)]
    inner = (_slope(*pair) for pair in pairwise(zip(steps, slopes, strict=True)))
    velocities = (velocity, *inner, 0.0)
    segments = tuple(
        Segment(time_s, value, begin, (3.0 * slope - 2.0 * begin - end) / step, (begin + end - 2.0 * slope) / step**2)
        for time_s, value, (begin, end), slope, step in zip(
            times[:-1], values[:-1], pairwise(velocities), slopes, steps, strict=True
        )
    )
    return Trajectory(segments, times[-1], values[-1])


def _slope(before: tuple[float, float], after: tuple[float, float]) -> float:
    """Return the velocity at a waypoint: a weighted harmonic mean of the adjacent slopes, zero where the direction
    reverses.
    """
    (step_before, slope_before), (step_after, slope_after) = before, after
    if slope_before * slope_after <= 0.0:
        return 0.0
    weight_before, weight_after = 2.0 * step_after + step_before, step_after + 2.0 * step_before
    return (weight_before + weight_after) / (weight_before / slope_before + weight_after / slope_after)


# Shorter distances are rounding errors.
_NO_WAY = 1e-12


def brake(position: float, velocity: float, acceleration: float, limits: Limits) -> Trajectory:
    """Come to rest with ``acceleration``, or with a higher one if a limit is nearer.

    A joint outside its limits may come to rest there.
    """
    if velocity == 0.0:
        return hold(position)
    end = limits.including(position).clamp(position + velocity * abs(velocity) / (2.0 * acceleration))
    if abs(end - position) <= _NO_WAY:
        return hold(position)
    slowing = velocity * abs(velocity) / (2.0 * (end - position))
    return from_accelerations(position, velocity, [(abs(velocity) / slowing, -math.copysign(slowing, velocity))], end)


def reach(
    position: float, velocity: float, target: float, cruise: float, acceleration: float, limits: Limits
) -> Trajectory:
    """Plan from ``position`` at ``velocity`` to rest at ``target``, as fast as ``cruise`` and ``acceleration`` allow.

    A joint that moves the other way, or too fast to stop at the target, brakes first. One above ``cruise`` slows down.
    """
    way, stopping = target - position, velocity * velocity / (2.0 * acceleration)
    if velocity != 0.0 and stopping > math.copysign(1.0, velocity) * way + _NO_WAY:
        braking = brake(position, velocity, acceleration, limits)
        return braking.concatenate(reach(braking.end, 0.0, target, cruise, acceleration, limits))
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
    return from_accelerations(position, velocity, signed, target)


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
