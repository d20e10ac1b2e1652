"""The map of the floor, as a typed value and as a record in Redis. Metre, radian; pure.

A map is an occupancy map of ROS ``map_server``: an image, and settings that say what its pixels mean and where it lies.
The frame of the map is the world. A cell is *occupied* if its probability is above ``occupied_thresh``, *free* if it is
below ``free_thresh``, and *unknown* in between.
"""

import gzip
from collections.abc import Mapping
from hashlib import blake2b
from types import MappingProxyType
from typing import Annotated, Literal

import msgspec
from msgspec import Meta, Struct

from linked_fleet_gateway.extensions.world.scene import FARTHEST_M

MAX_SIDE_PX = 4_000
MAX_CELLS = MAX_SIDE_PX * MAX_SIDE_PX
FINEST_M, COARSEST_M = 0.001, 1.0
"""Limits of the resolution."""
MAX_YAML_BYTES = 4_096
MAX_FORM_BYTES = 4_096
"""The fields of a form besides its files."""
MAX_IMAGE_BYTES = MAX_CELLS + 1_024
MAX_UPLOAD_BYTES = MAX_IMAGE_BYTES + MAX_YAML_BYTES + MAX_FORM_BYTES
MAX_STORED_BYTES = 4 * 2**20
"""Size of the compressed image. Maps of floors have a tenth of it; an image with as much noise is none."""
MOST_BOXES = 20_000
"""Boxes of which the occupied cells may consist in checks of motions."""
DEFAULT_HEIGHT_M = 2.0
LARGEST_HEIGHT_M = 100.0

OBSTACLES_KEY = "map-"
"""With this the keys of obstacles of maps begin."""

Mode = Literal["trinary", "scale", "raw"]


class UnusableMap(Exception):  # noqa: N818
    """A map, or a file of it, that cannot be used. A sentence for the client."""


class MapSettings(Struct, frozen=True, kw_only=True):
    """The keys of a YAML file of ``map_server``, except the name of the image.

    ``origin`` is the outer corner of the lower left pixel: x, y and yaw.
    """

    resolution: float
    origin: tuple[float, float, float]
    negate: bool
    occupied_thresh: float
    free_thresh: float
    mode: Mode = "trinary"


class FloorMap(Struct, frozen=True, kw_only=True):
    """A map that has been read. ``height_m`` is that of its obstacles above the floor, z = 0 of the world."""

    title: str
    settings: MapSettings
    columns: int
    rows: int
    height_m: Annotated[float, Meta(gt=0, le=LARGEST_HEIGHT_M)]
    occupied: int
    """Number of cells; ``free`` too, and the others are unknown."""
    free: int
    sha256: str
    """Digest of the image."""
    image: bytes
    """The PGM as it came, in gzip."""
    picture: bytes
    """A PNG of the cells: black is occupied, white is free, grey is unknown."""
    boxes: bytes
    """Rectangles of which the occupied cells consist: column, row, columns, rows as little-endian 16-bit numbers."""
    created_ns: int
    client: str

    @property
    def unknown(self) -> int:
        return self.columns * self.rows - self.occupied - self.free

    @property
    def obstacles_key(self) -> str:
        """A key that is equal for maps with equal obstacles at equal places."""
        digest = blake2b(repr((self.settings, self.height_m)).encode(), digest_size=8).hexdigest()
        return f"{OBSTACLES_KEY}{self.sha256}-{digest}"

    @property
    def box_count(self) -> int:
        return len(self.boxes) // 8

    @property
    def size_m(self) -> tuple[float, float]:
        return self.columns * self.settings.resolution, self.rows * self.settings.resolution


ID = "map"
"""The key of the only record of the table."""
Maps = Mapping[str, FloorMap]
NO_MAPS: Maps = MappingProxyType({})


def encode(found: FloorMap) -> bytes:
    return msgspec.msgpack.encode(found)


def decode(body: bytes) -> FloorMap:
    """Decode a map. Raises ValueError if another version wrote it in an unreadable form."""
    return msgspec.msgpack.decode(body, type=FloorMap)


def pgm_of(found: FloorMap) -> bytes:
    """Return the image as it was uploaded. It takes up to a tenth of a second."""
    return gzip.decompress(found.image)


def check_settings(settings: MapSettings) -> None:
    """Raise UnusableMap for numbers that describe no map."""
    if not FINEST_M <= settings.resolution <= COARSEST_M:
        raise UnusableMap(
            f"A resolution of {settings.resolution:g} m is not between {FINEST_M:g} m and {COARSEST_M:g} m for a pixel."
        )
    x, y, yaw = settings.origin
    if not (abs(x) <= FARTHEST_M and abs(y) <= FARTHEST_M and abs(yaw) <= 10):
        raise UnusableMap(
            f"The origin is x, y and yaw: at most {FARTHEST_M:g} m from the world's origin, and in radian."
        )
    if not 0 <= settings.free_thresh < settings.occupied_thresh <= 1:
        raise UnusableMap("Thresholds are probabilities: free_thresh is at least 0, below occupied_thresh, at most 1.")


def check_size(settings: MapSettings, columns: int, rows: int) -> None:
    """Raise UnusableMap for an image that is too large in pixels or metres."""
    if columns > MAX_SIDE_PX or rows > MAX_SIDE_PX:
        raise UnusableMap(
            f"The image has {columns} × {rows} pixels; at most {MAX_SIDE_PX} × {MAX_SIDE_PX} are read. "
            "Crop it, or save the map at a coarser resolution."
        )
    if max(columns, rows) * settings.resolution > FARTHEST_M:
        raise UnusableMap(
            f"The map is longer than {FARTHEST_M:g} m; is the resolution of {settings.resolution:g} m right?"
        )
