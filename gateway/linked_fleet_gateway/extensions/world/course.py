"""The course of a motion: where its joints are at a time, as agents carry it out. Radian, metre, second.

It loads no library. A motion from rest is as fast as its agent lets the joints move (``cruise.py`` of the agents).
"""

import math
from bisect import bisect_right
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from itertools import accumulate, pairwise

from msgspec.structs import replace

from linked_fleet_agent.urdf.cruise import RAMP_S
from linked_fleet_agent.wire.messages import Follow, Move
from linked_fleet_gateway.extensions.world.messages import PathSegment, Positions
from linked_fleet_gateway.extensions.world.other_motions import CONFIGURATION_STEP, MOST_CONFIGURATIONS
from linked_fleet_gateway.extensions.world.segments import interpolate, lasts_s, share_at
from linked_fleet_state.pace import duration_s
from linked_fleet_state.robot import Robot

_RAMP_STEPS = 8
_STEPS = 64
"""Places of a course that are compared with a measured one, and segments of the rest of a course."""


@dataclass(frozen=True)
class Course:
    """Joints on ``legs`` from ``start``. Each leg names all of them and has its time."""

    start: Positions
    legs: tuple[PathSegment, ...]

    @cached_property
    def _ends_s(self) -> tuple[float, ...]:
        return tuple(accumulate(map(lasts_s, self.legs)))

    @property
    def duration_s(self) -> float:
        return self._ends_s[-1]

    @property
    def end(self) -> Positions:
        return self.legs[-1].ends

    def at(self, time_s: float) -> Positions:
        """Return where the joints are at a time after the start."""
        number = bisect_right(self._ends_s, time_s)
        if number == len(self.legs):
            return self.end
        before, leg = self.legs[number - 1].ends if number else self.start, self.legs[number]
        share = share_at(leg, time_s - (self._ends_s[number - 1] if number else 0.0))
        return {name: float(interpolate(leg, name, before[name], share)) for name in leg.ends}

    def span(self, name: str, from_s: float, until_s: float) -> tuple[float, float]:
        """Return between which positions a joint is in a time."""
        found = [self.at(from_s + share / 8 * (until_s - from_s))[name] for share in range(9)]
        return min(found), max(found)

    def places(self, from_s: float) -> Iterator[tuple[float, Positions]]:
        """Yield times, from then on, and where the joints are, up to the end: at most MOST_CONFIGURATIONS."""
        left_s = max(0.0, self.duration_s - from_s)
        far = max(map(abs, self._ways(from_s)), default=0.0)
        count = min(MOST_CONFIGURATIONS, math.ceil(max(far / CONFIGURATION_STEP, 1.0)))
        for number in range(1, count + 1):
            after_s = number / count * left_s
            yield after_s, self.at(from_s + after_s)

    def _ways(self, from_s: float) -> Iterator[float]:
        """Yield how far each joint moves from then on, there and back."""
        times_s = [from_s + i / _STEPS * max(0.0, self.duration_s - from_s) for i in range(_STEPS + 1)]
        rows = [self.at(each) for each in times_s]
        for name in self.end:
            yield sum(abs(after[name] - before[name]) for before, after in pairwise(rows))

    def rest(self, from_s: float) -> tuple[PathSegment, ...]:
        """Return the segments from where the joints are at a time up to the end, each with its time."""
        step_s = max(self.duration_s - from_s, _LEAST_S) / _STEPS
        return tuple(
            PathSegment(self.at(from_s + number * step_s), timing=evenly(step_s)) for number in range(1, _STEPS + 1)
        )

    def reached_s(self, positions: Mapping[str, float]) -> float:
        """Return the earliest time at which the joints may be where they are measured: it may pass there again."""
        times_s = [i / _STEPS * self.duration_s for i in range(_STEPS + 1)]
        apart = [_apart(self.at(time_s), positions) for time_s in times_s]
        near = min(apart) + CONFIGURATION_STEP
        return next(time_s for time_s, each in zip(times_s, apart, strict=True) if each <= near)

    def after(self, wait_s: float) -> Follow:
        """Return the motion as a trajectory whose joints stay for a while first."""
        joints, step_s = tuple(self.end), max(_WAYPOINT_S, self.duration_s / _MOST_WAYPOINTS)
        count = max(1, math.ceil(self.duration_s / step_s))
        times_s = [number / count * self.duration_s for number in range(count + 1)]
        rows = tuple(tuple(self.at(time_s)[name] for name in joints) for time_s in times_s)
        return Follow(joints, tuple(wait_s + time_s for time_s in times_s), rows)


_LEAST_S = 0.001
_WAYPOINT_S, _MOST_WAYPOINTS = 0.03, 300


def _apart(one: Positions, other: Mapping[str, float]) -> float:
    return max(abs(at - other.get(name, math.inf)) for name, at in one.items())


def course_of(
    robot: Robot, motion: Move | Follow, scale: float, legs: tuple[PathSegment, ...], start: Positions
) -> Course | None:
    """Return the course of a motion from rest on its ``legs``; None if it moves nothing."""
    own = {name: start[name] for name in legs[-1].ends}
    if isinstance(motion, Move):
        timing = _timing(duration_s(robot, motion, scale, own))
        legs = (replace(legs[0], timing=timing),) if timing else ()
    return Course(own, legs) if legs else None


def evenly(duration_s: float) -> tuple[tuple[float, float], ...]:
    """Return the timing of a segment that is passed evenly."""
    return (0.0, 0.0), (duration_s, 1.0)


def _timing(duration_s: float) -> tuple[tuple[float, float], ...]:
    """Return the timing of a motion that ramps to its speed and back; nothing if it takes no time."""
    if duration_s < _LEAST_S:
        return ()
    ramp_s = min(RAMP_S, duration_s / 2.0)
    acceleration = 1.0 / (ramp_s * (duration_s - ramp_s))
    steps = [number / _RAMP_STEPS * ramp_s for number in range(_RAMP_STEPS + 1)]
    first = [(time_s, acceleration * time_s**2 / 2.0) for time_s in steps]
    return (*first, *((duration_s - time_s, 1.0 - share) for time_s, share in reversed(first)))
