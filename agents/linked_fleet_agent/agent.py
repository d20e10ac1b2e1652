"""The control loop of one robot: publish state, check and execute commands, stop. Depends only on Robot and Link."""

import asyncio
import logging
import math
import secrets
import time
from collections.abc import Callable, Iterable, Mapping, Sequence, Set
from functools import partial
from typing import Protocol, TypeVar

from linked_fleet_agent import pace, safety
from linked_fleet_agent.axis import Measurements
from linked_fleet_agent.components.component import Component
from linked_fleet_agent.components.declaration import Declared
from linked_fleet_agent.components.host import Host, declarations_of, encoded
from linked_fleet_agent.components.jogging import NAME, jogging_of, joints_to_jog
from linked_fleet_agent.components.operating import Operating
from linked_fleet_agent.demonstration import Demonstration
from linked_fleet_agent.mesh_files import MeshFiles
from linked_fleet_agent.motion import Motions, Outcome, Sway
from linked_fleet_agent.pace import every
from linked_fleet_agent.plan import ImpossibleError, Plan, joints_of, plan
from linked_fleet_agent.publications import Cameras, Conditions, Frames, Report, describe
from linked_fleet_agent.robot import ComponentRobot, NewDescriptionError, Reading, Robot, SensingRobot, TrajectoryRobot
from linked_fleet_agent.sensors import JointSensor
from linked_fleet_agent.urdf import RobotModel
from linked_fleet_agent.wire import codec
from linked_fleet_agent.wire.codec import VersionError, WireError
from linked_fleet_agent.wire.components import BASE, Operate, Sample
from linked_fleet_agent.wire.messages import Accepted, Command, Refused, Reply, Stop
from linked_fleet_agent.wire.transport import GATEWAY_LEASE_MS

_log = logging.getLogger(__name__)
_LEAST_APART = 0.1
"""Least time between a frame and the extra frame after a stop, as a share of the tick period."""
_M = TypeVar("_M", Command, Stop, Operate, Sample)


class Link(Protocol):
    """The connection to the gateways.

    Publishing never blocks or raises: when the connection is lost, it drops and logs.
    """

    @property
    def gateway_present(self) -> bool:
        """Return True if a gateway was known to be alive when ``watch_gateways`` was called last."""

    def watch_gateways(self, period_s: float) -> None:
        """Check which gateways are alive. Call it once per tick, with the tick period in seconds."""

    @property
    def arrivals(self) -> int:
        """Number of gateways that have appeared so far; a gateway that returns counts again."""

    def publish_state(self, payload: bytes) -> None: ...

    def publish_progress(self, payload: bytes, final: bool) -> None:
        """Publish progress.

        If ``final``, the message says how a motion ended and is sent reliably; others may be dropped.
        """

    def publish_condition(self, payload: bytes) -> None: ...

    def publish_values(self, payload: bytes) -> None: ...

    def publish_event(self, payload: bytes) -> None: ...


