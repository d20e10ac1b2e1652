"""Positions in a frame that are outside the limits of the URDF. Pure.

A joint at its stop may read slightly beyond it, because of its encoder or a soft stop. The tolerance covers that.
"""

import math
import struct
from collections.abc import Mapping, Sequence
from functools import lru_cache

from linked_fleet_agent.wire.codec import layout
from linked_fleet_gateway.fleet.model import JointKind, RobotModel

TOLERANCE_RAD = 0.02
TOLERANCE_M = 0.002
FAULTY_AFTER_NS = 1_000_000_000

Bounds = tuple[float, float]
_ENDLESS: Bounds = (-math.inf, math.inf)


def bounds_of(model: RobotModel, joints: Sequence[str]) -> Mapping[str, Bounds]:
    """Return the limits of each joint (rad or m) widened by the tolerance; infinite if there are none."""
    found = {}
    for name in joints:
        joint, (lower, upper) = model.joints[name], _ENDLESS
        limits = joint.limits
        if limits.lower is not None and limits.upper is not None and limits.lower <= limits.upper:
            tolerance = TOLERANCE_M if joint.kind is JointKind.PRISMATIC else TOLERANCE_RAD
            lower, upper = limits.lower - tolerance, limits.upper + tolerance
        found[name] = (lower, upper)
    return found


def is_outside(value: float, bounds: Bounds) -> bool:
    """Return True for a position outside ``bounds``. NaN is unknown and infinity malformed, so both are not outside."""
    return math.isfinite(value) and not bounds[0] <= value <= bounds[1]


def joints_outside(payload: bytes, floating: bool, bounds: Mapping[str, Bounds]) -> list[tuple[str, float]]:
    """Return the joints outside their limits with their positions.

    ``bounds`` are those of all joints in frame order.
    """
    positions = _positions(len(bounds)).unpack_from(payload, _offset(floating))
    if all([low <= value <= high for value, (low, high) in zip(positions, bounds.values(), strict=True)]):
        return []
    found = zip(bounds.items(), positions, strict=True)
    return [(name, value) for (name, each), value in found if is_outside(value, each)]


@lru_cache(maxsize=256)
def _positions(joints: int) -> struct.Struct:
    return struct.Struct(f"<{joints}d")


@lru_cache(maxsize=2)
def _offset(floating: bool) -> int:
    return next(field.offset for field in layout(1, floating) if field.name == "positions")
