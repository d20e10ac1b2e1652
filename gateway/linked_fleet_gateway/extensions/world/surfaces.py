"""Triangle meshes for coal: parsed, compared with their convex hull, converted to shapes, and cached. Metre.

A closed mesh that fills its convex hull is represented by the hull, which is exact and fast. Others are represented by
their surface, or by the hull if they have too many triangles: larger, never smaller. One without a hull, such as a flat
mesh or a cylinder of hundreds of sides, for which coal has no room, is its surface.

The cache is a folder of parsed meshes, each in a file named by the digest of its source. Several gateways may share the
folder: files appear atomically, and a missing one is parsed again. A damaged file, and one that another user could have
written, is ignored. Files contain data only, no code.
"""

import hashlib
import logging
import os
import re
import stat
import struct
import tempfile
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import coal
import numpy as np
import numpy.typing as npt

from linked_fleet_gateway.extensions.models.mesh_formats import collada_unit_m, with_plain_root
from linked_fleet_state.xml import ModelError

_log = logging.getLogger(__name__)

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int32]

MOST_TRIANGLES = 50_000  # about 30 MB as a surface
MOST_SURFACE_TRIANGLES = 200_000  # of a mesh whose convex hull cannot be computed
_FEWEST_CORNERS = 4
_FILLED = 0.995  # least share of the hull's volume of a closed mesh that counts as its hull
_OVERFULL = 1.0005  # a mesh with overlapping parts counts volume twice
_SMALLEST_M3 = 1e-12
_FLAT = 1e-7  # least thickness relative to the coordinates; coal ends the process if Qhull finds a mesh flat
_MOST = 1e6  # bound of vertices and scales, whose products could overflow


@dataclass(frozen=True)
class Surface:
    """A mesh; ``triangles`` are rows of three indices into ``vertices``.

    One that ``fills_hull`` is represented by its hull.
    """

    vertices: Array
    triangles: Indices
    fills_hull: bool

    @classmethod
    def from_triangles(cls, vertices: Array, triangles: Indices) -> "Surface":
        """Merge equal vertices and drop triangles without area. Raises ModelError for an empty mesh."""
        if not len(triangles):
            raise ModelError("it has no triangles")
        joined, place = np.unique(vertices, axis=0, return_inverse=True)
        corners = place.reshape(-1)[triangles].astype(np.int32)
        a, b, c = corners.T
        corners = corners[(a != b) & (b != c) & (c != a)]
        if not len(corners):
            raise ModelError("none of its triangles has an area")
        return cls(joined, corners, _fills_hull(joined, corners))

    def scaled(self, scale: Array) -> "Surface":
        """Return a scaled mesh.

        Raises ModelError for sizes that coal cannot handle: it aborts the process on infinity.
        """
        if not ((np.abs(scale) > 1 / _MOST) & (np.abs(scale) < _MOST)).all():
            raise ModelError("a mesh is scaled out of all bounds")
        vertices = self.vertices * scale
        if not (np.abs(vertices) < _MOST).all():
            raise ModelError("a mesh is too large")
        return Surface(vertices, self.triangles, self.fills_hull and not _is_flat(vertices))

    @cached_property
    def hull(self) -> coal.CollisionGeometry:
        """A convex shape around it: its convex hull or, if coal has none as for a flat mesh, a box."""
        try:
            return convex_hull(self.vertices)
        except ModelError:
            return convex_hull(_box_around(self.vertices))

    def exact_shape(self) -> coal.CollisionGeometry:
        """Return the surface as a shape."""
        surface = coal.BVHModelOBBRSS()
        surface.beginModel(len(self.triangles), len(self.vertices))
        surface.addVertices(self.vertices)
        surface.addTriangles(self.triangles)
        surface.endModel()
        return surface


def read_mesh(suffix: str, content: bytes) -> Surface:
    """Parse an STL, COLLADA, OBJ or binary glTF file. Raises ModelError if it is unusable."""
    if suffix == "glb":
        content = with_plain_root(content)
    metre = collada_unit_m(content) if suffix == "dae" else 1.0
    with tempfile.NamedTemporaryFile(suffix=f".{suffix}") as file:
        file.write(content)
        file.flush()
        try:
            mesh = coal.MeshLoader().load(file.name, np.ones(3))
        except (ValueError, RuntimeError) as error:
            raise ModelError(f"it cannot be read as {suffix}") from error
    vertices = metre * np.array(mesh.vertices(), dtype=float).reshape(-1, 3)
    if not (np.abs(vertices) < _MOST).all():  # also refuses NaN
        raise ModelError("it has vertices out of all bounds")
    if mesh.num_tris > MOST_TRIANGLES:
        with suppress(ModelError):
            return Surface(*_corners(convex_hull(vertices)), True)
    if mesh.num_tris > MOST_SURFACE_TRIANGLES:
        raise ModelError(f"it has {mesh.num_tris} triangles, more than {MOST_SURFACE_TRIANGLES}, and no convex hull")
    corners = [mesh.tri_indices(i) for i in range(mesh.num_tris)]
    return Surface.from_triangles(
        vertices, np.array([(each[0], each[1], each[2]) for each in corners], dtype=int).reshape(-1, 3)
    )


