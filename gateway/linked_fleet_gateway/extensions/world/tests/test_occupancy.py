"""Occupancy grids against brute force."""

import math
from itertools import product

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from linked_fleet_gateway.extensions.world.occupancy import FREE, OCCUPIED, UNKNOWN, OccupancyGrid

_VALUES = st.sampled_from((OCCUPIED, FREE, FREE, FREE, UNKNOWN))
_ORIGINS = st.tuples(st.floats(-5, 5), st.floats(-5, 5), st.floats(-4, 4))


@st.composite
def grids(draw: st.DrawFn) -> OccupancyGrid:
    rows, columns = draw(st.integers(1, 9)), draw(st.integers(1, 9))
    cells = draw(st.lists(_VALUES, min_size=rows * columns, max_size=rows * columns))
    resolution = draw(st.sampled_from((0.05, 0.1, 0.5)))
    return OccupancyGrid(np.array(cells, dtype=np.int8).reshape(rows, columns), resolution, draw(_ORIGINS))


@st.composite
def polygons(draw: st.DrawFn) -> list[tuple[float, float]]:
    """Star-shaped polygons about the origin, most of them not convex, in metres for cells of 0.5 m or less."""
    count = draw(st.integers(3, 7))
    radii = draw(st.lists(st.floats(0.05, 1.5), min_size=count, max_size=count))
    return [
        (radius * math.cos(at), radius * math.sin(at))
        for radius, at in zip(radii, (i * math.tau / count for i in range(count)), strict=True)
    ]


_POSES = st.lists(st.tuples(st.floats(-7, 7), st.floats(-7, 7), st.floats(-7, 7)), min_size=1, max_size=4)


def clipped_area(polygon: list[tuple[float, float]], low: tuple[float, float], high: tuple[float, float]) -> float:
    """Return the area of a polygon in a rectangle (Sutherland and Hodgman)."""
    for axis, bound, sign in ((0, low[0], 1), (0, high[0], -1), (1, low[1], 1), (1, high[1], -1)):
        kept: list[tuple[float, float]] = []
        for one, other in zip(polygon, polygon[1:] + polygon[:1], strict=True):
            before, after = sign * (one[axis] - bound), sign * (other[axis] - bound)
            if before >= 0:
                kept.append(one)
            if (before >= 0) != (after >= 0):
                share = before / (before - after)
                kept.append((one[0] + share * (other[0] - one[0]), one[1] + share * (other[1] - one[1])))
        polygon = kept
    return abs(sum(a[0] * b[1] - a[1] * b[0] for a, b in zip(polygon, polygon[1:] + polygon[:1], strict=True))) / 2


def brute_force(grid: OccupancyGrid, wanted: int, polygon: list[tuple[float, float]], pose: tuple[float, ...]) -> float:
    """Return the largest area, in cells, that the polygon has in a cell with this value."""
    x, y, heading = pose
    cosine, sine = math.cos(heading), math.sin(heading)
    placed = [(x + cosine * a - sine * b, y + sine * a + cosine * b) for a, b in polygon]
    outline = [tuple(each) for each in grid.to_cells(placed).tolist()]
    cells = [(c, r) for r, c in np.argwhere(grid.cells == wanted).tolist()]
    return max((clipped_area(outline, (c, r), (c + 1, r + 1)) for c, r in cells), default=0.0)


@given(grids(), polygons(), _POSES)
def test_a_footprint_meets_the_cells_in_which_it_has_an_area(
    grid: OccupancyGrid, polygon: list[tuple[float, float]], poses: list[tuple[float, float, float]]
) -> None:
    for found, pose in zip(grid.occupied(polygon, poses).tolist(), poses, strict=True):
        area = brute_force(grid, OCCUPIED, polygon, pose)
        if area > 1e-9:
            assert found
        elif found:  # it touches: a polygon that is slightly smaller has no area there either, a larger one has
            assert brute_force(grid, OCCUPIED, [(1.001 * x, 1.001 * y) for x, y in polygon], pose) > 0.0 or any(
                math.hypot(*each) < 0.06 for each in polygon
            )


@given(grids(), polygons(), _POSES)
def test_a_footprint_is_partly_unknown_over_unknown_cells_and_beyond_the_grid(
    grid: OccupancyGrid, polygon: list[tuple[float, float]], poses: list[tuple[float, float, float]]
) -> None:
    rows, columns = grid.cells.shape
    for found, (x, y, heading) in zip(grid.unknown(polygon, poses).tolist(), poses, strict=True):
        cosine, sine = math.cos(heading), math.sin(heading)
        placed = [(x + cosine * a - sine * b, y + sine * a + cosine * b) for a, b in polygon]
        outside = any(not (0 <= c <= columns and 0 <= r <= rows) for c, r in grid.to_cells(placed).tolist())
        if outside or brute_force(grid, UNKNOWN, polygon, (x, y, heading)) > 1e-9:
            assert found


