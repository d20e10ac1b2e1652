"""Velocities that keep a base on a path: it slows for corners, turns on the spot where it must, and stops. Pure.

A base that cannot drive sideways looks along its path, or away from it in reverse, and takes the heading of the last
pose. One that can takes the heading of each pose on the way. SI units.
"""

import bisect
import math
from collections.abc import Sequence
from itertools import accumulate, pairwise

from linked_fleet_agent.planar import STANDING, DriveLimits, Pose, Velocity
from linked_fleet_agent.smooth_path import TOLERANCE_M, Piece, Point, distinct, stretches, thinned
from linked_fleet_agent.wire.kinds import OFF_PATH

USED, _CHANGED = 0.7, 0.85
"""The share of its limits by which a base follows a path, and the one that it has to correct errors."""
LOST_M = 0.25
"""A base that is further off its path does not go on."""
_ORIGIN = Pose()
_TURNED_RAD, _THERE_M = 0.004, 0.002
_APPROACH_S = 0.1
"""Time constant by which it comes to rest, so that a delay does not let it pass its target."""
_SLOWEST_M_S, _SLOWEST_RAD_S = 0.01, 0.02
_SETTLE_S = 0.1
_CORRECTION_S, _CORRECTION_M = 0.25, 0.05
"""After so long, but not before so much of the way, most of an error is corrected."""
_CORRECTION_1_S = 2.0
_LONGEST_PAUSE_S = 1.0
"""A base goes on while its agent is held up; for longer than this it has braked."""
_LEAD_S, _FIRST_STEP_S, _LONGEST_STEP_S, _FASTER = 0.015, 0.01, 0.05, 2.0
_HEADING_M_RAD = 0.4
"""An error of the heading counts like so many metres beside the way when poses are left out."""
_ALIGNED_RAD = 0.2
"""A base that moves goes on along a new path that begins within this angle, and stops before any other."""


class PathError(Exception):
    """A path cannot be followed; the message says why."""


class Turn:
    """A turn on the spot to a heading."""

    def __init__(self, start: float, heading: float, limits: DriveLimits, speed: float) -> None:
        self.heading, self._most = heading, speed * limits.angular
        self._braking = USED * limits.angular_acceleration
        self._angle = self.left = abs(math.remainder(heading - start, math.tau))
        needed = self._angle > _TURNED_RAD
        self.duration_s = trapezoid_s(self._angle, self._most, self._braking) + _SETTLE_S if needed else 0.0

    @property
    def share(self) -> float:
        return 1.0 if not self._angle else 1.0 - min(self.left / self._angle, 1.0)

    def wanted(self, pose: Pose, now_s: float, share: float) -> Velocity:
        """Return the velocity, which is zero where the turn ends."""
        error = math.remainder(self.heading - pose.heading, math.tau)
        self.left = abs(error)
        if self.left <= _TURNED_RAD:
            return STANDING
        rate = min(share * self._most, approach(self.left, self._braking, _SLOWEST_RAD_S))
        return Velocity(angular=math.copysign(rate, error))


