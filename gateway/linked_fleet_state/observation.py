"""Observed values: changes of at least the resolution, and positions outside the limits of the URDF. Pure.

A value is held until it moves by at least the resolution. A joint at its stop may read slightly beyond it, because of
its encoder or a soft stop. The tolerance covers that.
"""

import math
import struct
from collections.abc import Mapping, Sequence
from decimal import Decimal
from functools import lru_cache
from typing import Literal, NamedTuple

from linked_fleet_agent.wire.codec import layout
from linked_fleet_state.model import JointKind, RobotModel

TOLERANCE_RAD = 0.02
TOLERANCE_M = 0.002
FAULTY_AFTER_NS = 1_000_000_000

Bounds = tuple[float, float]


def bounds_of(model: RobotModel, joints: Sequence[str]) -> Mapping[str, Bounds]:
    """Return the stops of each joint (rad or m) widened by the tolerance; infinite if there are none.

    A joint between a soft limit and its stop is where it can be, though it is not sent there.
    """
    found = {}
    for name in joints:
        joint = model.joints[name]
        lower, upper = joint.stops
        tolerance = TOLERANCE_M if joint.kind is JointKind.PRISMATIC else TOLERANCE_RAD
        found[name] = (
            -math.inf if lower is None else lower - tolerance,
            math.inf if upper is None else upper + tolerance,
        )
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


MAX_HELD = 16_384  # several times the number of values of the largest robot


Mark = Literal["", "outside", "derived"]


class Observation(NamedTuple):
    """Rounded values, and the wall time (ns, agent) and sequence of the frame in which they last changed.

    ``mark`` says that the value is a position outside the limits of its joint, or derived from another joint.
    """

    values: tuple[float, ...]
    wall_ns: int | None
    sequence: int | None = None
    mark: Mark = ""


class Observations:
    """The held observation of each key; beyond ``MAX_HELD`` the oldest key is forgotten."""

    def __init__(self) -> None:
        self._held: dict[str, Observation] = {}

    def observe(
        self,
        key: str,
        values: tuple[float, ...],
        resolution: float,
        wall_ns: int | None,
        sequence: int | None = None,
        bounds: Bounds | None = None,
        derived: bool = False,
    ) -> Observation:
        held = self._held.get(key)
        if held is not None and not differ(held.values, values, resolution) and (held.mark == "derived") == derived:
            return held
        if held is None and len(self._held) >= MAX_HELD:
            del self._held[next(iter(self._held))]
        outside = bounds is not None and is_outside(values[0], bounds)
        mark: Mark = "derived" if derived else "outside" if outside else ""
        fresh = Observation(tuple([rounded(value, resolution) for value in values]), wall_ns, sequence, mark)
        self._held[key] = fresh
        return fresh

    def clear(self) -> None:
        self._held.clear()


def differ(old: tuple[float, ...], new: tuple[float, ...], least: float) -> bool:
    """Return True if a value differs by at least ``least``, or their numbers differ; unknown values are equal."""
    if len(old) != len(new):
        return True
    # A decimal step such as 0.3 - 0.2 is less than 0.1 by rounding, but counts as a whole step.
    least *= 1 - 1e-9
    for a, b in zip(old, new, strict=True):
        # NaN is tested last, because it is rare.
        if a != b and not abs(a - b) < least and not (math.isnan(a) and math.isnan(b)):
            return True
    return False


def rounded(value: float, resolution: float) -> float:
    """Return ``value`` rounded to a decimal multiple of ``resolution``, for short output; NaN stays NaN."""
    if not math.isfinite(value) or abs(value) > 1e15 * resolution or resolution <= 0:
        return value  # nothing to round beyond the digits of a float
    return round(round(value / resolution) * resolution, _digits(resolution)) + 0.0  # + 0.0 turns -0.0 into 0.0


@lru_cache(maxsize=64)
def _digits(resolution: float) -> int:
    exponent = Decimal(repr(resolution)).normalize().as_tuple().exponent
    return max(0, -exponent) if isinstance(exponent, int) else 0
