"""The way that a base will take, from how it moves now to its rest. Pure. SI units, in the frame of the base now."""

import itertools
import math
from collections.abc import Iterator

from msgspec import Struct

from linked_fleet_agent.planar import STANDING, DriveLimits, Pose, Velocity

PLANE = ("plane x", "plane y", "plane turn")
"""Names of the joints by which checks of motions let a base slide and turn: metre, metre, radian."""
REACTION_S = 0.15
"""A request may reach the base so late, counted from the measurement for which its way was found free."""
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

    def ways(self, now: Velocity = STANDING, before: Velocity | None = None) -> tuple[tuple[Pose, ...], ...]:
        """Return the ways until the base stands, each as poses a few centimetres apart.

        It moves like ``now``. Until the request reaches it, it goes on like that, brakes because the time of an earlier
        request is over, or goes towards ``before``, the velocity of one that has not reached it either. The request
        reaches it at once, or late, or in between.
        """
        meanwhile = dict.fromkeys((now, STANDING, now if before is None else before))
        late = [(velocity, share * REACTION_S) for velocity in meanwhile for share in (0.5, 1.0)]
        return tuple(tuple(_sparse(self._steps(now, *each))) for each in ((now, 0.0), *late))

    def fitting_share(self, free: float) -> float:
        """Return the share of the speed at which only the share ``free`` of its way is needed."""
        braking_s = self.limits.braking_s(self.velocity)
        before_s = self.duration_s + REACTION_S
        there_s = free * (before_s + braking_s / 2.0)
        if not braking_s:
            return free
        return (math.sqrt(before_s**2 + 2.0 * braking_s * there_s) - before_s) / braking_s

    def _steps(self, now: Velocity, meanwhile: Velocity, reaction_s: float) -> Iterator[Pose]:
        """Yield the poses after each step. The request holds for a step longer, since agents act once in a tick."""
        pose, velocity = Pose(), now
        begins, brakes = round(reaction_s / _STEP_S), math.ceil((reaction_s + self.duration_s) / _STEP_S) + 1
        for step in itertools.count():
            if step >= brakes and velocity == STANDING:
                return
            wanted = meanwhile if step < begins else self.velocity if step < brakes else STANDING
            before, velocity = velocity, self.limits.toward(velocity, wanted, _STEP_S)
            linear, lateral, angular = (_STEP_S / 2 * (at + to) for at, to in zip(before, velocity, strict=True))
            pose = pose.moved(linear, angular, lateral)
            yield pose


def _sparse(poses: Iterator[Pose]) -> Iterator[Pose]:
    """Leave out poses that are near the one before, but not the last one. Headings do not jump at half a turn."""
    kept, heading, last = Pose(), 0.0, 0.0
    pending: Pose | None = None
    for pose in poses:
        heading += math.remainder(pose.heading - last, math.tau)
        last, pending = pose.heading, Pose(pose.x, pose.y, heading)
        if math.hypot(pose.x - kept.x, pose.y - kept.y) >= _APART_M or abs(heading - kept.heading) >= _APART_RAD:
            yield pending
            kept, pending = pending, None
    if pending is not None:
        yield pending
