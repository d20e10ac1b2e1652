"""The limits of joints as numbers of shapes, in every unit that a body may use.

They are rounded inwards. A position at its limit that is shown rounded outwards is accepted as well.
"""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from decimal import Decimal

from pyoxigraph import Literal, NamedNode

from linked_fleet_gateway.resources.joint_kinds import POSITION_RESOLUTION, kind_of
from linked_fleet_rdf.graph import ANGULAR, LINEAR, Dimension, Unit, lexical
from linked_fleet_rdf.vocabulary import LF, XSD
from linked_fleet_state.model import Joint, JointKind
from linked_fleet_state.observation import rounded

_DIGITS = 6  # limits are rounded inwards to a millionth of the unit, so that the robot accepts what the shape accepts
_FARTHEST = 1e9  # of any unit; a number beyond is no limit, and has no whole millionths in a double
MAX_TURNS = 10  # most turns of a continuous joint in one motion
_FASTEST = {ANGULAR: 10.0, LINEAR: 10.0}  # rad/s or m/s, stated for a joint without a velocity limit


@dataclass(frozen=True)
class JointLimits:
    """All that shapes state about one joint: the numbers of each completion in ``NUMBERS``, in the order of its units.

    Shapes of two joints of a robot differ in these numbers alone if dimension and ``is_continuous`` are equal.
    """

    dimension: Dimension
    is_continuous: bool
    """True for a continuous joint."""
    numbers: Mapping[NamedNode, Sequence[Literal]]


def dimension_of(joint: Joint) -> Dimension:
    dimension = kind_of(joint).dimension
    assert dimension is not None
    return dimension


def position_bounds(joint: Joint, unit: Unit) -> tuple[float, float]:
    """Return the lowest and highest position in ``unit``; a continuous joint has 0 up to, excluding, one turn."""
    if joint.kind is JointKind.CONTINUOUS:
        return 0.0, round(math.tau / unit.si, _DIGITS)
    low, high = joint.limits.lower, joint.limits.upper
    assert low is not None and high is not None
    (low_exact, high_exact), (low_shown, high_shown) = (
        _inwards(below / unit.si, above / unit.si) for below, above in ((low, high), map(_shown, (low, high)))
    )
    return min(low_exact, low_shown), max(high_exact, high_shown)


def _shown(position: float) -> float:
    """Return a position as it is read: whoever reads it at the limit can send it back. Actions clamp it."""
    return rounded(position, POSITION_RESOLUTION)


def _inwards(low: float, high: float) -> tuple[float, float]:
    """Return both limits in a millionth of the unit, and at most ``_FARTHEST``: files have limits of 1.8e308."""
    low, high = max(low, -_FARTHEST), min(high, _FARTHEST)
    scale = 10**_DIGITS
    return math.ceil(low * scale - 1e-3) / scale, math.floor(high * scale + 1e-3) / scale


def limits_of(joint: Joint, completions: Iterable[NamedNode]) -> JointLimits:
    """Return the limits of the joint that these completions state; those that state no limits are skipped."""
    numbers = {each: NUMBERS[each](joint) for each in completions if each in NUMBERS}
    return JointLimits(dimension_of(joint), joint.kind is JointKind.CONTINUOUS, numbers)


def _positions(joint: Joint) -> list[Literal]:
    """Return the lowest and the highest position in each unit."""
    return [number for unit in dimension_of(joint).accepted for number in position_limits(joint, unit)]


def position_limits(joint: Joint, unit: Unit) -> tuple[Literal, Literal]:
    """Return the lowest and the highest position in one unit; a continuous joint excludes the highest."""
    low, high = position_bounds(joint, unit)
    return minimum_literal(low), double_literal(high) if joint.kind is JointKind.CONTINUOUS else maximum_literal(high)


def _displacements(joint: Joint) -> list[Literal]:
    """Return the lowest and the highest displacement in each unit."""
    limits = joint.limits
    if joint.kind is JointKind.CONTINUOUS:
        span = MAX_TURNS * math.tau
    else:
        assert limits.lower is not None and limits.upper is not None
        span = limits.upper - limits.lower
    found: list[Literal] = []
    for unit in dimension_of(joint).accepted:
        low, high = _inwards(-span / unit.si, span / unit.si)
        found += (minimum_literal(low), maximum_literal(high))
    return found


def _speeds(joint: Joint) -> list[Literal]:
    """Return the highest speed in each unit."""
    dimension = dimension_of(joint)
    fastest = joint.limits.velocity or _FASTEST[dimension]
    return [maximum_literal(_inwards(0.0, fastest / unit.si)[1]) for unit in dimension.speeds]


NUMBERS: dict[NamedNode, Callable[[Joint], Sequence[Literal]]] = {
    LF.jointPosition: _positions,
    LF.jointDisplacement: _displacements,
    LF.jointSpeed: _speeds,
}
"""Completions that depend on the joint, and the numbers that they state about it."""


def minimum_literal(value: float) -> Literal:
    """Return ``value``, of ``_DIGITS`` decimal places, as the lowest conforming number."""
    return double_literal(-_reaching(-value))


def maximum_literal(value: float) -> Literal:
    """Return ``value``, of ``_DIGITS`` decimal places, as the highest conforming number."""
    return double_literal(_reaching(value))


def double_literal(value: float) -> Literal:
    """Return a limit as a double. With a decimal limit pySHACL would raise an exception on a NaN in the body."""
    return Literal(lexical(value), datatype=XSD.double)


def _reaching(value: float) -> float:
    """Return the first double at or above ``value`` that is not below the decimal forms of itself and of ``value``.

    Validators compare a double and a decimal exactly, and half of all doubles are below the decimal with their digits.
    """
    stated = Decimal(f"{value:.{_DIGITS}f}")
    while Decimal(value) < max(stated, Decimal(repr(value))):
        value = math.nextafter(value, math.inf)
    return value
