"""Joints of a ROS 2 robot: their last states, and setpoints as points of trajectories. Pure: times are passed in.

A joint without recent news is unknown.

The joint_trajectory_controller of ros2_control replaces its trajectory by each new one and holds the end of the last.
So it gets one point at a time, as from MoveIt Servo: the positions to reach a few cycles later. It interpolates between
points, and stands at the last one if no more arrive.
"""

import logging
import math
from collections.abc import Iterable, Mapping
from typing import NamedTuple

from linked_fleet_agent.robot import JointFacts, Reading, RobotFaultError
from linked_fleet_agent.robots.ros2.cdr import JointState
from linked_fleet_agent.sensors import JointSensor
from linked_fleet_agent.setpoints import HOLDING
from linked_fleet_agent.urdf.joints import Mimic

_log = logging.getLogger(__name__)

_MOST_STRANGERS = 64
# Assumed until messages have come: the usual rate of the joint_state_broadcaster is 50 to 500 Hz.
_PERIOD_S = 0.02


class _JointSample(NamedTuple):
    """The last state of a joint, its values as ``said``. ``stamped`` says that the stamps of its messages change."""

    said: list[float]
    stamp_ns: int
    stamped: bool
    arrived_s: float
    position: float
    velocity: float
    effort: float


class JointStates:
    """Joint states of one robot from one or several publishers. Times are monotonic seconds of arrival.

    A joint without news for ``stale_s`` is unknown, and so is one whose positions contradict each other. If no joint
    has news, the robot cannot be measured. The position of a joint of ``mimics`` follows from that of the joint that it
    follows, while nobody states it.
    """

    def __init__(
        self,
        robot: str,
        joints: Iterable[JointFacts],
        topic: str,
        stale_s: float,
        mimics: Mapping[str, Mimic] | None = None,
    ) -> None:
        self._robot, self._topic, self._stale_s = robot, topic, stale_s
        self._mimics = mimics or {}
        self._sensors = {joint.name: JointSensor(joint, _PERIOD_S) for joint in joints}
        self._joints: dict[str, _JointSample | None] = dict.fromkeys(self._sensors)
        self._strangers: set[str] = set()

    def update(self, state: JointState, arrived_s: float) -> None:
        """Store a message.

        One with stamp and values of the last message is a repetition and ignored, if the stamps of others change.
        """
        for stated, *values in zip(state.names, state.positions, state.velocities, state.efforts, strict=True):
            name = stated.strip()  # as in the description
            if name not in self._joints:
                self._warn_of_unknown(name)
                continue
            last, stamp_ns = self._joints[name], state.stamp_ns
            stamped = last is not None and (last.stamped or last.stamp_ns != stamp_ns)
            if stamped and last is not None and stamp_ns == last.stamp_ns != 0 and values == last.said:
                continue
            position, velocity, effort = values
            believed = self._sensors[name].update(position, arrived_s)
            self._joints[name] = _JointSample(values, stamp_ns, stamped, arrived_s, believed, velocity, effort)

    def reading(self, now_s: float) -> Reading:
        """Return the state of all joints. Raises RobotFaultError if all of them are stale."""
        said = [self._fresh_sample(name, now_s) for name in self._joints]
        if not any(said):
            raise RobotFaultError(f"no joint state of this robot came on {self._topic} for {self._stale_s:g} s")
        return Reading(
            positions=tuple(math.nan if one is None else one.position for one in said),
            velocities=tuple(math.nan if one is None else one.velocity for one in said),
            efforts=tuple(math.nan if one is None else one.effort for one in said),
            measured_s=tuple(now_s if one is None else one.arrived_s for one in said),
            faults={name: sensor.fault for name, sensor in self._sensors.items() if sensor.fault},
        )

    def position(self, name: str, now_s: float) -> float:
        """Return the position of the joint in rad or m; NaN is unknown."""
        said = self._fresh_sample(name, now_s)
        return math.nan if said is None else said.position

    def _fresh_sample(self, name: str, now_s: float) -> _JointSample | None:
        said = self._joints[name]
        if said is not None and now_s - said.arrived_s <= self._stale_s:
            return said
        mimic = self._mimics.get(name)
        leader = None if mimic is None else self._fresh_sample(mimic.joint, now_s)
        if mimic is None or leader is None:
            return None
        at, velocity = mimic.multiplier * leader.position + mimic.offset, mimic.multiplier * leader.velocity
        return leader._replace(position=at, velocity=velocity, effort=math.nan)

    def _warn_of_unknown(self, name: str) -> None:
        if name not in self._strangers and len(self._strangers) < _MOST_STRANGERS:
            self._strangers.add(name)
            _log.warning("%s: %s names %.128r, which is not a joint of the URDF", self._robot, self._topic, name)


# A point is reached this long after it was sent, or after this many cycles if the agent's cycles are slow.
SOONEST_S, CYCLES, LATEST_S = 0.05, 3, 0.5


def time_from_start_s(cycle_s: float) -> float:
    """Return the time from sending a point until it is reached, for an agent that sends one per cycle."""
    return min(max(SOONEST_S, CYCLES * cycle_s), LATEST_S)


class TrajectoryPoints:
    """The points of one controller, which needs a position of each of its joints in each message."""

    def __init__(self, topic: str, joints: Iterable[str]) -> None:
        self.topic, self.joints = topic, tuple(joints)
        self._sent: dict[str, float] = {}
        self._sent_s = -math.inf

    def next(self, setpoints: Mapping[str, float], now_s: float) -> dict[str, float]:
        """Return the positions to send (rad or m): the ``setpoints`` of the joints of this controller."""
        return self._note({name: setpoints[name] for name in self.joints if name in setpoints}, now_s)

    def hold(self, measured: Mapping[str, float], now_s: float) -> dict[str, float]:
        """Return the positions that hold the joints: those that were sent a moment ago, else the measured ones.

        A joint that only sags keeps its last position. Joints with unknown position are left out.
        """
        held = {name: measured[name] for name in self.joints if math.isfinite(measured[name])}
        recent = now_s - self._sent_s <= LATEST_S
        for name, at in self._sent.items():
            if recent or abs(held.get(name, math.nan) - at) <= HOLDING:
                held[name] = at
        return self._note(held, now_s)

    def _note(self, positions: dict[str, float], now_s: float) -> dict[str, float]:
        self._sent, self._sent_s = positions, now_s
        return positions