@given(grids(), st.floats(0, 1.2))
def test_inflated_cells_are_those_that_are_nearer_than_the_radius(grid: OccupancyGrid, radius: float) -> None:
    occupied = np.argwhere(grid.cells == OCCUPIED).tolist()
    found = grid.inflate(radius).cells
    for row, column in product(*map(range, grid.cells.shape)):
        gaps = [
            grid.resolution_m * math.hypot(max(abs(row - r) - 1, 0), max(abs(column - c) - 1, 0)) for r, c in occupied
        ]
        if any(abs(gap - radius) < 1e-9 for gap in gaps):
            continue  # rounding decides
        near = grid.cells[row, column] == OCCUPIED or any(gap < radius for gap in gaps)
        assert found[row, column] == (OCCUPIED if near else grid.cells[row, column])


@given(grids(), st.lists(st.tuples(st.floats(-9, 9), st.floats(-9, 9)), min_size=1, max_size=5))
def test_cells_and_points_lead_to_each_other(grid: OccupancyGrid, points: list[tuple[float, float]]) -> None:
    assert grid.to_world(grid.to_cells(points)) == pytest.approx(np.array(points), abs=1e-9)
    for row, column in product(*map(range, grid.cells.shape)):
        centre = grid.to_world((column + 0.5, row + 0.5))
        assert grid.values(centre) == grid.cells[row, column]


def test_the_first_row_is_the_lowest_and_the_origin_its_outer_corner() -> None:
    cells = np.array([[OCCUPIED, FREE], [FREE, FREE]], dtype=np.int8)
    grid = OccupancyGrid(cells, 0.5, (10.0, 20.0, math.pi / 2))
    assert grid.values([(9.75, 20.25), (9.25, 20.25), (9.75, 20.75), (10.25, 20.25)]).tolist() == [100, 0, 0, -1]


def test_a_footprint_without_area_is_a_point_and_a_thin_one_crosses_cells() -> None:
    cells = np.zeros((4, 4), dtype=np.int8)
    cells[2, 2] = OCCUPIED
    grid = OccupancyGrid(cells, 1.0)
    assert grid.occupied([(0.0, 0.0)], [(2.5, 2.5, 0.0), (1.5, 2.5, 0.0)]).tolist() == [True, False]
    assert grid.occupied([(0.0, 0.0), (4.0, 0.0)], [(0.0, 2.5, 0.0), (0.0, 3.5, 0.0)]).tolist() == [True, False]


def test_a_footprint_around_a_cell_meets_it() -> None:
    cells = np.zeros((5, 5), dtype=np.int8)
    cells[2, 2] = OCCUPIED
    grid = OccupancyGrid(cells, 1.0)
    assert grid.occupied([(-2, -2), (2, -2), (2, 2), (-2, 2)], [(2.5, 2.5, 0.0)]).tolist() == [True]


def test_many_poses_are_answered_in_parts() -> None:
    """As one by one: with windows of 200 × 200 cells a part has a hundred poses."""
    random = np.random.default_rng(1)
    cells = np.where(random.random((400, 400)) < 0.0005, OCCUPIED, FREE).astype(np.int8)
    grid = OccupancyGrid(cells, 0.05)
    polygon = [(5.0, -3.0), (5.0, 3.0), (-5.0, 3.0), (-5.0, -0.1), (4.0, -0.1)]
    poses = np.column_stack((random.uniform(-2, 22, (500, 2)), random.uniform(-4, 4, 500)))
    found = grid.occupied(polygon, poses)
    assert found.tolist() == [bool(grid.occupied(polygon, pose)[0]) for pose in poses]
    assert found.any() and not found.all()


@pytest.mark.parametrize("bad", [math.nan, math.inf])
def test_what_is_not_finite_is_refused(bad: float) -> None:
    grid = OccupancyGrid(np.zeros((2, 2), dtype=np.int8), 1.0)
    for polygon, pose in (([(bad, 0.0)], (0.0, 0.0, 0.0)), ([(0.0, 0.0)], (0.0, bad, 0.0)), ([], (0.0, 0.0, 0.0))):
        with pytest.raises(ValueError, match="finite"):
            grid.occupied(polygon, [pose])
    with pytest.raises(ValueError, match="radius"):
        grid.inflate(bad)
