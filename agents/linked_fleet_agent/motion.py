"""Running motions of a robot: setpoints, preemption and outcomes of commands.

Pure: time and measurements are passed in.
"""

import math
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

from linked_fleet_agent.plan import Plan, Start
from linked_fleet_agent.robot import JointFacts
from linked_fleet_agent.trajectory import RAMP_S, Trajectory, brake, cruise_of, hold, reach_in

# If all seven joints of an arm of 1.2 m are off by this much in the same direction, its tip is off by less than 1 mm.
TOLERANCE_RAD, TOLERANCE_M = 2e-4, 2e-4
# A joint slower than this counts as standing.
STANDING_RAD_S, STANDING_M_S = 0.01, 0.002
# How far a joint may lag behind its setpoint, and how long it may settle after the end of its trajectory.
MAX_LAG_RAD, MAX_LAG_M = 0.4, 0.1
SETTLE_S = 2.0
# A joint at rest that is further from its setpoint (rad or m) was moved by something else; a nearer one only sags.
_HOLDING = 0.01
# A longer step (of a stalled host) is shortened to this, so that no setpoint jumps.
MAX_STEP_S = 0.05

State = Literal["running", "succeeded", "failed", "cancelled", "preempted"]


@dataclass(frozen=True)
class Outcome:
    """The outcome of a command; the agent publishes it as progress with the measured positions of ``joints``."""

    command_id: str
    state: State
    joints: tuple[str, ...]
    reason: str = ""
    progress: float = 0.0
    successor: str = ""


@dataclass(frozen=True)
class Sway:
    """A demonstration: the joint swings around its position until a stop or a command takes it over. SI units."""

    joint: str
    amplitude: float = 0.4
    period_s: float = 10.0


@dataclass(frozen=True)
class Measurements:
    """Positions, velocities and efforts by joint; NaN is unknown."""

    positions: Mapping[str, float]
    velocities: Mapping[str, float] = field(default_factory=dict)
    efforts: Mapping[str, float] = field(default_factory=dict)


class Axis:
    """The trajectory of one joint, and the position and velocity of its setpoint (rad, rad/s or m, m/s)."""

    def __init__(self, joint: JointFacts, measured: float) -> None:
        self.joint = joint
        self.position, self.velocity = measured, 0.0
        self.trajectory, self._time_s = hold(self.position), 0.0
        self.at_rest = True
        self._stood: float | None = None  # where the joint stood when it was last stopped at rest
        self.tolerance = TOLERANCE_M if joint.linear else TOLERANCE_RAD
        self.max_lag = MAX_LAG_M if joint.linear else MAX_LAG_RAD
        self.standing = STANDING_M_S if joint.linear else STANDING_RAD_S

    @property
    def start(self) -> Start:
        return Start(self.joint, self.position, self.velocity)

    @property
    def braking(self) -> Trajectory:
        """The trajectory that brakes the joint to rest from its present setpoint."""
        return brake(self.position, self.velocity, cruise_of(self.joint) / RAMP_S, self.joint.limits)

    def follow(self, trajectory: Trajectory) -> None:
        """Follow ``trajectory`` from now on. Its last setpoint is applied even if it is the only one."""
        self.position, self.velocity = trajectory.at(0.0)
        self._stood = None
        self.trajectory, self._time_s, self.at_rest = trajectory, 0.0, False

    def stop(self, measured: float) -> None:
        """Remember where the joint stands, if it is at rest; it may be off its last setpoint."""
        if self.at_rest and math.isfinite(measured):
            self._stood = measured

    def step(self, dt_s: float) -> float:
        """Advance by ``dt_s`` and return the setpoint."""
        self._time_s += dt_s
        position, self.velocity = self.trajectory.at(self._time_s)
        if (within := self.joint.limits.clamp(position)) != position:  # no further out than the joint is already
            within = self.joint.limits.including(self.position).clamp(position)
        self.position = within
        self.at_rest = self._time_s >= self.trajectory.duration_s
        return self.position

    def is_displaced(self, measured: float) -> bool:
        """Return True if the joint stood at its setpoint and something else has moved it."""
        return self.at_rest and abs(self.position - measured) > _HOLDING

    def distance_to_end(self, measured: Measurements) -> float:
        """Distance of the joint from the end of its trajectory."""
        return abs(self.trajectory.end - measured.positions[self.joint.name])

    def lag(self, measured: Measurements) -> float:
        """Distance of the joint from its setpoint."""
        return abs(self.position - measured.positions[self.joint.name])

    def is_at_rest(self, measured: Measurements) -> bool:
        """Return True if the joint is at rest. Without a measured velocity its position decides."""
        velocity = measured.velocities.get(self.joint.name, math.nan)
        if math.isnan(velocity):
            stands_at = self.trajectory.end if self._stood is None else self._stood
            return self.at_rest and abs(stands_at - measured.positions[self.joint.name]) <= self.tolerance
        return self.at_rest and abs(velocity) <= self.standing


