"""Motion of a base in the plane: poses, velocities within limits, and the wheels of a differential drive. Pure.

x points forward and y to the left; headings are counterclockwise (REP 103). SI units.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

_STRAIGHT_RAD = 1e-9


class Velocity(NamedTuple):
    """Velocity in the frame of the base: forward (m/s), to the left (m/s) and counterclockwise (rad/s)."""

    linear: float = 0.0
    lateral: float = 0.0
    angular: float = 0.0

    def turned(self, angle_rad: float) -> "Velocity":
        """Return the velocity in a frame from which this one is turned by an angle."""
        cosine, sine = math.cos(angle_rad), math.sin(angle_rad)
        linear, lateral, angular = self
        return Velocity(linear * cosine - lateral * sine, linear * sine + lateral * cosine, angular)


STANDING = Velocity()


class Pose(NamedTuple):
    """Position (m) and heading (rad)."""

    x: float = 0.0
    y: float = 0.0
    heading: float = 0.0

    def moved(self, linear_m: float, angular_rad: float, lateral_m: float = 0.0) -> "Pose":
        """Return the pose after a piece of constant velocity, which is an arc."""
        half = angular_rad / 2.0
        chord = 1.0 if abs(half) < _STRAIGHT_RAD else math.sin(half) / half
        along, across = linear_m * chord, lateral_m * chord
        cosine, sine = math.cos(self.heading + half), math.sin(self.heading + half)
        heading = math.remainder(self.heading + angular_rad, math.tau)
        return Pose(self.x + along * cosine - across * sine, self.y + along * sine + across * cosine, heading)

    def ahead_m(self, other: "Pose") -> float:
        """Return how far another pose is ahead of this one; one that is behind has a negative distance."""
        return (other.x - self.x) * math.cos(self.heading) + (other.y - self.y) * math.sin(self.heading)

    def between(self, other: "Pose", share: float) -> "Pose":
        """Return the pose after a share of the straight way to another one, on which the heading changes evenly."""
        return Pose(*(at + share * (to - at) for at, to in zip(self, other, strict=True)))

    def to_leg_m(self, start: "Pose", end: "Pose") -> float:
        """Return how far it is from the straight way between two others."""
        along, square = (end.x - start.x, end.y - start.y), (end.x - start.x) ** 2 + (end.y - start.y) ** 2
        share = ((self.x - start.x) * along[0] + (self.y - start.y) * along[1]) / square if square else 0.0
        at = start.between(end, min(max(share, 0.0), 1.0))
        return math.hypot(self.x - at.x, self.y - at.y)

    def error_of(self, other: "Pose") -> tuple[float, float]:
        """Return how far another pose is away: the distance, and the turn without its sign."""
        turn = math.remainder(other.heading - self.heading, math.tau)
        return math.hypot(other.x - self.x, other.y - self.y), abs(turn)


@dataclass(frozen=True)
class DriveLimits:
    """The most that a base drives: m/s, rad/s, m/s² and rad/s². One that cannot move sideways has no ``lateral``."""

    linear: float
    angular: float
    linear_acceleration: float
    angular_acceleration: float
    lateral: float = 0.0

    def __post_init__(self) -> None:
        said = (self.linear, self.angular, self.linear_acceleration, self.angular_acceleration)
        if not (all(0.0 < each < math.inf for each in said) and 0.0 <= self.lateral < math.inf):
            raise ValueError(f"limits of a base are positive numbers; these are {self}")

    def clamp(self, wanted: Velocity) -> Velocity:
        """Return the velocity on the same arc that is within the limits. Raises ValueError if it is not finite."""
        if not all(map(math.isfinite, wanted)):
            raise ValueError(f"velocities of a base are finite; these are {tuple(wanted)}")
        lateral = wanted.lateral if self.lateral else 0.0
        excess = max(
            1.0,
            abs(wanted.linear) / self.linear,
            abs(wanted.angular) / self.angular,
            abs(lateral) / self.lateral if self.lateral else 0.0,
        )
        return Velocity(wanted.linear / excess, lateral / excess, wanted.angular / excess)

    def braking_s(self, velocity: Velocity) -> float:
        """Return how long the base takes to come to rest."""
        return self._duration_s(velocity, STANDING)

    def toward(self, now: Velocity, wanted: Velocity, elapsed_s: float) -> Velocity:
        """Return the velocity after ``elapsed_s``. All parts of it arrive together, so that braking keeps the arc."""
        needed_s = self._duration_s(now, wanted)
        if needed_s <= elapsed_s:
            return wanted
        share = elapsed_s / needed_s
        return Velocity(*(at + (to - at) * share for at, to in zip(now, wanted, strict=True)))

    def _duration_s(self, now: Velocity, wanted: Velocity) -> float:
        change = [abs(to - at) for at, to in zip(now, wanted, strict=True)]
        straight = math.hypot(change[0], change[1]) / self.linear_acceleration
        return max(straight, change[2] / self.angular_acceleration)


class Ramp:
    """The velocity of a base, which follows what is requested, and brakes when the time of the request is over."""

    def __init__(self, limits: DriveLimits) -> None:
        self.limits, self.velocity = limits, STANDING
        self._wanted, self._until_s = STANDING, -math.inf

    @property
    def standing(self) -> bool:
        return self.velocity == STANDING and self._wanted == STANDING

    def request(self, wanted: Velocity, until_s: float) -> None:
        """Drive like this until a time. Raises ValueError if a velocity is not finite."""
        self._wanted, self._until_s = self.limits.clamp(wanted), until_s

    def brake(self) -> None:
        self._wanted = STANDING

    def step(self, now_s: float, elapsed_s: float, share: float = 1.0) -> Velocity:
        """Return the velocity of the next piece. ``share`` is the share of its speed that the base uses."""
        if now_s >= self._until_s:
            self.brake()
        wanted = Velocity(*(share * each for each in self._wanted))
        self.velocity = self.limits.toward(self.velocity, wanted, elapsed_s)
        return self.velocity


@dataclass(frozen=True)
class Differential:
    """Two wheels on one axle, a drive on each, with their radius and distance in metres."""

    radius: float
    separation: float

    def wheels(self, velocity: Velocity) -> tuple[float, float]:
        """Return the rates of the left and of the right wheel in rad/s."""
        turn = velocity.angular * self.separation / 2.0
        return (velocity.linear - turn) / self.radius, (velocity.linear + turn) / self.radius

    def body(self, left: float, right: float) -> Velocity:
        """Return the velocity for two rates in rad/s, or the way (m and rad) for two angles in rad."""
        return Velocity((left + right) * self.radius / 2.0, 0.0, (right - left) * self.radius / self.separation)

    def moved(self, pose: Pose, left_rad: float, right_rad: float) -> Pose:
        """Return the pose after both wheels have turned by these angles (odometry)."""
        way = self.body(left_rad, right_rad)
        return pose.moved(way.linear, way.angular)
