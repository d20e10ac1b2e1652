"""Inverse kinematics of one link on Pinocchio: joint positions that bring it to a pose. Metre and radian.

Damped least squares within the joint limits, started from the present positions and then from seeded ones around them.
The damping grows with the square of the error, after T. Sugihara, "Solvability-Unconcerned Inverse Kinematics by the
Levenberg-Marquardt Method", IEEE Transactions on Robotics 27(5), 2011; steps that increase the error are rejected.
"""

import math
from collections.abc import Collection
from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from linked_fleet_agent.wire.messages import Base
from linked_fleet_state.joint_chain import (
    FAR,
    Chain,
    Limits,
    Positions,
    bounds_of,
    chain_to,
    has_unlimited_rotation,
    known_position,
)
from linked_fleet_state.model import JointKind
from linked_fleet_state.xml import Quaternion, Vector, rotation

Array = npt.NDArray[np.float64]

TOLERANCE_M, TOLERANCE_RAD = 5e-5, math.radians(0.01)
MAX_ITERATIONS = 1500  # below 100 ms on one core
_PER_START = 300
# An orientation error is weighted so that both tolerances are equal.
_M_PER_RAD = TOLERANCE_M / TOLERANCE_RAD
_PULL_M = 0.5  # a larger error determines only the direction of a step
_LONGEST_STEP = 0.5  # rad or m, of the joint that moves most
# A start is abandoned if this many iterations reduce its error by less than this share.
_PATIENCE, _PROGRESS = 15, 0.003


@dataclass(frozen=True)
class Solution:
    """Positions (rad or m) of the movable joints, and the residual errors.

    ``residual_rad`` is 0 without a target orientation.
    """

    positions: dict[str, float]
    residual_m: float
    residual_rad: float
    iterations: int


class Unreachable(Exception):  # noqa: N818 a result rather than a fault
    """No positions within the limits were found; ``best`` is the nearest result, the message gives distance and
    reason.
    """

    def __init__(self, message: str, best: Solution) -> None:
        super().__init__(message)
        self.best = best


def reach(
    urdf: str,
    floating: bool,
    link: str,
    position_m: Vector,
    orientation_xyzw: Quaternion | None,
    start: Positions,
    limits: Limits,
    movable: Collection[str],
    base: Base | None,
    frame: Literal["base", "world", "carried"],
) -> Solution:
    """Find positions of ``movable`` joints, near ``start``, that bring ``link`` within 0.05 mm and 0.01° of a pose.

    ``base`` is the frame of the root link; ``world`` differs from it only for a floating base, whose present pose is
    then needed. ``carried`` is the frame of the link that the last floating or planar joint above ``link`` carries. A
    joint without ``limits`` is unbounded, a position outside them is clamped, and a continuous joint makes half a turn
    at most. A joint that mimics a movable one, also indirectly, follows it, and its limits apply. A joint that mimics
    with a factor or offset above 1000 does not move.

    Raises Unreachable; ModelError if the robot is too large to compute; ValueError naming an unknown or non-finite
    number: a joint between root and link, the base, the target, a limit.
    """
    task = _Task(chain_to(urdf, floating, link, frame == "carried"), start, limits, movable)
    task.aim(position_m, orientation_xyzw, floating and frame == "world", base)
    if max(map(abs, task.position)) > FAR:
        away = Solution(task.named(task.nearest(task.start)), math.hypot(*task.position), 0.0, 0)
        raise Unreachable(f"{link} cannot be {_length(away.residual_m)} away from the root of the robot", away)
    best, iterations = _search(task)
    reached = task.reached(best, iterations)
    if not task.solved(best):
        miss = _length(reached.residual_m)
        miss += "" if orientation_xyzw is None else f" and {math.degrees(reached.residual_rad):.2f}°"
        raise Unreachable(f"{link} comes no nearer than {miss}: {_obstacles(task, reached)}", reached)
    return reached


def _check_finite(what: str, values: tuple[float, ...]) -> None:
    if not all(map(math.isfinite, values)):
        raise ValueError(f"{what} is not finite: {values}")


