"""Poses of things in the world relative to each other. Pure; metre."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

from linked_fleet_gateway.fleet.kinematics import ORIGIN, compose, inverse
from linked_fleet_gateway.fleet.model import Pose
from linked_fleet_gateway.fleet.robot import Robot
from linked_fleet_gateway.resources.joint_kinds import POSE_RESOLUTION
from linked_fleet_gateway.resources.paths import part_of, robot_name
from linked_fleet_gateway.resources.placement import WORLD, placement_of

_DECIMALS = round(-math.log10(POSE_RESOLUTION))


class FramedThing(Protocol):
    """An object with a pose in the world."""

    @property
    def pose(self) -> Pose: ...


@dataclass(frozen=True)
class Posed:
    """A relative pose, None if unknown. ``moves`` says that a robot is involved, whose frame is of ``wall_ns``."""

    pose: Pose | None
    moves: bool
    wall_ns: int | None


@dataclass(frozen=True)
class _Place:
    """A thing with a frame: its pose in the frame of its robot, or in the world if it has none."""

    robot: Robot | None
    pose: Pose | None

    @property
    def in_world(self) -> Pose | None:
        if self.robot is None or self.pose is None:
            return self.pose
        placement = placement_of(self.robot)
        return None if placement is None else compose(placement, self.pose)


def seen_from(of: str, frame: str, robots: Mapping[str, Robot], objects: Mapping[str, FramedThing]) -> Posed:
    """Return the pose of ``of`` in ``frame``, paths of the world, a robot, a link or an object.

    Parts of one robot need no placement. The time is that of the older frame. Raises LookupError naming an unknown
    path.
    """
    what, where = _place(of, robots, objects), _place(frame, robots, objects)
    same = what.robot is not None and what.robot is where.robot
    poses = (what.pose, where.pose) if same else (what.in_world, where.in_world)
    frames = [each.robot.frame for each in (what, where) if each.robot is not None]
    times = [None if each is None else each.wall_ns for each in frames]
    wall_ns = min((each for each in times if each is not None), default=None) if None not in times else None
    if poses[0] is None or poses[1] is None:
        return Posed(None, bool(times), wall_ns)
    return Posed(_rounded(compose(inverse(poses[1]), poses[0])), bool(times), wall_ns)


def _place(path: str, robots: Mapping[str, Robot], objects: Mapping[str, FramedThing]) -> _Place:
    if path == WORLD:
        return _Place(None, ORIGIN)
    if path.startswith(f"{WORLD}/objects/"):
        return _Place(None, objects[path.removeprefix(f"{WORLD}/objects/")].pose)
    head, _, part = path[1:].partition("/")
    try:
        robot = robots[robot_name(head)]
        if robot.model is None:
            raise LookupError(path)
        link = part_of(part, robot.model)[1] if part else robot.model.root
    except ValueError as error:
        raise LookupError(path) from error
    if link is None:
        raise LookupError(path)
    return _Place(robot, robot.link_pose(link))


def _rounded(pose: Pose) -> Pose:
    """Round to the resolution of link poses; smaller changes are noise and would change the ETag."""
    x, y, z = map(rounded, pose.position_m)
    a, b, c, w = map(rounded, pose.orientation_xyzw)
    return Pose((x, y, z), (a, b, c, w))


def rounded(value: float) -> float:
    return round(value, _DECIMALS)
