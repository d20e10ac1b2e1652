"""Running motions of a robot: setpoints, preemption and outcomes of commands.

Pure: time and measurements are passed in.
"""

import math
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

from msgspec.structs import replace

from linked_fleet_agent.axis import SETTLE_S, STANDSTILL_S, Axis, Measurements
from linked_fleet_agent.jog import Jog
from linked_fleet_agent.plan import Plan, Start, joints_of
from linked_fleet_agent.robot import JointFacts
from linked_fleet_agent.setpoints import Setpoints
from linked_fleet_agent.trajectory import Trajectory, hold, reach_in
from linked_fleet_agent.urdf.cruise import RAMP_S, cruise_of
from linked_fleet_agent.wire.messages import Follow, Move, StreamCounts

# A joint that nothing drives, and that is further from its setpoint, moves or has a sensor that has jumped.
_UNSETTLED_RAD, _UNSETTLED_M = 0.1, 0.02
# A longer step (of a stalled host) is shortened to this, so that no setpoint jumps.
MAX_STEP_S = 0.05

State = Literal["running", "succeeded", "failed", "cancelled", "preempted"]


@dataclass(frozen=True)
class Outcome:
    """The outcome of a command; the agent publishes it as progress with the measured positions of ``joints``.

    ``feedback`` and ``result`` are those of an action of a component, as JSON, ``stream`` the counts of its samples.
    """

    command_id: str
    state: State
    joints: tuple[str, ...]
    reason: str = ""
    progress: float = 0.0
    successor: str = ""
    feedback: bytes | None = None
    result: bytes | None = None
    stream: StreamCounts | None = None


@dataclass(frozen=True)
class Sway:
    """A demonstration: the joint swings around its position until a stop or a command takes it over. SI units."""

    joint: str
    amplitude: float = 0.4
    period_s: float = 10.0


