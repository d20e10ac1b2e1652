"""Paths of cameras."""

from functools import lru_cache

from linked_fleet_agent.wire.names import escape
from linked_fleet_gateway.resources.paths import robot_of, robot_path

SEGMENT = "cameras"
_RESERVED = frozenset({"blueprint"})
_segment = lru_cache(maxsize=4096)(escape)


def cameras_path(robot: str) -> str:
    return robot_path(robot) + SEGMENT


def camera_path(robot: str, camera: str) -> str:
    return f"{cameras_path(robot)}/{_segment(camera, _RESERVED)}"


def is_in_cameras(path: str) -> bool:
    """Return True if the resource at ``path`` is a camera, if it is any, or below one."""
    return robot_of(path) is not None and path.split("/")[2:3] == [SEGMENT]