def _fills_hull(vertices: Array, triangles: Indices) -> bool:
    if not _is_closed(triangles):
        return False
    try:
        hull = convex_hull(vertices)
    except ModelError:
        return False
    points, around = _corners(hull)
    centre = points.mean(axis=0)
    filled, whole = _volume(vertices - centre, triangles), float(np.abs(_wedges(points - centre, around)).sum())
    return whole > _SMALLEST_M3 and _FILLED <= filled / whole <= _OVERFULL


def _corners(hull: coal.CollisionGeometry) -> tuple[Array, Indices]:
    """Return the vertices of a convex hull and its triangles, with arbitrary orientation."""
    faces = [hull.polygons(i) for i in range(hull.num_polygons)]
    corners = np.array([(each[0], each[1], each[2]) for each in faces], dtype=np.int32).reshape(-1, 3)
    return np.array(hull.points(), dtype=float).reshape(-1, 3), corners


def _is_closed(triangles: Indices) -> bool:
    """Return True if each edge has equally many triangles on both sides."""
    a, b, c = triangles.T.astype(np.int64)
    ahead = np.concatenate([np.stack(edge, axis=1) for edge in ((a, b), (b, c), (c, a))])
    forth, forth_count = np.unique(ahead, axis=0, return_counts=True)
    back, back_count = np.unique(ahead[:, ::-1], axis=0, return_counts=True)
    return np.array_equal(forth, back) and np.array_equal(forth_count, back_count)


def _volume(vertices: Array, triangles: Indices) -> float:
    return abs(float(_wedges(vertices, triangles).sum()))


def _wedges(vertices: Array, triangles: npt.NDArray[np.integer]) -> Array:
    """Return the signed volumes of the tetrahedra from the origin to each triangle."""
    a, b, c = (vertices[column] for column in triangles.T)
    found: Array = np.einsum("ij,ij->i", a, np.cross(b, c)) / 6.0
    return found


def _is_flat(vertices: Array) -> bool:
    """Return True if the points lie in a plane, as far as their coordinates tell."""
    centred = vertices - vertices.mean(axis=0)
    _, axes = np.linalg.eigh(centred.T @ centred)
    thickness = float(np.ptp(centred @ axes, axis=0).min())
    return not thickness > _FLAT * float(np.abs(vertices).max())


def _box_around(vertices: Array) -> Array:
    """Return the corners of a box that contains all points and has a volume."""
    margin = 10 * _FLAT * float(np.abs(vertices).max()) + _FLAT
    ends = np.stack([vertices.min(axis=0) - margin, vertices.max(axis=0) + margin])
    return np.array([[ends[i, 0], ends[j, 1], ends[k, 2]] for i, j, k in np.ndindex(2, 2, 2)])


def convex_hull(vertices: Array) -> coal.CollisionGeometry:
    """Return the convex hull. Raises ModelError if there is none, or if coal cannot compute it."""
    if len(vertices) < _FEWEST_CORNERS or _is_flat(vertices):
        raise ModelError("it has no convex hull, because it is flat")
    cloud = coal.StdVec_Vec3s()
    cloud.extend(vertices)
    try:
        return coal.Convex.convexHull(cloud, True, "Qt")
    except (ValueError, RuntimeError) as error:
        raise ModelError("its convex hull cannot be computed") from error


def winding_number(surface: Surface, point: Array) -> float:
    """Return the winding number of a point: 1 inside of a closed mesh, 0 outside (van Oosterom, 1983)."""
    a, b, c = (surface.vertices[column] - point for column in surface.triangles.T)
    lengths = [np.linalg.norm(each, axis=1) for each in (a, b, c)]
    numerator = np.einsum("ij,ij->i", a, np.cross(b, c))
    denominator = (
        lengths[0] * lengths[1] * lengths[2]
        + np.einsum("ij,ij->i", a, b) * lengths[2]
        + np.einsum("ij,ij->i", b, c) * lengths[0]
        + np.einsum("ij,ij->i", c, a) * lengths[1]
    )
    return float(np.arctan2(numerator, denominator).sum() / (2.0 * np.pi))


