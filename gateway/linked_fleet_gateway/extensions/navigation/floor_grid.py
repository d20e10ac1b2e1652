"""A grid over a part of the floor: how far each cell is from the nearest obstacle, and which one that is. Metre.

Runs in the process that plans ways. Row 0 is the lowest y. Cells at the border are never free.
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from linked_fleet_gateway.extensions.navigation.messages import FloorCells, Point

Floats = npt.NDArray[np.float64]
FINEST_M, COARSEST_M = 0.05, 0.2
MOST_CELLS = 300_000
NOTHING = -1


class TooLarge(Exception):  # noqa: N818
    """The grid would have too many cells."""


@dataclass(frozen=True)
class Lattice:
    """The places of the cells: ``origin`` is the centre of cell [0, 0]."""

    origin: Point
    step_m: float
    columns: int
    rows: int

    @classmethod
    def around(cls, low: Sequence[float], high: Sequence[float]) -> "Lattice":
        """Return the finest lattice over a rectangle. Raises TooLarge."""
        wide, tall = high[0] - low[0], high[1] - low[1]
        step_m = max(FINEST_M, math.sqrt(wide * tall / MOST_CELLS))
        if step_m > COARSEST_M:
            raise TooLarge
        return cls((low[0], low[1]), step_m, math.ceil(wide / step_m) + 1, math.ceil(tall / step_m) + 1)

    def cell(self, at: Point) -> int:
        """Return the number of the cell nearest to a point, by rows."""
        column = round((at[0] - self.origin[0]) / self.step_m)
        row = round((at[1] - self.origin[1]) / self.step_m)
        return min(max(row, 0), self.rows - 1) * self.columns + min(max(column, 0), self.columns - 1)

    def point(self, cell: int) -> Point:
        row, column = divmod(cell, self.columns)
        return self.origin[0] + column * self.step_m, self.origin[1] + row * self.step_m

    def window(self, low: Floats, high: Floats) -> tuple[slice, slice]:
        """Return the rows and columns of the cells in a rectangle."""
        first = np.floor((low - self.origin) / self.step_m).astype(int)
        last = np.ceil((high - self.origin) / self.step_m).astype(int) + 1
        columns, rows = np.clip((first, last), 0, (self.columns, self.rows)).T
        return slice(*rows.tolist()), slice(*columns.tolist())

    def points(self, window: tuple[slice, slice]) -> tuple[Floats, Floats]:
        """Return x of the columns and y of the rows of a window."""
        rows, columns = window
        x = self.origin[0] + self.step_m * np.arange(columns.start, columns.stop)
        return x, self.origin[1] + self.step_m * np.arange(rows.start, rows.stop)


class FloorGrid:
    """``clearance_m[row, column]`` is exact up to ``far_m``, and not less than that beyond."""

    def __init__(self, lattice: Lattice, far_m: float) -> None:
        self.lattice, self.far_m = lattice, far_m
        self.clearance_m = np.full((lattice.rows, lattice.columns), np.inf)
        self.nearest = np.full((lattice.rows, lattice.columns), NOTHING, dtype=np.int32)

    def add(self, polygons: Iterable[Sequence[Point]], number: int) -> None:
        """Add the convex polygons of the obstacle with a number."""
        for polygon in polygons:
            corners = np.asarray(polygon, dtype=float)
            self._put(corners.min(axis=0), corners.max(axis=0), number, corners)

    def add_cells(self, cells: FloorCells, number: int) -> list[Floats]:
        """Add the occupied cells of a map. Return their corners."""
        boxes = np.frombuffer(cells.boxes, dtype="<u2").reshape(-1, 4).astype(float)
        x, y, yaw = cells.origin
        cosine, sine, placed = math.cos(yaw), math.sin(yaw), list[Floats]()
        for column, row, columns, rows in (boxes * cells.resolution_m).tolist():
            corners = np.array(
                ((column, row), (column + columns, row), (column + columns, row + rows), (column, row + rows))
            )
            placed.append(corners @ np.array(((cosine, sine), (-sine, cosine))) + (x, y))
            self._put(placed[-1].min(axis=0), placed[-1].max(axis=0), number, placed[-1])
        return placed

    def _put(self, low: Floats, high: Floats, number: int, corners: Floats) -> None:
        window = self.lattice.window(low - self.far_m, high + self.far_m)
        x, y = self.lattice.points(window)
        if not len(x) or not len(y):
            return
        apart = distance_to(corners, x[None, :], y[:, None])
        held, nearest = self.clearance_m[window], self.nearest[window]
        closer = apart < held
        held[closer], nearest[closer] = apart[closer], number

    def leave_out(self, outside: npt.NDArray[np.bool_], number: int) -> None:
        """Make cells an obstacle with a number."""
        self.clearance_m[outside], self.nearest[outside] = 0.0, number


def distance_to(corners: Floats, x: Floats, y: Floats) -> Floats:
    """Return the distance of points from a convex polygon with counterclockwise corners; 0 inside."""
    ends = np.roll(corners, -1, axis=0)
    apart = np.full(np.broadcast_shapes(x.shape, y.shape), np.inf)
    inside = np.full(apart.shape, len(corners) > 2)
    for (x1, y1), (x2, y2) in zip(corners.tolist(), ends.tolist(), strict=True):
        along_x, along_y = x2 - x1, y2 - y1
        square = along_x**2 + along_y**2 or 1.0
        share = np.clip(((x - x1) * along_x + (y - y1) * along_y) / square, 0.0, 1.0)
        np.minimum(apart, np.hypot(x - x1 - share * along_x, y - y1 - share * along_y), out=apart)
        inside &= along_x * (y - y1) - along_y * (x - x1) >= 0.0
    apart[inside] = 0.0
    return apart
