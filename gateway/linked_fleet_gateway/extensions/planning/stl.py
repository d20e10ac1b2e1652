"""Binary STL of surfaces and of convex hulls."""

import struct

import coal
import numpy as np

from linked_fleet_gateway.extensions.planning.kept import Kept
from linked_fleet_gateway.extensions.world.surfaces import Array, Indices

_STL = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attributes", "<u2")])


def stl_of(vertices: Array, triangles: Indices) -> bytes:
    """Return a file of triangles, which are rows of three indices into ``vertices``."""
    rows = np.zeros(len(triangles), dtype=_STL)
    rows["corners"] = vertices[triangles]
    return bytes(80) + struct.pack("<I", len(rows)) + rows.tobytes()


def _of_hull(hull: coal.CollisionGeometry) -> bytes:
    faces = [hull.polygons(i) for i in range(hull.num_polygons)]
    triangles = np.array([(each[0], each[1], each[2]) for each in faces], dtype=np.int32)
    return stl_of(np.array(hull.points(), dtype=float).reshape(-1, 3), triangles)


stl_of_hull = Kept(_of_hull)
"""Returns a file of a convex hull."""
