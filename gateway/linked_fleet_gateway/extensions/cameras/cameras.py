"""The cameras that a robot says it has, their paths, and the pictures that they give. Pure."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache

from linked_fleet_agent.wire.codec import HEADER, PictureHeader, WireError, decode_picture
from linked_fleet_agent.wire.keys import MAX_NAME_BYTES, escape
from linked_fleet_agent.wire.messages import MAX_PIXELS, Camera, PictureFormat
from linked_fleet_gateway.api import robot_of, robot_path
from linked_fleet_state.robot import Robot

FRAME_MEDIA_TYPE = "application/vnd.linked-fleet.frame"
_FARTHEST_M, _AROUND_BYTES = 1e6, 4096
FORMATS: Mapping[str, PictureFormat] = {
    "image/jpeg": "jpeg",
    "image/png": "png",
    FRAME_MEDIA_TYPE: "depth",
    "application/octet-stream": "depth",
}
"""Formats by media type; other formats are ignored."""


@dataclass(frozen=True)
class Picture:
    """A camera picture of one state frame; ``content`` is an image file or, for depth, the frame with its header."""

    moment: PictureHeader
    content: bytes


def cameras_of(robot: Robot) -> dict[str, Camera]:
    """Return cameras by name, without invalid ones, those on unknown links, and repeated names."""
    said = robot.description.cameras if robot.description is not None else ()
    found: dict[str, Camera] = {}
    for camera in said:
        if robot.model is not None and camera.link in robot.model.links and _sound(camera):
            found.setdefault(camera.name, camera)
    return found


def types_of(camera: Camera) -> tuple[str, ...]:
    """Return the available media types of a camera's pictures."""
    return () if camera.unavailable else tuple(each for each, format in FORMATS.items() if format in camera.formats)


def size_limit(camera: Camera) -> int:
    """Return the largest reply in bytes: four bytes per pixel, which also bounds image files, plus headers."""
    return HEADER.size + 4 * camera.width * camera.height + _AROUND_BYTES


def read_picture(
    answer: bytes | str, camera: Camera, format: PictureFormat, incarnation: int | None
) -> tuple[Picture | None, str]:
    """Check the reply of an agent. Return the picture, or None and a sentence about the error."""
    if isinstance(answer, str):
        return None, answer
    try:
        moment, content = decode_picture(answer, format)
    except WireError as error:
        return None, str(error)
    if moment.incarnation != incarnation:
        return None, f"the picture is of run {moment.incarnation}, but {incarnation} is present"
    if len(answer) > size_limit(camera):
        return None, f"the picture has {len(answer)} bytes; {size_limit(camera)} is the maximum for {camera.name!r}"
    said = (camera.height, camera.width, camera.near_m, camera.far_m)
    if (moment.rows, moment.columns, moment.near_m, moment.far_m) != said:
        return None, f"the picture is of another camera than {camera.name!r}: its size or its range differs"
    return Picture(moment, answer if format == "depth" else content), ""


def _sound(camera: Camera) -> bool:
    """Return True if the values are consistent and within the limits of the resource tree."""
    values = (*camera.position_m, *camera.orientation_xyzw)
    return (
        len(camera.name.encode()) <= MAX_NAME_BYTES
        and all(abs(value) <= _FARTHEST_M for value in values)
        and abs(math.hypot(*camera.orientation_xyzw) - 1) < 1e-3
        and camera.width * camera.height <= MAX_PIXELS
        and camera.near_m < camera.far_m
    )


SEGMENT = "cameras"
_RESERVED = frozenset({"blueprint"})
_segment = lru_cache(maxsize=4096)(escape)


def cameras_path(robot: str) -> str:
    return robot_path(robot) + SEGMENT


def camera_path(robot: str, camera: str) -> str:
    return f"{cameras_path(robot)}/{_segment(camera, _RESERVED)}"


def is_in_cameras(path: str) -> bool:
    """Return True if ``path`` has the form of the path of a camera, or of a resource below one."""
    return robot_of(path) is not None and path.split("/")[2:3] == [SEGMENT]
