"""Where the setpoint of every joint goes next. Pure: time and measurements are passed in.

Each joint follows a trapezoid of velocity to its target: at most CRUISE_SHARE of its URDF velocity limit, so that the
real joint with its lag and ripple stays below the limit itself, and never above the cruise of a machine among people.
"""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Literal

from agents.robot import JointFacts

CRUISE_SHARE = 0.8
MAX_CRUISE_RAD_S, MAX_CRUISE_M_S = 1.5, 0.25
# For joints whose URDF states no velocity limit.
UNKNOWN_CRUISE_RAD_S, UNKNOWN_CRUISE_M_S = 0.5, 0.05
RAMP_S = 0.4
TOLERANCE_RAD, TOLERANCE_M = 2e-3, 5e-4
# How far a joint may trail its setpoint, and how long it may settle after the end of the profile.
MAX_LAG_RAD, MAX_LAG_M = 0.4, 0.1
SETTLE_S = 2.0
# A step longer than this (a stalled host) is taken as this long, so that no setpoint leaps.
MAX_STEP_S = 0.05


@dataclass(frozen=True)
class Outcome:
    """What became of a command; the agent publishes it as progress with the measured positions of ``joints``."""

    command_id: str
    state: Literal["running", "succeeded", "failed", "preempted"]
    joints: tuple[str, ...]
    reason: str = ""


@dataclass(frozen=True)
class Sway:
    """A demonstration: the joint goes to and fro around where it is, until a command takes it over for good."""

    joint: str
    amplitude: float = 0.4
    period_s: float = 10.0


class Axis:
    """The profile of one joint: where its setpoint is, how fast it moves (rad, rad/s or m, m/s) and where it goes."""

    def __init__(self, joint: JointFacts, position: float) -> None:
        self.joint = joint
        self.position = self.target = position
        self.velocity = 0.0
        self.cruise = cruise_of(joint)
        self.acceleration = self.cruise / RAMP_S
        self.tolerance = TOLERANCE_M if joint.linear else TOLERANCE_RAD
        self.max_lag = MAX_LAG_M if joint.linear else MAX_LAG_RAD

    @property
    def at_rest(self) -> bool:
        return self.position == self.target and self.velocity == 0.0

    def step(self, dt_s: float) -> float:
        """Advance by ``dt_s`` and return the setpoint."""
        ramp, ahead = self.acceleration * dt_s, self.target - self.position
        if abs(ahead) <= ramp * dt_s and abs(self.velocity) <= 2.0 * ramp:
            self.position, self.velocity = self.target, 0.0
            return self.position
        # The fastest speed from which the rest of the way suffices to brake, with braking in steps of dt.
        brakable = math.sqrt((ramp / 2.0) ** 2 + 2.0 * self.acceleration * abs(ahead)) - ramp / 2.0
        wanted = math.copysign(min(self.cruise, brakable), ahead)
        self.velocity += max(-ramp, min(ramp, wanted - self.velocity))
        self.position = self.joint.limits.clamp(self.position + self.velocity * dt_s)
        return self.position

    def brake(self) -> None:
        """Head for the nearest place where the joint can stand still."""
        way = math.copysign(self.velocity**2 / (2.0 * self.acceleration), self.velocity)
        self.target = self.joint.limits.clamp(self.position + way)

    def rest_at(self, position: float) -> None:
        """Start over from ``position``, standing still."""
        self.position = self.target = position
        self.velocity = 0.0


def cruise_of(joint: JointFacts) -> float:
    """The fastest that the setpoint of ``joint`` ever moves, in rad/s or m/s."""
    limit = joint.limits.velocity
    if limit is None:
        return UNKNOWN_CRUISE_M_S if joint.linear else UNKNOWN_CRUISE_RAD_S
    return min(CRUISE_SHARE * limit, MAX_CRUISE_M_S if joint.linear else MAX_CRUISE_RAD_S)


@dataclass
class _Motion:
    command_id: str
    joints: tuple[str, ...]
    settled_for_s: float = 0.0


@dataclass
class _Swaying:
    sway: Sway
    centre: float | None = None
    phase: float = 0.0


