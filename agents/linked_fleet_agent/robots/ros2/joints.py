"""Joints of a ROS 2 robot: their last states, and setpoints as points of trajectories. Pure: times are passed in.

A joint without recent news is unknown.

The joint_trajectory_controller of ros2_control replaces its trajectory by each new one and holds the end of the last.
So it gets one point at a time, as from MoveIt Servo: the positions to reach a few cycles later. It interpolates between
points, and stands at the last one if no more arrive.
"""

import logging
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from linked_fleet_agent.robot import Reading, RobotFaultError
from linked_fleet_agent.robots.ros2.cdr import JointState

_log = logging.getLogger(__name__)

_MOST_STRANGERS = 64


@dataclass(frozen=True)
class _JointSample:
    stamp_ns: int
    arrived_s: float
    position: float
    velocity: float
    effort: float


class JointStates:
    """Joint states of one robot from one or several publishers. Times are monotonic seconds of arrival.

    A joint without news for ``stale_s`` is unknown. If that holds for all joints, the robot cannot be measured.
    """

    def __init__(self, robot: str, joints: Iterable[str], topic: str, stale_s: float) -> None:
        self._robot, self._topic, self._stale_s = robot, topic, stale_s
        self._joints: dict[str, _JointSample | None] = dict.fromkeys(joints)
        self._strangers: set[str] = set()

    def update(self, state: JointState, arrived_s: float) -> None:
        """Store a message. A joint whose stamp equals that of its last message is a repetition and is ignored."""
        for stated, *values in zip(state.names, state.positions, state.velocities, state.efforts, strict=True):
            name = stated.strip()  # as in the description
            if name not in self._joints:
                self._warn_of_unknown(name)
                continue
            last = self._joints[name]
            if last is None or state.stamp_ns == 0 or state.stamp_ns != last.stamp_ns:
                self._joints[name] = _JointSample(state.stamp_ns, arrived_s, *values)

    def reading(self, now_s: float) -> Reading:
        """Return the state of all joints. Raises RobotFaultError if all of them are stale."""
        said = [self._fresh_sample(name, now_s) for name in self._joints]
        if not any(said):
            raise RobotFaultError(f"no joint state of this robot came on {self._topic} for {self._stale_s:g} s")
        return Reading(
            positions=tuple(math.nan if one is None else one.position for one in said),
            velocities=tuple(math.nan if one is None else one.velocity for one in said),
            efforts=tuple(math.nan if one is None else one.effort for one in said),
        )

    def position(self, name: str, now_s: float) -> float:
        """Return the position of the joint in rad or m; NaN is unknown."""
        said = self._fresh_sample(name, now_s)
        return math.nan if said is None else said.position

    def _fresh_sample(self, name: str, now_s: float) -> _JointSample | None:
        said = self._joints[name]
        return None if said is None or now_s - said.arrived_s > self._stale_s else said

    def _warn_of_unknown(self, name: str) -> None:
        if name not in self._strangers and len(self._strangers) < _MOST_STRANGERS:
            self._strangers.add(name)
            _log.warning("%s: %s names %.128r, which is not a joint of the URDF", self._robot, self._topic, name)


# A point is reached this long after it was sent, or after this many cycles if the agent's cycles are slow.
SOONEST_S, CYCLES, LATEST_S = 0.05, 3, 0.5
# A joint this close to its last sent position counts as holding it. Sending its sagged position would add sag.
_HOLDING = 0.01


def time_from_start_s(cycle_s: float) -> float:
    """Return the time from sending a point until it is reached, for an agent that sends one per cycle."""
    return min(max(SOONEST_S, CYCLES * cycle_s), LATEST_S)


class TrajectoryPoints:
    """The points of one controller.

    Each message needs all of its joints; those that are not moved stay where they are.
    """

    def __init__(self, topic: str, joints: Iterable[str]) -> None:
        self.topic, self.joints = topic, tuple(joints)
        self._sent: dict[str, float] = {}
        self._sent_s = -math.inf

    def next(self, setpoints: Mapping[str, float], measured: Mapping[str, float], now_s: float) -> dict[str, float]:
        """Return the positions to send (rad or m). After a pause, a joint that others have moved stays at its new
        position.

        Joints with neither a setpoint nor a known position (NaN) are left out.
        """
        staying = self._held(measured)
        if now_s - self._sent_s <= LATEST_S:
            staying |= self._sent
        return self._note(staying | dict(setpoints), now_s)

    def hold(self, measured: Mapping[str, float], now_s: float) -> dict[str, float]:
        """Return the positions that hold the joints; joints with unknown position are left out."""
        return self._note(self._held(measured), now_s)

    def _held(self, measured: Mapping[str, float]) -> dict[str, float]:
        known = {name: measured[name] for name in self.joints if math.isfinite(measured[name])}
        sent = {name: self._sent.get(name, at) for name, at in known.items()}
        return {name: sent[name] if abs(sent[name] - at) <= _HOLDING else at for name, at in known.items()}

    def _note(self, positions: dict[str, float], now_s: float) -> dict[str, float]:
        self._sent, self._sent_s = positions, now_s
        return {name: positions[name] for name in self.joints if name in positions}
