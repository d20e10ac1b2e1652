"""Operations of cameras in OpenAPI."""

from linked_fleet_agent.wire.messages import Camera
from linked_fleet_gateway.api import RequestView, robot_path
from linked_fleet_gateway.extensions.cameras.cameras import camera_path, cameras_of, types_of
from linked_fleet_gateway.extensions.cameras.resources import PATH
from linked_fleet_gateway.extensions.openapi.api import (
    Json,
    rdf_get_operation,
    resource_path_items,
    segment_schema,
)
from linked_fleet_state.robot import Robot


def operations(view: RequestView) -> dict[str, Json]:
    """Return the path items of the list of all cameras, of a robot's cameras and of their pictures."""
    found = list[tuple[Robot, Camera]]()
    wall = resource_path_items(PATH, {}, "AllCameras", "The cameras of all robots")
    for robot in view.robots.values():
        with view.faults.guard("OpenAPI", robot.name, "its cameras"):
            found += [(robot, camera) for camera in cameras_of(robot).values()]
    if not found:
        return wall
    of = {"robot": segment_schema(robot_path(each.name) for each, _ in found)}
    one = of | {"camera": segment_schema(camera_path(each.name, camera.name) for each, camera in found)}
    get = rdf_get_operation("readCamera", "A camera: its description, or its picture")
    get["responses"]["200"]["content"] |= {media_type: {} for _, camera in found for media_type in types_of(camera)}
    return {
        **wall,
        **resource_path_items("/{robot}/cameras", of, "Cameras", "Cameras of a robot"),
        **resource_path_items("/{robot}/cameras/{camera}", one, "Camera", "A camera", get),
    }
