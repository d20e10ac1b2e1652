"""Paths of joints of which others move meanwhile. It loads no library."""

from collections.abc import Mapping

from linked_fleet_gateway.extensions.world.messages import MotionPath, PathSegment, Positions


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