@dataclass
class _Motion:
    command_id: str
    joints: tuple[str, ...]
    duration_s: float
    stopping: bool = False
    elapsed_s: float = 0.0

    @property
    def progress(self) -> float:
        return min(1.0, self.elapsed_s / self.duration_s) if self.duration_s > 0.0 else 0.0

    def outcome(self, state: State, reason: str = "", successor: str = "") -> Outcome:
        progress = 1.0 if state == "succeeded" else self.progress
        return Outcome(self.command_id, state, self.joints, reason, progress, successor)


@dataclass
class _Swaying:
    sway: Sway
    centre: float = math.nan
    side: float = 1.0


@dataclass
class Motions:
    """All motions of one robot."""

    joints: Mapping[str, JointFacts]
    sways: Sequence[Sway] = ()
    _axes: dict[str, Axis] = field(default_factory=dict, init=False)
    _running: list[_Motion] = field(default_factory=list, init=False)

    def __post_init__(self) -> None:
        self._swaying = {sway.joint: _Swaying(sway) for sway in self.sways}

    @property
    def idle(self) -> bool:
        """True if a step would do nothing: no motion, no demonstration, and all joints at rest."""
        if self._running or self._swaying:
            return False
        for axis in self._axes.values():  # noqa: SIM110 - asked in every tick, and a generator costs more than the rest
            if not axis.at_rest:
                return False
        return True

    @property
    def swaying(self) -> frozenset[str]:
        """The joints with an active demonstration."""
        return frozenset(self._swaying)

    def restart_demonstrations(self) -> list[str]:
        """Restart the ended demonstrations of joints that no motion moves. Return these joints."""
        moved = {name for motion in self._running for name in motion.joints}
        begun = [sway for sway in self.sways if sway.joint not in moved | self._swaying.keys()]
        self._swaying |= {sway.joint: _Swaying(sway) for sway in begun}
        return [sway.joint for sway in begun]

    def setpoints(self, joints: Iterable[str], measured: Mapping[str, float]) -> list[Start]:
        """Return the setpoints of ``joints``.

        For a joint that never moved, or that something else has moved since, return its measured position.
        """
        running = {name for motion in self._running for name in motion.joints}
        starts = []
        for name in joints:
            axis = self._axes.get(name)
            if axis is None or (name not in running and axis.is_displaced(measured[name])):
                axis = Axis(self.joints[name], measured[name])
            starts.append(axis.start)
        return starts

    def preemptible_ids(self, joints: Collection[str]) -> tuple[str, ...]:
        """Return the ids of the motions that a new one on ``joints`` would preempt."""
        return tuple(motion.command_id for motion in self._on(joints))

    def start(self, command_id: str, plan: Plan, measured: Mapping[str, float]) -> list[Outcome]:
        """Start a motion. An older motion that shares a joint with it is preempted, and its other joints brake."""
        older, reason = self._on(plan.trajectories), f"replaced by command {command_id}"
        outcomes = self._end(older, "preempted", reason, command_id)
        for name, trajectory in plan.trajectories.items():
            self._swaying.pop(name, None)
            self._axis(name, measured[name]).follow(trajectory)
        return [*outcomes, *self._begin(_Motion(command_id, tuple(plan.trajectories), plan.duration_s))]

    def stoppable_ids(self, joints: Collection[str], command_id: str = "") -> tuple[str, ...]:
        """Return the ids of the motions that a stop of ``joints``, or of one command, would cancel."""
        return tuple(motion.command_id for motion in self._stoppable(joints, command_id))

    def stop(
        self, stop_id: str, joints: Collection[str], command_id: str, reason: str, measured: Mapping[str, float]
    ) -> tuple[float, list[Outcome]]:
        """Brake the motion ``command_id``, or all ``joints`` if it is empty. Return the braking time in seconds and
        outcomes.

        The stop is a motion itself, which succeeds when its joints stand.
        """
        ended = self._stoppable(joints, command_id)
        outcomes = self._end(ended, "cancelled", reason, stop_id)
        concerned = dict.fromkeys(name for motion in ended for name in motion.joints)
        if not command_id:  # a joint that never moved and has no known position cannot be braked
            concerned |= dict.fromkeys(n for n in joints if n in self._axes or math.isfinite(measured[n]))
        for name in concerned:
            self._swaying.pop(name, None)
            self._axis(name, measured[name]).stop(measured[name])
        duration_s = self._brake(concerned)
        # A repeated stop replaces the first one.
        self._running = [motion for motion in self._running if not (motion.stopping and motion.command_id == stop_id)]
        return duration_s, [*outcomes, *self._begin(_Motion(stop_id, tuple(concerned), duration_s, stopping=True))]

    def braking_s(self, joints: Collection[str], command_id: str = "") -> float:
        """Return the time in seconds that a stop of ``joints``, or of one command, would take."""
        ended = self._stoppable(joints, command_id)
        concerned = {*(name for motion in ended for name in motion.joints), *(() if command_id else joints)}
        return max((self._axes[name].braking.duration_s for name in concerned & self._axes.keys()), default=0.0)

    def end_stop(self, stop_id: str, state: Literal["succeeded", "failed"], reason: str) -> list[Outcome]:
        """End a stop whose result cannot be measured."""
        return self._end([m for m in self._running if m.stopping and m.command_id == stop_id], state, reason)

    def step(self, dt_s: float, measured: Measurements, held: bool = False) -> tuple[dict[str, float], list[Outcome]]:
        """Advance by ``dt_s``.

        Return the setpoints to apply and the ended motions. While ``held``, demonstrations pause.
        """
        dt_s = min(max(dt_s, 0.0), MAX_STEP_S)
        if not held:
            self._sway(measured.positions)
        setpoints = {name: axis.step(dt_s) for name, axis in self._axes.items() if not axis.at_rest}
        for motion in self._running:
            motion.elapsed_s += dt_s
        return setpoints, [outcome for motion in list(self._running) for outcome in self._judge(motion, measured)]

    def running_progress(self) -> list[Outcome]:
        """Return the progress of every running motion."""
        return [motion.outcome("running") for motion in self._running]

    def halt(self, reason: str) -> list[Outcome]:
        """Brake every joint. All motions fail with ``reason``, except stops."""
        outcomes = self._end([motion for motion in self._running if not motion.stopping], "failed", reason)
        self._brake(self._axes)
        return outcomes

    def hold_after_pause(self, reason: str) -> list[Outcome]:
        """Hold every joint at its last setpoint. All motions but stops fail with ``reason``, demonstrations end.

        The robot has stood at that setpoint since the pause began, so a ramp would set it in motion again.
        """
        outcomes = self._end([motion for motion in self._running if not motion.stopping], "failed", reason)
        self._swaying.clear()
        for axis in self._axes.values():
            axis.follow(hold(axis.position))
        return outcomes

    def fail_all(self, reason: str) -> list[Outcome]:
        """Fail all motions and drop their trajectories, because after a fault positions may differ from setpoints."""
        outcomes = [motion.outcome("failed", reason) for motion in self._running]
        self._running.clear()
        self._axes.clear()
        return outcomes

    def adopt_setpoints(self, applied: Mapping[str, float]) -> None:
        """Adopt the setpoints that the robot applied, where its own limits are narrower than the agent's."""
        for name, position in applied.items():
            if name in self._axes:
                self._axes[name].position = position

    def _axis(self, name: str, measured: float) -> Axis:
        if name not in self._axes:
            self._axes[name] = Axis(self.joints[name], measured)
        return self._axes[name]

    def _on(self, joints: Collection[str]) -> list[_Motion]:
        wanted = set(joints)
        return [motion for motion in self._running if not wanted.isdisjoint(motion.joints)]

    def _stoppable(self, joints: Collection[str], command_id: str) -> list[_Motion]:
        found = [m for m in self._running if m.command_id == command_id] if command_id else self._on(joints)
        return [motion for motion in found if not motion.stopping]

    def _begin(self, motion: _Motion) -> list[Outcome]:
        self._running.append(motion)
        return [motion.outcome("running")]

    def _brake(self, joints: Iterable[str]) -> float:
        duration_s = 0.0
        for axis in (self._axes[name] for name in joints if not self._axes[name].at_rest):
            axis.follow(axis.braking)
            duration_s = max(duration_s, axis.trajectory.duration_s)
        return duration_s

    def _end(self, motions: list[_Motion], state: State, reason: str, successor: str = "") -> list[Outcome]:
        for motion in motions:
            self._running.remove(motion)
            self._brake(motion.joints)
        return [motion.outcome(state, reason, successor) for motion in motions]

    def _judge(self, motion: _Motion, measured: Measurements) -> Iterable[Outcome]:
        axes = [self._axes[name] for name in motion.joints]
        late = motion.elapsed_s > motion.duration_s + SETTLE_S
        if motion.stopping:
            moving = [axis.joint.name for axis in axes if not axis.is_at_rest(measured)]
            if moving and late:
                return self._end([motion], "failed", f"not come to rest: {', '.join(moving)}"[:1024])
            return [] if moving else self._succeed(motion)
        astray = [axis for axis in axes if not (axis.at_rest and axis.distance_to_end(measured) <= axis.tolerance)]
        if not astray:
            return self._succeed(motion)
        lost = [axis for axis in axes if not axis.lag(measured) <= axis.max_lag]
        lost += [axis for axis in astray if late and axis.at_rest]
        return [self._give_up(motion, lost[0], measured)] if lost else []

    def _succeed(self, motion: _Motion) -> list[Outcome]:
        self._running.remove(motion)
        return [motion.outcome("succeeded")]

    def _give_up(self, motion: _Motion, axis: Axis, measured: Measurements) -> Outcome:
        name, unit = axis.joint.name, "m" if axis.joint.linear else "rad"
        effort, limit = measured.efforts.get(name, math.nan), axis.joint.limits.effort
        why = "at its effort limit" if limit is not None and abs(effort) >= 0.95 * limit else "stuck"
        reason = (
            f"{name} is {why} at {measured.positions[name]:.6g} {unit}, its target is {axis.trajectory.end:.6g} {unit}"
        )
        [outcome] = self._end([motion], "failed", reason)
        # hold the present position: the joint must neither push on nor jump once it is free
        for joint in motion.joints:
            if math.isfinite(measured.positions[joint]):
                self._axes[joint].follow(hold(measured.positions[joint]))
        return outcome

    def _sway(self, positions: Mapping[str, float]) -> None:
        for name, swaying in self._swaying.items():
            if not math.isfinite(positions[name]):
                continue
            if math.isnan(swaying.centre):
                swaying.centre = positions[name]
            if name in self._axes and self._axes[name].is_displaced(positions[name]):
                del self._axes[name]
            axis, limits = self._axis(name, positions[name]), self.joints[name].limits
            if axis.at_rest:
                cruise, way = cruise_of(axis.joint), swaying.side * swaying.sway.amplitude
                target, swaying.side = limits.clamp(swaying.centre + way), -swaying.side
                leg_s = swaying.sway.period_s / 2.0
                axis.follow(reach_in(leg_s, axis.position, 0.0, target, cruise, cruise / RAMP_S, limits))
