"""Measured joint positions, as far as they can be believed. Pure: times are passed in; SI units.

A joint moves at a bounded speed. A position that contradicts the ones before is a fault of its sensor: an outlier, the
seam of an encoder, or two publishers that disagree. The position of such a joint is unknown until its sensor has been
consistent for ``TRUST_S``. Standstill is that of measured positions over time, never a measured velocity, which may be
missing or zero.
"""

import math

from linked_fleet_agent.urdf.facts import JointFacts

TRUST_S = 1.0
"""Time without contradiction after which a sensor is believed again."""
STANDSTILL_RAD, STANDSTILL_M = 2e-3, 4e-4
"""A joint stands while its position stays within this much of one place."""
# What is possible beyond the URDF's velocity limit, which is often a guess: another controller, gravity or a hand may
# move the joint.
_FASTER = 3.0
_UNKNOWN_RAD_S, _UNKNOWN_M_S = 3.0, 0.5
_SLOWEST_RAD_S, _SLOWEST_M_S = 1.0, 0.2
_FASTEST = 100.0
# Noise, and the resolution of coarse encoders.
_NOISE_RAD, _NOISE_M = 0.02, 5e-3
# Messages that were held up arrive at once: each may be one period ahead of its arrival, and all together this much.
_BURST_S = 0.2
_LONGEST_PERIOD_S = 0.1


class JointSensor:
    """The sensor of one joint, which is read about every ``period_s`` seconds."""

    __slots__ = (
        "_anchor", "_at_s", "_burst", "_counted_s", "_doubted_s", "_joint", "_last", "_noise",
        "_period_s", "_quiet", "_since_s", "_speed", "_still", "_travel", "fault",
    )  # fmt: skip

    def __init__(self, joint: JointFacts, period_s: float) -> None:
        self.fault = ""
        """A sentence about the contradiction that makes the position unknown; empty if there is none."""
        self._joint = joint
        limit = joint.limits.velocity or (_UNKNOWN_M_S if joint.linear else _UNKNOWN_RAD_S)
        self._speed = min(max(_FASTER * limit, _SLOWEST_M_S if joint.linear else _SLOWEST_RAD_S), _FASTEST)
        self._noise, self._still = (_NOISE_M, STANDSTILL_M) if joint.linear else (_NOISE_RAD, STANDSTILL_RAD)
        self._quiet = self._still / 2.0
        self._burst = self._speed * _BURST_S + self._noise
        self._period_s = min(period_s, _LONGEST_PERIOD_S)
        self._last = self._anchor = math.nan
        self._at_s = self._since_s = self._doubted_s = self._counted_s = 0.0
        self._travel = 0.0

    def update(self, position: float, at_s: float) -> float:
        """Return ``position``, measured at ``at_s``, if it can be believed, else NaN."""
        way, gap_s = position - self._last, at_s - self._at_s
        if self.fault or not -self._quiet <= way <= self._quiet:
            reach = self._speed * gap_s
            if self.fault or self._travel or not -reach <= way <= reach:
                return self._judged(position, at_s)
            self._counted_s = at_s  # it moves as fast as it may, which most samples of moving joints show
            self._expect(gap_s)
        self._at_s, self._last = at_s, position
        if not -self._still <= position - self._anchor <= self._still:
            self._anchor, self._since_s = position, at_s
        return position

    def _judged(self, position: float, at_s: float) -> float:
        last = self._last
        if position != position or (position == last and at_s == self._at_s):
            return math.nan if self.fault else position
        if last != last:
            self._last = self._anchor = position
            self._at_s = self._since_s = self._counted_s = at_s
            return position
        self._judge(abs(self._joint.difference(position, last)), position, at_s)
        if self.fault and at_s - self._doubted_s >= TRUST_S:
            self.fault = ""
        return math.nan if self.fault else position

    def _judge(self, way: float, position: float, at_s: float) -> None:
        gap_s = max(0.0, at_s - self._at_s)
        self._travel = max(0.0, self._travel + way - self._speed * max(0.0, at_s - self._counted_s))
        self._last, self._at_s, self._counted_s = position, at_s, at_s
        possible = self._noise + self._speed * max(gap_s, 2.0 * self._period_s)
        if way > possible or self._travel > self._burst:
            self._doubt(way, gap_s, possible)
        self._expect(gap_s)
        if abs(self._joint.difference(position, self._anchor)) > self._still:
            self._anchor, self._since_s = position, at_s

    def _expect(self, gap_s: float) -> None:
        """Learn the period of the samples."""
        self._period_s += 0.05 * ((gap_s if gap_s < _LONGEST_PERIOD_S else _LONGEST_PERIOD_S) - self._period_s)

    def forget(self) -> None:
        """Take the next position as the first one."""
        self._last, self.fault, self._travel = math.nan, "", 0.0

    @property
    def standing_s(self) -> float:
        """Time in seconds for which the joint has been measured in one place; 0 while it cannot be believed."""
        return 0.0 if self.fault or self._last != self._last else self._at_s - self._since_s

    def _doubt(self, way: float, gap_s: float, possible: float) -> None:
        self._doubted_s, self._travel = self._at_s, 0.0
        self._anchor, self._since_s = self._last, self._at_s
        name, unit = self._joint.name, self._joint.unit
        self.fault = (
            f"the sensor of {name} contradicts itself: the position changed by {way:.3g} {unit} within "
            f"{1e3 * gap_s:.0f} ms, and {possible:.3g} {unit} are possible"
        )
