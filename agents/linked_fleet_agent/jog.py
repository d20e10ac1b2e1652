"""Jogging: joints move at given velocities, one step at a time. Pure: time and measurements are passed in; SI units.

Each step gives its joints a trajectory that ends at rest: one that is not renewed brakes by itself. All joints slow
down together before one of them reaches a limit, so that a hand keeps its line as far as it goes.
"""

import math
from collections.abc import Callable, Iterable, Mapping

from linked_fleet_agent.axis import STUCK_S, Axis, Measurements
from linked_fleet_agent.joint_ramp import ramp_s, toward
from linked_fleet_agent.plan import cruise_from
from linked_fleet_agent.robot import JointFacts
from linked_fleet_agent.safety import far_outside
from linked_fleet_agent.trajectory import brake, from_accelerations
from linked_fleet_agent.urdf.cruise import RAMP_S, cruise_of

_SOON_S = 0.03
"""A joint brakes so long before it has to, because steps are not equally long."""
_SLOWER = 0.99
"""Slower than this share of what was asked for has a reason worth telling."""


class Jog:
    """The velocities that joints of one robot shall have now; none of them moves beyond its limits."""

    def __init__(self, joints: Mapping[str, JointFacts]) -> None:
        self._joints = joints
        self._cruises = {name: cruise_of(joint) for name, joint in joints.items()}
        self.accelerations = {name: cruise / RAMP_S for name, cruise in self._cruises.items()}
        self.wanted: dict[str, float] = {}
        """By joint; those of a stream of zeros too. Nothing is jogged while it is empty."""
        self.limited = ""
        """The reason why it is slower than wanted, in words; empty if it is not."""
        self.failed = ""
        """The reason why it cannot go on."""

    def request(self, velocities: Mapping[str, float]) -> None:
        """Take on velocities of all the joints that are jogged, which are zero where nothing is said."""
        self.wanted = dict(velocities)

    def release(self, joints: Iterable[str] | None = None) -> None:
        """Jog nothing more, if one of these is jogged; whatever it is for None."""
        if joints is None or not self.wanted.keys().isdisjoint(joints):
            self.wanted, self.limited = {}, ""

    def begin(self) -> None:
        """Forget why the one before has failed."""
        self.release()
        self.failed = ""

    def step(self, axis_of: Callable[[str], Axis], measured: Measurements, dt_s: float) -> None:
        """Let the axes move on for ``dt_s``."""
        axes = {name: axis_of(name) for name in self.wanted}
        moving = [each for name, each in axes.items() if self.wanted[name] or each.velocity]
        self.failed = self._failure(moving, measured)
        if self.failed:
            self.release()
            return
        pace = min(((each.pace(measured, dt_s), each.joint.name) for each in moving), default=(1.0, ""))
        if stuck := [each for each in moving if each.waiting_s >= STUCK_S or each.lag(measured) > 2.0 * each.max_lag]:
            self._give_up(stuck[0], moving, measured)
            return
        share = self._share(moving, pace)
        now = {name: each.velocity for name, each in axes.items()}
        ramped = toward(now, {name: share * each for name, each in self.wanted.items()}, self._of(axes), dt_s)
        velocities = {name: self._braking(axes[name], velocity, dt_s) for name, velocity in ramped.items()}
        braking_s = ramp_s(velocities, {}, self._of(axes))
        for each in moving:
            _follow(each, velocities[each.joint.name], dt_s, braking_s)

    def _of(self, axes: Mapping[str, Axis]) -> dict[str, float]:
        return {name: self.accelerations[name] for name in axes}

    def _failure(self, moving: Iterable[Axis], measured: Measurements) -> str:
        names = [each.joint.name for each in moving]
        for name in names:
            if not math.isfinite(measured.positions[name]):
                return measured.faults.get(name, f"the position of {name} is unknown")
        return far_outside(names, measured.positions, self._joints)

    def _give_up(self, stuck: Axis, moving: Iterable[Axis], measured: Measurements) -> None:
        """End it. Nothing pushes on: all setpoints return to where the joints are."""
        name, unit = stuck.joint.name, stuck.joint.unit
        self.release()
        self.failed = f"{name} is stuck at {measured.positions[name]:.6g} {unit}"
        for each in moving:
            each.return_to(measured.positions[each.joint.name])

    def _share(self, moving: Iterable[Axis], pace: tuple[float, str]) -> float:
        """Return the share of the velocities at which each joint can stop before its limit, and say why it is less."""
        shares = [(pace[0], f"{pace[1]} lags behind")]
        wanted = [each for each in moving if self.wanted[each.joint.name]]
        braking_s = ramp_s(self.wanted, {}, {each.joint.name: self.accelerations[each.joint.name] for each in wanted})
        for each in wanted:
            velocity = self.wanted[each.joint.name]
            shares.append((cruise_from(each.start) / abs(velocity), f"{each.joint.name} is outside its limits"))
            room = _room(each, velocity) / abs(velocity)
            shares.append((_stoppable(room, braking_s), f"{each.joint.name} is near its limit"))
        share, why = min(shares)
        self.limited = why if share < _SLOWER else ""
        return min(share, 1.0)

    def _braking(self, axis: Axis, velocity: float, dt_s: float) -> float:
        """Return the velocity, or less, so that this joint alone can stop before its limit."""
        acceleration = self.accelerations[axis.joint.name]
        most = acceleration * _stoppable(_room(axis, velocity) / acceleration, 1.0)
        # One that is faster has braked as late as it could, and goes on doing so.
        most = max(most, abs(axis.velocity) - acceleration * dt_s)
        return math.copysign(min(abs(velocity), most), velocity)


def _room(axis: Axis, velocity: float) -> float:
    """Return the way to the limit in the direction of a velocity."""
    limits = axis.joint.limits.including(axis.position)
    end = limits.upper if velocity > 0.0 else limits.lower
    return math.inf if end is None else abs(end - axis.position)


def _stoppable(room: float, braking_s: float) -> float:
    """Return the speed from which to stop within ``room``, if one of 1 takes ``braking_s`` to brake."""
    if math.isinf(room):
        return math.inf
    return 2.0 * room / (_SOON_S + math.sqrt(_SOON_S * _SOON_S + 2.0 * braking_s * room))


def _follow(axis: Axis, velocity: float, dt_s: float, braking_s: float) -> None:
    """Reach a velocity within ``dt_s``, and then brake: together with the others, or harder before a limit."""
    change, middle = velocity - axis.velocity, (velocity + axis.velocity) / 2.0
    end = axis.joint.limits.including(axis.position).clamp(axis.position + middle * dt_s)
    ramp = from_accelerations(axis.position, axis.velocity, [(dt_s, change / dt_s)], end)
    slowing = abs(velocity) / braking_s if braking_s else 1.0
    waiting_s = axis.waiting_s
    axis.follow(ramp.concatenate(brake(end, velocity, slowing, axis.joint.limits)))
    axis.waiting_s = waiting_s
