"""Small meshes for tests, as triangles and as binary STL."""

import struct
from collections.abc import Sequence
from itertools import product

from linked_fleet_gateway.extensions.world.surfaces import Surface, read_mesh

Point = tuple[float, ...]
Triangle = tuple[Point, ...]


def stl(triangles: Sequence[Triangle]) -> bytes:
    body = b"".join(struct.pack("<12fH", 0, 0, 0, *(x for p in each for x in p), 0) for each in triangles)
    return b"\0" * 80 + struct.pack("<I", len(triangles)) + body


def read(triangles: Sequence[Triangle]) -> Surface:
    return read_mesh("stl", stl(triangles))


def box(centre: Point, size: Point) -> list[Triangle]:
    """Return twelve triangles whose normals point outwards."""
    found: list[Triangle] = []
    for axis, side in product(range(3), (-1, 1)):
        one, other = (axis + 1) % 3, (axis + 2) % 3
        corners = []
        for u, v in ((-1, -1), (1, -1), (1, 1), (-1, 1)):
            point = list(centre)
            for where, sign in ((axis, side), (one, u), (other, v)):
                point[where] += sign * size[where] / 2
            corners.append(tuple(point))
        a, b, c, d = corners if side > 0 else corners[::-1]
        found += [(a, b, c), (a, c, d)]
    return found


BOX = box((0, 0, 0), (0.2, 0.3, 0.4))


def channel() -> list[Triangle]:
    """Return a U that is open towards y, 40 cm along x: bottom 5 cm thick, walls 2 cm, 16 cm between them."""
    depth, outline = 0.2, [
        (-0.1, -0.1), (0.1, -0.1), (0.1, 0.12), (0.08, 0.12),
        (0.08, -0.05), (-0.08, -0.05), (-0.08, 0.12), (-0.1, 0.12),
    ]  # fmt: skip
    found: list[Triangle] = []
    for (z, y), (z_next, y_next) in zip(outline, [*outline[1:], outline[0]], strict=True):
        a, b, c, d = (-depth, y, z), (-depth, y_next, z_next), (depth, y_next, z_next), (depth, y, z)
        found += [(a, b, c), (a, c, d)]
    caps = [(0, 1, 4), (0, 4, 5), (1, 2, 3), (1, 3, 4), (0, 5, 6), (0, 6, 7)]
    for x, order in ((depth, -1), (-depth, 1)):
        for cap in caps:
            found.append(tuple((x, outline[i][1], outline[i][0]) for i in cap[::-order]))
    return found


def plate(half: float) -> list[Triangle]:
    """Return a square without thickness, perpendicular to z."""
    a, b, c, d = (-half, -half, 0.0), (half, -half, 0.0), (half, half, 0.0), (-half, half, 0.0)
    return [(a, b, c), (a, c, d)]