@dataclass
class Motions:
    """All motions of one robot. ``measured`` maps joints to positions; NaN is unknown."""

    joints: Mapping[str, JointFacts]
    sways: Iterable[Sway] = ()
    _axes: dict[str, Axis] = field(default_factory=dict, init=False)
    _running: list[_Motion] = field(default_factory=list, init=False)

    def __post_init__(self) -> None:
        self._swaying = {sway.joint: _Swaying(sway) for sway in self.sways}

    def start(self, command_id: str, targets: Mapping[str, float], measured: Mapping[str, float]) -> list[Outcome]:
        """Begin a motion; any older one on one of its joints is preempted as a whole and its other joints brake."""
        outcomes = self._end(
            [m for m in self._running if not targets.keys().isdisjoint(m.joints)],
            "preempted",
            f"replaced by command {command_id}",
        )
        for name, target in targets.items():
            self._swaying.pop(name, None)
            self._axis(name, measured[name]).target = target
        self._running.append(_Motion(command_id, tuple(targets)))
        return [*outcomes, Outcome(command_id, "running", tuple(targets))]

    def step(
        self, dt_s: float, measured: Mapping[str, float], efforts: Mapping[str, float], held: bool = False
    ) -> tuple[dict[str, float], list[Outcome]]:
        """Advance by ``dt_s``: the setpoints to apply now and what ended. While ``held``, demonstrations pause."""
        dt_s = min(max(dt_s, 0.0), MAX_STEP_S)
        if not held:
            self._sway(dt_s, measured)
        setpoints = {name: axis.step(dt_s) for name, axis in self._axes.items() if not axis.at_rest}
        return setpoints, [outcome for m in list(self._running) for outcome in self._judge(m, dt_s, measured, efforts)]

    def halt(self, reason: str) -> list[Outcome]:
        """Brake every joint; all motions fail with ``reason``."""
        outcomes = self._end(list(self._running), "failed", reason)
        for axis in self._axes.values():
            axis.brake()
        return outcomes

    def forget(self, reason: str) -> list[Outcome]:
        """The robot no longer is where the profiles believe (a fault): fail all motions and measure afresh."""
        outcomes = self._end(list(self._running), "failed", reason)
        self._axes.clear()
        return outcomes

    def correct(self, applied: Mapping[str, float]) -> None:
        """Take over setpoints that the robot really applied, where its own limits are narrower than ours."""
        for name, position in applied.items():
            axis = self._axes.get(name)
            if axis is not None and position != axis.position:
                axis.position = position

    def _axis(self, name: str, measured: float) -> Axis:
        return self._axes.setdefault(name, Axis(self.joints[name], self.joints[name].limits.clamp(measured)))

    def _end(self, motions: list[_Motion], state: Literal["failed", "preempted"], reason: str) -> list[Outcome]:
        for motion in motions:
            self._running.remove(motion)
            for name in motion.joints:
                self._axes[name].brake()
        return [Outcome(motion.command_id, state, motion.joints, reason) for motion in motions]

    def _judge(
        self, motion: _Motion, dt_s: float, measured: Mapping[str, float], efforts: Mapping[str, float]
    ) -> list[Outcome]:
        axes = [self._axes[name] for name in motion.joints]
        off = {axis.joint.name: abs(axis.target - measured[axis.joint.name]) for axis in axes}
        if all(axis.at_rest and off[axis.joint.name] <= axis.tolerance for axis in axes):
            self._running.remove(motion)
            return [Outcome(motion.command_id, "succeeded", motion.joints)]
        lagging = [a for a in axes if not abs(a.position - measured[a.joint.name]) <= a.max_lag]
        if all(axis.at_rest for axis in axes):
            motion.settled_for_s += dt_s
            if motion.settled_for_s > SETTLE_S:
                lagging = [axis for axis in axes if not off[axis.joint.name] <= axis.tolerance]
        return [self._give_up(motion, lagging[0], measured, efforts)] if lagging else []

    def _give_up(
        self, motion: _Motion, axis: Axis, measured: Mapping[str, float], efforts: Mapping[str, float]
    ) -> Outcome:
        name, unit = axis.joint.name, "m" if axis.joint.linear else "rad"
        effort, limit = efforts.get(name, math.nan), axis.joint.limits.effort
        why = "at its effort limit" if limit is not None and abs(effort) >= 0.95 * limit else "stuck"
        reason = f"{name} is {why} at {measured[name]:.4g} {unit}, its target is {axis.target:.4g} {unit}"
        [outcome] = self._end([motion], "failed", reason)
        for joint in motion.joints:  # stay where the robot is: it must neither push on nor leap once it is free
            if math.isfinite(measured[joint]):
                self._axes[joint].rest_at(self.joints[joint].limits.clamp(measured[joint]))
                self._axes[joint].velocity = math.ulp(0.0)  # not at rest: the new setpoint is still to be applied
        return outcome

    def _sway(self, dt_s: float, measured: Mapping[str, float]) -> None:
        for name, swaying in self._swaying.items():
            if swaying.centre is None:
                if not math.isfinite(measured[name]):
                    continue
                swaying.centre = measured[name]
            swaying.phase = (swaying.phase + 2.0 * math.pi * dt_s / swaying.sway.period_s) % (2.0 * math.pi)
            wanted = swaying.centre + swaying.sway.amplitude * math.sin(swaying.phase)
            self._axis(name, measured[name]).target = self.joints[name].limits.clamp(wanted)