class Stretch:
    """A way without a stop. ``headings`` are those of a base that drives sideways, at the corners and at both ends."""

    def __init__(
        self,
        pieces: Sequence[Piece],
        limits: DriveLimits,
        speed: float,
        headings: Sequence[float] = (),
        reverse: bool = False,
    ) -> None:
        self._pieces, self._limits, self._reverse = pieces, limits, reverse
        self._starts = [0.0, *accumulate(each.length for each in pieces)]
        self.length, self.way, self.speed = self._starts[-1], 0.0, 0.0
        self._braking, self._before_s, self._rate = USED * limits.linear_acceleration, 0.0, 0.0
        self._headings = list(headings)
        middles = [(start + end) / 2.0 for start, end in pairwise(self._starts)][1:-1:2]
        self._marks = [0.0, *middles, self.length]
        self._speed, self._share = speed, 1.0
        self._most = [self._most_of(index, speed) for index in range(len(pieces))]
        self.duration_s = self._duration_s()

    def join(self, velocity: Velocity) -> None:
        """Begin with this velocity."""
        self.speed, self._rate = math.hypot(velocity.linear, velocity.lateral), velocity.angular

    @property
    def direction(self) -> float:
        """The direction in which it begins."""
        return self._pieces[0].direction

    @property
    def share(self) -> float:
        return min(self.way / self.length, 1.0)

    def _duration_s(self) -> float:
        """Return how long it takes from rest to rest."""
        most = [0.0, *(min(pair) for pair in pairwise(self._most)), 0.0]
        lengths = [each.length for each in self._pieces]
        for index, length in enumerate(lengths):
            most[index + 1] = min(most[index + 1], math.sqrt(most[index] ** 2 + 2.0 * self._braking * length))
        for index in reversed(range(len(lengths))):
            most[index] = min(most[index], math.sqrt(most[index + 1] ** 2 + 2.0 * self._braking * lengths[index]))
        parts = zip(lengths, self._most, pairwise(most), strict=True)
        return sum(trapezoid_s(length, top, self._braking, *ends) for length, top, ends in parts) + _SETTLE_S

    def wanted(self, pose: Pose, now_s: float, share: float) -> Velocity:
        """Return the velocity, which is zero where the way ends. Raises PathError far off the way."""
        passed_s = max(now_s - self._before_s, 0.0) if self._before_s else _FIRST_STEP_S
        self._before_s, elapsed_s = now_s, min(passed_s, _LONGEST_STEP_S)
        self._advance(pose, _FASTER * self.speed * min(passed_s, _LONGEST_PAUSE_S) + _THERE_M)
        if self.length - self.way <= _THERE_M:
            return STANDING
        if share != self._share:
            self._share = share
            self._most = [self._most_of(index, share * self._speed) for index in range(len(self._pieces))]
        self.speed = min(self._allowed(), self.speed + self._braking * elapsed_s)
        lead = self._at(self.way + self.speed * _LEAD_S)
        wanted = self._sideways(pose, lead) if self._headings else self._along(pose, lead)
        # A rate that the base cannot have yet would delay its braking, because all parts of a velocity arrive together.
        change = _CHANGED * self._limits.angular_acceleration * elapsed_s
        self._rate = min(max(wanted.angular, self._rate - change), self._rate + change)
        return wanted._replace(angular=self._rate)

    def _advance(self, pose: Pose, most_m: float) -> None:
        """Find the point of the way that is nearest, at most so far from the last one."""
        least, most = max(self.way - most_m, 0.0), min(self.way + most_m, self.length)
        for _ in range(2):
            at = self._at(self.way)
            ahead = (pose.x - at.x) * math.cos(at.direction) + (pose.y - at.y) * math.sin(at.direction)
            self.way = min(max(self.way + ahead, least), most)
        at = self._at(self.way)
        off = math.hypot(pose.x - at.x, pose.y - at.y)
        if off > LOST_M:
            raise PathError(f"{OFF_PATH} by {off:.2f} m; {LOST_M:g} m is the most")

    def _at(self, way: float) -> Point:
        index = self._index(way)
        return self._pieces[index].at(way - self._starts[index])

    def _index(self, way: float) -> int:
        return min(bisect.bisect_right(self._starts, way) - 1, len(self._pieces) - 1)

    def _allowed(self) -> float:
        """Return the speed at which it can still slow down for all that comes."""
        index = self._index(self.way)
        speed = min(self._most[index], approach(self.length - self.way, self._braking, _SLOWEST_M_S))
        for later in range(index + 1, len(self._pieces)):
            ahead = self._starts[later] - self.way
            if 2.0 * self._braking * ahead >= speed**2:
                break
            speed = min(speed, math.sqrt(self._most[later] ** 2 + 2.0 * self._braking * ahead))
        return speed

    def _along(self, pose: Pose, at: Point) -> Velocity:
        """Return the velocity of a base that looks along its way."""
        heading = pose.heading + (math.pi if self._reverse else 0.0)
        x, y = pose.x - at.x, pose.y - at.y
        aside = y * math.cos(at.direction) - x * math.sin(at.direction)
        turned = math.sin(heading - at.direction)
        within = max(self.speed * _CORRECTION_S, _CORRECTION_M)
        rate = self.speed * (at.curvature - aside / within**2 - 2.0 * turned / within)
        return Velocity(-self.speed if self._reverse else self.speed, 0.0, rate)

    def _sideways(self, pose: Pose, at: Point) -> Velocity:
        """Return the velocity of a base that can drive in all directions."""
        cosine, sine = math.cos(at.direction), math.sin(at.direction)
        aside = (pose.y - at.y) * cosine - (pose.x - at.x) * sine
        back = -_CORRECTION_1_S * aside
        direction = at.direction - pose.heading
        heading, slope = self._heading(self.way)
        rate = self.speed * slope + _CORRECTION_1_S * math.remainder(heading - pose.heading, math.tau)
        return Velocity(
            self.speed * math.cos(direction) - back * math.sin(direction),
            self.speed * math.sin(direction) + back * math.cos(direction),
            rate,
        )

    def _heading(self, way: float) -> tuple[float, float]:
        """Return the heading at a point of the way, and its change with the way. It changes smoothly between poses."""
        index = min(max(bisect.bisect_right(self._marks, way) - 1, 0), len(self._marks) - 2)
        start, length = self._marks[index], self._marks[index + 1] - self._marks[index]
        turn, share = self._turn(index), min((way - start) / length, 1.0)
        smooth, slope = share**2 * (3.0 - 2.0 * share), 6.0 * share * (1.0 - share)
        return self._headings[index] + turn * smooth, turn * slope / length

    def _turn(self, index: int) -> float:
        return math.remainder(self._headings[index + 1] - self._headings[index], math.tau)

    def _most_of(self, index: int, speed: float) -> float:
        """Return the most speed on a piece."""
        piece, limits = self._pieces[index], self._limits
        most = [speed * limits.linear]
        if not self._headings:
            most += [speed * limits.angular * USED / piece.curvature] if piece.curvature else []
            most += [math.sqrt(limits.angular_acceleration * USED / piece.sharpness)] if piece.sharpness else []
            return min(most)
        first, last = (
            min(max(bisect.bisect_right(self._marks, way) - 1, 0), len(self._marks) - 2)
            for way in (self._starts[index], max(self._starts[index + 1] - 1e-9, 0.0))
        )
        for interval in range(first, last + 1):
            length, turn = self._marks[interval + 1] - self._marks[interval], abs(self._turn(interval))
            slope, bend = 1.5 * turn / length, 6.0 * turn / length**2
            most += [speed * limits.angular * USED / slope] if slope else []
            most += [math.sqrt(limits.angular_acceleration * USED / bend)] if bend else []
            most.append(math.sqrt(limits.linear_acceleration * USED / (piece.curvature + slope or 1e-9)))
        return min(*most, *(self._most_at(way, speed) for way in self._samples(index)))

    def _samples(self, index: int) -> list[float]:
        start, length = self._starts[index], self._pieces[index].length
        return [start + share / 8.0 * length for share in range(9)]

    def _most_at(self, way: float, speed: float) -> float:
        """Return the most speed in the direction that the way has for a base that looks elsewhere."""
        direction = self._at(way).direction - self._heading(way)[0]
        limits, cosine, sine = self._limits, abs(math.cos(direction)), abs(math.sin(direction))
        return speed * min(limits.linear / max(cosine, 1e-9), limits.lateral / max(sine, 1e-9))


