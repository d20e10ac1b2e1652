"""Forms of objects in scenes of planning: boards that make a table or a shelf, as meshes of the world. Metre."""

import math
import struct
from collections.abc import Iterable

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from linked_fleet_gateway.extensions.world.scene import TriangleMesh
from linked_fleet_state.model import Pose

Array = npt.NDArray[np.float64]
Board = tuple[Iterable[float], Iterable[float]]
"""Size and centre of a box."""
_BOARD_M = 0.025
_LEG_M = 0.05
_CORNERS = np.array(list(np.ndindex(2, 2, 2))) - 0.5
_FACES = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))
_TRIANGLES = [each for a, b, c, d in _FACES for each in ((a, b, c), (a, c, d))]


def table(length: float, width: float, height: float) -> TriangleMesh:
    """Return a table; its origin is the middle of its top."""
    x, y = length / 2 - _LEG_M, width / 2 - _LEG_M
    legs = [((_LEG_M, _LEG_M, height), (a * x, b * y, -height / 2)) for a in (-1, 1) for b in (-1, 1)]
    return boards([((length, width, _BOARD_M), (0, 0, 0)), *legs])


def shelf(depth: float, width: float, height: float) -> TriangleMesh:
    """Return a shelf with two compartments, open towards -x; its origin is the middle of the lower one."""
    floors = [((depth, width, _BOARD_M), (0, 0, (n - 0.5) * height)) for n in range(3)]
    sides = [((depth, _BOARD_M, 2 * height), (0, side * width / 2, height / 2)) for side in (-1, 1)]
    return boards([*floors, *sides, ((_BOARD_M, width, 2 * height), (depth / 2, 0, height / 2))])


def boards(each: Iterable[Board]) -> TriangleMesh:
    """Return a mesh of boxes."""
    corners = [np.array(centre) + _CORNERS * np.array(size) for size, centre in each]
    triangles = np.concatenate([points[_TRIANGLES] for points in corners])
    rows = b"".join(struct.pack("<12fH", 0, 0, 0, *triangle.ravel(), 0) for triangle in triangles)
    return TriangleMesh(bytes(80) + struct.pack("<I", len(triangles)) + rows)


def corners_of(mesh: TriangleMesh) -> Array:
    """Return the triangles of a mesh: rows of three corners."""
    rows = [each for each in struct.iter_unpack("<12x9f2x", mesh.stl[84:])]
    return np.array(rows).reshape(-1, 3, 3)


def turned_to(x: Array, z: Array) -> Array:
    """Return the rotation whose axes x and z have these directions."""
    return np.column_stack([x, np.cross(z, x), z])


def pose(at: Iterable[float], turn: Array) -> Pose:
    x, y, z = (float(each) for each in at)
    qx, qy, qz, qw = pin.Quaternion(turn).normalized().coeffs().tolist()
    length = math.hypot(qx, qy, qz, qw)
    return Pose((x, y, z), (qx / length, qy / length, qz / length, qw / length))
