"""Inverse kinematics of one link on Pinocchio: where joints have to stand to bring it to a pose. Metre and radian.

Damped least squares between the joint limits, from the present positions first and then from seeded ones around them.
The damping grows with the square of the error, after T. Sugihara, "Solvability-Unconcerned Inverse Kinematics by the
Levenberg-Marquardt Method", IEEE Transactions on Robotics 27(5), 2011; a step that makes the error larger is not taken.
"""

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Literal

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from linked_fleet_agent.wire.messages import Base
from linked_fleet_gateway.fleet.model import Joint, JointKind, ModelError, RobotModel
from linked_fleet_gateway.fleet.pinocchio_model import build_model
from linked_fleet_gateway.fleet.xml import Quaternion, Vector, rotation

Array = npt.NDArray[np.float64]
Positions = Mapping[str, float]
Limits = Mapping[str, tuple[float, float]]

TOLERANCE_M, TOLERANCE_RAD = 5e-5, math.radians(0.01)
MAX_ITERATIONS = 1500  # below 100 ms on one core
_PER_START = 300
# An orientation error counts as the position error that is as far beyond its tolerance.
_M_PER_RAD = TOLERANCE_M / TOLERANCE_RAD
_PULL_M = 0.5  # an error beyond this sets the direction of a step only
_LONGEST_STEP = 0.5  # rad or m, of the joint that moves most
# A start is given up when so many iterations take less than this part off its error.
_PATIENCE, _PROGRESS = 15, 0.003
_FAR, _STEEPEST = 1e6, 1e3  # m or rad, and of a mimic: no robot has more, and squares of these are far from overflow


@dataclass(frozen=True)
class Reached:
    """Positions (rad or m) of the joints that are to move, and what is left of the error there.

    ``residual_rad`` is 0 when no orientation was asked for.
    """

    positions: dict[str, float]
    residual_m: float
    residual_rad: float
    iterations: int


class Unreachable(Exception):  # noqa: N818  a finding rather than a fault
    """No positions within the limits were found; ``best`` come nearest, the message says how near and why."""

    def __init__(self, message: str, best: Reached) -> None:
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
    frame: Literal["base", "world"],
) -> Reached:
    """Find positions of ``movable`` joints that bring ``link`` within 0.05 mm and 0.01° of a pose; near ``start``.

    ``base`` is the frame of the root link, which never moves; ``world`` differs from it only if the robot floats, and
    then needs its present pose. A joint without ``limits`` has none, one outside them is brought inside, and a
    continuous one makes half a turn at most. A joint that mimics a movable one, even through others, follows it, and
    bounds it if it has limits; one that mimics itself, or by a factor or offset above 1000, stays where it is.

    Raises Unreachable; ModelError when the robot is too large to compute; ValueError naming what is unknown or no
    finite number: a joint between root and link, the base, the target, a limit.
    """
    task = _Task(_chain(urdf, floating, link), start, limits, movable)
    task.aim(position_m, orientation_xyzw, floating and frame == "world", base)
    if max(map(abs, task.position)) > _FAR:
        away = Reached(task.named(task.nearest(task.start)), math.hypot(*task.position), 0.0, 0)
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
        raise ValueError(f"{what} is no orientation: {xyzw}")
    x, y, z, w = (part / length for part in xyzw)
    return np.array(rotation((x, y, z, w)))


@dataclass(frozen=True)
class _Joint:
    """Stands at ``factor`` times the position of ``driver``, itself unless it mimics, plus ``offset``."""

    name: str
    kind: JointKind
    driver: str
    factor: float
    offset: float


@dataclass(frozen=True)
class _Chain:
    """The joints between root and link, from the root on. Threads share it: never written to."""

    model: pin.Model
    frame: int
    joints: tuple[_Joint, ...]
    continuous: frozenset[str]  # of the whole robot


@lru_cache(maxsize=64)
def _chain(urdf: str, floating: bool, link: str) -> _Chain:
    robot, whole = _whole(urdf, floating)
    if link not in robot.links:
        raise ValueError(f"the robot has no link {link[:128]!r}")
    body = whole.frames[whole.getFrameId(link, pin.FrameType.BODY)]
    # Not by buildReducedModel, which refuses a joint that shares its name with a link. The base's free joint is first.
    above = [i for i in whole.supports[body.parentJoint] if i > int(floating)]
    model, last = pin.Model(), 0
    for i in above:
        last = model.addJoint(last, whole.joints[i], whole.jointPlacements[i], f"{i}")
    frame = model.addFrame(pin.Frame("link", last, 0, body.placement, pin.FrameType.OP_FRAME))
    if not sum(math.hypot(*at.translation) for at in (*model.jointPlacements[1:], body.placement)) < _FAR:
        raise ModelError(f"the robot is more than {_FAR / 1000:.0f} km long")
    joints = tuple(_joint(robot, robot.joints[whole.names[i]]) for i in above)
    continuous = frozenset(joint.name for joint in robot.joints.values() if joint.kind is JointKind.CONTINUOUS)
    return _Chain(model, frame, joints, continuous)


