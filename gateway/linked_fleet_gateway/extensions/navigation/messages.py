"""Messages between the gateway and the process that plans ways. Metre, radian, frame of the world; MessagePack."""

from typing import Literal

from msgspec import Struct

from linked_fleet_agent.planar import Pose

Point = tuple[float, float]
Polygon = tuple[Point, ...]
"""Corners of a convex polygon, counterclockwise."""
MAP, EDGE = "//map", "//corridor"
"""Names of the map of the floor, and of the edge of a corridor, beside those of robots and the paths of objects."""


class Obstacle(Struct, frozen=True):
    """Something on the floor, seen from above: one convex polygon, or several.

    ``name`` is that of a robot, the path of an object, ``MAP`` or ``EDGE``. A robot that moves is an obstacle on its
    way too, which ``passes``.
    """

    name: str
    polygons: tuple[Polygon, ...]
    passes: bool = False


class FloorCells(Struct, frozen=True):
    """The occupied cells of the map: rectangles of column, row, columns, rows as little-endian 16-bit numbers.

    ``origin`` is the corner of cell [0, 0]: x, y, yaw.
    """

    boxes: bytes
    resolution_m: float
    origin: tuple[float, float, float]


class ToPose(Struct, frozen=True, tag="pose"):
    """A goal: a place and, if it matters, a heading there."""

    at: Point
    heading: float | None = None


class Near(Struct, frozen=True, tag="near"):
    """A goal: any place beside an obstacle, looking at a point of it."""

    name: str
    at: Point


class AsideOf(Struct, frozen=True, tag="aside"):
    """A goal: the nearest place off these polygons."""

    kept_free: tuple[Polygon, ...]


Goal = ToPose | Near | AsideOf


class Strip(Struct, frozen=True):
    """A straight strip of the floor with round ends."""

    start: Point
    end: Point
    width_m: float


class PlanWay(Struct, frozen=True):
    """Plan the way of a base, whose ``outline`` is given in its own frame.

    One that drives sideways is ``lateral``. The way does not leave the strips of the ``corridor``, if there are any.
    """

    start: Pose
    goal: Goal
    outline: Polygon
    obstacles: tuple[Obstacle, ...] = ()
    cells: FloorCells | None = None
    corridor: tuple[Strip, ...] = ()
    lateral: bool = False


class Way(Struct, frozen=True, tag="way"):
    """A way: poses after the start, between which the base drives straight, and its length."""

    poses: tuple[Pose, ...]
    length_m: float


class Blocked(Struct, frozen=True, tag="blocked"):
    """There is no way. ``by`` are the names of the obstacles around the place that cannot be left or reached."""

    place: Literal["start", "goal", "between"]
    by: tuple[str, ...]


class TooFar(Struct, frozen=True, tag="far"):
    """The way is longer than can be planned at once."""

    most_m: float


class PlanFailed(Struct, frozen=True, tag="unable"):
    reason: str


Answer = Way | Blocked | TooFar | PlanFailed