@dataclass
class _Motion:
    command_id: str
    joints: tuple[str, ...]
    duration_s: float
    stopping: bool = False
    note: Callable[[], str] = str
    others: Callable[[], Sequence[str]] = tuple
    """Sentences about what else a stop waits for."""
    elapsed_s: float = 0.0
    """Time on its trajectories, which wait for joints that lag behind."""
    resting_s: float = 0.0
    """Time since all its trajectories have ended."""
    followed: bool = False
    """True while controllers follow its trajectories and judge it; no setpoints are sent meanwhile."""

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
    setpoints: Setpoints = field(init=False)
    _axes: dict[str, Axis] = field(default_factory=dict, init=False)
    _running: list[_Motion] = field(default_factory=list, init=False)

    def __post_init__(self) -> None:
        self._swaying = {sway.joint: _Swaying(sway) for sway in self.sways}
        self.setpoints = Setpoints(self.joints.values())
        self.jog = Jog(self.joints)
        self.left: list[str] = []
        """The motions that controllers have followed and are to leave, for the agent to tell the robot."""

    @property
    def driven(self) -> set[str]:
        """The joints of motions, and those that still brake or return."""
        return {name for name, axis in self._axes.items() if not axis.at_rest}.union(
            *(motion.joints for motion in self._running)
        )

    @property
    def idle(self) -> bool:
        """True if a step would do nothing: no motion, no demonstration, and all joints at rest."""
        if self._running or self._swaying or self.jog.wanted:
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

    def starts(self, joints: Iterable[str]) -> list[Start]:
        """Return the setpoints of ``joints``, from which a motion begins."""
        return [self._axis(name).start for name in joints]

    def unsettled(self, joints: Iterable[str], measured: Mapping[str, float]) -> str:
        """Return a sentence about the first joint that nothing drives and that is not at its setpoint, or ""."""
        driven = self.driven
        for name in joints:
            joint, setpoint = self.joints[name], self.setpoints[name]
            allowed = _UNSETTLED_M if joint.linear else _UNSETTLED_RAD
            if name not in driven and abs(joint.difference(measured[name], setpoint)) > allowed:
                return (
                    f"{name} is measured at {measured[name]:.6g} {joint.unit} and was at {setpoint:.6g} {joint.unit} a "
                    "moment ago: something else moves it. Wait until it stands"
                )
        return ""

    def unwound(self, motion: Move | Follow, measured: Mapping[str, float]) -> Move | Follow:
        """Return ``motion`` with the targets of continuous joints in the turn of their setpoints.

        The measured position of such a joint may be a whole number of turns away from its setpoint.
        """
        turns = {}
        for name in joints_of(motion):
            turned = self.setpoints[name] - measured[name] if self.joints[name].continuous else 0.0
            turns[name] = math.tau * round(turned / math.tau)
        if not any(turns.values()):
            return motion
        if isinstance(motion, Move):
            return replace(motion, targets={name: at + turns[name] for name, at in motion.targets.items()})
        shift = [turns[name] for name in motion.joints]
        rows = (tuple(at + by for at, by in zip(row, shift, strict=True)) for row in motion.positions)
        return replace(motion, positions=tuple(rows))

    def preemptible_ids(self, joints: Collection[str]) -> tuple[str, ...]:
        """Return the ids of the motions that a new one on ``joints`` would preempt."""
        return tuple(motion.command_id for motion in self._on(joints))

    def start(self, command_id: str, plan: Plan, followed: bool = False) -> list[Outcome]:
        """Start a motion. An older motion that shares a joint with it is preempted, and its other joints brake.

        While it is ``followed``, controllers follow its trajectories and judge it.
        """
        older, reason = self._on(plan.trajectories), f"replaced by command {command_id}"
        outcomes = self._end(older, "preempted", reason, command_id)
        for name, trajectory in plan.trajectories.items():
            self._swaying.pop(name, None)
            self._axis(name).follow(trajectory)
        motion = _Motion(command_id, tuple(plan.trajectories), plan.duration_s, followed=followed)
        return [*outcomes, *self._begin(motion)]

    def trajectories(self, joints: Iterable[str], command_id: str) -> dict[str, Trajectory] | None:
        """Return what all of these joints are to follow: those of one motion, while the others stand at their setpoint.

        None if another one moves, or its setpoint is not known.
        """
        own = {name for motion in self._running if motion.command_id == command_id for name in motion.joints}
        found = dict[str, Trajectory]()
        for name in joints:
            if name not in own and (name in self.driven or not math.isfinite(self.setpoints[name])):
                return None
            found[name] = self._axes[name].trajectory if name in own else hold(self.setpoints[name])
        return found

    def take_back(self, joints: Collection[str]) -> None:
        """Send setpoints again for the motions of these joints that controllers follow."""
        for motion in self._on(joints):
            self._leave(motion)

    def end_followed(self, command_id: str, reason: str, measured: Mapping[str, float]) -> list[Outcome]:
        """Take what controllers say about a motion that they follow: it has failed if they give a ``reason``."""
        found = [each for each in self._running if each.command_id == command_id and each.followed]
        for motion in found:
            motion.followed = False
            if not reason:
                for name in motion.joints:
                    self._axes[name].finish()
                self.setpoints.adopt({name: self._axes[name].position for name in motion.joints})
        if not reason:
            return []
        outcomes = self._end(found, "failed", reason[:1024])
        for name in (name for motion in found for name in motion.joints):
            if math.isfinite(measured[name]):
                self._axes[name].return_to(measured[name])
        return outcomes

    def release(self, joints: Collection[str], successor: str) -> list[Outcome]:
        """Brake ``joints`` for something else that is about to move them. Their motions are preempted."""
        outcomes = self._end(self._on(joints), "preempted", f"replaced by command {successor}", successor)
        for name in joints:
            self._swaying.pop(name, None)
        self._brake(name for name in joints if name in self._axes)
        return outcomes

    def begin_jog(self, joints: Collection[str]) -> None:
        """Let setpoints move these joints again, which something else has been about to move."""
        self.setpoints.keep(joints)
        self.jog.begin()

    def stands(self, joints: Collection[str]) -> bool:
        """Return True if no setpoint of ``joints`` moves."""
        return all(self._axes[name].at_rest for name in joints if name in self._axes)

    def stoppable_ids(self, joints: Collection[str], command_id: str = "") -> tuple[str, ...]:
        """Return the ids of the motions that a stop of ``joints``, or of one command, would cancel."""
        return tuple(motion.command_id for motion in self._stoppable(joints, command_id))

    def stop(
        self,
        stop_id: str,
        joints: Collection[str],
        command_id: str,
        reason: str,
        others: Callable[[], Sequence[str]] = tuple,
        others_s: float = 0.0,
        note: Callable[[], str] = str,
    ) -> tuple[float, list[Outcome]]:
        """Brake the motion ``command_id``, or all ``joints`` if it is empty. Return the braking time in seconds and
        outcomes.

        A joint that this agent does not move is held where it is, because something else may move it. The stop is a
        motion itself, which succeeds when its joints have been measured at a standstill. Until then setpoints are sent.
        It also waits, ``others_s`` by itself, until ``others`` returns nothing; these are sentences for its failure.
        ``note`` returns what else its end is to say.
        """
        ended = self._stoppable(joints, command_id)
        outcomes = self._end(ended, "cancelled", reason, stop_id)
        concerned = dict.fromkeys(name for motion in ended for name in motion.joints)
        unmeasured = []
        if not command_id:
            for name in joints:
                known = math.isfinite(self.setpoints[name])
                concerned |= {name: None} if known else {}
                unmeasured += [] if known else [name]
        for name in concerned:
            self._swaying.pop(name, None)
            self._axis(name)
        duration_s = max(self._brake(concerned), others_s)
        # A repeated stop replaces the first one.
        self._running = [motion for motion in self._running if not (motion.stopping and motion.command_id == stop_id)]
        unseen = f"not measured, and so neither held nor seen to stand: {', '.join(unmeasured)}" if unmeasured else ""

        def said() -> str:
            return "; ".join(filter(None, (note(), unseen)))[:1024]

        stop = _Motion(stop_id, tuple(concerned), duration_s, stopping=True, note=said, others=others)
        return duration_s, [*outcomes, *self._begin(stop)]

    def braking_s(self, joints: Collection[str], command_id: str = "") -> float:
        """Return the time in seconds in which a stop of ``joints``, or of one command, would brake."""
        ended = self._stoppable(joints, command_id)
        concerned = {*(name for motion in ended for name in motion.joints), *(() if command_id else joints)}
        return max((self._axes[name].braking.duration_s for name in concerned & self._axes.keys()), default=0.0)

    def fail_stop(self, stop_id: str, reason: str) -> list[Outcome]:
        """End a stop whose result cannot be measured."""
        return self._end([m for m in self._running if m.stopping and m.command_id == stop_id], "failed", reason)

    def step(self, dt_s: float, measured: Measurements, held: bool = False) -> tuple[dict[str, float], list[Outcome]]:
        """Advance by ``dt_s``.

        Return the setpoints to apply and the ended motions. While ``held``, demonstrations pause.
        """
        dt_s = min(max(dt_s, 0.0), MAX_STEP_S)
        if not held:
            self._sway(measured.positions)
        if self.jog.wanted and not held and dt_s > 0.0:
            self.jog.step(self._axis, measured, dt_s)
        paces = {name: pace for motion in self._running for name, pace in self._pace(motion, measured, dt_s).items()}
        stopped = {name for motion in self._running if motion.stopping for name in motion.joints}
        setpoints = {
            name: axis.step(dt_s, paces.get(name, 1.0))
            for name, axis in self._axes.items()
            if not axis.joint.passive and (not axis.at_rest or name in stopped)
        }
        followed = {name for motion in self._running if motion.followed for name in motion.joints}
        if followed:
            self.setpoints.adopt({name: setpoints.pop(name) for name in followed & setpoints.keys()})
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
        """Hold every moving joint at its last setpoint. All motions but stops fail with ``reason``, demonstrations end.

        The robot has stood at that setpoint since the pause began, so a ramp would set it in motion again.
        """
        moving = self.driven
        outcomes = self._end([motion for motion in self._running if not motion.stopping], "failed", reason)
        self._swaying.clear()
        self.jog.release()
        for axis in (self._axes[name] for name in moving):
            axis.follow(hold(axis.position))
        return outcomes

    def fail_all(self, reason: str) -> list[Outcome]:
        """Fail all motions and drop their trajectories, because after a fault positions may differ from setpoints."""
        outcomes = [motion.outcome("failed", reason) for motion in self._running]
        for motion in self._running:
            self._leave(motion)
        self._running.clear()
        self._axes.clear()
        self.jog.release()
        return outcomes

    def adopt_setpoints(self, applied: Mapping[str, float]) -> None:
        """Adopt the setpoints that the robot applied, where its own limits are narrower than the agent's."""
        self.setpoints.adopt(applied)
        for name, position in applied.items():
            if name in self._axes:
                self._axes[name].position = position

    def _axis(self, name: str) -> Axis:
        """Return the axis of a joint. One at rest stands at the last setpoint, which follows what else moves it."""
        axis = self._axes.get(name)
        if axis is None or (axis.at_rest and axis.position != self.setpoints[name]):
            axis = self._axes[name] = Axis(self.joints[name], self.setpoints[name])
        return axis

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
        duration_s, joints = 0.0, tuple(joints)
        self.jog.release(joints)
        for axis in (self._axes[name] for name in joints if not self._axes[name].at_rest):
            axis.follow(axis.braking)
            duration_s = max(duration_s, axis.trajectory.duration_s)
        return duration_s

    def _end(self, motions: list[_Motion], state: State, reason: str, successor: str = "") -> list[Outcome]:
        for motion in motions:
            self._running.remove(motion)
            self._leave(motion)
            self._brake(motion.joints)
        return [motion.outcome(state, reason, successor) for motion in motions]

    def _leave(self, motion: _Motion) -> None:
        if motion.followed:
            motion.followed = False
            self.left.append(motion.command_id)

    def _judge(self, motion: _Motion, measured: Measurements) -> Iterable[Outcome]:
        axes = [self._axes[name] for name in motion.joints]
        if motion.stopping:
            late = motion.elapsed_s > motion.duration_s + SETTLE_S
            moving = [axis.joint.name for axis in axes if not axis.stands(measured)]
            others = motion.others()
            if (moving or others) and late:
                return self._end([motion], "failed", _not_standing(moving, measured, others))
            # Standstill counts from the stop on: a motion by something else may have begun a moment before it.
            soon = motion.elapsed_s < STANDSTILL_S and bool(axes)
            return [] if moving or others or soon else self._succeed(motion)
        unseen = [name for name in motion.joints if not math.isfinite(measured.positions[name])]
        if unseen:
            why = measured.faults.get(unseen[0], f"the position of {unseen[0]} is not known any more")
            return self._end([motion], "failed", why[:1024])
        if motion.followed:
            return []
        if all([axis.arrived(measured) for axis in axes]):
            return self._succeed(motion)
        lost = [axis for axis in axes if axis.gives_up(measured, motion.resting_s)]
        return [self._give_up(motion, lost[0], measured)] if lost else []

    def _pace(self, motion: _Motion, measured: Measurements, dt_s: float) -> dict[str, float]:
        """Advance the time of a motion. Return by joint the pace of its setpoint: the joints wait for each other."""
        axes = [self._axes[name] for name in motion.joints]
        slowest = 1.0 if motion.stopping else min((axis.pace(measured, dt_s) for axis in axes), default=1.0)
        motion.elapsed_s += dt_s * slowest
        if all([axis.at_rest for axis in axes]):
            motion.resting_s += dt_s
        return dict.fromkeys(motion.joints, slowest)

    def _succeed(self, motion: _Motion) -> list[Outcome]:
        self._running.remove(motion)
        return [motion.outcome("succeeded", motion.note())]

    def _give_up(self, motion: _Motion, axis: Axis, measured: Measurements) -> Outcome:
        name, unit = axis.joint.name, axis.joint.unit
        effort, limit = measured.efforts.get(name, math.nan), axis.joint.limits.effort
        why = "at its effort limit" if limit is not None and abs(effort) >= 0.95 * limit else "stuck"
        reason = (
            f"{name} is {why} at {measured.positions[name]:.6g} {unit}, its target is {axis.trajectory.end:.6g} {unit}"
        )
        [outcome] = self._end([motion], "failed", reason)
        # The joint must neither push on nor jump once it is free, so its setpoint returns to where it is.
        for joint in motion.joints:
            self._axes[joint].return_to(measured.positions[joint])
        return outcome

    def _sway(self, positions: Mapping[str, float]) -> None:
        for name, swaying in self._swaying.items():
            if not math.isfinite(positions[name]):
                continue
            if math.isnan(swaying.centre):
                swaying.centre = positions[name]
            axis, limits = self._axis(name), self.joints[name].limits
            if axis.at_rest:
                cruise, way = cruise_of(axis.joint), swaying.side * swaying.sway.amplitude
                target, swaying.side = limits.clamp(swaying.centre + way), -swaying.side
                leg_s = swaying.sway.period_s / 2.0
                axis.follow(reach_in(leg_s, axis.position, 0.0, target, cruise, cruise / RAMP_S, limits))


def _not_standing(joints: Sequence[str], measured: Measurements, others: Sequence[str]) -> str:
    unknown = [name for name in joints if not math.isfinite(measured.positions[name])]
    moving = [name for name in joints if name not in unknown]
    parts = [f"not come to rest: {', '.join(moving)}"] if moving else []
    parts += [f"standstill cannot be measured: {', '.join(unknown)}"] if unknown else []
    parts += [measured.faults[name] for name in unknown[:1] if name in measured.faults]
    parts += others
    return "; ".join(parts)[:1024]
