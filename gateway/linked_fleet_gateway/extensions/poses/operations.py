"""Operations of poses in OpenAPI."""

from dataclasses import replace

from linked_fleet_gateway.api import RequestView, robot_path
from linked_fleet_gateway.extensions.openapi.api import Json, container_operations, segment_schema
from linked_fleet_gateway.extensions.poses.saved import PosesOfRobot, container_of
from linked_fleet_gateway.faces import commandable_joints


def operations(view: RequestView) -> dict[str, Json]:
    """Return the path items of the containers of poses, and of poses."""
    robots = [each for each in view.robots.values() if commandable_joints(each)]
    if not robots:
        return {}
    of = {"robot": segment_schema(robot_path(each.name) for each in robots)}
    any_of_them = container_of(robots[0], PosesOfRobot(None, robots[0], {}))
    return container_operations(replace(any_of_them, title="Poses of a robot"), "/{robot}/poses", of)
