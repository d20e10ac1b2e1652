"""The map of the floor as a message of Foxglove. It runs in a thread, because it takes some ten milliseconds."""

import math

import numpy as np
import numpy.typing as npt
from foxglove import messages as fox

from linked_fleet_gateway.extensions.foxglove.messages import WORLD_FRAME, stamp_of
from linked_fleet_gateway.extensions.world.occupancy import FREE, OCCUPIED, UNKNOWN, OccupancyGrid

MAP_BYTES = 4 * 2**20
"""Limit for the cells of one message; of a larger map, several cells become one."""
_CELL = np.dtype([("red", "u1"), ("green", "u1"), ("blue", "u1"), ("alpha", "u1"), ("occupancy", "i1")])
_BY_RANK = np.array(
    [(254, 254, 254, 255, FREE), (205, 205, 205, 90, UNKNOWN), (0, 0, 0, 255, OCCUPIED)], dtype=_CELL
)  # of several cells that become one, the last counts
_NO_MAP = OccupancyGrid(np.full((1, 1), UNKNOWN, dtype=np.int8), 1.0)


def floor_grid(found: OccupancyGrid | None, stamp_ns: int) -> bytes:
    """Return a Grid message: colours, and the occupancy as in nav_msgs/OccupancyGrid. Without a map it is one cell."""
    grid = found or _NO_MAP
    ranks = np.where(grid.cells == OCCUPIED, 2, np.where(grid.cells == UNKNOWN, 1, 0)).astype(np.uint8)
    times = max(1, math.ceil(math.sqrt(ranks.size * _CELL.itemsize / MAP_BYTES)))
    cells, size_m = _BY_RANK[_coarser(ranks, times)], grid.resolution_m * times
    x, y, yaw = grid.origin
    kinds = fox.PackedElementFieldNumericType
    return fox.Grid(
        timestamp=stamp_of(stamp_ns),
        frame_id=WORLD_FRAME,
        pose=fox.Pose(
            position=fox.Vector3(x=x, y=y, z=0.0),
            orientation=fox.Quaternion(x=0.0, y=0.0, z=math.sin(yaw / 2), w=math.cos(yaw / 2)),
        ),
        column_count=cells.shape[1],
        cell_size=fox.Vector2(x=size_m, y=size_m),
        row_stride=cells.shape[1] * _CELL.itemsize,
        cell_stride=_CELL.itemsize,
        fields=[
            fox.PackedElementField(name=name, offset=offset, type=kinds.Int8 if name == "occupancy" else kinds.Uint8)
            for offset, name in enumerate(_CELL.names or ())
        ],
        data=cells.tobytes(),
    ).encode()


def _coarser(ranks: npt.NDArray[np.uint8], times: int) -> npt.NDArray[np.uint8]:
    """Return the greatest number of each square of ``times`` cells."""
    rows, columns = (-(-each // times) for each in ranks.shape)
    padded = np.zeros((rows * times, columns * times), dtype=np.uint8)
    padded[: ranks.shape[0], : ranks.shape[1]] = ranks
    found: npt.NDArray[np.uint8] = padded.reshape(rows, times, columns, times).max(axis=(1, 3))
    return found
