"""Objects in the world other than robots: obstacles and keep-out zones, as typed values. Metre; pure."""

import math
import struct
from collections.abc import Callable, Sequence
from typing import Annotated, Literal

import msgspec
from msgspec import Meta, Struct

from linked_fleet_state.model import Pose

MAX_TRIANGLES = 10_000
MAX_OBJECTS = 256
FARTHEST_M = 1_000.0
"""Limit of coordinates, and of the extent of an object."""

Metres = Annotated[float, Meta(gt=0, le=FARTHEST_M)]


class Box(Struct, frozen=True, tag="box"):
    """A box with edges along x, y and z, about its centre."""

    size_m: tuple[Metres, Metres, Metres]


class Sphere(Struct, frozen=True, tag="sphere"):
    radius_m: Metres


class Cylinder(Struct, frozen=True, tag="cylinder"):
    """A cylinder along z, about its centre."""

    radius_m: Metres
    length_m: Metres


class TriangleMesh(Struct, frozen=True, tag="mesh"):
    """A binary STL in metre, as accepted by ``read_stl``."""

    stl: bytes


Geometry = Box | Sphere | Cylinder | TriangleMesh
Kind = Literal["obstacle", "zone"]


class Held(Struct, frozen=True, omit_defaults=True):
    """The link of a robot that holds an object, and the ``pose`` of the object in the frame of that link.

    ``gripper`` is the segment of the component whose grasp holds it ``since_ns`` (wall time of the agent); empty if a
    client has stated that it is held.
    """

    robot: str
    link: str
    pose: Pose
    gripper: str = ""
    since_ns: int = 0


class SceneObject(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """An object with its ``pose`` in the world. A ``zone`` is empty space that robots must not enter.

    One that is ``held`` moves with its link; its ``pose`` is then the last one on its own. Who holds it was decided at
    ``decided_ns``: by an action of a gripper that was created then, or by a client.
    """

    title: Annotated[str, Meta(min_length=1, max_length=256)]
    kind: Kind
    pose: Pose
    geometry: Geometry
    held: Held | None = None
    decided_ns: int = 0


Unreadable = Callable[[], Sequence[str]]
"""Returns the paths of what is there, and whose record cannot be read."""


def encode(thing: SceneObject) -> bytes:
    return msgspec.json.encode(thing)


def decode(body: bytes) -> SceneObject:
    """Decode an object. Raises ValueError if another version wrote it in an unreadable form."""
    return msgspec.json.decode(body, type=SceneObject)


def read_stl(content: bytes) -> TriangleMesh:
    """Check a binary STL of 1 to ``MAX_TRIANGLES`` triangles within ``FARTHEST_M``.

    Raises ValueError with a sentence.
    """
    count = struct.unpack_from("<I", content, 80)[0] if len(content) >= 84 else 0
    if len(content) != 84 + 50 * count or count == 0:
        raise ValueError("it is not a binary STL: 80 bytes, the number of triangles, and 50 bytes for each")
    if count > MAX_TRIANGLES:
        raise ValueError(f"it has {count} triangles; {MAX_TRIANGLES} is the maximum")
    # Each triangle has a normal, which is ignored, three corners, and two bytes of attributes.
    for corners in struct.iter_unpack("<12x9f2x", memoryview(content)[84:]):
        if not (max(corners) <= FARTHEST_M and min(corners) >= -FARTHEST_M and math.isfinite(sum(corners))):
            raise ValueError(f"a corner is not within {FARTHEST_M:g} m of its origin")
    return TriangleMesh(content)
