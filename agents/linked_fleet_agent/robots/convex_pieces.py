"""Convex pieces of surfaces, because MuJoCo takes a mesh for its convex hull. Metre; pure."""

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.integer]

MOST_PIECES = 64
"""Pieces of one surface: its separate parts, each cut into 32 at most."""
_MOST_CUTS = 5
_CONVEX_M = 1e-3
"""A part whose corners are nowhere further out than this in front of its faces is convex."""
_MOST_COMPARED = 4_000_000
_FLAT_M = 5e-4


def convex_pieces(vertices: Array, triangles: Indices) -> list[Array]:
    """Return points whose convex hulls cover a surface: of each part that hangs together, cut where it is not convex.

    Cuts halve the longest side of a piece, so a hollow that is narrower than a piece is filled.
    """
    parts = _parts(vertices, triangles)
    if len(parts) > MOST_PIECES:
        parts = [triangles]
    cuts = min(_MOST_CUTS, int(np.log2(MOST_PIECES // len(parts)))) if parts else 0
    found: list[Array] = []
    for each in parts:
        corners = vertices[each]
        found += [_used(corners)] if _is_convex(corners) else _cut(corners, cuts)
    return [_thick(each) for each in found if len(each)]


def _parts(vertices: Array, triangles: Indices) -> list[Indices]:
    """Return the triangles of each part that hangs together."""
    _, same = np.unique(np.round(vertices, 6), axis=0, return_inverse=True)
    corners = same.reshape(-1)[triangles]
    labels = np.arange(len(vertices))
    while True:
        least = labels[corners].min(axis=1, keepdims=True)
        before = labels.copy()
        for column in range(3):
            np.minimum.at(labels, corners[:, column], least[:, 0])
        labels = labels[labels]
        if (labels == before).all():
            break
    of_triangle = labels[corners[:, 0]]
    return [triangles[of_triangle == each] for each in np.unique(of_triangle)]


def _is_convex(corners: Array) -> bool:
    """Return True if all corners are behind all faces; ``corners`` are three of each triangle."""
    points = _used(corners)
    if len(points) * len(corners) > _MOST_COMPARED:
        return False
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    lengths = np.linalg.norm(normals, axis=1)
    normals, origins = normals[lengths > 0] / lengths[lengths > 0, None], corners[lengths > 0, 0]
    ahead = points @ normals.T - (origins * normals).sum(axis=1)
    return bool((ahead.max(axis=0) < _CONVEX_M).all() or (ahead.min(axis=0) > -_CONVEX_M).all())


def _used(corners: Array) -> Array:
    found: Array = np.unique(corners.reshape(-1, 3), axis=0)
    return found


def _cut(corners: Array, cuts: int) -> list[Array]:
    """Return the points of a surface, halved along its longest side ``cuts`` times."""
    points = _used(corners)
    if cuts == 0 or len(points) < 4:
        return [points]
    low, high = points.min(axis=0), points.max(axis=0)
    axis = int((high - low).argmax())
    middle = (low[axis] + high[axis]) / 2
    halves = (_clipped(corners, axis, middle, side) for side in (1.0, -1.0))
    return [piece for half in halves if len(half) for piece in _cut(half, cuts - 1)]


def _clipped(corners: Array, axis: int, middle: float, side: float) -> Array:
    """Return the triangles on one side of a plane, those that it cuts without what is beyond."""
    heights = side * (corners[:, :, axis] - middle)
    whole = corners[(heights >= 0).all(axis=1)]
    crossing = (heights > 0).any(axis=1) & (heights < 0).any(axis=1)
    cut = [
        _without_rest(triangle, height) for triangle, height in zip(corners[crossing], heights[crossing], strict=True)
    ]
    found: Array = np.concatenate([whole, *cut]) if cut else whole
    return found


def _without_rest(triangle: Array, heights: Array) -> Array:
    points = []
    for k in range(3):
        (a, b), (high, next_high) = (triangle[k], triangle[k - 2]), (heights[k], heights[k - 2])
        if high >= 0:
            points.append(a)
        if high * next_high < 0:
            points.append(a + high / (high - next_high) * (b - a))
    return np.array([(points[0], points[k], points[k + 1]) for k in range(1, len(points) - 1)])


def _thick(points: Array) -> Array:
    """Return points that lie in no plane, because a hull needs a volume."""
    _, sizes, axes = np.linalg.svd(points - points.mean(axis=0), full_matrices=True)
    spread = np.zeros(3)
    spread[: len(sizes)] = sizes / np.sqrt(len(points))
    for axis in axes[spread < _FLAT_M]:
        points = np.concatenate([points + _FLAT_M * axis, points - _FLAT_M * axis])
    return points
