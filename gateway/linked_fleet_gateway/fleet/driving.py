"""The way that a base will take, from how it moves now to its rest. Pure. SI units, in the frame of the base now."""

import math
from collections.abc import Iterator

from msgspec import Struct

from linked_fleet_agent.planar import STANDING, DriveLimits, Pose, Velocity

PLANE = ("plane x", "plane y", "plane turn")
"""Names of the joints by which checks of motions let a base slide and turn: metre, metre, radian."""
REACTION_S = 0.1
"""For so long a base may go on as it moves now, before a request reaches it."""
_STEP_S = 0.02
_APART_M, _APART_RAD = 0.02, 0.03
_SLOWEST_M_S, _SLOWEST_RAD_S = 0.02, 0.03


class Drive(Struct, frozen=True):
    """Velocities of a base for a time, after which it brakes within its limits."""

    velocity: Velocity
    duration_s: float
    limits: DriveLimits

    @property
    def input(self) -> dict[str, float]:
        """The velocities by their names in the input of the action ``drive``."""
        return {name: each for name, each in self.velocity._asdict().items() if each}

    def slowed(self, share: float) -> "Drive":
        """Return the drive at a share of its speed, on the same arc."""
        return Drive(Velocity(*(share * each for each in self.velocity)), self.duration_s, self.limits)

    @property
    def is_too_slow(self) -> bool:
        linear, lateral, angular = self.velocity
        return math.hypot(linear, lateral) < _SLOWEST_M_S and abs(angular) < _SLOWEST_RAD_S

    def way(self, now: Velocity = STANDING) -> tuple[Pose, ...]:
        """Return the poses on the way until the base stands, a few centimetres apart, for one that moves like this."""
        return tuple(_sparse(self._steps(now)))

    def fitting_share(self, free: float) -> float:
        """Return the share of the speed at which only the share ``free`` of its way is needed."""
        braking_s = self.limits.braking_s(self.velocity)
        before_s = self.duration_s + REACTION_S
        there_s = free * (before_s + braking_s / 2.0)
        if not braking_s:
            return free
        return (math.sqrt(before_s**2 + 2.0 * braking_s * there_s) - before_s) / braking_s

    def _steps(self, now: Velocity) -> Iterator[Pose]:
        pose = Pose().moved(now.linear * REACTION_S, now.angular * REACTION_S, now.lateral * REACTION_S)
        velocity, left_s = now, self.duration_s
        yield pose
        while left_s > 0.0 or velocity != STANDING:
            velocity = self.limits.toward(velocity, self.velocity if left_s > 0.0 else STANDING, _STEP_S)
            left_s -= _STEP_S
            pose = pose.moved(velocity.linear * _STEP_S, velocity.angular * _STEP_S, velocity.lateral * _STEP_S)
            yield pose


def _sparse(poses: Iterator[Pose]) -> Iterator[Pose]:
    """Leave out poses that are near the one before, but not the last one. Headings do not jump at half a turn."""
    kept, heading, last, pending = Pose(), 0.0, 0.0, None
    for pose in poses:
        heading += math.remainder(pose.heading - last, math.tau)
        last, pending = pose.heading, Pose(pose.x, pose.y, heading)
        if math.hypot(pose.x - kept.x, pose.y - kept.y) >= _APART_M or abs(heading - kept.heading) >= _APART_RAD:
            yield pending
            kept, pending = pending, None
    if pending is not None:
        yield pending
