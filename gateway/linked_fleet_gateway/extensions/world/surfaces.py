"""Triangle meshes for coal: parsed, compared with their convex hull, and converted to shapes. Metre.

A closed mesh that fills its convex hull is represented by the hull, which is exact and fast. Others are represented by
their surface, or by the hull if they have too many triangles: larger, never smaller.
"""

import tempfile
from dataclasses import dataclass
from functools import cached_property

import coal
import numpy as np
import numpy.typing as npt

from linked_fleet_gateway.fleet.xml import ModelError

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int32]

MOST_TRIANGLES = 50_000  # about 30 MB as a surface
_FILLED = 0.995  # least share of the hull's volume of a closed mesh that counts as its hull
_OVERFULL = 1.0005  # a mesh with overlapping parts counts volume twice
_SMALLEST_M3 = 1e-12
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
    def of(cls, vertices: Array, triangles: Indices) -> "Surface":
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
        return Surface(vertices, self.triangles, self.fills_hull)

    @cached_property
    def hull(self) -> coal.CollisionGeometry:
        """The convex hull. Raises ModelError if there is none, as for a flat mesh."""
        return _hull(self.vertices)

    def exact(self) -> coal.CollisionGeometry:
        """Return the surface as a shape."""
        surface = coal.BVHModelOBBRSS()
        surface.beginModel(len(self.triangles), len(self.vertices))
        surface.addVertices(self.vertices)
        surface.addTriangles(self.triangles)
        surface.endModel()
        return surface


def read_mesh(suffix: str, content: bytes) -> Surface:
    """Parse an STL, COLLADA or OBJ file. Raises ModelError if it is unusable."""
    with tempfile.NamedTemporaryFile(suffix=f".{suffix}") as file:
        file.write(content)
        file.flush()
        try:
            mesh = coal.MeshLoader().load(file.name, np.ones(3))
        except (ValueError, RuntimeError) as error:
            raise ModelError(f"it cannot be read as {suffix}") from error
    vertices = np.array(mesh.vertices(), dtype=float).reshape(-1, 3)
    if not (np.abs(vertices) < _MOST).all():  # also refuses NaN
        raise ModelError("it has vertices out of all bounds")
    if mesh.num_tris > MOST_TRIANGLES:
        hull = _hull(vertices)
        return Surface(*_corners(hull), True)
    corners = [mesh.tri_indices(i) for i in range(mesh.num_tris)]
    return Surface.of(vertices, np.array([(each[0], each[1], each[2]) for each in corners], dtype=int).reshape(-1, 3))


def _fills_hull(vertices: Array, triangles: Indices) -> bool:
    if not _is_closed(triangles):
        return False
    try:
        hull = _hull(vertices)
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


def _hull(vertices: Array) -> coal.CollisionGeometry:
    cloud = coal.StdVec_Vec3s()
    cloud.extend(vertices)
    try:
        return coal.Convex.convexHull(cloud, True, "Qt")
    except (ValueError, RuntimeError) as error:
        raise ModelError(f"it has no convex hull: {error}") from error


def winding(surface: Surface, point: Array) -> float:
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
