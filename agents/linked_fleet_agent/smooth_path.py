"""Smooth ways along a list of positions: straight lines, and corners that a base can drive without stopping. Pure.

A corner is driven on a curve whose curvature rises and falls evenly with the way, so that the rate of turning never
jumps. SI units.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

TOLERANCE_M = 0.05
"""The most by which a way leaves the list of positions."""
_THINNING_M = 0.02
"""The part of the tolerance by which positions may be off the way that leaves them out."""
SHARPEST_RAD = 1.75
"""A base stops at corners that are sharper."""
_FLAT = 1e-9
_LEAST_M = 0.01
"""Positions that are nearer together count as one."""
_TERMS = 5

Position = tuple[float, float]


class Point(NamedTuple):
    """A point of a way: position (m), direction (rad) and curvature (1/m)."""

    x: float
    y: float
    direction: float
    curvature: float


@dataclass(frozen=True)
class Line:
    """A straight piece."""

    start: Position
    direction: float
    length: float
    sharpness = curvature = 0.0

    def at(self, way_m: float) -> Point:
        cosine, sine = math.cos(self.direction), math.sin(self.direction)
        return Point(self.start[0] + way_m * cosine, self.start[1] + way_m * sine, self.direction, 0.0)


@dataclass(frozen=True)
class Corner:
    """A piece that turns by ``angle``. Its curvature rises evenly over ``half`` metres, and falls over as many."""

    start: Position
    direction: float
    angle: float
    half: float

    @property
    def length(self) -> float:
        return 2.0 * self.half

    @property
    def curvature(self) -> float:
        """The most, in the middle."""
        return abs(self.angle) / self.half

    @property
    def sharpness(self) -> float:
        """The change of the curvature with the way."""
        return self.curvature / self.half

    def at(self, way_m: float) -> Point:
        if way_m <= self.half:
            along, across = _spiral(way_m / self.half, self.angle)
            turned, curvature = self.angle * (way_m / self.half) ** 2 / 2.0, self.angle * way_m / self.half**2
            return self._placed(along, across, turned, curvature)
        left = max(self.length - way_m, 0.0)
        along, across = self._mirrored(left / self.half)
        turned = self.angle - self.angle * (left / self.half) ** 2 / 2.0
        return self._placed(along, across, turned, self.angle * left / self.half**2)

    def _mirrored(self, share: float) -> Position:
        """Return where it is, in halves, with ``share`` of its second half to go."""
        reach, _ = _reach(self.angle)
        along, across = _spiral(share, self.angle)
        cosine, sine = math.cos(self.angle), math.sin(self.angle)
        # The end is as far from the tip of the corner as the start; from there it looks the same backwards.
        back = reach - along
        return reach + back * cosine - across * sine, back * sine + across * cosine

    def _placed(self, along: float, across: float, turned: float, curvature: float) -> Point:
        cosine, sine = math.cos(self.direction), math.sin(self.direction)
        x = self.start[0] + self.half * (along * cosine - across * sine)
        y = self.start[1] + self.half * (along * sine + across * cosine)
        return Point(x, y, self.direction + turned, curvature)


Piece = Line | Corner


def _spiral(share: float, angle: float) -> Position:
    """Return where a spiral is after a share of its length, in lengths, if it turns by half of ``angle`` over all."""
    half, x, y, term = angle / 2.0, 0.0, 0.0, share
    for order in range(_TERMS):
        x += term / (4 * order + 1)
        term *= half * share**2 / (2 * order + 1)
        y += term / (4 * order + 3)
        term *= -half * share**2 / (2 * order + 2)
    return x, y


def _reach(angle: float) -> tuple[float, float]:
    """Return how far the start of a corner is from its tip, and how far its middle, in halves of the corner."""
    x, y = _spiral(1.0, abs(angle))
    half = abs(angle) / 2.0
    return x + y * math.tan(half), y / math.cos(half)


def distinct(positions: Sequence[Position]) -> list[int]:
    """Return the indices of positions that are apart from the one before, and the last one unless it is very near."""
    kept = [0]
    for index in range(1, len(positions)):
        if math.dist(positions[index], positions[kept[-1]]) >= _LEAST_M:
            kept.append(index)
    if len(kept) > 1 and math.dist(positions[-1], positions[kept[-2]]) >= _LEAST_M:
        kept[-1] = len(positions) - 1
    return kept


def thinned(positions: Sequence[Position], off: Sequence[float] | None = None) -> list[int]:
    """Return the indices of positions without those that are near the straight way that leaves them out.

    ``off`` are further coordinates, in metres, in which a position counts as far from the way.
    """
    further = [0.0] * len(positions) if off is None else off
    kept, open_ = {0, len(positions) - 1}, [(0, len(positions) - 1)]
    while open_:
        first, last = open_.pop()
        worst, index = max(
            ((_aside(positions, further, first, last, each), each) for each in range(first + 1, last)),
            default=(0.0, first),
        )
        if worst > _THINNING_M:
            kept.add(index)
            open_ += [(first, index), (index, last)]
    return sorted(kept)


def _aside(positions: Sequence[Position], further: Sequence[float], first: int, last: int, index: int) -> float:
    (x1, y1), (x2, y2), (x, y) = positions[first], positions[last], positions[index]
    square = (x2 - x1) ** 2 + (y2 - y1) ** 2
    share = 0.0 if square == 0.0 else ((x - x1) * (x2 - x1) + (y - y1) * (y2 - y1)) / square
    share = min(max(share, 0.0), 1.0)
    expected = further[first] + share * (further[last] - further[first])
    return math.hypot(x - x1 - share * (x2 - x1), y - y1 - share * (y2 - y1), further[index] - expected)


def stretches(positions: Sequence[Position]) -> list[list[Piece]]:
    """Return the pieces of the way along distinct positions. A base stops, and turns, after each list of pieces."""
    directions = [math.atan2(y2 - y1, x2 - x1) for (x1, y1), (x2, y2) in pairwise(positions)]
    lengths = [math.dist(*each) for each in pairwise(positions)]
    found, pieces, used = list[list[Piece]](), list[Piece](), 0.0
    for index, (direction, length) in enumerate(zip(directions, lengths, strict=True)):
        turn = math.remainder(directions[index + 1] - direction, math.tau) if index + 1 < len(lengths) else math.inf
        stops = abs(turn) > SHARPEST_RAD
        half, reach = (0.0, 0.0) if stops else _corner(turn, min(length, lengths[index + 1]) / 2.0)
        start = _ahead(positions[index], direction, used)
        pieces.append(Line(start, direction, max(length - used - reach, 0.0)))
        if not stops:
            pieces.append(Corner(_ahead(positions[index + 1], direction, -reach), direction, turn, half))
        if stops:
            found.append(pieces)
            pieces = []
        used = reach
    return found


def _corner(angle: float, most_m: float) -> tuple[float, float]:
    """Return half the length of a corner within the tolerance, and how far before its tip it begins."""
    reach, cut = _reach(angle)
    half = min((TOLERANCE_M - _THINNING_M) / max(cut, _FLAT), most_m / reach)
    return half, half * reach


def _ahead(start: Position, direction: float, way_m: float) -> Position:
    return start[0] + way_m * math.cos(direction), start[1] + way_m * math.sin(direction)
