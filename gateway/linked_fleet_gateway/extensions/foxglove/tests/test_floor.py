"""The map of the floor as a grid, decoded by its own schema."""

import math
from typing import Any

import numpy as np
import pytest
from foxglove import messages as fox

from foxglove_messages import decoded
from linked_fleet_gateway.extensions.foxglove import floor
from linked_fleet_gateway.extensions.foxglove.floor import floor_grid
from linked_fleet_gateway.extensions.world.occupancy import FREE, OCCUPIED, UNKNOWN, OccupancyGrid

STAMP_NS = 1_700_000_000_000_000_007
CELLS = np.array(((FREE, UNKNOWN, OCCUPIED), (FREE, FREE, FREE), (UNKNOWN, UNKNOWN, UNKNOWN)), dtype=np.int8)


def read(content: bytes) -> Any:
    schema = fox.Grid.get_schema()
    return decoded(schema.name, schema.data, content)


def values(grid: Any, name: str) -> list[list[int]]:
    """Return a field of the cells as a viewer finds it, the lowest row first."""
    (field,) = (each for each in grid.fields if each.name == name)
    assert field.type == (2 if name == "occupancy" else 1)
    rows = [grid.data[at : at + grid.row_stride] for at in range(0, len(grid.data), grid.row_stride)]
    kind = np.int8 if name == "occupancy" else np.uint8
    found = [np.frombuffer(row, dtype=kind)[field.offset :: grid.cell_stride].tolist() for row in rows]
    assert all(len(row) == grid.column_count for row in found)
    return found


def test_a_grid_has_each_cell_at_its_place() -> None:
    grid = read(floor_grid(OccupancyGrid(CELLS, 0.5, (1.0, -2.0, math.pi / 2)), STAMP_NS))
    assert (grid.frame_id, grid.timestamp.seconds) == ("world", STAMP_NS // 10**9)
    assert (grid.pose.position.x, grid.pose.position.y, grid.pose.position.z) == (1.0, -2.0, 0.0)
    assert grid.pose.orientation.z == pytest.approx(math.sqrt(0.5))
    assert (grid.cell_size.x, grid.cell_size.y) == (0.5, 0.5)
    assert values(grid, "occupancy") == CELLS.tolist()
    assert values(grid, "red")[0] == [254, 205, 0]
    assert values(grid, "alpha")[2] == [90, 90, 90]


def test_of_several_cells_that_become_one_the_occupied_one_counts_and_then_the_unknown_one(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(floor, "MAP_BYTES", 20)
    grid = read(floor_grid(OccupancyGrid(CELLS, 0.5), STAMP_NS))
    assert len(grid.data) <= 20
    assert grid.cell_size.x == 1.0
    assert values(grid, "occupancy") == [[UNKNOWN, OCCUPIED], [UNKNOWN, UNKNOWN]]


def test_the_largest_map_fits_into_a_message() -> None:
    grid = read(floor_grid(OccupancyGrid(np.zeros((4_000, 4_000), dtype=np.int8), 0.05), STAMP_NS))
    assert len(grid.data) <= floor.MAP_BYTES
    assert grid.column_count * grid.cell_size.x == pytest.approx(200.0, abs=0.5)


def test_without_a_map_nothing_of_the_last_one_stays() -> None:
    assert values(read(floor_grid(None, STAMP_NS)), "occupancy") == [[UNKNOWN]]
