"""The last setpoint of each joint. Pure; SI units.

All setpoints of an agent pass here: none is further from the one before than the speed of the joint and the time allow,
whatever was measured. The setpoint of a joint that nothing drives follows its measured position, at no more than this
speed. So a motion that begins after something else has moved the joint starts where the joint is.
"""

import logging
import math
from collections.abc import Collection, Iterable, Mapping

from linked_fleet_agent.robot import JointFacts
from linked_fleet_agent.urdf.cruise import MAX_CRUISE_M_S, MAX_CRUISE_RAD_S

_log = logging.getLogger(__name__)

HOLDING = 0.01
"""A joint at rest that is further from its setpoint (rad or m) was moved by something else; a nearer one only sags."""
_FASTEST = 100.0
_ROUNDING = 1e-9


def rate_of(joint: JointFacts) -> float:
    """Return the highest speed of the setpoints of ``joint``, in rad/s or m/s: the URDF's limit, if it states one."""
    return min(joint.limits.velocity or (MAX_CRUISE_M_S if joint.linear else MAX_CRUISE_RAD_S), _FASTEST)


class Setpoints:
    """The last setpoints of ``joints``; NaN before the first measurement of a joint."""

    def __init__(self, joints: Iterable[JointFacts]) -> None:
        self._joints = {joint.name: joint for joint in joints}
        self._rates = {name: rate_of(joint) for name, joint in self._joints.items()}
        self._last = dict.fromkeys(self._rates, math.nan)
        self._limited: set[str] = set()
        self._displaced: set[str] = set()

    def __getitem__(self, joint: str) -> float:
        return self._last[joint]

    def follow(self, measured: Iterable[float], driven: Collection[str], dt_s: float) -> None:
        """Let the setpoints of joints that are not ``driven`` follow the measured positions for ``dt_s`` seconds."""
        last, displaced = self._last, self._displaced
        for name, position in zip(last, measured, strict=True):
            before = last[name]
            way = position - before
            if -HOLDING <= way <= HOLDING and name not in displaced:
                continue
            if before != before:
                last[name] = position
            elif name not in driven and position == position:
                most = self._rates[name] * dt_s
                if name in displaced and -most <= way <= most <= math.pi:  # the nearest way, also of an endless joint
                    last[name] = position
                else:
                    self._pursue(name, position, most)

    def _pursue(self, name: str, position: float, most: float) -> None:
        """Let the setpoint of a joint that something else has moved follow it, by ``most`` at most."""
        way = self._joints[name].difference(position, self._last[name])
        if abs(way) > HOLDING:
            self._displaced.add(name)
        if name in self._displaced:
            self._last[name] += min(max(way, -most), most)

    def release(self, joints: Iterable[str]) -> None:
        """Follow the measured positions of these joints also over short ways, because something else moves them now."""
        self._displaced |= self._last.keys() & set(joints)

    def keep(self, joints: Iterable[str]) -> None:
        """Take back ``release``: setpoints move these joints."""
        self._displaced.difference_update(joints)

    def limit(self, wanted: Mapping[str, float], dt_s: float) -> dict[str, float]:
        """Return the setpoints to send ``dt_s`` after the last ones: as wanted, or as near as the speed allows."""
        found = {}
        for name, position in wanted.items():
            before, most = self._last[name], self._rates[name] * dt_s + _ROUNDING
            found[name] = position if before != before else min(max(position, before - most), before + most)
            if found[name] != position and name not in self._limited:
                self._limited.add(name)
                _log.error("a setpoint of %s was %g from the one before; %g are allowed", name, position - before, most)
        return found

    def adopt(self, applied: Mapping[str, float]) -> None:
        """Note the setpoints that the robot has applied."""
        self._last.update(applied)
        self._displaced -= applied.keys()
