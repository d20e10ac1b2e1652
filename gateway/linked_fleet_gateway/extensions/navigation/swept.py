"""The floor that a base covers on a way. Pure. Metre, radian."""

import math
from collections.abc import Iterator, Sequence
from itertools import pairwise

from linked_fleet_agent.planar import Pose
from linked_fleet_gateway.extensions.navigation.messages import Point, Polygon
from linked_fleet_state.driving import pieces, through

MARGIN_M = 0.1


def swept(outline: Polygon, start: Pose, way: Sequence[Pose], lateral: bool) -> Iterator[Polygon]:
    """Yield convex polygons that contain the base on its way, with a margin: one for each leg, and for each turn."""
    wide = [_widened(each) for each in outline]
    for piece in pieces(start, through(start, way, lateral)):
        yield hull([corner for pose in piece for corner in _placed(wide, pose)])


def _widened(corner: Point) -> Point:
    far = math.hypot(*corner)
    share = 1.0 + MARGIN_M / far if far else 1.0
    return corner[0] * share, corner[1] * share


def _placed(corners: Sequence[Point], pose: Pose) -> list[Point]:
    cosine, sine = math.cos(pose.heading), math.sin(pose.heading)
    return [(pose.x + x * cosine - y * sine, pose.y + x * sine + y * cosine) for x, y in corners]


def hull(points: Sequence[Point]) -> Polygon:
    """Return the convex hull, counterclockwise (Andrew, 1979)."""
    ordered = sorted(set(points))
    if len(ordered) < 3:
        return tuple(ordered)
    lower, upper = _chain(ordered), _chain(ordered[::-1])
    return (*lower[:-1], *upper[:-1])


def _chain(points: Sequence[Point]) -> list[Point]:
    found = list[Point]()
    for point in points:
        while len(found) > 1 and _turn(found[-2], found[-1], point) <= 0.0:
            found.pop()
        found.append(point)
    return found


def _turn(a: Point, b: Point, c: Point) -> float:
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])


def meets(one: Polygon, other: Polygon) -> bool:
    """Return True if two convex polygons overlap or touch (separating axes)."""
    return not any(_separates(edges, one, other) for edges in (one, other))


def _separates(edges: Polygon, one: Polygon, other: Polygon) -> bool:
    for (x1, y1), (x2, y2) in pairwise((*edges, edges[0])):
        across = (y2 - y1, x1 - x2)
        mine = [x * across[0] + y * across[1] for x, y in one]
        yours = [x * across[0] + y * across[1] for x, y in other]
        if max(mine) < min(yours) or max(yours) < min(mine):
            return True
    return False
