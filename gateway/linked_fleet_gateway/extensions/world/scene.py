"""Objects in the world besides robots: obstacles and keep-out zones, as typed values. Metre; pure."""

import math
import struct
from typing import Annotated, Literal

import msgspec
from msgspec import Meta, Struct

from linked_fleet_gateway.fleet.model import Pose

MAX_TRIANGLES = 10_000
MAX_OBJECTS = 256
FARTHEST_M = 1_000.0
"""From the origin of the world, in each direction; also the largest extent of an object."""

Metres = Annotated[float, Meta(gt=0, le=FARTHEST_M)]


class Box(Struct, frozen=True, tag="box"):
    """Edges along x, y and z, about its centre."""

    size_m: tuple[Metres, Metres, Metres]


class Sphere(Struct, frozen=True, tag="sphere"):
    radius_m: Metres


class Cylinder(Struct, frozen=True, tag="cylinder"):
    """Along z, about its centre."""

    radius_m: Metres
    length_m: Metres


class TriangleMesh(Struct, frozen=True, tag="mesh"):
    """A binary STL in metre, as ``read_stl`` admits it."""

    stl: bytes


Geometry = Box | Sphere | Cylinder | TriangleMesh
Kind = Literal["obstacle", "zone"]


class SceneObject(Struct, frozen=True, kw_only=True):
    """``pose``: where it stands in the frame of the world. ``zone``: nothing is there, and nothing is to go there."""

    title: Annotated[str, Meta(min_length=1, max_length=256)]
    kind: Kind
    pose: Pose
    geometry: Geometry


def encode(thing: SceneObject) -> bytes:
    return msgspec.json.encode(thing)


def decode(body: bytes) -> SceneObject:
    """ValueError for what another version has written and this one cannot read."""
    return msgspec.json.decode(body, type=SceneObject)


def read_stl(content: bytes) -> TriangleMesh:
    """ValueError, in words, for what is no binary STL of 1 to ``MAX_TRIANGLES`` triangles within ``FARTHEST_M``."""
    count = struct.unpack_from("<I", content, 80)[0] if len(content) >= 84 else 0
    if len(content) != 84 + 50 * count or count == 0:
        raise ValueError("it is no binary STL: 80 bytes, the number of triangles, and 50 bytes for each")
    if count > MAX_TRIANGLES:
        raise ValueError(f"it has {count} triangles; {MAX_TRIANGLES} are the most")
    # Of each triangle: its normal, which is not looked at, three corners, and two bytes of attributes.
    for corners in struct.iter_unpack("<12x9f2x", memoryview(content)[84:]):
        if not (max(corners) <= FARTHEST_M and min(corners) >= -FARTHEST_M and math.isfinite(sum(corners))):
            raise ValueError(f"a corner is not within {FARTHEST_M:g} m of its origin")
    return TriangleMesh(content)