@lru_cache(maxsize=16)
def _whole(urdf: str, floating: bool) -> tuple[RobotModel, pin.Model]:
    """To read it takes longer than most searches. Threads share it: never written to."""
    return RobotModel.of(urdf), build_model(urdf, floating)


def _joint(robot: RobotModel, joint: Joint) -> _Joint:
    if not joint.movable:
        raise ValueError(f"the position of {joint.kind} joint {joint.name!r} is unknown")
    driver, factor, offset, seen = joint, 1.0, 0.0, {joint.name}
    while driver.mimic is not None:
        mimic = driver.mimic
        offset += factor * mimic.offset
        factor *= mimic.multiplier
        driver = robot.joints[mimic.joint]
        if driver.name in seen or not max(abs(factor), abs(offset)) <= _STEEPEST:
            return _Joint(joint.name, joint.kind, "", 0.0, 0.0)
        seen.add(driver.name)
    return _Joint(joint.name, joint.kind, driver.name, factor, offset)


def _known(name: str, start: Positions) -> float:
    position = start.get(name, math.nan)
    if not abs(position) <= _FAR:
        raise ValueError(f"the position of joint {name!r} is {'unknown' if math.isnan(position) else 'absurd'}")
    return position


def _bounds(chain: _Chain, name: str, present: float, limits: Limits) -> tuple[float, float]:
    """Return the limits of a joint, by its own and by those of the joints that follow it."""
    ends = [_limits(name, limits)]
    for joint in chain.joints:
        if joint.driver == name and joint.factor:
            follows = [(end - joint.offset) / joint.factor for end in _limits(joint.name, limits)]
            ends.append((min(follows), max(follows)))
    if name in chain.continuous and not _turns_freely(chain, name):
        ends.append((present - math.pi, present + math.pi))
    lower, upper = max(low for low, _ in ends), min(high for _, high in ends)
    if not max(lower, -_FAR) <= min(upper, _FAR):
        raise ValueError(f"the limits of joint {name!r}, or of those that mimic it, leave it no position")
    return lower, upper


def _limits(name: str, limits: Limits) -> tuple[float, float]:
    lower, upper = limits.get(name, (-math.inf, math.inf))
    if not lower <= upper:
        raise ValueError(f"joint {name!r} cannot have the limits {lower} and {upper}")
    return lower, upper


def _turns_freely(chain: _Chain, name: str) -> bool:
    """Return True if whole turns of this joint leave the link where it is."""
    followers = [joint for joint in chain.joints if joint.driver == name and joint.factor]
    return all(joint.kind is not JointKind.PRISMATIC and joint.factor.is_integer() for joint in followers)


@dataclass(frozen=True)
class _Try:
    """Positions, the error there and its derivative; both in metre, or in what counts as one."""

    x: Array
    error: Array
    jacobian: Array
    size: float


