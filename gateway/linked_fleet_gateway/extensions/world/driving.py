"""Robots that drive: how fast, and where their bases will be."""

import math
import time
from collections.abc import Callable, Iterator, Sequence
from itertools import pairwise

from msgspec.structs import replace

from linked_fleet_agent import planar
from linked_fleet_agent.planar import STANDING, Velocity
from linked_fleet_gateway.extensions.world.messages import Positions
from linked_fleet_gateway.extensions.world.other_motions import thinned
from linked_fleet_gateway.extensions.world.plane import positions_of
from linked_fleet_gateway.faces import path_ahead
from linked_fleet_state.driving import REACTION_S, Drive, FollowedPath, placed, relative
from linked_fleet_state.kinematics import base_pose
from linked_fleet_state.model import Pose
from linked_fleet_state.robot import Robot
from linked_fleet_state.xml import rotation

COAST_S = 1.0
"""A base that moves, and of which this gateway knows no drive, may go on like this for so long."""
_UPRIGHT = 1e-3
"""Least length of the x axis of a base seen from above at which it has a heading."""
_STILL_M_S, _STILL_RAD_S = 0.01, 0.02
_MARGIN_S = 0.5
_TOLD_S = 1.0
"""A robot tells of the path that it follows within this time."""
_NEAR_M = 0.1


def heading_of(pose: Pose) -> float | None:
    """Return the direction of the x axis seen from above (rad); None if that points up or down."""
    turned = rotation(pose.orientation_xyzw)
    x, y = turned[0][0], turned[1][0]
    return None if math.hypot(x, y) < _UPRIGHT else math.atan2(y, x)


def on_floor(pose: Pose | None) -> planar.Pose | None:
    """Return a pose seen from above; None if it is unknown or has no heading."""
    heading = None if pose is None else heading_of(pose)
    return None if pose is None or heading is None else planar.Pose(*pose.position_m[:2], heading)


def odometry_of(robot: Robot) -> planar.Pose | None:
    """Return where the base is in its odometry frame; None if that is unknown."""
    return on_floor(base_pose(None if robot.frame is None else robot.frame.base))


def velocity_of(robot: Robot) -> Velocity:
    """Return the measured velocity in the frame of the base; of an unknown one, standing."""
    base, pose = None if robot.frame is None else robot.frame.base, odometry_of(robot)
    if base is None or pose is None or not all(map(math.isfinite, (*base.linear_m_s, *base.angular_rad_s))):
        return STANDING
    return Velocity(base.linear_m_s[0], base.linear_m_s[1], base.angular_rad_s[2]).turned(-pose.heading)


def valid_until_ns(robot: Robot) -> int:
    """Return until when a way that is found free now may be begun, by the robot's clock."""
    assert robot.frame is not None
    return robot.frame.monotonic_ns + round(REACTION_S * 1e9)


def poses_along(stands: planar.Pose, here: planar.Pose, path: FollowedPath) -> list[planar.Pose]:
    """Return the poses in the world of a path, from where a base stands, which is ``here`` by its odometry."""
    return [stands, *(placed(relative(each, here), stands) for each in path.poses)]


def apart_m(one: Sequence[planar.Pose], other: Sequence[planar.Pose]) -> float:
    """Return how far two ways of at least two poses each are apart: 0 if they cross."""
    return min(_legs_apart_m(mine, yours) for mine in pairwise(one) for yours in pairwise(other))


def _legs_apart_m(one: Sequence[planar.Pose], other: Sequence[planar.Pose]) -> float:
    if _parts(one, other) and _parts(other, one):
        return 0.0
    ends = [(at, other) for at in one] + [(at, one) for at in other]
    return min(at.to_leg_m(*leg) for at, leg in ends)


def _parts(one: Sequence[planar.Pose], other: Sequence[planar.Pose]) -> bool:
    """Return True if the ends of the other leg are on two sides of the line along this one."""
    (start, end), sides = one, []
    for at in other:
        sides.append((end.x - start.x) * (at.y - start.y) - (end.y - start.y) * (at.x - start.x))
    return sides[0] * sides[1] < 0.0


def _facing(path: FollowedPath, here: planar.Pose | None) -> FollowedPath:
    """Return the path as driven backwards if the base looks away from its first pose."""
    if here is None or path.lateral:
        return path
    x, y = path.poses[0].x - here.x, path.poses[0].y - here.y
    ahead = x * math.cos(here.heading) + y * math.sin(here.heading)
    return replace(path, reverse=ahead < 0.0 and math.hypot(x, y) > _NEAR_M)


class Driving:
    """The drives and paths that this gateway has let begin, and the paths that robots tell of."""

    def __init__(self, now_s: Callable[[], float] = time.monotonic) -> None:
        self._now_s = now_s
        self._begun = dict[str, tuple[Drive, float]]()
        self._followed = dict[str, tuple[FollowedPath, float]]()

    def begin(self, robot: Robot, drive: Drive) -> None:
        lasts_s = drive.duration_s + drive.limits.braking_s(drive.velocity) + _MARGIN_S
        self._begun[robot.name] = drive, self._now_s() + lasts_s

    def wanted(self, robot: Robot) -> Velocity | None:
        """Return the velocity that the latest of these drives wants; None if there is none now."""
        drive = self._latest(robot)
        return None if drive is None else drive.velocity

    def _latest(self, robot: Robot) -> Drive | None:
        drive, until_s = self._begun.get(robot.name, (None, 0.0))
        return drive if self._now_s() < until_s else None

    def along(self, robot: Robot) -> Iterator[Positions]:
        """Yield where the base may be on the arc of a drive, as positions of the joints that carry it."""
        if (drive := self._latest(robot)) is not None:
            yield from map(positions_of, thinned(drive.until_standing(velocity_of(robot))))

    def follow(self, robot: Robot, path: FollowedPath) -> None:
        """Keep a path that was let begin until the robot tells of it."""
        self._followed[robot.name] = path, self._now_s() + _TOLD_S

    def forget(self, robot: Robot) -> None:
        """Forget a path that was refused."""
        self._followed.pop(robot.name, None)

    def path_of(self, robot: Robot) -> FollowedPath | None:
        """Return the path that the base follows or is about to follow, from where it is; None if there is none."""
        path, until_s = self._followed.get(robot.name, (None, 0.0))
        if (told := path_ahead(robot)) is not None:
            return _facing(told, odometry_of(robot))
        return None if path is None or self._now_s() >= until_s else path

    def way(self, robot: Robot) -> tuple[planar.Pose, ...]:
        """Return the poses on the way along that path, in the frame of the base now; nothing without a path."""
        here, path = odometry_of(robot), self.path_of(robot)
        return () if here is None or path is None else path.ways(here)[0]

    def ends(self, robot: Robot) -> Positions:
        """Return where the base may be when it stands, as positions of the joints that carry it; nothing if it stands.

        Drives that another gateway has let begin are seen once the base moves.
        """
        return {} if (end := self.end(robot)) is None else positions_of(end)

    def end(self, robot: Robot) -> planar.Pose | None:
        """Return that place in the frame of the base now; None if it stands."""
        if not robot.floats:
            return None
        now = velocity_of(robot)
        if (drive := self._latest(robot)) is not None:
            return drive.until_standing(now)[-1]
        self._begun.pop(robot.name, None)
        linear, lateral, angular = now
        if math.hypot(linear, lateral) < _STILL_M_S and abs(angular) < _STILL_RAD_S:
            return None
        there = planar.Pose().moved(linear * COAST_S, angular * COAST_S, lateral * COAST_S)
        return there._replace(heading=angular * COAST_S)
