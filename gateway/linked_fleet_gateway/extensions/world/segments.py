"""Positions of joints on a segment of a path, by its completed share or by time. It loads no library.

Radian, metre, second.
"""

from bisect import bisect_right
from typing import TYPE_CHECKING

from linked_fleet_gateway.extensions.world.messages import PathSegment

if TYPE_CHECKING:
    from linked_fleet_gateway.extensions.world.surfaces import Array


def interpolate(leg: PathSegment, name: str, start: float, share: "float | Array") -> "float | Array":
    """Return positions on a cubic Hermite or linear leg."""
    end = leg.ends[name]
    if not leg.duration_s:
        return start + share * (end - start)
    enters, leaves = (
        leg.start_velocities.get(name, 0.0) * leg.duration_s,
        leg.end_velocities.get(name, 0.0) * leg.duration_s,
    )
    a, b = 2 * (start - end) + enters + leaves, 3 * (end - start) - 2 * enters - leaves
    return start + share * (enters + share * (b + share * a))


def lasts_s(leg: PathSegment) -> float:
    """Return the time that a segment takes; 0 if it is unknown."""
    return leg.timing[-1][0] if leg.timing else leg.duration_s


def share_at(leg: PathSegment, time_s: float) -> float:
    """Return the completed share of a segment at a time after its start."""
    if time_s >= lasts_s(leg):
        return 1.0
    if not leg.timing:
        return max(0.0, time_s / leg.duration_s)
    after = bisect_right(leg.timing, (time_s, 1.0), lo=1)
    (before_s, before), (after_s, share) = leg.timing[after - 1], leg.timing[after]
    return before + max(0.0, time_s - before_s) / (after_s - before_s) * (share - before)