Move = Turn | Stretch


def from_here(pose: Pose, path: Sequence[Pose]) -> list[Pose]:
    """Return a path without its first pose if the base has just passed that, on its way to the second one."""
    if len(path) < 2:
        return list(path)
    (x, y, _), (next_x, next_y, _) = path[:2]
    along, length = (next_x - x, next_y - y), math.hypot(next_x - x, next_y - y)
    share = ((pose.x - x) * along[0] + (pose.y - y) * along[1]) / max(length**2, 1e-12)
    off = math.hypot(pose.x - x - share * along[0], pose.y - y - share * along[1])
    return list(path[1:] if 0.0 <= share <= 1.0 and off <= TOLERANCE_M else path)


class PosesAhead:
    """The poses of a path that a base has not passed yet."""

    def __init__(self, start: Pose = _ORIGIN, path: Sequence[Pose] = ()) -> None:
        self._before, self.poses = start, list(path)

    def advance(self, pose: Pose) -> None:
        """Leave out the poses that a base has passed: it is nearer to the leg behind the pose than to the one before.

        The last pose stays.
        """
        while len(self.poses) > 1 and pose.to_leg_m(*self.poses[:2]) < pose.to_leg_m(self._before, self.poses[0]):
            self._before = self.poses.pop(0)

    def clear(self) -> None:
        """Leave out all: the base does not follow the path any more."""
        self.poses.clear()


