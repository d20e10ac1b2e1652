"""Occupancy grids for guards and planners: which cells of the floor are occupied, free or unknown. Pure.

Metre and radian, in the frame of the world. Arrays are of numpy: ``points`` are rows of x and y, ``poses`` rows of x, y
and heading, a ``polygon`` has the corners of a simple polygon in order, in the frame that the poses place.

Unknown is neither free nor occupied: ``occupied`` does not count it, ``unknown`` tells of it. What is outside of the
grid is unknown.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]
Bools = npt.NDArray[np.bool_]
Indices = npt.NDArray[np.intp]

OCCUPIED, FREE, UNKNOWN = 100, 0, -1
"""Values of cells, as in nav_msgs/OccupancyGrid."""
_AT_ONCE = 4_000_000
"""Numbers in one temporary array: 32 MB."""


@dataclass(frozen=True, eq=False)
class OccupancyGrid:
    """``cells[row, column]`` with the row of the lowest y first, as in nav_msgs/OccupancyGrid.

    ``origin`` is the outer corner of cell [0, 0]: x, y, and the direction of the rows (yaw).
    """

    cells: npt.NDArray[np.int8]
    resolution_m: float
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0)

    @cached_property
    def _is_occupied(self) -> Bools:
        return np.asarray(self.cells == OCCUPIED)

    @cached_property
    def _is_unknown(self) -> Bools:
        return np.asarray(self.cells == UNKNOWN)

    def to_cells(self, points: npt.ArrayLike) -> Floats:
        """Return points (…, 2) in cells: column and row, whose integer parts are the indices."""
        x, y, yaw = self.origin
        cosine, sine = math.cos(yaw), math.sin(yaw)
        moved = np.asarray(points, dtype=float) - (x, y)
        turned = moved @ np.array(((cosine, -sine), (sine, cosine)))
        found: Floats = turned / self.resolution_m
        return found

    def to_world(self, cells: npt.ArrayLike) -> Floats:
        """Return the points (…, 2) at columns and rows; the centre of a cell is half a cell behind its indices."""
        x, y, yaw = self.origin
        cosine, sine = math.cos(yaw), math.sin(yaw)
        scaled = np.asarray(cells, dtype=float) * self.resolution_m
        found: Floats = scaled @ np.array(((cosine, sine), (-sine, cosine))) + (x, y)
        return found

    def values(self, points: npt.ArrayLike) -> npt.NDArray[np.int8]:
        """Return the value of the cell at each point; ``UNKNOWN`` outside."""
        found = np.floor(self.to_cells(points))
        rows, columns = self.cells.shape
        inside = np.asarray(((found >= 0) & (found < (columns, rows))).all(axis=-1))
        column, row = np.moveaxis(np.where(inside[..., None], found, 0).astype(np.intp), -1, 0)
        return np.where(inside, self.cells[row, column], np.int8(UNKNOWN)).astype(np.int8)

    def inflate(self, radius_m: float) -> "OccupancyGrid":
        """Return the grid in which each cell with a point less than ``radius_m`` from an occupied cell is occupied.

        So a disc of this radius about any point of another cell meets no occupied cell. Other cells keep their values.
        """
        if not 0 <= radius_m < math.inf:
            raise ValueError(f"a radius is not negative and finite; {radius_m} is not")
        cells = self.cells.copy()
        cells[_dilated(self._is_occupied, radius_m / self.resolution_m)] = OCCUPIED
        return replace(self, cells=cells)

    def occupied(self, polygon: npt.ArrayLike, poses: npt.ArrayLike) -> Bools:
        """Return for each pose (N, 3) whether the polygon (K, 2) meets an occupied cell; touching counts."""
        return self._meets(self._is_occupied, self._outlines(polygon, poses))

    def unknown(self, polygon: npt.ArrayLike, poses: npt.ArrayLike) -> Bools:
        """Return for each pose (N, 3) whether the polygon (K, 2) meets an unknown cell, or leaves the grid."""
        outlines = self._outlines(polygon, poses)
        rows, columns = self.cells.shape
        leaves = np.asarray(((outlines < 0) | (outlines > (columns, rows))).any(axis=(1, 2)))
        return leaves | self._meets(self._is_unknown, outlines)

    def _outlines(self, polygon: npt.ArrayLike, poses: npt.ArrayLike) -> Floats:
        """Return the corners of the polygon at each pose (N, K, 2) in cells. Raises ValueError."""
        corners = np.asarray(polygon, dtype=float).reshape(-1, 2)
        placed = np.asarray(poses, dtype=float).reshape(-1, 3)
        if not len(corners) or not np.isfinite(corners).all() or not np.isfinite(placed).all():
            raise ValueError("a polygon has at least one corner, and all its corners and poses are finite")
        cosine, sine = np.cos(placed[:, 2, None]), np.sin(placed[:, 2, None])
        x = placed[:, 0, None] + cosine * corners[:, 0] - sine * corners[:, 1]
        y = placed[:, 1, None] + sine * corners[:, 0] + cosine * corners[:, 1]
        return self.to_cells(np.stack((x, y), axis=-1))

    def _meets(self, wanted: Bools, outlines: Floats) -> Bools:
        """Return for each outline (N, K, 2) whether it meets a ``wanted`` cell."""
        limits = np.array(wanted.shape[::-1])
        low = np.clip(np.ceil(outlines.min(axis=1)) - 1, 0, limits).astype(np.intp)
        high = np.clip(np.floor(outlines.max(axis=1)), -1, limits - 1).astype(np.intp)
        found = np.zeros(len(outlines), dtype=bool)
        for part in _parts(len(outlines), int(np.prod(np.maximum(high - low + 1, 0).max(axis=0, initial=1)))):
            of, cells = _wanted_cells(wanted, low[part], high[part])
            for some in _parts(len(of), outlines.shape[1]):
                met = _touch(outlines[part][of[some]], cells[some])
                found[part.start + np.unique(of[some][met])] = True
        return found


def _parts(count: int, each: int) -> Iterator[slice]:
    """Yield slices of ``count`` items that need ``each`` numbers, so that a slice needs few enough."""
    step = max(1, _AT_ONCE // max(each, 1))
    return (slice(start, start + step) for start in range(0, count, step))


def _wanted_cells(wanted: Bools, low: Indices, high: Indices) -> tuple[Indices, Indices]:
    """Return the wanted cells between ``low`` and ``high`` (N, 2): indices into these, and columns and rows (F, 2)."""
    if not (size := np.maximum(high - low + 1, 0).max(axis=0, initial=0)).all():
        return np.zeros(0, dtype=np.intp), np.zeros((0, 2), dtype=np.intp)
    columns, rows = (low[:, axis, None] + np.arange(size[axis]) for axis in (0, 1))
    inside = (rows <= high[:, 1, None])[:, :, None] & (columns <= high[:, 0, None])[:, None, :]
    row, column = (np.minimum(each, most - 1) for each, most in zip((rows, columns), wanted.shape, strict=True))
    of, down, along = np.nonzero(inside & wanted[row[:, :, None], column[:, None, :]])
    return of, np.stack((columns[of, along], rows[of, down]), axis=-1)


def _touch(outlines: Floats, cells: Indices) -> Bools:
    """Return whether each outline (F, K, 2) meets its cell (F, 2), a closed unit square."""
    begin, end, middle = outlines, np.roll(outlines, -1, axis=1), cells[:, None, :].astype(float) + 0.5
    beside = ((np.minimum(begin, end) > middle + 0.5) | (np.maximum(begin, end) < middle - 0.5)).any(axis=-1)
    way, there = end - begin, middle - begin
    across = np.abs(way[..., 0] * there[..., 1] - way[..., 1] * there[..., 0])
    crosses = ~beside & (across <= 0.5 * np.abs(way).sum(axis=-1))
    met: Bools = crosses.any(axis=1) | _contains(begin, end, middle[:, 0])
    return met


def _contains(begin: Floats, end: Floats, points: Floats) -> Bools:
    """Return whether each point (F, 2) is inside its polygon, whose edges are from ``begin`` to ``end`` (F, K, 2)."""
    y = points[:, None, 1]
    spans = (begin[..., 1] > y) != (end[..., 1] > y)
    rise = np.where(spans, end[..., 1] - begin[..., 1], 1.0)
    at = begin[..., 0] + (y - begin[..., 1]) / rise * (end[..., 0] - begin[..., 0])
    found: Bools = (spans & (points[:, None, 0] < at)).sum(axis=1) % 2 == 1
    return found


def _dilated(wanted: Bools, radius: float) -> Bools:
    """Return the cells with a point less than ``radius`` (in cells) from a wanted one, and the wanted ones."""
    found, widened, along = wanted.copy(), wanted, 0
    if radius <= 0 or not wanted.any():
        return found
    rows = wanted.shape[0]
    for up in range(min(math.ceil(radius), rows - 1), -1, -1):
        gap = max(up - 1, 0)  # between the squares of two cells
        # The gap along the row must be less than this, and the cells there are one more apart than the gap.
        reach = math.ceil(math.sqrt(radius * radius - gap * gap))
        while along < min(reach, wanted.shape[1] - 1):
            widened, along = _widened(widened), along + 1
        found[up:] |= widened[: rows - up]
        found[: rows - up] |= widened[up:]
    return found


def _widened(wanted: Bools) -> Bools:
    """Return the wanted cells and their neighbours in their rows."""
    found = wanted.copy()
    found[:, 1:] |= wanted[:, :-1]
    found[:, :-1] |= wanted[:, 1:]
    return found
