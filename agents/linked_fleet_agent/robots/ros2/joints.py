"""Joints of a ROS 2 robot: their last states, and setpoints as points of trajectories. Pure: times are passed in.

A joint without recent news is unknown.

The joint_trajectory_controller of ros2_control replaces its trajectory by each new one and holds the end of the last.
So it gets one point at a time, as from MoveIt Servo: the positions to reach a few cycles later. It interpolates between
points, and stands at the last one if no more arrive.
"""

import logging
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from operator import itemgetter
from typing import NamedTuple

from linked_fleet_agent.robot import JointFacts, Reading, RobotFaultError
from linked_fleet_agent.robots.ros2.cdr import JointState
from linked_fleet_agent.sensors import JointSensor
from linked_fleet_agent.setpoints import HOLDING
from linked_fleet_agent.urdf.joints import Mimic

_log = logging.getLogger(__name__)

_MOST_STRANGERS, _MOST_PUBLISHERS = 64, 64
# Assumed until messages have come: the usual rate of the joint_state_broadcaster is 50 to 500 Hz.
_PERIOD_S = 0.02


class _Sample(NamedTuple):
    """The last state of a joint, and the time of its arrival."""

    position: float
    velocity: float
    effort: float
    measured_s: float


class _Publisher:
    """The messages with the same names. ``merged`` picks the value of each joint of the robot.

    It takes a row of a message, followed by the values that were known before, of which it keeps those of the joints
    that the message lacks.
    """

    __slots__ = ("_said", "_stamped", "merged")

    def __init__(self, names: Sequence[str], joints: Sequence[str]) -> None:
        places = {name.strip(): place for place, name in enumerate(names)}  # as in the description
        order = [places.get(joint, len(names) + index) for index, joint in enumerate(joints)]
        self.merged: Callable[[tuple[float, ...]], tuple[float, ...]] = (
            itemgetter(*order) if len(order) > 1 else itemgetter(slice(order[0], order[0] + 1))
        )
        self._said: JointState | None = None
        self._stamped = False

    def repeats(self, state: JointState) -> bool:
        """Return True for a message with stamp and values of the last one, if the stamps of others change."""
        last, self._said = self._said, state
        if last is None:
            return False
        if last.stamp_ns != state.stamp_ns:
            self._stamped = True
            return False
        return self._stamped and state.stamp_ns != 0 and state == last


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
        self.sensors = {joint.name: JointSensor(joint, _PERIOD_S) for joint in joints}
        self._places = {name: place for place, name in enumerate(self.sensors)}
        self._mimics = {self._places[name]: mimic for name, mimic in (mimics or {}).items() if name in self._places}
        self._publishers = dict[tuple[str, ...], _Publisher]()
        self._strangers: set[str] = set()
        unknown = (math.nan,) * len(self.sensors)
        self._said = self._believed = self._velocities = self._efforts = unknown
        self._arrived_s = (-math.inf,) * len(self.sensors)
        self._faults: Mapping[str, str] = {}

    def update(self, state: JointState, arrived_s: float) -> None:
        """Store a message.

        One with stamp and values of the last message is a repetition and ignored, if the stamps of others change.
        """
        publisher = self._publishers.get(state.names) or self._meet(state.names)
        if publisher.repeats(state):
            return
        merged = publisher.merged
        self._said = merged(state.positions + self._said)
        self._velocities = merged(state.velocities + self._velocities)
        self._efforts = merged(state.efforts + self._efforts)
        self._arrived_s = merged((arrived_s,) * len(state.names) + self._arrived_s)
        self._believed = tuple(map(JointSensor.update, self.sensors.values(), self._said, self._arrived_s))
        doubted = math.isnan(sum(self._believed))
        self._faults = {name: each.fault for name, each in self.sensors.items() if each.fault} if doubted else {}

    def reading(self, now_s: float) -> Reading:
        """Return the state of all joints. Raises RobotFaultError if all of them are stale."""
        if now_s - max(self._arrived_s, default=-math.inf) > self._stale_s:
            raise RobotFaultError(f"no joint state of this robot came on {self._topic} for {self._stale_s:g} s")
        rows: tuple[tuple[float, ...], ...] = self._believed, self._velocities, self._efforts, self._arrived_s
        if now_s - min(self._arrived_s) > self._stale_s:
            rows = self._without_stale(now_s)
        positions, velocities, efforts, measured_s = rows
        return Reading(positions, velocities, efforts, measured_s=measured_s, faults=self._faults)

    def position(self, name: str, now_s: float) -> float:
        """Return the position of the joint in rad or m; NaN is unknown."""
        return self._sample(self._places[name], now_s).position

    def _meet(self, names: tuple[str, ...]) -> _Publisher:
        """Return a new publisher; the oldest is forgotten for it if there are many."""
        if len(self._publishers) >= _MOST_PUBLISHERS:
            del self._publishers[next(iter(self._publishers))]
        self._publishers[names] = made = _Publisher(names, tuple(self.sensors))
        for name in names:
            if name.strip() not in self._places:
                self._warn_of_unknown(name.strip())
        return made

    def _without_stale(self, now_s: float) -> tuple[tuple[float, ...], ...]:
        """Return the rows of all joints, of which those without news are unknown or follow another joint."""
        rows = [list(row) for row in (self._believed, self._velocities, self._efforts, self._arrived_s)]
        for place, at_s in enumerate(self._arrived_s):
            if now_s - at_s > self._stale_s:
                for row, value in zip(rows, self._sample(place, now_s), strict=True):
                    row[place] = value
        return tuple(map(tuple, rows))

    def _sample(self, place: int, now_s: float) -> _Sample:
        at_s = self._arrived_s[place]
        if now_s - at_s <= self._stale_s:
            return _Sample(self._believed[place], self._velocities[place], self._efforts[place], at_s)
        mimic = self._mimics.get(place)
        if mimic is None:
            return _Sample(math.nan, math.nan, math.nan, now_s)
        leader = self._sample(self._places[mimic.joint], now_s)
        position, velocity = mimic.multiplier * leader.position + mimic.offset, mimic.multiplier * leader.velocity
        return _Sample(position, velocity, math.nan, leader.measured_s)

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
