"""Operations of the notes of robots in OpenAPI. The container of all notes has its own."""

from linked_fleet_gateway.api import RequestView, robot_path
from linked_fleet_gateway.extensions.openapi.api import Json, resource_path_items, segment_schema


def operations(view: RequestView) -> dict[str, Json]:
    """Return the path items of the notes about a robot."""
    if not view.robots:
        return {}
    of = {"robot": segment_schema(map(robot_path, view.robots))}
    return resource_path_items("/{robot}/notes", of, "RobotNotes", "Notes about a robot, its parts and its faults")
