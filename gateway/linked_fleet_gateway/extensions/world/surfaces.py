"""Triangle meshes for coal: read once, told from their convex hull, and made into shapes. Metre.

A closed mesh that fills its convex hull counts as that hull, which is exact and quick. Any other counts as the surface
that it is. A mesh of too many triangles counts as its hull: larger, never smaller.
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

MOST_TRIANGLES = 50_000  # some 30 MB as a surface
_FILLED = 0.995  # share of the hull's volume from which on a closed mesh is its hull
_OVERFULL = 1.0005  # a mesh whose parts overlap counts volume twice
_SMALLEST_M3 = 1e-12
_MOST = 1e6  # of vertices and scales; what is larger overflows where it is multiplied


@dataclass(frozen=True)
class Surface:
    """``triangles`` are rows of three indices into ``vertices``; one that ``fills_hull`` counts as its hull."""

    vertices: Array
    triangles: Indices
    fills_hull: bool

    @classmethod
    def of(cls, vertices: Array, triangles: Indices) -> "Surface":
        """With equal vertices joined and triangles without an area left out; ModelError for what is no mesh."""
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
        """ModelError when coal could not reckon with that: it ends the process over what is infinite."""
        if not ((np.abs(scale) > 1 / _MOST) & (np.abs(scale) < _MOST)).all():
            raise ModelError("a mesh is scaled out of all bounds")
        vertices = self.vertices * scale
        if not (np.abs(vertices) < _MOST).all():
            raise ModelError("a mesh is too large")
        return Surface(vertices, self.triangles, self.fills_hull)

    @cached_property
    def hull(self) -> coal.CollisionGeometry:
        """Its convex hull; ModelError when it has none, as a flat mesh."""
        return _hull(self.vertices)

    def exact(self) -> coal.CollisionGeometry:
        """The surface itself."""
        surface = coal.BVHModelOBBRSS()
        surface.beginModel(len(self.triangles), len(self.vertices))
        surface.addVertices(self.vertices)
        surface.addTriangles(self.triangles)
        surface.endModel()
        return surface


def read_mesh(suffix: str, content: bytes) -> Surface:
    """The mesh in a file of the formats STL, COLLADA and OBJ; ModelError for one that cannot be used."""
    with tempfile.NamedTemporaryFile(suffix=f".{suffix}") as file:
        file.write(content)
        file.flush()
        try:
            mesh = coal.MeshLoader().load(file.name, np.ones(3))
        except (ValueError, RuntimeError) as error:
            raise ModelError(f"it cannot be read as {suffix}") from error
    vertices = np.array(mesh.vertices(), dtype=float).reshape(-1, 3)
    if not (np.abs(vertices) < _MOST).all():  # nor what is no number
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
    """The vertices of a convex hull, and its triangles, which face either way."""
    faces = [hull.polygons(i) for i in range(hull.num_polygons)]
    corners = np.array([(each[0], each[1], each[2]) for each in faces], dtype=np.int32).reshape(-1, 3)
    return np.array(hull.points(), dtype=float).reshape(-1, 3), corners


def _is_closed(triangles: Indices) -> bool:
    """Each edge has as many triangles on its one side as on its other."""
    a, b, c = triangles.T.astype(np.int64)
    ahead = np.concatenate([np.stack(edge, axis=1) for edge in ((a, b), (b, c), (c, a))])
    forth, forth_count = np.unique(ahead, axis=0, return_counts=True)
    back, back_count = np.unique(ahead[:, ::-1], axis=0, return_counts=True)
    return np.array_equal(forth, back) and np.array_equal(forth_count, back_count)


def _volume(vertices: Array, triangles: Indices) -> float:
    return abs(float(_wedges(vertices, triangles).sum()))


def _wedges(vertices: Array, triangles: npt.NDArray[np.integer]) -> Array:
    """Signed volumes of the tetrahedra from the origin to each triangle."""
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
    """How often the surface goes around a point: 1 inside of a closed mesh, 0 outside (van Oosterom, 1983)."""
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