class _Task:
    """One target and what may move towards it. Owns Pinocchio's scratch memory, which threads must not share.

    The joints of the chain stand at ``gear @ x + shift``, where x are the positions of ``names``.
    """

    def __init__(self, chain: _Chain, start: Positions, limits: Limits, movable: Collection[str]) -> None:
        joints = chain.joints
        self.names = list(dict.fromkeys(joint.driver for joint in joints if joint.driver in movable))
        known = {name: _known(name, start) for name in (*(joint.name for joint in joints), *self.names)}
        self.start = np.array([known[name] for name in self.names])
        bounds = [_bounds(chain, name, known[name], limits) for name in self.names]
        self.lower, self.upper = np.array(bounds).reshape(-1, 2).T
        self._turning = [_turns_freely(chain, name) for name in self.names]
        gear = [joint.factor * (joint.driver == name) for joint in joints for name in self.names]
        self._gear = np.array(gear).reshape(len(joints), len(self.names))
        self._shift = np.array([j.offset if j.driver in self.names else known[j.name] for j in joints])
        self._model, self._frame, self._data = chain.model, chain.frame, chain.model.createData()
        self._q = pin.neutral(chain.model)
        self._at = np.array([joint.idx_q for joint in list(chain.model.joints)[1:]], dtype=np.intp)
        # Pinocchio keeps an unbounded rotation as a point on the circle.
        self._circular = np.array([joint.kind is JointKind.CONTINUOUS for joint in joints], dtype=np.bool_)

    def aim(self, position: Vector, orientation: Quaternion | None, in_world: bool, base: Base | None) -> None:
        """Set the target, turned into the frame of the root link."""
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
        self.position = inverse @ offset if np.abs(offset).max() <= _FAR else offset
        self.rotation = None if self.rotation is None else inverse @ self.rotation

    def nearest(self, x: Array) -> Array:
        """Clamped to the limits."""
        return np.clip(x, self.lower, self.upper)

    def try_at(self, x: Array) -> _Try:
        """Forward kinematics at these positions."""
        joints = self._gear @ x + self._shift
        self._q[self._at] = np.where(self._circular, np.cos(joints), joints)
        self._q[self._at[self._circular] + 1] = np.sin(joints[self._circular])
        pin.computeJointJacobians(self._model, self._data, self._q)
        placement = pin.updateFramePlacement(self._model, self._data, self._frame)
        jacobian = np.empty((6, 0))
        if self._model.nv:  # without a joint Pinocchio reads outside its memory
            jacobian = pin.getFrameJacobian(self._model, self._data, self._frame, pin.LOCAL_WORLD_ALIGNED)
        jacobian = jacobian.reshape(6, self._model.nv) @ self._gear  # Pinocchio makes a vector of one column
        error = self.position - placement.translation
        if self.rotation is None:
            jacobian = jacobian[:3]
        else:
            error = np.concatenate((error, _M_PER_RAD * pin.log3(self.rotation @ placement.rotation.T)))
            jacobian[3:] *= _M_PER_RAD
        return _Try(x, error, jacobian, math.sqrt(error @ error))

    def solved(self, found: _Try) -> bool:
        """Return True if position and orientation are both within their tolerance."""
        return all(math.sqrt(part @ part) <= TOLERANCE_M for part in (found.error[:3], found.error[3:]))

    def named(self, x: Array) -> dict[str, float]:
        return dict(zip(self.names, x.tolist(), strict=True))

    def reached(self, found: _Try, iterations: int) -> Reached:
        residuals = math.hypot(*found.error[:3]), math.hypot(*found.error[3:]) / _M_PER_RAD
        return Reached(self.named(self._unwound(found.x)), *residuals, iterations)

    def _unwound(self, x: Array) -> Array:
        """The same pose with the fewest whole turns between here and the start that the limits allow."""
        unwound = x.copy()
        for i in np.flatnonzero(self._turning):
            turns = round((x[i] - self.start[i]) / math.tau)
            while turns and not self.lower[i] <= x[i] - math.tau * turns <= self.upper[i]:
                turns -= int(math.copysign(1, turns))
            unwound[i] -= math.tau * turns
        return unwound


def _search(task: _Task) -> tuple[_Try, int]:
    """The first solution, or of all tries the one that comes nearest, and the iterations that it took."""
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


def _descend(task: _Task, x: Array, limit: int) -> tuple[_Try, int]:
    """Go downhill from x until the target is reached, little more is gained or the iterations are used up."""
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


def _step(task: _Task, here: _Try, caution: float) -> Array:
    """One damped step, with the joints left out that would only press against their limits."""
    downhill = here.jacobian.T @ here.error
    pressed = ((here.x <= task.lower) & (downhill < 0)) | ((here.x >= task.upper) & (downhill > 0))
    jacobian = np.where(pressed, 0.0, here.jacobian)
    pull = min(1.0, _PULL_M / here.size)
    damping = caution * 0.1 * (pull * here.size) ** 2 + 1e-6
    normal = jacobian @ jacobian.T + damping * np.eye(len(here.error))
    step: Array = jacobian.T @ np.linalg.solve(normal, pull * here.error)
    return step * (_LONGEST_STEP / max(_LONGEST_STEP, float(np.abs(step).max())))


def _obstacles(task: _Task, best: Reached) -> str:
    if not task.names:
        return "no joint that may move moves it"
    ends = zip(best.positions.items(), task.lower, task.upper, strict=True)
    stops = [(name, "lower" if x <= low else "upper") for (name, x), low, up in ends if not low < x < up]
    return ", ".join(f"{name} is at its {end} limit" for name, end in stops) or "no joint is at a limit"


def _length(metres: float) -> str:
    return f"{metres * 1000:.1f} mm" if metres < 1000 else f"{metres:.3g} m"
