"""Straight lines of a link: joint positions that keep it on a line, with its orientation turning evenly (slerp).

The joints follow the line by differential inverse kinematics from where they stand, so that they never change to
another posture. Where the line leaves what the joints can do, or where they would have to jump, it ends, and the answer
says where. Metre, radian.
"""

import math
import tempfile
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pinocchio as pin
from roboplan.core import JointPath

from linked_fleet_gateway.extensions.planning.keeping import Keeper
from linked_fleet_gateway.extensions.planning.messages import (
    FindStraight,
    LineEnds,
    PlanAnswer,
    PlanFailed,
    StraightFound,
)
from linked_fleet_gateway.extensions.planning.planner_scene import SceneWriter
from linked_fleet_gateway.extensions.planning.timing import Timed, curve_places, smooth
from linked_fleet_gateway.extensions.world.robot import Robot, put
from linked_fleet_gateway.extensions.world.surfaces import Array
from linked_fleet_gateway.extensions.world.surroundings import MovingRobot

MOST_OFF_M, MOST_OFF_RAD = 0.001, math.radians(0.5)
"""Largest distance of the link from the line, and of its orientation from the even turn."""
STEP_M, STEP_RAD = 0.005, math.radians(1.0)
_SOLVED_M, _SOLVED_RAD = 1e-6, 1e-6
_DAMPING = 1e-4
_MOST_ITERATIONS = 40
_JUMP = 20.0
"""A joint that moves further in a step than this times the step of the line (rad per m or rad) jumps."""
_MOST_REFINED = 3
_NO_WAY = 1e-6
_SAME = 1e-3


class _Line(NamedTuple):
    """The pose of a link along a line, by the completed share."""

    start: pin.SE3
    end: pin.SE3

    @property
    def length_m(self) -> float:
        return float(np.linalg.norm(self.end.translation - self.start.translation))

    @property
    def turn_rad(self) -> float:
        return float(np.linalg.norm(pin.log3(self.start.rotation.T @ self.end.rotation)))

    def at(self, share: float) -> pin.SE3:
        turned = self.start.rotation @ pin.exp3(share * pin.log3(self.start.rotation.T @ self.end.rotation))
        return pin.SE3(turned, (1.0 - share) * self.start.translation + share * self.end.translation)

    def deviation(self, at: pin.SE3) -> tuple[float, float]:
        """Return how far a pose is from the line, and from the orientation at the nearest place of the line."""
        way = self.end.translation - self.start.translation
        far = float(way @ way)
        if far > _NO_WAY**2:
            share = float((at.translation - self.start.translation) @ way) / far
        else:
            turn = pin.log3(self.start.rotation.T @ self.end.rotation)
            share = float(pin.log3(self.start.rotation.T @ at.rotation) @ turn) / max(float(turn @ turn), _NO_WAY**2)
        there = self.at(min(max(share, 0.0), 1.0))
        off_m = float(np.linalg.norm(at.translation - there.translation))
        return off_m, float(np.linalg.norm(pin.log3(there.rotation.T @ at.rotation)))


class _Ends(Exception):  # noqa: N818
    """The joints cannot follow the line further."""

    def __init__(self, share: float, why: str, joint: str = "") -> None:
        super().__init__(why)
        self.share, self.why, self.joint = share, why, joint


def find_straight(asked: FindStraight, robot: Robot) -> PlanAnswer:
    """Answer a question about a prepared robot."""
    arm = _Arm(robot, asked)
    try:
        rows = arm.along()
        arm.check_end(rows[-1])
    except _Ends as end:
        return LineEnds(round(end.share, 3), end.why, end.joint, tuple(arm.line.at(end.share).translation.tolist()))
    with tempfile.TemporaryDirectory(prefix="linked-fleet-plan-") as folder:
        start = asked.around.paths[0].start
        made = SceneWriter(robot, start, asked.bounds, Path(folder)).build_bare()
        order = [arm.joints.index(name) for name in made.joints]
        path = JointPath()
        path.joint_names, path.positions = made.scene.getJointNames(), [row[order] for row in rows]
        speeds = np.array([asked.bounds[name].speed for name in made.joints])
        timed = smooth(made.scene, path, speeds)
    if timed is None:
        return PlanFailed("no motion along the line keeps to the limits of the joints")
    off_m, off_rad = arm.deviation(timed, made.joints)
    if off_m > MOST_OFF_M or off_rad > MOST_OFF_RAD:
        return PlanFailed(f"the link would leave the line by {1e3 * off_m:.2g} mm and {math.degrees(off_rad):.2g}°")
    least = None
    if asked.keeps.tip:
        keeper = Keeper(asked.around, robot, asked.keeps, made.joints)
        if (broken := keeper.judged(timed)) is not None:
            return broken
        timed = keeper.slowed(timed)
        least = keeper.least(timed)
    positions = tuple(tuple(row) for row in timed.positions.tolist())
    return StraightFound(made.joints, tuple(timed.times_s.tolist()[1:]), positions[1:], off_m, off_rad, least)


