"""The way that a base will take, from how it moves now to its rest. Pure. SI units, in the frame of the base now."""

import itertools
import math
from collections.abc import Iterable, Iterator, Sequence

from msgspec import Struct

from linked_fleet_agent.planar import STANDING, DriveLimits, Pose, Velocity
from linked_fleet_agent.smooth_path import TOLERANCE_M

REACTION_S = 0.15
"""A request may reach the base so late, counted from the measurement for which its way was found free."""
Point = tuple[float, float]
_STEP_S = 0.02
_NO_WAY_M = 1e-4
_APART_M, _APART_RAD = 0.02, 0.03
_TURN_RAD, _SPOT_M = math.radians(10.0), 0.05
"""A turn is split so that the corners of a robot leave the hull of both ends by 0.4 % of its radius."""
_SLOWEST_M_S, _SLOWEST_RAD_S = 0.02, 0.03
_STILL, _PARALLEL = 1e-3, 0.01


class Drive(Struct, frozen=True):
    """Velocities of a base for a time, after which it brakes within its limits."""

    velocity: Velocity
    duration_s: float
    limits: DriveLimits

    @property
    def input(self) -> dict[str, float]:
        """The velocities by their names in the input of the action ``drive``."""
        return {name: each for name, each in self.velocity._asdict().items() if each}

    @property
    def standing(self) -> bool:
        return self.velocity == STANDING

    @property
    def standing_input(self) -> dict[str, float]:
        """The input that brakes."""
        return dict.fromkeys(self.input, 0.0)

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
        reaches it at once, or late, or in between. Of ways on one arc the longest is enough.
        """
        meanwhile = dict.fromkeys((now, STANDING, now if before is None else before))
        if all(self._is_along(each) for each in meanwhile):
            return (max((self._way(now, each, REACTION_S) for each in meanwhile), key=_length),)
        late = [(velocity, share * REACTION_S) for velocity in meanwhile for share in (0.5, 1.0)]
        return tuple(self._way(now, *each) for each in ((now, 0.0), *late))

    def _is_along(self, velocity: Velocity) -> bool:
        """Return True if this velocity leads along the same arc."""
        size, own = math.hypot(*velocity), math.hypot(*self.velocity)
        if size < _STILL or not own:
            return size < _STILL
        return all(abs(at / size - to / own) < _PARALLEL for at, to in zip(velocity, self.velocity, strict=True))

    def until_standing(self, now: Velocity) -> tuple[Pose, ...]:
        """Return one of these ways: a late one, before which it brakes."""
        return self._way(now, STANDING, REACTION_S)

    def _way(self, now: Velocity, meanwhile: Velocity, reaction_s: float) -> tuple[Pose, ...]:
        return tuple(_sparse(self._steps(now, meanwhile, reaction_s)))

    def fitting_share(self, free: float) -> float:
        """Return the share of the speed at which only the share ``free`` of its way is needed."""
        return fitting_share(free, self.duration_s, self.limits.braking_s(self.velocity))

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


def _length(way: Sequence[Pose]) -> float:
    """Return the sum of all that changes along a way, in metre and radian."""
    return math.fsum(math.dist(*each) for each in itertools.pairwise((Pose(), *way)))


def fitting_share(free: float, duration_s: float, braking_s: float) -> float:
    """Return the share of a speed, held for a time and then braked, at which only a share of its way is needed."""
    before_s = duration_s + REACTION_S
    there_s = free * (before_s + braking_s / 2.0)
    if not braking_s:
        return free
    return (math.sqrt(before_s**2 + 2.0 * braking_s * there_s) - before_s) / braking_s


class FollowedPath(Struct, frozen=True):
    """A path in the odometry frame that a base follows. A pose without heading has NaN.

    ``limits`` are those of the base, if it says how it brakes. One that ``docks`` stops at each pose, and drives to the
    first one backwards if that lies behind it.
    """

    poses: tuple[Pose, ...]
    reverse: bool = False
    limits: DriveLimits | None = None
    docks: bool = False

    @property
    def lateral(self) -> bool:
        """True if the base can drive sideways."""
        return self.limits is not None and self.limits.lateral > 0.0

    def ways(self, now: Pose) -> tuple[tuple[Pose, ...], ...]:
        """Return the way through all poses, and the one that cuts corners, for a base at this pose.

        Between two poses position and heading change evenly.
        """
        points = [(now.x, now.y), *((each.x, each.y) for each in self.poses)]
        exact = self._through(now, self.poses)
        cut = _cut(points)
        headings = [*(Pose(x, y, math.nan) for x, y in cut[1:-1]), self.poses[-1]]
        around = self._through(now, headings)
        return (exact,) if self.lateral or self.docks or len(cut) == len(points) else (exact, around)

    def _through(self, now: Pose, poses: Sequence[Pose]) -> tuple[Pose, ...]:
        first = self.reverse or (self.docks and now.ahead_m(poses[0]) < 0.0)
        backwards = [first, *[self.reverse] * (len(poses) - 1)]
        return tuple(relative(each, now) for each in through(now, poses, self.lateral, backwards))


def through(start: Pose, poses: Sequence[Pose], lateral: bool, backwards: Sequence[bool] = ()) -> Iterator[Pose]:
    """Yield the poses of a base on its way through some, between which position and heading change evenly.

    One that is not ``lateral`` turns on the spot before each leg, away from the next pose if that leg is ``backwards``.
    """
    at, heading = start, start.heading
    for target, is_backwards in zip(poses, backwards or itertools.repeat(False), strict=False):
        if not lateral and math.hypot(target.x - at.x, target.y - at.y) > _NO_WAY_M:
            ahead = math.atan2(target.y - at.y, target.x - at.x) + (math.pi if is_backwards else 0.0)
            heading += math.remainder(ahead - heading, math.tau)
            yield Pose(at.x, at.y, heading)
        elif lateral and math.isfinite(target.heading):
            heading += math.remainder(target.heading - heading, math.tau)
        at = Pose(target.x, target.y, heading)
        yield at
    if poses and math.isfinite(poses[-1].heading):
        yield at._replace(heading=heading + math.remainder(poses[-1].heading - heading, math.tau))


def pieces(start: Pose, way: Iterable[Pose]) -> Iterator[Sequence[Pose]]:
    """Yield the poses of the pieces of a way: those of a turn on the spot, else two with little turn between them."""
    for one, other in itertools.pairwise((start, *way)):
        count = max(1, math.ceil(abs(other.heading - one.heading) / _TURN_RAD))
        steps = [one.between(other, index / count) for index in range(count + 1)]
        if math.dist(one[:2], other[:2]) < _SPOT_M:
            yield steps
        else:
            yield from itertools.pairwise(steps)


def placed(pose: Pose, at: Pose) -> Pose:
    """Return a pose that is given in the frame of another one. The inverse of ``relative``."""
    cosine, sine = math.cos(at.heading), math.sin(at.heading)
    return Pose(
        at.x + pose.x * cosine - pose.y * sine, at.y + pose.x * sine + pose.y * cosine, at.heading + pose.heading
    )


def relative(pose: Pose, to: Pose) -> Pose:
    """Return a pose in the frame of another one. Its heading is the difference, which may exceed half a turn."""
    x, y, cosine, sine = pose.x - to.x, pose.y - to.y, math.cos(to.heading), math.sin(to.heading)
    return Pose(x * cosine + y * sine, y * cosine - x * sine, pose.heading - to.heading)


def _cut(points: Sequence[Point]) -> list[Point]:
    """Return the points of a path with two in the place of each corner."""
    found = [points[0]]
    for before, at, after in zip(points, points[1:], points[2:], strict=False):
        one, other = math.dist(before, at), math.dist(at, after)
        if min(one, other) < _NO_WAY_M:
            found.append(at)
            continue
        turn = math.atan2(after[1] - at[1], after[0] - at[0]) - math.atan2(at[1] - before[1], at[0] - before[0])
        far = min(TOLERANCE_M / max(math.cos(math.remainder(turn, math.tau) / 2.0), 0.1), one / 2.0, other / 2.0)
        found += [_toward(at, before, far / one), _toward(at, after, far / other)]
    return [*found, points[-1]]


def _toward(start: Point, end: Point, share: float) -> Point:
    return start[0] + share * (end[0] - start[0]), start[1] + share * (end[1] - start[1])


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
