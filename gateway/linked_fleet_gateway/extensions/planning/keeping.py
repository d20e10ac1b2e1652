"""Constraints of a link on a path: judged on the curve that the agent follows. Radian, metre, second."""

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from linked_fleet_gateway.extensions.planning.messages import Broken, Constraints, LeastManipulability
from linked_fleet_gateway.extensions.planning.timing import Timed, curve_places
from linked_fleet_gateway.extensions.world.messages import Check, Positions
from linked_fleet_gateway.extensions.world.robot import Robot, put
from linked_fleet_gateway.extensions.world.surfaces import Array
from linked_fleet_gateway.extensions.world.surroundings import MovingRobot, se3

AXES: Mapping[str, Array] = {
    sign + name: (-1.0 if sign else 1.0) * row for name, row in zip("xyz", np.eye(3), strict=True) for sign in ("", "-")
}
_ROUNDING = 1e-6
_SPEED_SHARE = 0.98
"""Share of the highest speed of the tip, which is measured between places of the curve."""
_MOST_SINGULAR_VALUES = 6


class _Seen(NamedTuple):
    """The tip in one configuration: its place in the world, its tilt, and its manipulability."""

    place: Array
    tilt: float
    manipulability: float


class Keeper:
    """The tip of a robot, and what it keeps to. ``joints`` are those that move, in the order of rows of positions."""

    def __init__(self, around: Check, robot: Robot, keeps: Constraints, joints: Sequence[str]) -> None:
        self._robot, self._model, self._data = robot, robot.model, robot.model.createData()
        self.keeps, self._joints = keeps, joints
        self._base = se3(around.robot.base)
        self._start = around.paths[0].start
        self._q = MovingRobot(robot, self._start).configuration
        self._frame = self._model.getFrameId(keeps.tip, pin.FrameType.BODY)
        self._columns = [self._model.joints[self._model.getJointId(name)].idx_v for name in joints]
        self.axis = keeps.axis or self._upmost_axis()

    def _pose(self) -> pin.SE3:
        pin.framesForwardKinematics(self._model, self._data, self._q)
        return self._base * self._data.oMf[self._frame]

    def _upmost_axis(self) -> str:
        upward = self._pose().rotation[2]
        return max(AXES, key=lambda name: float(AXES[name] @ upward))

    def _look(self, row: Sequence[float]) -> _Seen:
        for name, position in zip(self._joints, row, strict=True):
            put(self._robot, self._q, self._model.getJointId(name), position)
        at = self._pose()
        jacobian = pin.computeFrameJacobian(self._model, self._data, self._q, self._frame, pin.LOCAL)[:, self._columns]
        tilt = math.acos(float(np.clip((at.rotation @ AXES[self.axis])[2], -1.0, 1.0)))
        moving = jacobian[:, np.abs(jacobian).max(axis=0) > 0.0]
        values = np.linalg.svd(moving, compute_uv=False)[:_MOST_SINGULAR_VALUES]
        return _Seen(at.translation.copy(), tilt, float(np.prod(values)) if len(values) else 0.0)

    def broken_at(self, place: Positions, share: float) -> Broken | None:
        """Return the constraint that is not kept to at the start (share 0) or at a goal (1)."""
        return self._broken(self._look([place[name] for name in self._joints]), share)

    def _broken(self, seen: _Seen, share: float) -> Broken | None:
        keeps = self.keeps
        if keeps.upright is not None and seen.tilt > keeps.upright + _ROUNDING:
            return Broken("upright", share, seen.tilt, keeps.upright, self.axis)
        for name, value, low, high in zip("xyz", seen.place.tolist(), *(keeps.stay_in or ((), ())), strict=False):
            if not low - _ROUNDING <= value <= high + _ROUNDING:
                return Broken("stayIn", share, value, low if value < low else high, name)
        if seen.manipulability < keeps.least_manipulability - _ROUNDING:
            return Broken("leastManipulability", share, seen.manipulability, keeps.least_manipulability)
        return None

    def judged(self, timed: Timed) -> Broken | None:
        """Return the first constraint that a motion does not keep to."""
        for time_s, row in curve_places(timed):
            share = round(time_s / timed.duration_s, 3)
            if (broken := self._broken(self._look(row.tolist()), share)) is not None:
                return broken
        return None

    def slowed(self, timed: Timed) -> Timed:
        """Return the motion so slow that the tip is never faster than it may be."""
        if self.keeps.tip_speed is None:
            return timed
        times, rows = zip(*curve_places(timed), strict=True)
        places = np.array([self._look(row.tolist()).place for row in rows])
        speeds = np.linalg.norm(np.diff(places, axis=0), axis=1) / np.diff(times)
        excess = float(speeds.max()) / (_SPEED_SHARE * self.keeps.tip_speed)
        return timed if excess <= 1.0 else Timed((timed.times_s * excess).tolist(), timed.positions)

    def least(self, timed: Timed) -> LeastManipulability:
        """Return where the manipulability is least at the waypoints of a motion."""
        seen = [self._look(row).manipulability for row in timed.positions.tolist()]
        least = int(np.argmin(seen))
        return LeastManipulability(seen[least], float(timed.times_s[least]))