def _rotation(what: str, xyzw: Quaternion) -> Array:
    _check_finite(what, xyzw)
    length = math.hypot(*xyzw)
    if not 1e-6 < length < math.inf:
        raise ValueError(f"{what} is not an orientation: {xyzw}")
    x, y, z, w = (part / length for part in xyzw)
    return np.array(rotation((x, y, z, w)))


@dataclass(frozen=True)
class _Candidate:
    """Positions with their error and its derivative, weighted in metre."""

    x: Array
    error: Array
    jacobian: Array
    size: float


class _Task:
    """One target and the movable joints. Owns Pinocchio's scratch memory, which threads must not share.

    The joints of the chain are at ``gear @ x + shift``, where x are the positions of ``names``.
    """

    def __init__(self, chain: Chain, start: Positions, limits: Limits, movable: Collection[str]) -> None:
        joints = chain.joints
        self.names = list(dict.fromkeys(joint.driver for joint in joints if joint.driver in movable))
        known = {name: known_position(name, start) for name in (*(joint.name for joint in joints), *self.names)}
        self.start = np.array([known[name] for name in self.names])
        bounds = [bounds_of(chain, name, known[name], limits) for name in self.names]
        self.lower, self.upper = np.array(bounds).reshape(-1, 2).T
        self._turning = [has_unlimited_rotation(chain, name) for name in self.names]
        gear = [joint.factor * (joint.driver == name) for joint in joints for name in self.names]
        self._gear = np.array(gear).reshape(len(joints), len(self.names))
        self._shift = np.array([j.offset if j.driver in self.names else known[j.name] for j in joints])
        self._model, self._frame, self._data = chain.model, chain.frame, chain.model.createData()
        self._q = pin.neutral(chain.model)
        self._at = np.array([joint.idx_q for joint in list(chain.model.joints)[1:]], dtype=np.intp)
        # Pinocchio stores an unbounded rotation as a point on the unit circle.
        self._circular = np.array([joint.kind is JointKind.CONTINUOUS for joint in joints], dtype=np.bool_)

    def aim(self, position: Vector, orientation: Quaternion | None, in_world: bool, base: Base | None) -> None:
        """Set the target, transformed into the frame of the root link."""
        _check_finite("the target position", position)
        self.position = np.array(position)
        self.rotation = None if orientation is None else _rotation("the target orientation", orientation)
        if not in_world:
            return
        if base is None:
            raise ValueError("the pose of the base is unknown")
        _check_finite("the position of the base", base.position_m)
        inverse = _rotation("the orientation of the base", base.orientation_xyzw).T
        offset = np.array([to - at for to, at in zip(position, base.position_m, strict=True)])
        self.position = inverse @ offset if np.abs(offset).max() <= FAR else offset
        self.rotation = None if self.rotation is None else inverse @ self.rotation

    def nearest(self, x: Array) -> Array:
        """Return positions clamped to the limits."""
        return np.clip(x, self.lower, self.upper)

    def try_at(self, x: Array) -> _Candidate:
        """Compute the forward kinematics at these positions."""
        joints = self._gear @ x + self._shift
        self._q[self._at] = np.where(self._circular, np.cos(joints), joints)
        self._q[self._at[self._circular] + 1] = np.sin(joints[self._circular])
        pin.computeJointJacobians(self._model, self._data, self._q)
        placement = pin.updateFramePlacement(self._model, self._data, self._frame)
        jacobian = np.empty((6, 0))
        if self._model.nv:  # without a joint Pinocchio reads outside its memory
            jacobian = pin.getFrameJacobian(self._model, self._data, self._frame, pin.LOCAL_WORLD_ALIGNED)
        jacobian = jacobian.reshape(6, self._model.nv) @ self._gear  # Pinocchio returns a vector for a single column
        error = self.position - placement.translation
        if self.rotation is None:
            jacobian = jacobian[:3]
        else:
            error = np.concatenate((error, _M_PER_RAD * pin.log3(self.rotation @ placement.rotation.T)))
            jacobian[3:] *= _M_PER_RAD
        return _Candidate(x, error, jacobian, math.sqrt(error @ error))

    def solved(self, found: _Candidate) -> bool:
        """Return True if position and orientation are within their tolerances."""
        return all(math.sqrt(part @ part) <= TOLERANCE_M for part in (found.error[:3], found.error[3:]))

    def named(self, x: Array) -> dict[str, float]:
        return dict(zip(self.names, x.tolist(), strict=True))

    def reached(self, found: _Candidate, iterations: int) -> Solution:
        residuals = math.hypot(*found.error[:3]), math.hypot(*found.error[3:]) / _M_PER_RAD
        return Solution(self.named(self._fewest_turns(found.x)), *residuals, iterations)

    def _fewest_turns(self, x: Array) -> Array:
        """Return the same pose with as few whole turns from the start as the limits allow."""
        unwound = x.copy()
        for i in np.flatnonzero(self._turning):
            turns = round((x[i] - self.start[i]) / math.tau)
            while turns and not self.lower[i] <= x[i] - math.tau * turns <= self.upper[i]:
                turns -= int(math.copysign(1, turns))
            unwound[i] -= math.tau * turns
        return unwound


