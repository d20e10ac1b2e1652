"""A sphere that contains all positions that a link can reach. Metre and radian.

It is computed in microseconds and excludes most unreachable positions. A failing inverse kinematics takes a tenth of a
second.
"""

import math
from collections.abc import Collection
from typing import NamedTuple

from linked_fleet_state.kinematics import compose
from linked_fleet_state.model import Joint, JointKind, Pose, RobotModel
from linked_fleet_state.xml import Vector

_UNTURNED = (0.0, 0.0, 0.0, 1.0)
_ANYWHERE = (-math.inf, math.inf)


class BoundingSphere(NamedTuple):
    centre: Vector
    radius: float

    def contains(self, place: Vector, slack: float) -> bool:
        return not math.dist(self.centre, place) > self.radius + slack


def envelope(model: RobotModel, link: str, movable: Collection[str]) -> BoundingSphere:
    """Return the sphere in the frame of the root link. Joints that are not ``movable`` may have any position.

    The radius is infinite if a joint has several degrees of freedom, or is prismatic without limits.
    """
    ball = BoundingSphere((0.0, 0.0, 0.0), 0.0)
    while (parent := model.links[link].parent_joint) is not None:
        joint = model.joints[parent]
        ball = _placed(joint.origin, _moved(ball, joint, _range(model, joint, movable)))
        link = joint.parent
    return ball


def _moved(ball: BoundingSphere, joint: Joint, between: tuple[float, float]) -> BoundingSphere:
    """Return a sphere around ``ball`` in all positions of the joint."""
    if joint.kind is JointKind.FIXED:
        return ball
    if not joint.movable:
        return BoundingSphere(ball.centre, math.inf)
    lower, upper = between
    half = (upper - lower) / 2
    if joint.kind is JointKind.PRISMATIC:
        if not math.isfinite(half):
            return BoundingSphere(ball.centre, math.inf)
        return BoundingSphere(_along(ball.centre, joint.axis, (lower + upper) / 2), ball.radius + half)
    onto = sum(c * a for c, a in zip(ball.centre, joint.axis, strict=True))
    foot = _along((0.0, 0.0, 0.0), joint.axis, onto)
    arm = _along(ball.centre, joint.axis, -onto)
    length = math.hypot(*arm)
    if not half < math.pi / 2 or not math.isfinite(lower + upper):
        return BoundingSphere(foot, ball.radius + length)
    middle = _along(foot, _rotated(arm, joint.axis, (lower + upper) / 2), math.cos(half))
    return BoundingSphere(middle, ball.radius + length * math.sin(half))


def _range(model: RobotModel, joint: Joint, movable: Collection[str]) -> tuple[float, float]:
    """Return the range of positions of the joint."""
    factor, offset = 1.0, 0.0
    while joint.mimic is not None:  # chains end at a joint that moves by itself
        offset += factor * joint.mimic.offset
        factor *= joint.mimic.multiplier
        joint = model.joints[joint.mimic.joint]
    lower, upper = joint.limits.lower, joint.limits.upper
    bounded = joint.name in movable and joint.kind is not JointKind.CONTINUOUS
    if not bounded or lower is None or upper is None:
        return _ANYWHERE
    ends = factor * lower + offset, factor * upper + offset
    return min(ends), max(ends)


def _placed(origin: Pose, ball: BoundingSphere) -> BoundingSphere:
    return BoundingSphere(compose(origin, Pose(ball.centre, _UNTURNED)).position_m, ball.radius)


def _rotated(arm: Vector, axis: Vector, angle: float) -> Vector:
    x, y, z = axis
    sine = math.sin(angle / 2)
    turn = Pose((0.0, 0.0, 0.0), (sine * x, sine * y, sine * z, math.cos(angle / 2)))
    return compose(turn, Pose(arm, _UNTURNED)).position_m


def _along(start: Vector, direction: Vector, by: float) -> Vector:
    x, y, z = (s + by * d for s, d in zip(start, direction, strict=True))
    return x, y, z
