"""The limits of a joint. rad, rad/s, N·m (revolute, continuous) or m, m/s, N (prismatic).

Files write "no limit" in many ways. One rule holds for all who read them:

- velocity and effort: absent, zero, negative, infinite, or ``ENDLESS`` and more mean that no limit is known. A joint
  that may neither move nor push would be useless.
- position: infinite, or ``ENDLESS_POSITION`` and more mean that there is no limit at that end; an omitted end is zero
  (https://wiki.ros.org/urdf/XML/joint). If both ends are zero, no range is known: exporters write that for it.
- ``soft_lower_limit`` and ``soft_upper_limit`` of a ``<safety_controller>`` narrow the range for commands.
"""

import math
from dataclasses import dataclass, replace
from typing import Final
from xml.etree.ElementTree import Element

from linked_fleet_agent.urdf.document import UrdfError
from linked_fleet_agent.urdf.values import Findings, extended_number, named, only

ENDLESS: Final = 1e9
ENDLESS_POSITION: Final = 1e6


@dataclass(frozen=True)
class Limits:
    """Limits of one joint in rad, rad/s, N·m (revolute) or m, m/s, N (prismatic); None is unbounded or unknown."""

    lower: float | None = None
    upper: float | None = None
    velocity: float | None = None
    effort: float | None = None

    def clamp(self, position: float) -> float:
        """Return the position nearest to ``position`` within the limits."""
        if self.lower is not None:
            position = max(position, self.lower)
        return position if self.upper is None else min(position, self.upper)

    def including(self, position: float) -> "Limits":
        """Return the limits, extended to a ``position`` beyond them; NaN extends nothing."""
        lower = None if self.lower is None else min(self.lower, position)
        upper = None if self.upper is None else max(self.upper, position)
        return replace(self, lower=lower, upper=upper)


NO_LIMITS: Final = Limits()
Range = tuple[float | None, float | None]
"""Lowest and highest position; None is no known limit."""


@dataclass(frozen=True)
class JointLimits:
    """``limits`` hold for commands; ``stops`` is the range that the joint can reach, also beyond its soft limits.

    ``unranged`` says why no range is known in which the joint may be moved; empty if one is, or if it needs none.
    """

    limits: Limits = NO_LIMITS
    stops: Range = (None, None)
    unranged: str = ""


def limits_of(joint: Element, name: str, has_range: bool, findings: Findings) -> JointLimits:
    """Return the limits of a joint; ``has_range`` is False for a continuous one, whose positions have none."""
    limit = only(joint, "limit", "joint", name, findings)
    try:
        velocity, effort = (_capacity(limit, attribute, name) for attribute in ("velocity", "effort"))
        _report_unknown(limit, {"velocity": velocity, "effort": effort}, name, findings)
        if not has_range:
            return JointLimits(Limits(velocity=velocity, effort=effort))
        stops = _stops(limit, name)
        lower, upper = _softened(joint, stops, name, findings)
    except UrdfError as error:
        return JointLimits(unranged=str(error))
    return JointLimits(Limits(lower, upper, velocity, effort), stops, _why_unranged(limit, (lower, upper)))


def _capacity(limit: Element | None, attribute: str, name: str) -> float | None:
    """Return the limit of velocity or effort; None if none is known."""
    text = None if limit is None else limit.get(attribute)
    value = 0.0 if text is None else extended_number(text, f"the {attribute} limit of joint {name!r}")
    return value if 0 < value < ENDLESS else None


def _report_unknown(limit: Element | None, found: dict[str, float | None], name: str, findings: Findings) -> None:
    """Report limits that the file states without a usable value. An absent one speaks for itself."""
    stated = [
        f"{attribute} {limit.get(attribute, '')[:40]!r}"
        for attribute, value in found.items()
        if limit is not None and value is None and limit.get(attribute) is not None
    ]
    if stated:
        means = "which means that no limit is known" if len(stated) == 1 else "which mean that no limits are known"
        findings.add("joint", name, f"{named('joint', name)} has the limit of {' and '.join(stated)}, {means}.")


def _stops(limit: Element | None, name: str) -> Range:
    """Return the range of positions. Raises UrdfError if it contradicts itself."""
    if limit is None:
        return None, None
    lower, upper = (
        extended_number(limit.get(end, "0"), f"the {end} limit of joint {name!r}") for end in ("lower", "upper")
    )
    if lower > upper:
        raise UrdfError(f"the lower limit of joint {name!r}, {lower}, is above its upper limit, {upper}")
    if lower == upper == 0:
        return None, None
    return _end(lower), _end(upper)


def _end(value: float) -> float | None:
    return value if abs(value) < ENDLESS_POSITION else None


def _softened(joint: Element, stops: Range, name: str, findings: Findings) -> Range:
    """Return the range for commands: that of the stops and of the soft limits. Raises UrdfError if nothing is left."""
    safety = only(joint, "safety_controller", "joint", name, findings)
    soft = [None if safety is None else safety.get(f"soft_{end}_limit") for end in ("lower", "upper")]
    if soft == [None, None]:
        return stops
    low, high = (
        end if text is None else extended_number(text, f"a soft limit of joint {name!r}")
        for text, end in zip(soft, (-math.inf, math.inf), strict=True)
    )
    if low == high == 0:  # the default of readers of ROS, which means none
        return stops
    lower, upper = (-math.inf if stops[0] is None else stops[0]), (math.inf if stops[1] is None else stops[1])
    low, high = max(low, lower), min(high, upper)
    if low > high:
        raise UrdfError(f"the soft limits of joint {name!r} leave no position within its limits")
    if (low, high) != (lower, upper):
        within = f"; its stops are at {lower:g} and {upper:g}"
        sentence = f"{named('joint', name)} is moved between its soft limits {low:g} and {high:g} only{within}."
        findings.add("joint", name, sentence)
    return _end(low), _end(high)


def _why_unranged(limit: Element | None, between: Range) -> str:
    if limit is None:
        return "it has no <limit>"
    if None not in between:
        return ""
    stated = ", ".join(f"{end} {limit.get(end, 'absent')[:40]!r}" for end in ("lower", "upper"))
    return f"its <limit> states no range ({stated})"
