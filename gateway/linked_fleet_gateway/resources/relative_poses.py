"""Poses of robots, links and other things relative to each other. Pure; metre.

Robots have a common frame if an extension places them in one.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from linked_fleet_base.contributions import present
from linked_fleet_gateway.resources.joint_kinds import POSE_RESOLUTION
from linked_fleet_gateway.resources.paths import thing_at
from linked_fleet_state.carried import CarriedPose
from linked_fleet_state.kinematics import ORIGIN, compose, inverse
from linked_fleet_state.model import Joint, Pose
from linked_fleet_state.robot import Robot

_DECIMALS = round(-math.log10(POSE_RESOLUTION))


def _placements() -> Sequence[Callable[[Robot], Pose | None]]:
    """Return the functions of extensions from a robot to the pose of its own frame in the common one."""
    return present().placements


@dataclass(frozen=True)
class RelativePose:
    """A relative pose, None if unknown.

    ``involves_robot`` says that a robot is involved, whose frame is of ``wall_ns``.
    """

    pose: Pose | None
    involves_robot: bool
    wall_ns: int | None


@dataclass(frozen=True)
class _Place:
    """A thing with a frame: its pose in the frame of its robot, or in the common frame if it has none.

    ``link`` is the link of the robot, empty for other things, and ``on_link`` the pose in the frame of that.
    """

    robot: Robot | None
    pose: Pose | None
    link: str = ""
    on_link: Pose = ORIGIN

    @property
    def in_common(self) -> Pose | None:
        if self.robot is None or self.pose is None:
            return self.pose
        found = (each(self.robot) for each in _placements())
        placement = next((each for each in found if each is not None), None)
        return None if placement is None else compose(placement, self.pose)


def relative_pose(
    thing: str, frame: str, robots: Mapping[str, Robot], common_poses: Mapping[str, Pose | CarriedPose]
) -> RelativePose:
    """Return the pose of ``thing`` in ``frame``, paths of a robot, a link or a thing in ``common_poses``.

    ``common_poses``: poses of other things in the common frame, or on links, by path. Parts of one robot, and what its
    links carry, need no placement. The time is that of the older frame. Raises LookupError naming an unknown path.
    """
    what, where = _place(thing, robots, common_poses), _place(frame, robots, common_poses)
    frames = [each.robot.frame for each in (what, where) if each.robot is not None]
    times = [None if each is None else each.wall_ns for each in frames]
    wall_ns = min((each for each in times if each is not None), default=None) if None not in times else None
    pose = _between(what, where)
    return RelativePose(None if pose is None else _rounded(pose), bool(times), wall_ns)


def _between(what: _Place, where: _Place) -> Pose | None:
    robot, other = what.robot, where.robot
    if robot is not None and robot is other:
        between = robot.pose_between(where.link, what.link)
        return None if between is None else compose(inverse(where.on_link), compose(between, what.on_link))
    pose, frame = what.in_common, where.in_common
    return None if pose is None or frame is None else compose(inverse(frame), pose)


def _place(path: str, robots: Mapping[str, Robot], common: Mapping[str, Pose | CarriedPose]) -> _Place:
    if (found := common.get(path)) is not None:
        return _Place(None, found) if isinstance(found, Pose) else _carried(found, robots)
    robot, part = thing_at(path, robots) or thing_at(path + "/", robots) or (None, None)
    if robot is None or robot.model is None or isinstance(part, Joint):
        raise LookupError(path)
    link = robot.model.root if part is None else part.name
    return _Place(robot, robot.link_pose(link), link)


def _carried(on: CarriedPose, robots: Mapping[str, Robot]) -> _Place:
    robot = robots.get(on.robot)
    if robot is None or robot.model is None or on.link not in robot.model.links:
        return _Place(None, None)
    link = robot.link_pose(on.link)
    return _Place(robot, None if link is None else compose(link, on.pose), on.link, on.pose)


def _rounded(pose: Pose) -> Pose:
    """Round to the resolution of link poses; smaller changes are noise and would change the ETag."""
    x, y, z = map(round_to_resolution, pose.position_m)
    a, b, c, w = map(round_to_resolution, pose.orientation_xyzw)
    return Pose((x, y, z), (a, b, c, w))


def round_to_resolution(value: float) -> float:
    """Round a number of a pose to the resolution of poses."""
    return round(value, _DECIMALS)