class Tracker:
    """Follows a path from where the base is. ``speed`` is the share of its speed that the base uses at most."""

    def __init__(
        self,
        start: Pose,
        path: Sequence[Pose],
        limits: DriveLimits,
        speed: float = 1.0,
        reverse: bool = False,
    ) -> None:
        self._start = start
        self._moves = plan(start, path, limits, speed, reverse)
        self.duration_s = sum(each.duration_s for each in self._moves)
        self._done_s = 0.0

    @property
    def finished(self) -> bool:
        return not self._moves

    @property
    def share(self) -> float:
        """The share of the path that has been driven, by the time that it takes."""
        now = self._moves[0].share * self._moves[0].duration_s if self._moves else 0.0
        return 1.0 if self.finished or not self.duration_s else (self._done_s + now) / self.duration_s

    def join(self, velocity: Velocity) -> bool:
        """Go on from this velocity if it leads along the path; a base that moves otherwise must stop first."""
        first, *others = self._moves
        if isinstance(first, Turn):
            if first.left > _ALIGNED_RAD or not others:
                return False
            (first, *_) = self._moves = others
        assert isinstance(first, Stretch)
        direction = self._start.heading + math.atan2(velocity.lateral, velocity.linear)
        first.join(velocity)
        return first.speed > 0.0 and abs(math.remainder(direction - first.direction, math.tau)) <= _ALIGNED_RAD

    def wanted(self, pose: Pose, velocity: Velocity, now_s: float, share: float = 1.0) -> Velocity:
        """Return the velocity for the next tick.

        ``velocity`` is the one that the base was given last, ``share`` the share of its speed that it uses now.
        """
        while self._moves:
            wanted = self._moves[0].wanted(pose, now_s, share)
            if wanted != STANDING or velocity != STANDING:
                return wanted
            self._done_s += self._moves.pop(0).duration_s
        return STANDING


def plan(start: Pose, path: Sequence[Pose], limits: DriveLimits, speed: float, reverse: bool) -> list[Move]:
    """Return the turns and stretches from a pose along a path."""
    poses, moves = [start, *path], list[Move]()
    poses = [poses[index] for index in distinct([each[:2] for each in poses])]
    if limits.lateral:
        poses = _without(poses, [_HEADING_M_RAD * each for each in _unwrapped(poses)])
        headings = _unwrapped([*poses[:-1], path[-1]])
    else:
        poses, headings = _without(poses, None), []
    heading, used = start.heading, 0
    for pieces in stretches([each[:2] for each in poses]) if len(poses) > 1 else ():
        corners = len(pieces) // 2
        stretch = Stretch(pieces, limits, speed, headings[used : used + corners + 2], reverse)
        used += corners + 1
        if not limits.lateral:
            moves.append(Turn(heading, _faced(stretch.direction, reverse), limits, speed))
            heading = _faced(pieces[-1].direction, reverse)
        else:
            heading = headings[used]
        moves.append(stretch)
    return [*moves, Turn(heading, path[-1].heading, limits, speed)]


def _faced(direction: float, reverse: bool) -> float:
    return direction + math.pi if reverse else direction


def _without(poses: Sequence[Pose], off: Sequence[float] | None) -> list[Pose]:
    return [poses[index] for index in thinned([each[:2] for each in poses], off)]


def _unwrapped(poses: Sequence[Pose]) -> list[float]:
    """Return the headings without jumps at half a turn."""
    return list(
        accumulate((each.heading for each in poses), lambda last, new: last + math.remainder(new - last, math.tau))
    )


def approach(left: float, braking: float, slowest: float) -> float:
    """Return the speed at which a base still comes to rest within what is left, without passing it."""
    return max(min(math.sqrt(2.0 * braking * left), left / _APPROACH_S), slowest)


def trapezoid_s(length: float, most: float, acceleration: float, first: float = 0.0, last: float = 0.0) -> float:
    """Return how long a way takes that begins and ends with these speeds."""
    top = min(most, math.sqrt((first**2 + last**2) / 2.0 + acceleration * length))
    cruise = length - (2.0 * top**2 - first**2 - last**2) / (2.0 * acceleration)
    return (2.0 * top - first - last) / acceleration + (max(cruise, 0.0) / top if top else 0.0)
