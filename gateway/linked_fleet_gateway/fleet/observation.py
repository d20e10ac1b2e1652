"""Change detection: a value is held until it moves by at least the resolution."""

import math
from decimal import Decimal
from functools import lru_cache
from typing import NamedTuple

from linked_fleet_gateway.fleet.limits import Bounds, is_outside

MAX_HELD = 16_384  # several times the number of values of the largest robot


class Observation(NamedTuple):
    """Rounded values, and the wall time (ns, agent) and sequence of the frame in which they last changed.

    ``outside`` says that the value is a position outside the limits of its joint.
    """

    values: tuple[float, ...]
    wall_ns: int | None
    sequence: int | None = None
    outside: bool = False


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
    ) -> Observation:
        held = self._held.get(key)
        if held is not None and not _moved(held.values, values, resolution):
            return held
        if held is None and len(self._held) >= MAX_HELD:
            del self._held[next(iter(self._held))]
        outside = bounds is not None and is_outside(values[0], bounds)
        fresh = Observation(tuple([rounded(value, resolution) for value in values]), wall_ns, sequence, outside)
        self._held[key] = fresh
        return fresh

    def clear(self) -> None:
        self._held.clear()


def _moved(old: tuple[float, ...], new: tuple[float, ...], resolution: float) -> bool:
    if len(old) != len(new):
        return True
    # A decimal step such as 0.3 - 0.2 is less than 0.1 by rounding, but counts as a whole step.
    least = resolution * (1 - 1e-9)
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
