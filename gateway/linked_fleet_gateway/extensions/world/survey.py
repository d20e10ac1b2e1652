"""Obstacles on the floor around a robot, seen from above, as far as the robot could meet it. Metre, radian.

Runs in the check process.
"""

from collections.abc import Iterator, Mapping

import coal
import numpy as np

from linked_fleet_gateway.extensions.world.corners import RING, corners_of
from linked_fleet_gateway.extensions.world.held_bodies import with_held
from linked_fleet_gateway.extensions.world.messages import Placement, Plan, Seen, Survey, Surveyed
from linked_fleet_gateway.extensions.world.outline import Outline, hull_of, outline, plans_along
from linked_fleet_gateway.extensions.world.path import UnknownPosition
from linked_fleet_gateway.extensions.world.robot import Robot
from linked_fleet_gateway.extensions.world.surfaces import Array
from linked_fleet_gateway.extensions.world.surroundings import MARGIN_M, MovingRobot, se3

_GROUND_M = 0.02
"""Whatever is no higher than this above the lowest point of the robot is floor."""


def survey(asked: Survey, robots: Mapping[str, Robot], objects: Mapping[str, coal.CollisionGeometry]) -> Surveyed:
    """Return the outline of the robot, and those of everything around it. Raises UnknownPosition."""
    around, robots = with_held(asked.around, robots, objects)
    if missing := [each.key for each in (around.robot, *around.robots) if each.key not in robots]:
        raise UnknownPosition(f"{missing[0]} has to be prepared again")
    me = MovingRobot(robots[around.robot.key], asked.start)
    mine = outline(me.placed_bodies())
    if mine is None:
        raise UnknownPosition("it has no shapes")
    z = around.robot.base.position_m[2]
    heights = (mine.low + z + _GROUND_M, mine.high + z + MARGIN_M)
    seen = [
        *(_object(each, objects[each.key], heights) for each in around.objects if each.key in objects),
        *(_robot(each, robots[each.key], heights) for each in around.robots),
    ]
    return Surveyed(_plan(mine.corners), tuple(each for each in seen if each is not None))


def _object(placed: Placement, shape: coal.CollisionGeometry, heights: tuple[float, float]) -> Seen | None:
    at = se3(placed.base)
    points = corners_of(shape) @ at.rotation.T + at.translation
    radius = shape.radius if isinstance(shape, coal.Sphere | coal.Capsule) else 0.0
    if points[:, 2].min() - radius > heights[1] or points[:, 2].max() + radius < heights[0]:
        return None
    return Seen("object", placed.name, (_plan(_rounded(points[:, :2], radius)),))


def _robot(placed: Placement, robot: Robot, heights: tuple[float, float]) -> Seen | None:
    stood, base = MovingRobot(robot, placed.configurations[0]), se3(placed.base)
    shapes = []
    for positions in placed.configurations[:: max(len(placed.configurations) - 1, 1)]:
        stood.set_positions(positions)
        shapes += list(_bodies(stood, placed, heights))
    if not shapes:
        return None
    whole = Outline(hull_of(np.concatenate([each.corners for each in shapes])), 0.0, 0.0)
    standing, way = (each.corners for each in shapes), plans_along(whole, placed.way)
    covers, ways = (
        tuple(_plan(each @ base.rotation[:2, :2].T + base.translation[:2]) for each in plans)
        for plans in (standing, way)
    )
    return Seen("robot", placed.name, covers, ways)


def _bodies(stood: MovingRobot, placed: Placement, heights: tuple[float, float]) -> Iterator[Outline]:
    """Yield the outlines of the bodies that reach these heights, in the frame of the robot."""
    z = placed.base.position_m[2]
    for each in stood.placed_bodies():
        found = outline([each])
        if found is not None and found.low + z <= heights[1] and found.high + z >= heights[0]:
            yield found


def _rounded(points: Array, radius: float) -> Array:
    if not radius:
        return hull_of(points)
    return hull_of((points[:, None, :] + radius * RING[:, :2]).reshape(-1, 2))


def _plan(corners: Array) -> Plan:
    return tuple((round(x, 4), round(y, 4)) for x, y in corners.tolist())