MOST_BYTES = 256 * 2**20
_MAGIC = b"linked fleet mesh 2\n"  # increment the number with every change of how meshes are parsed
_HEAD = struct.Struct("<?II")
_DIGEST_BYTES = 32
_NAME = re.compile(r"[0-9a-f]{64}\.(stl|dae|obj|glb)")


class MeshCache:
    """The cache. Without a usable folder nothing is stored."""

    def __init__(self, folder: Path | None, most_bytes: int = MOST_BYTES) -> None:
        self._folder, self._most_bytes = folder, most_bytes
        if folder is not None and not _own_folder(folder):
            _log.warning("meshes are not kept in %s: it cannot be written, or others can write it", folder)
            self._folder = None

    def get(self, name: str) -> Surface | None:
        """Return the mesh stored under a name, which is the digest of its source file."""
        if self._folder is None or not _NAME.fullmatch(name):
            return None
        try:
            content = _read(self._folder / name, self._most_bytes)
        except OSError:
            return None
        return None if content is None else _decoded(content)

    def put(self, name: str, surface: Surface) -> None:
        if self._folder is None or not _NAME.fullmatch(name):
            return
        content = _encoded(surface)
        if len(content) > self._most_bytes:
            return
        try:
            self._make_room(len(content))
            with tempfile.NamedTemporaryFile(dir=self._folder, prefix=".new-", delete=False) as file:
                try:
                    file.write(content)
                    file.flush()
                    Path(file.name).replace(self._folder / name)
                except BaseException:
                    Path(file.name).unlink(missing_ok=True)
                    raise
        except OSError as error:
            _log.warning("a mesh is not kept in %s: %s", self._folder, error.strerror)

    def _make_room(self, size: int) -> None:
        """Remove the least recently used files, including leftovers of crashes."""
        assert self._folder is not None
        found = []
        for entry in os.scandir(self._folder):
            with suppress(FileNotFoundError):  # another gateway was faster
                about = entry.stat(follow_symlinks=False)
                found.append((about.st_mtime_ns, about.st_size, entry.path))
        total = sum(size for _, size, _ in found)
        for _, each, path in sorted(found):
            if total + size <= self._most_bytes:
                break
            with suppress(FileNotFoundError):
                Path(path).unlink()
            total -= each


def _own_folder(folder: Path) -> bool:
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        about = folder.lstat()
    except OSError:
        return False
    return stat.S_ISDIR(about.st_mode) and _is_ours(about) and os.access(folder, os.W_OK)


def _is_ours(about: os.stat_result) -> bool:
    return about.st_uid == os.geteuid() and not about.st_mode & (stat.S_IWGRP | stat.S_IWOTH)


def _read(path: Path, most_bytes: int) -> bytes | None:
    """Return the content of a file that this user owns, else None. Set its modification time to now."""
    descriptor = os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_CLOEXEC | os.O_NONBLOCK)
    with os.fdopen(descriptor, "rb") as file:
        about = os.fstat(descriptor)
        if not stat.S_ISREG(about.st_mode) or not _is_ours(about) or about.st_size > most_bytes:
            return None
        os.utime(descriptor)
        return file.read(most_bytes)


def _encoded(surface: Surface) -> bytes:
    body = b"".join(
        (
            _HEAD.pack(surface.fills_hull, len(surface.vertices), len(surface.triangles)),
            surface.vertices.astype("<f8").tobytes(),
            surface.triangles.astype("<i4").tobytes(),
        )
    )
    return _MAGIC + hashlib.sha256(body).digest() + body


def _decoded(content: bytes) -> Surface | None:
    magic, start = content[: len(_MAGIC)], len(_MAGIC) + _DIGEST_BYTES
    body = memoryview(content)[start:]
    if magic != _MAGIC or len(body) < _HEAD.size or hashlib.sha256(body).digest() != content[len(_MAGIC) : start]:
        return None
    fills_hull, vertices, triangles = _HEAD.unpack_from(body)
    middle = _HEAD.size + 24 * vertices
    if len(body) != middle + 12 * triangles or not triangles:
        return None
    points = np.frombuffer(body[_HEAD.size : middle], "<f8").reshape(-1, 3)
    corners = np.frombuffer(body[middle:], "<i4").reshape(-1, 3)
    if not np.isfinite(points).all() or corners.min() < 0 or corners.max() >= vertices:
        return None
    return Surface(points, corners, fills_hull)
