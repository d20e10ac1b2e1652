"""The last state of each joint and its validity. Pure: times are passed in."""

import logging
import math
from collections.abc import Iterable
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

    def take(self, state: JointState, arrived_s: float) -> None:
        """Store a message. A joint whose stamp equals that of its last message is a repetition and is ignored."""
        for name, *values in zip(state.names, state.positions, state.velocities, state.efforts, strict=True):
            if name not in self._joints:
                self._tell_of(name)
                continue
            last = self._joints[name]
            if last is None or state.stamp_ns == 0 or state.stamp_ns != last.stamp_ns:
                self._joints[name] = _JointSample(state.stamp_ns, arrived_s, *values)

    def reading(self, now_s: float) -> Reading:
        """Return the state of all joints. Raises RobotFaultError if all of them are stale."""
        said = [self._lately(name, now_s) for name in self._joints]
        if not any(said):
            raise RobotFaultError(f"no joint state of this robot came on {self._topic} for {self._stale_s:g} s")
        return Reading(
            positions=tuple(math.nan if one is None else one.position for one in said),
            velocities=tuple(math.nan if one is None else one.velocity for one in said),
            efforts=tuple(math.nan if one is None else one.effort for one in said),
        )

    def position(self, name: str, now_s: float) -> float:
        """Return the position of the joint in rad or m; NaN is unknown."""
        said = self._lately(name, now_s)
        return math.nan if said is None else said.position

    def _lately(self, name: str, now_s: float) -> _JointSample | None:
        said = self._joints[name]
        return None if said is None or now_s - said.arrived_s > self._stale_s else said

    def _tell_of(self, name: str) -> None:
        if name not in self._strangers and len(self._strangers) < _MOST_STRANGERS:
            self._strangers.add(name)
            _log.warning("%s: %s says something of %.128r, no joint of the URDF", self._robot, self._topic, name)