class _Arm:
    """The joints that move a link along a line."""

    def __init__(self, robot: Robot, asked: FindStraight) -> None:
        self._robot, self._model, self._data = robot, robot.model, robot.model.createData()
        self.joints = tuple(asked.bounds)
        start = asked.around.paths[0].start
        self._q = MovingRobot(robot, start).configuration
        self._columns = [self._model.joints[self._model.getJointId(name)].idx_v for name in self.joints]
        self._low = np.array([asked.bounds[name].lower for name in self.joints])
        self._high = np.array([asked.bounds[name].upper for name in self.joints])
        self._start = np.array([start[name] for name in self.joints])
        self._goal = np.array([asked.goal[name] for name in self.joints]) if asked.exact else None
        self._frame = self._model.getFrameId(asked.link, pin.FrameType.BODY)
        here = self.pose(self._start)
        there = self.pose(np.array([asked.goal[name] for name in self.joints]))
        self.line = _Line(here, there if asked.turns else pin.SE3(here.rotation, there.translation))

    def pose(self, positions: Array) -> pin.SE3:
        self._put(positions)
        pin.framesForwardKinematics(self._model, self._data, self._q)
        return self._data.oMf[self._frame].copy()

    def _put(self, positions: Array) -> None:
        for name, position in zip(self.joints, positions.tolist(), strict=True):
            put(self._robot, self._q, self._model.getJointId(name), position)

    def along(self) -> list[Array]:
        """Return positions along the line, so dense that the link stays on it between them. Raises _Ends."""
        count = max(1, math.ceil(self.line.length_m / STEP_M), math.ceil(self.line.turn_rad / STEP_RAD))
        for _ in range(_MOST_REFINED):
            rows = list(self._followed(count))
            between = (self.line.deviation(self.pose((a + b) / 2)) for a, b in pairwise(rows))
            if all(off_m < MOST_OFF_M / 4 and off_rad < MOST_OFF_RAD / 4 for off_m, off_rad in between):
                return rows
            count *= 2
        return rows

    def check_end(self, end: Array) -> None:
        """Check that the joints end where they have to. Raises _Ends."""
        off = np.zeros(1) if self._goal is None else np.abs(end - self._goal)
        if float(off.max()) > _SAME:
            raise _Ends(1.0, "it would end in another posture", self.joints[int(off.argmax())])

    def _followed(self, count: int) -> Iterator[Array]:
        here = self._start
        yield here
        step = max(self.line.length_m, self.line.turn_rad) / count
        for k in range(1, count + 1):
            there = self._solved(here, self.line.at(k / count), (k - 1) / count)
            far = np.abs(there - here)
            if float(far.max()) > _JUMP * step:
                joint = self.joints[int(far.argmax())]
                raise _Ends((k - 1) / count, "it would have to jump to another posture", joint)
            here = there
            yield here

    def _solved(self, start: Array, target: pin.SE3, share: float) -> Array:
        """Return the positions near ``start`` that bring the link to a pose. Raises _Ends."""
        found = start.copy()
        for _ in range(_MOST_ITERATIONS):
            here = self.pose(found)
            error = pin.log6(here.actInv(target)).vector
            if np.linalg.norm(error[:3]) < _SOLVED_M and np.linalg.norm(error[3:]) < _SOLVED_RAD:
                return found
            jacobian = pin.computeFrameJacobian(self._model, self._data, self._q, self._frame, pin.LOCAL)
            own = jacobian[:, self._columns]
            step = own.T @ np.linalg.solve(own @ own.T + _DAMPING**2 * np.eye(6), error)
            found = np.clip(found + step, self._low, self._high)
        at_limit = np.nonzero((found <= self._low) | (found >= self._high))[0]
        if len(at_limit):
            raise _Ends(share, "it is at its limit", self.joints[int(at_limit[0])])
        raise _Ends(share, "the joints cannot bring the link further")

    def deviation(self, timed: Timed, joints: tuple[str, ...]) -> tuple[float, float]:
        """Return the largest deviation of the curve through waypoints, at several places between two of them."""
        order = [joints.index(name) for name in self.joints]
        off = [self.line.deviation(self.pose(row[order])) for _, row in curve_places(timed)]
        return max(m for m, _ in off), max(rad for _, rad in off)