def new_incarnation() -> int:
    """Return a number for this run: it grows with wall time, differs between simultaneous starts, and fits 63 bits."""
    return (time.time_ns() // 1_000_000) * 4096 + secrets.randbelow(4096)


class Agent:
    """One robot. ``description`` and ``incarnation`` never change; everything runs on one event loop.
    ``elapsed_ns`` goes on while the machine is suspended; without it ``monotonic_ns`` tells of pauses too, if given.

    Raises ValueError if a demonstration names a joint that takes no commands, DeclarationError and UrdfError for a
    description that gateways would refuse.
    """

    def __init__(
        self,
        name: str,
        robot: Robot,
        *,
        rate_hz: float = 100.0,
        sways: Iterable[Sway] = (),
        monotonic_ns: Callable[[], int] | None = None,
        elapsed_ns: Callable[[], int] | None = None,
        wall_ns: Callable[[], int] = lambda: time.time_ns(),
    ) -> None:
        self.name, self.rate_hz = name, rate_hz
        self.incarnation = new_incarnation()
        self._robot, self._facts = robot, robot.describe()
        self._joints = {joint.name: joint for joint in self._facts.joints}
        self._names = tuple(self._joints)
        self._movable = (*self._names, BASE)
        """All that a stop of the whole robot stops."""
        self._counts = (len(self._names),) * 3
        sways = tuple(sways)
        for sway in sways:
            joint = self._joints.get(sway.joint)
            if joint is None or joint.mimics is not None or joint.passive:
                raise ValueError(f"{name} has no joint {sway.joint!r} that takes commands")
        self._motions = Motions(self._joints, sways)
        self._judges = not isinstance(robot, SensingRobot)
        """True if the agent judges the sensors, and not the driver."""
        self._sensors: Mapping[str, JointSensor] = (
            robot.sensors
            if isinstance(robot, SensingRobot)
            else {joint.name: JointSensor(joint, 1.0 / rate_hz) for joint in self._facts.joints}
        )
        self._coupled = {name: group for group in self._facts.coupled for name in group}
        self._follower = robot if isinstance(robot, TrajectoryRobot) else None
        self.demonstration = Demonstration(name, self._motions)
        self._monotonic_ns, self._wall_ns = monotonic_ns or (lambda: time.monotonic_ns()), wall_ns
        self._elapsed_ns = elapsed_ns or monotonic_ns or pace.elapsed_ns
        self._seen, self._stops = safety.RecentIds(), safety.Stops()
        self._reading: Reading | None = None
        self._tick_ns: int | None = None
        self._ran_ns: tuple[int, int] | None = None
        self._gateway_present = False
        self._lost_ns: int | None = None
        self._doubted: Set[str] = frozenset()
        self._fault: str | None = None
        self._described_anew: NewDescriptionError | None = None
        self._outcomes: list[Outcome] = []
        self._report = Report(self.incarnation)
        self._conditions = Conditions(self.incarnation)
        self._meshes = MeshFiles(name, self._facts.meshes)
        self._cameras = Cameras(robot, self._facts.cameras)
        declared = self._declared(robot.components() if isinstance(robot, ComponentRobot) else ())
        self._host = Host(declared, self.incarnation, lambda: (self._monotonic_ns(), self._wall_ns()))
        self._operating = Operating(
            self._host, self._motions, self._seen, self._stops, self.incarnation, self._monotonic_ns
        )
        self._prevented = ""
        self._link: Link | None = None
        """The link while ``run`` runs, else None."""
        self._frames = Frames(self.incarnation, self._facts)
        self.description = codec.encode(
            describe(
                name,
                self.incarnation,
                self._facts,
                rate_hz,
                self._meshes.offers,
                self._cameras.offers,
                encoded(declared),
            )
        )

    def _declared(self, parts: Sequence[Component]) -> list[Declared]:
        """Return the declarations of the components of the robot, and of the one by which its joints are jogged."""
        links = RobotModel.for_urdf(self._facts.urdf).links if parts else ()
        declared = declarations_of(parts, links, self._joints)
        joints = joints_to_jog(self._joints.values(), declared)
        if not joints or any(each.said.name == NAME for each in declared):
            return declared
        return [*declared, *declarations_of([jogging_of(joints, self._motions, parts)], (), self._joints)]

    async def run(self, link: Link) -> None:
        """Tick at ``rate_hz`` until cancelled, then hold and close the robot. Missed ticks are skipped, not made up.

        Raises NewDescriptionError if the robot has described itself anew.
        """
        self._link = link
        try:
            await every(1.0 / self.rate_hz, partial(self.tick, link))
        finally:
            self._link = None
            self._outcomes += [*self._motions.fail_all("the agent ends"), *self._operating.fail_all("the agent ends")]
            self._publish_progress(link, self._monotonic_ns())
            self._stop_robot()
            self.close()

    def close(self) -> None:
        """Close the robot, if it is not run."""
        self._host.close()
        self._robot.close()

    def tick(self, link: Link) -> None:
        """Read and publish the state, hold the robot if no gateway is present, and advance the motions."""
        self._hold_after_pause()
        now_ns = self._monotonic_ns()
        elapsed_s = 0.0 if self._tick_ns is None else (now_ns - self._tick_ns) / 1e9
        self._tick_ns = now_ns
        self._reading = self._read(now_ns)
        self._publish_state(link, now_ns)
        self._watch_gateways(link, now_ns)
        if self._reading is not None:
            self._move(self._reading, elapsed_s)
        if self._host:
            self._tick_components(link, now_ns)
        self._publish_progress(link, now_ns)
        fault = self._fault or self._operating.fault
        if (condition := self._conditions.due(fault, self._told_of_joints(), link.arrivals, now_ns)) is not None:
            link.publish_condition(condition)
        if self._described_anew is not None:
            raise self._described_anew

    def _told_of_joints(self) -> Mapping[str, str]:
        """Return a sentence for each joint whose sensor cannot be believed, or that takes no commands now."""
        reading = self._reading
        if reading is None:
            return {}
        return {**reading.held, **reading.faults} if reading.held else reading.faults

    def handle(self, payload: bytes) -> bytes:
        """Check one command and start it. The reply is Accepted, or Refused with the reason. Never raises."""
        self._hold_after_pause()
        command = _decoded(payload, Command)
        if isinstance(command, Refused):
            return codec.encode(command)
        reply = self._judge(command)
        if isinstance(reply, Refused):
            _log.info("%s: command %s refused (%s): %s", self.name, reply.id, reply.code, reply.reason)
        return codec.encode(reply)

    def handle_operate(self, payload: bytes) -> bytes:
        """Check the request of an action of a component and begin it, as ``handle`` does. Never raises."""
        self._hold_after_pause()
        operate = _decoded(payload, Operate)
        reply = operate if isinstance(operate, Refused) else self._operating.judge(operate, self._refuse_moving)
        if isinstance(reply, Refused):
            _log.info("%s: request %s refused (%s): %s", self.name, reply.id, reply.code, reply.reason)
        return codec.encode(reply)

    def handle_sample(self, payload: bytes) -> None:
        """Judge a sample of a stream, and give it to its action. Never raises."""
        self._hold_after_pause()
        sample = _decoded(payload, Sample)
        if isinstance(sample, Refused):
            _log.info("%s: a sample is dropped (%s): %s", self.name, sample.code, sample.reason)
        else:
            self._operating.hear(sample)

    def values(self) -> bytes:
        """Return the values of all components."""
        return self._host.values()

    @property
    def has_components(self) -> bool:
        return bool(self._host)

    def _tick_components(self, link: Link, now_ns: int) -> None:
        self._host.tick(now_ns / 1e9)
        prevented = self._host.prevents_motion
        if prevented and not self._prevented:
            _log.warning("%s: %s; the robot holds", self.name, prevented)
            self._hold(prevented)
        self._prevented = prevented
        self._outcomes += self._operating.step()
        if (values := self._host.values_due(now_ns, self._wall_ns())) is not None:
            link.publish_values(values)
        for event in self._host.events_due():
            link.publish_event(event)

    def _hold(self, reason: str) -> None:
        """Brake all joints and end all actions that move something. All fail with ``reason``."""
        self._outcomes += [*self._motions.halt(reason), *self._operating.hold(reason)]
        self._stops.record(self._movable, self._monotonic_ns())

    def handle_stop(self, payload: bytes) -> bytes:
        """Execute a stop, even if it is old or a duplicate. It is refused only for unknown joints. Never raises."""
        self._hold_after_pause()
        stop = _decoded(payload, Stop)
        reply = stop if isinstance(stop, Refused) else safety.check_stop(stop, self._joints) or self._stop(stop)
        if isinstance(reply, Refused):
            _log.warning("%s: stop %s refused (%s): %s", self.name, reply.id, reply.code, reply.reason)
        elif self._link is not None:
            asyncio.get_running_loop().call_soon(self._publish_extra_frame)
        return codec.encode(reply)

    def _hold_after_pause(self) -> None:
        """Hold if this agent has not run for longer than the lease of gateways.

        Whoever moved the robot cannot have seen or stopped it meanwhile (IEC 60204-1, 9.2.3.2: no restart by itself).
        This precedes everything else in each call from outside, because a command that waited for the end of the pause
        can come before the first tick.
        """
        before_ns, now_ns = self._ran_ns, (self._monotonic_ns(), self._elapsed_ns())
        self._ran_ns = now_ns
        if before_ns is None:
            return
        pause_s = max(now_ns[0] - before_ns[0], now_ns[1] - before_ns[1]) / 1e9
        if pause_s <= GATEWAY_LEASE_MS / 1000.0:
            return
        reason = f"the agent did not run for {pause_s:.1f} s"
        _log.warning("%s: %s: it or the machine was paused; the robot holds", self.name, reason)
        self._outcomes += [*self._motions.hold_after_pause(reason), *self._operating.hold(reason)]
        self.demonstration.log_ended()
        self._stops.record(self._movable, now_ns[0])
        self._report.repeat_later(now_ns[0])

    def _publish_extra_frame(self) -> None:
        """Publish a frame after a stop, for gateways that have not sent it. Many stops in a row share one frame."""
        now_ns = self._monotonic_ns()
        if self._link is not None and now_ns - self._frames.published_ns >= _LEAST_APART * 1e9 / self.rate_hz:
            self._reading = self._read(now_ns)
            self._publish_state(self._link, now_ns)

    def mesh(self, question: bytes) -> bytes:
        """Return the mesh with the given digest, read from disk. Call it in a thread. Raises MeshError."""
        return self._meshes.read(question)

    def picture(self, question: bytes) -> bytes:
        """Return a camera picture of the last published frame. Call it in a thread. Raises PictureError."""
        return self._cameras.take(question, self._frames.latest)

    @property
    def has_cameras(self) -> bool:
        return bool(self._cameras.offers)

    def _judge(self, command: Command) -> Reply:
        verdict = safety.check_command(
            command,
            now_ns=self._monotonic_ns(),
            incarnation=self.incarnation,
            joints=self._joints,
            seen=self._seen,
            stops=self._stops,
        )
        return (
            verdict
            if isinstance(verdict, Refused)
            else self._refuse_now(command) or self._start(command, verdict.at_ns)
        )

    def _refuse_now(self, command: Command) -> Refused | None:
        """Return the refusal of a valid command that cannot run now, or None."""
        if (refusal := self._refuse_moving(command.id)) is not None:
            return refusal
        concerned = dict.fromkeys((*joints_of(command.motion), *command.expects))
        unknown = [name for name in concerned if not math.isfinite(self._measured.positions[name])]
        if unknown:
            why = next(filter(None, (self._measured.faults.get(name) for name in unknown)), "")
            said = f"the position of {', '.join(unknown)} is unknown{f': {why}' if why else ''}"
            return Refused(command.id, "fault", said[:1024])
        if lost := safety.far_outside(joints_of(command.motion), self._measured.positions, self._joints):
            return Refused(command.id, "fault", lost[:1024])
        if held := self._held(joints_of(command.motion)):
            return Refused(command.id, "fault", held[:1024])
        if moved := self._motions.unsettled(joints_of(command.motion), self._measured.positions):
            return Refused(command.id, "fault", moved[:1024])
        surprise = safety.position_mismatch(command.expects, self._measured.positions, self._joints)
        return Refused(command.id, "expectation", surprise[:1024]) if surprise else None

    def _held(self, joints: Iterable[str]) -> str:
        """Return why one of these joints takes no commands now, or an empty string."""
        held = {} if self._reading is None else self._reading.held
        return next((f"{name} takes no command now: {held[name]}" for name in joints if name in held), "")

    def _refuse_moving(self, id: str) -> Refused | None:
        """Return the refusal of anything that moves the robot now, or None."""
        if self._fault is not None:
            return Refused(id, "fault", f"the robot has a fault: {self._fault}"[:1024])
        if not self._gateway_present:
            return Refused(id, "fault", "no gateway is present, and the robot holds until one is")
        return self._operating.refuse_motion(id)

    def _start(self, command: Command, at_ns: int) -> Reply:
        try:
            made = self._plan(command)
        except ImpossibleError as error:
            return Refused(command.id, "limits", str(error)[:1024])
        joints = tuple(made.trajectories)
        preempted = (*self._motions.preemptible_ids(joints), *self._operating.blocking(joints))
        if not command.rehearsal:
            self._seen.add(command.id)
            self._begin(command, made)
            self.demonstration.log_ended()
        return Accepted(command.id, made.duration_s, preempted[:1024], at_ns)

    def _begin(self, command: Command, made: Plan) -> None:
        """Begin a motion now, or once the actions that move its joints have ended."""
        joints = tuple(made.trajectories)
        if not self._operating.blocking(joints):
            self._outcomes += self._start_motion(command.id, made)
            return
        self._outcomes += [*self._operating.give_way(command.id, joints), *self._motions.release(joints, command.id)]
        self._operating.begin_when_free(command.id, joints, partial(self._begin_late, command))

    def _begin_late(self, command: Command) -> list[Outcome]:
        """Begin a motion that has waited, from where its joints are now."""
        try:
            return self._start_motion(command.id, self._plan(command))
        except ImpossibleError as error:
            return [Outcome(command.id, "failed", joints_of(command.motion), str(error)[:1024])]

    def _start_motion(self, id: str, made: Plan) -> list[Outcome]:
        """Start a motion, which controllers follow if they can."""
        outcomes = self._motions.start(id, made, followed=self._follower is not None)
        self._leave_motions()
        if self._follower is not None:
            whole = self._motions.trajectories(self._group_of(made.trajectories), id)
            if whole is None or not self._follower.follow(id, whole):
                self._motions.take_back(made.trajectories)
                self._motions.left.clear()
        return outcomes

    def _group_of(self, joints: Iterable[str]) -> list[str]:
        """Return the joints, and all that are coupled to them."""
        return list(dict.fromkeys(each for name in joints for each in (name, *self._coupled.get(name, ()))))

    def _leave_motions(self) -> None:
        """Tell the robot which motions its controllers are not to follow any more."""
        while self._motions.left:
            id = self._motions.left.pop()
            if self._follower is not None:
                self._follower.leave(id)

    def _plan(self, command: Command) -> Plan:
        """Plan the motion of a command from the present setpoints. Raises ImpossibleError."""
        motion = self._motions.unwound(safety.clamp(command.motion, self._joints), self._measured.positions)
        return plan(motion, command.scale, self._motions.starts(joints_of(motion)))

    def _stop(self, stop: Stop) -> Accepted:
        now_ns = self._monotonic_ns()
        named = [self._leader(name) for name in stop.joints or self._names]
        joints = [name for name in dict.fromkeys(named) if name is not None]
        acting = self._operating.stoppable(stop, joints)
        acting_s = self._operating.stop_s(acting)
        motions = self._motions.stoppable_ids(joints, stop.command)
        cancelled = tuple(dict.fromkeys((*motions, *self._operating.known(acting))))[:1024]
        if stop.rehearsal:
            braking_s = max(self._motions.braking_s(joints, stop.command), acting_s)
            return Accepted(stop.id, braking_s, cancelled, now_ns)
        if stop.command:
            self._stops.cancel(stop.command)
            self._report.repeat_end(stop.command)
        else:
            self._stops.record(joints if stop.joints else (*joints, BASE), now_ns)
        reason = stop.reason or "stopped"
        others = partial(self._operating.still_running, acting)
        self._outcomes += self._operating.stop(stop, acting)
        note = str if stop.command else self._end_others(joints if stop.joints else (*joints, BASE))
        duration_s, outcomes = self._motions.stop(stop.id, joints, stop.command, reason, others, acting_s, note)
        self._outcomes += outcomes
        self._leave_motions()
        if self._fault is not None:
            # Nothing can be measured, so only the driver knows if the robot stands.
            problem = self._stop_robot() or "the driver was told to hold the robot, whose standstill cannot be measured"
            self._outcomes += self._motions.fail_stop(stop.id, f"{problem}: {self._fault}"[:1024])
        _log.warning("%s: stop %s: %s", self.name, stop.id, reason)
        self.demonstration.log_ended()
        return Accepted(stop.id, duration_s, cancelled, now_ns)

    def _end_others(self, joints: Sequence[str]) -> Callable[[], str]:
        """End what other clients of the robot's controllers move. Return what says later which that was."""
        follower = self._follower
        if follower is None:
            return str
        follower.end_others(joints)
        return lambda: follower.ended_others

    def _leader(self, name: str) -> str | None:
        """Return the joint that takes the commands for ``name``, following mimics; None if there is none."""
        for _ in self._names:
            joint = self._joints.get(name)
            if joint is None or joint.mimics is None:
                return None if joint is None else name
            name = joint.mimics
        return None

    def _read(self, now_ns: int) -> Reading | None:
        try:
            reading = self._robot.read(now_ns / 1e9)
            counts = (len(reading.positions), len(reading.velocities), len(reading.efforts))
            if counts != self._counts:
                raise ValueError(f"{counts} positions, velocities and efforts of {len(self._names)} joints")
            # ``hypot`` raises TypeError for what is no number, and is infinite if a value is, also beside NaN.
            if reading.measured_s and len(reading.measured_s) != len(self._names):
                raise ValueError(f"{len(reading.measured_s)} times of measurement of {len(self._names)} joints")
            if math.isinf(math.hypot(*reading.positions, *reading.velocities, *reading.efforts)):
                raise ValueError("a measured value is infinite")
        except Exception as error:  # noqa: BLE001 - a driver may raise whatever its hardware library does
            self._described_anew = error if isinstance(error, NewDescriptionError) else None
            self._fail(error, "read")
            return None
        if self._fault is not None:
            _log.warning("%s: the robot can be read again", self.name)
            self._fault = None
        return self._believed(reading, now_ns / 1e9)

    def _believed(self, reading: Reading, now_s: float) -> Reading:
        """Return the reading without the positions that contradict the ones before."""
        positions = reading.positions
        if self._judges:
            times = reading.measured_s or (now_s,) * len(self._names)
            positions = tuple(map(JointSensor.update, self._sensors.values(), positions, times))
        if not (reading.faults or self._doubted) and math.isfinite(sum(positions)):  # almost always
            return reading
        faults = {name: sensor.fault for name, sensor in self._sensors.items() if sensor.fault}
        for name, fault in reading.faults.items():
            faults[name] = fault
            if self._judges:
                self._sensors[name].forget()  # the driver judges this one itself
        for name in faults.keys() - self._doubted:
            _log.warning("%s: %s", self.name, faults[name])
        for name in self._doubted - faults.keys():
            _log.warning("%s: the sensor of %s is consistent again", self.name, name)
        self._doubted = faults.keys()
        return reading._replace(positions=positions, faults=faults) if faults else reading

    @property
    def _measured(self) -> Measurements:
        """The last reading by joint. Built on demand, because most ticks move nothing and do not need it."""
        reading = self._reading
        if reading is None:
            return Measurements(dict.fromkeys(self._names, math.nan))
        return Measurements(
            dict(zip(self._names, reading.positions, strict=True)),
            dict(zip(self._names, reading.efforts, strict=True)),
            {name: sensor.standing_s for name, sensor in self._sensors.items()},
            reading.faults,
        )

    def _fail(self, error: Exception, doing: str) -> None:
        reason = f"{doing} failed: {error or type(error).__name__}"
        if self._fault is None:
            _log.exception("%s: %s; the robot holds", self.name, reason)
            self._stop_robot()
        self._fault = reason
        self._reading = None
        why = f"driver fault: {reason}"[:1024]
        self._outcomes += [*self._motions.fail_all(why), *self._operating.hold(why)]

    def _stop_robot(self) -> str:
        """Make the driver hold. Return why it could not, or an empty string."""
        try:
            self._robot.stop()
        except Exception as error:  # noqa: BLE001 - as in _read
            _log.exception("%s: the robot could not be stopped", self.name)
            return f"the robot could not be stopped: {error or type(error).__name__}"
        return ""

    def _publish_state(self, link: Link, now_ns: int) -> None:
        link.publish_state(self._frames.encode(self._reading, now_ns, self._wall_ns()))

    def _watch_gateways(self, link: Link, now_ns: int) -> None:
        link.watch_gateways(1.0 / self.rate_hz)
        present = link.gateway_present
        if self._gateway_present and not present:
            _log.warning("%s: the last gateway is gone; the robot holds", self.name)
            self._hold("gateway lost")
            self._lost_ns = now_ns
        elif present and not self._gateway_present and self._lost_ns is None:
            _log.info("%s: a gateway is present", self.name)
        elif present and not self._gateway_present:
            away_s = (now_ns - (self._lost_ns or now_ns)) / 1e9
            _log.warning("%s: a gateway is back after %.1f s; the robot takes commands again", self.name, away_s)
        self._gateway_present = present

    def _move(self, reading: Reading, elapsed_s: float) -> None:
        motions, idle = self._motions, self._motions.idle
        motions.setpoints.follow(reading.positions, () if idle else motions.driven, elapsed_s)
        if idle:
            return
        if self._follower is not None:
            for end in self._follower.ended():
                self._outcomes += motions.end_followed(end.id, end.reason, self._measured.positions)
        setpoints, outcomes = motions.step(
            elapsed_s, self._measured, held=not self._gateway_present or bool(self._prevented)
        )
        self._outcomes += outcomes
        if setpoints:
            self._send(setpoints, elapsed_s)
        self._leave_motions()

    def _send(self, setpoints: dict[str, float], elapsed_s: float) -> None:
        """Send setpoints to the robot. Nothing else does."""
        last = self._motions.setpoints
        for group in {self._coupled[name] for name in setpoints if name in self._coupled}:
            for name in group:
                if math.isfinite(last[name]):
                    setpoints.setdefault(name, last[name])
        self._motions.take_back(setpoints)
        try:
            self._motions.adopt_setpoints(self._robot.apply(last.limit(setpoints, elapsed_s)))
        except Exception as error:  # noqa: BLE001 - as in _read
            self._fail(error, "apply")

    def _publish_progress(self, link: Link, now_ns: int) -> None:
        for payload in self._report.repeat(link.arrivals, now_ns):
            link.publish_progress(payload, final=True)
        outcomes = [*self._outcomes, *(self._running_progress() if self._report.due(now_ns) else ())]
        if not outcomes:
            return
        wall_ns, positions = self._wall_ns(), self._measured.positions
        for outcome in outcomes:
            payload = self._report.write(outcome, positions, now_ns, wall_ns)
            link.publish_progress(payload, final=outcome.state != "running")
        self._outcomes.clear()

    def _running_progress(self) -> list[Outcome]:
        return [*self._motions.running_progress(), *self._operating.running_progress()]


def _decoded(payload: bytes, kind: type[_M]) -> _M | Refused:
    try:
        return codec.decode(payload, kind)
    except VersionError as error:
        return Refused("", "version", str(error)[:1024])
    except WireError as error:
        return Refused("", "malformed", str(error)[:1024])
