"""An arm of three joints that turns in a plane, and questions about its motions."""

import math
from collections.abc import Mapping

from linked_fleet_gateway.extensions.planning.messages import FindPath, FindStraight, JointBounds
from linked_fleet_gateway.extensions.world.messages import Check, MotionPath, PathSegment, Placement
from linked_fleet_gateway.extensions.world.robot import Robot
from linked_fleet_gateway.extensions.world.scene import Box, Geometry
from linked_fleet_gateway.extensions.world.shapes import build_object_shape, build_robot
from linked_fleet_state.model import Pose

JOINTS = ("shoulder", "elbow", "wrist")
LENGTH_M = 0.4
SPEED, ACCELERATION = 1.5, 3.75
BOUNDS = {name: JointBounds(-3.0, 3.0, SPEED, ACCELERATION) for name in JOINTS}
UPRIGHT = (0.0, 0.0, 0.0, 1.0)
CORNER = math.pi / 2


def _link(name: str) -> str:
    shape = f'<origin xyz="{LENGTH_M / 2} 0 0"/><geometry><box size="{LENGTH_M - 0.06} .04 .04"/></geometry>'
    return f'<link name="{name}"><collision>{shape}</collision></link>'


def _joint(name: str, parent: str, child: str, x: float) -> str:
    return (
        f'<joint name="{name}" type="revolute"><parent link="{parent}"/><child link="{child}"/><origin xyz="{x} 0 0"/>'
        '<axis xyz="0 0 1"/><limit lower="-3" upper="3" velocity="2" effort="1"/></joint>'
    )


def arm() -> Robot:
    joints = [
        ("shoulder", "base", "upper", 0.0),
        ("elbow", "upper", "lower", LENGTH_M),
        ("wrist", "lower", "hand", LENGTH_M),
    ]
    parts = ['<link name="base"/>', *map(_link, ("upper", "lower", "hand")), *(_joint(*each) for each in joints)]
    tip = '<link name="tip"/><joint name="end" type="fixed"><parent link="hand"/><child link="tip"/>'
    return build_robot(f"<robot name='r'>{''.join(parts)}{tip}<origin xyz=\"{LENGTH_M} 0 0\"/></joint></robot>")


ARM = arm()
ROBOTS = {"arm": ARM}
STRETCHED = dict.fromkeys(JOINTS, 0.0)
"""Along x, 1.2 m from the root."""


class Room:
    """Objects by their names, and questions about motions among them."""

    def __init__(self, **objects: tuple[Geometry, tuple[float, float, float]]) -> None:
        self.shapes = {name: build_object_shape(shape) for name, (shape, _) in objects.items()}
        self.places = tuple(Placement(name, name, Pose(at, UPRIGHT)) for name, (_, at) in objects.items())

    def around(self, start: Mapping[str, float], end: Mapping[str, float]) -> Check:
        path = MotionPath(dict(start), (PathSegment(dict(end)),))
        return Check(Placement("arm", "arm", Pose((0.0, 0.0, 0.0), UPRIGHT)), (path,), (), self.places, 10.0)

    def path(self, start: Mapping[str, float], *goals: Mapping[str, float], within_s: float = 10.0) -> FindPath:
        return FindPath(self.around(start, goals[0]), BOUNDS, tuple(map(dict, goals)), within_s)

    def line(self, start: Mapping[str, float], goal: Mapping[str, float], exact: bool = True) -> FindStraight:
        return FindStraight(self.around(start, goal), BOUNDS, "tip", dict(goal), True, exact)


def joints(shoulder: float, elbow: float, wrist: float) -> dict[str, float]:
    return dict(zip(JOINTS, (shoulder, elbow, wrist), strict=True))


def wall(x: float, y: float, along_x: float = 0.1, along_y: float = 0.1) -> tuple[Geometry, tuple[float, float, float]]:
    return Box((along_x, along_y, 0.5)), (x, y, 0.0)
