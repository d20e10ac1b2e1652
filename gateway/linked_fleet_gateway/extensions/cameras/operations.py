"""Operations on cameras, for who describes the gateway as a whole."""

from linked_fleet_gateway.fleet.cameras import cameras_of, types_of
from linked_fleet_gateway.http.operations import described, names, reading, segment
from linked_fleet_gateway.resources.branches import RequestView
from linked_fleet_gateway.resources.json_form import Json
from linked_fleet_gateway.resources.paths import camera_path, robot_path


def operations(view: RequestView) -> dict[str, Json]:
    """The cameras of a robot, and what one of them sees."""
    found = [(each, camera) for each in view.robots.values() for camera in cameras_of(each).values()]
    if not found:
        return {}
    of = {"robot": names(segment(robot_path(each.name)) for each, _ in found)}
    one = of | {"camera": names(segment(camera_path(each.name, camera.name)) for each, camera in found)}
    get = reading("readCamera", "A camera: what it is, or what it sees")
    get["responses"]["200"]["content"] |= {media_type: {} for _, camera in found for media_type in types_of(camera)}
    return {
        **described("/{robot}/cameras", of, "Cameras", "Cameras of a robot"),
        **described("/{robot}/cameras/{camera}", one, "Camera", "A camera", get),
    }
