"""Operations on cameras, for descriptions of the whole gateway."""

from linked_fleet_gateway.extensions.cameras.cameras import camera_path, cameras_of, types_of
from linked_fleet_gateway.http.operations import described, names, reading, segment
from linked_fleet_gateway.resources.branches import RequestView
from linked_fleet_gateway.resources.json_form import Json
from linked_fleet_gateway.resources.paths import robot_path


def operations(view: RequestView) -> dict[str, Json]:
    """Return the path items of a robot's cameras and their pictures."""
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
