"""Motions beside the one that is checked: of other joints, and of other robots. It loads no library."""

import math
from collections.abc import Mapping, Sequence
from typing import TypeVar

from linked_fleet_gateway.extensions.world.messages import MotionPath, PathSegment, Positions

MOST_CONFIGURATIONS = 24
"""Places on the way of another robot at which it may be met."""
CONFIGURATION_STEP = 0.05
"""The most that a joint moves (rad, m) from one of these places to the next, if there are not too many."""
Place = TypeVar("Place")


def thinned(way: Sequence[Place]) -> Sequence[Place]:
    """Return at most so many places of a way, evenly, with its end."""
    step = math.ceil(len(way) / MOST_CONFIGURATIONS) or 1
    return way[::-1][::step][::-1]


def paths_along(
    legs: tuple[PathSegment, ...], start: Positions, elsewhere: Mapping[str, float]
) -> tuple[MotionPath, ...]:
    """Return the paths along ``legs``, whose last one names all joints that move."""
    own = legs[-1].ends
    meanwhile = {name: end for name, end in elsewhere.items() if name not in own and name in start}
    ways = (MotionPath(start, legs),)
    if not meanwhile:
        return ways
    along = tuple(_beside(leg, (i + 1) / len(legs), start, meanwhile) for i, leg in enumerate(legs))
    return (*ways, MotionPath(start | meanwhile, legs), MotionPath(start, along))


def _beside(leg: PathSegment, share: float, start: Positions, meanwhile: Mapping[str, float]) -> PathSegment:
    there = {name: start[name] + share * (end - start[name]) for name, end in meanwhile.items()}
    return PathSegment(leg.ends | there)
