"""Reads what the world knows of the floor around a base, for planning. Metre, radian."""

from linked_fleet_agent import planar
from linked_fleet_gateway.api import Conflict, Robot, robot_path
from linked_fleet_gateway.extensions.navigation.messages import FloorCells, Obstacle
from linked_fleet_gateway.extensions.navigation.trips import Around
from linked_fleet_gateway.extensions.world.descriptions import object_path
from linked_fleet_gateway.extensions.world.driving import odometry_of, on_floor
from linked_fleet_gateway.extensions.world.placement import pose_in_world
from linked_fleet_gateway.extensions.world.service import World
from linked_fleet_gateway.faces import View
from linked_fleet_state.driving import placed, relative


def standing(robot: Robot) -> planar.Pose:
    """Return where a base stands in the world. Raises Conflict if that is unknown."""
    pose = on_floor(None if robot.model is None else pose_in_world(robot, robot.model.root))
    if pose is None:
        raise Conflict(
            f"Where {robot.name} stands in the world is unknown: PUT the placement of its odometry frame at "
            f"{robot_path(robot.name)}placement."
        )
    return pose


def to_odometry(robot: Robot, poses: tuple[planar.Pose, ...]) -> list[planar.Pose]:
    """Return poses of the world in the odometry frame of a robot. Raises Conflict."""
    world, own = standing(robot), odometry_of(robot)
    if own is None:
        raise Conflict(f"Where {robot.name} is in its odometry frame is unknown.")
    return [placed(relative(each, world), own) for each in poses]


async def around(world: World, robot: Robot, sees: View, lateral: bool) -> Around:
    """Return what is around a base. A robot that the caller may not know has no name.

    Raises Conflict, Unchecked, Busy.
    """
    pose, found = standing(robot), await world.survey(robot, sees)
    obstacles = []
    for each in found.things:
        name = object_path(each.name) if each.kind == "object" else each.name
        obstacles.append(Obstacle(name, each.covers))
        if each.way:
            obstacles.append(Obstacle(name, each.way, passes=True))
    floor = world.floor
    cells = None if floor is None else FloorCells(floor.boxes, floor.settings.resolution, floor.settings.origin)
    return Around(planar.Pose(*(round(each, 3) for each in pose)), found.outline, tuple(obstacles), cells, lateral)