def _search(task: _Task) -> tuple[_Candidate, int]:
    """Return the first solution, or the nearest result of all starts, and the number of iterations."""
    centre = task.nearest(task.start)
    lower, upper = np.maximum(task.lower, centre - math.pi), np.minimum(task.upper, centre + math.pi)
    seeded = np.random.default_rng(0)
    (best, used), spread = _descend(task, centre, _PER_START), 0.0
    while task.names and not task.solved(best) and used < MAX_ITERATIONS:
        spread = min(1.0, spread + 0.25)
        elsewhere = centre + spread * (seeded.uniform(lower, upper) - centre)
        found, more = _descend(task, task.nearest(elsewhere), min(_PER_START, MAX_ITERATIONS - used))
        used += more
        if found.size < best.size or task.solved(found):
            best = found
    return best, used


def _descend(task: _Task, x: Array, limit: int) -> tuple[_Candidate, int]:
    """Iterate from x until the target is reached, progress stalls, or ``limit`` iterations are used."""
    best, caution = task.try_at(x), 1.0
    before = best.size
    for iteration in range(1, limit):
        if task.solved(best) or not task.names:
            return best, iteration
        if iteration % _PATIENCE == 0:
            if before - best.size < _PROGRESS * min(best.size, _PULL_M):
                return best, iteration
            before = best.size
        found = task.try_at(task.nearest(best.x + _step(task, best, caution)))
        if found.size < best.size:
            best, caution = found, max(1.0, caution / 4)
        else:
            caution *= 4
    return best, limit


def _step(task: _Task, here: _Candidate, caution: float) -> Array:
    """Return one damped step, without the joints that would press against their limits."""
    downhill = here.jacobian.T @ here.error
    pressed = ((here.x <= task.lower) & (downhill < 0)) | ((here.x >= task.upper) & (downhill > 0))
    jacobian = np.where(pressed, 0.0, here.jacobian)
    pull = min(1.0, _PULL_M / here.size)
    damping = caution * 0.1 * (pull * here.size) ** 2 + 1e-6
    normal = jacobian @ jacobian.T + damping * np.eye(len(here.error))
    step: Array = jacobian.T @ np.linalg.solve(normal, pull * here.error)
    return step * (_LONGEST_STEP / max(_LONGEST_STEP, float(np.abs(step).max())))


def _obstacles(task: _Task, best: Solution) -> str:
    if not task.names:
        return "no movable joint moves it"
    ends = zip(best.positions.items(), task.lower, task.upper, strict=True)
    stops = [(name, "lower" if x <= low else "upper") for (name, x), low, up in ends if not low < x < up]
    return ", ".join(f"{name} is at its {end} limit" for name, end in stops) or "no joint is at a limit"


def _length(metres: float) -> str:
    return f"{metres * 1000:.1f} mm" if metres < 1000 else f"{metres:.3g} m"
