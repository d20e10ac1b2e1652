"""Forward kinematics of one robot. Metre and radian; a pose that cannot be known is None.

Implemented here because only the joints above a watched link are computed, and a gateway without planning need not load
Pinocchio (60 MB).
"""

import math
from collections.abc import Mapping

from linked_fleet_agent.wire.messages import Base
from linked_fleet_state.model import Joint, JointKind, Pose, RobotModel
from linked_fleet_state.xml import Quaternion, Vector

ORIGIN = Pose((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))

_HALF_TURN = 0.1  # |w| at a rotation of 168 degrees, near which no link is mounted


class LinkPoses:
    """Poses of the links of a robot at given joint positions (rad or m), computed on demand.

    ``root`` is the pose of the root link: ``ORIGIN`` for a fixed base, or ``base_pose(base)``. A link is unknown behind
    a joint whose position is missing or NaN, or that is floating or planar.
    """

    def __init__(self, model: RobotModel, positions: Mapping[str, float], root: Pose | None) -> None:
        self._model = model
        self._positions = positions
        self._known: dict[str, Pose | None] = {model.root: root}

    def pose(self, link: str) -> Pose | None:
        """Return the pose of a link; None if it is unknown or does not exist."""
        above: list[Joint] = []
        while link not in self._known:
            parent = self._model.links[link].parent_joint if link in self._model.links else None
            if parent is None:
                return None
            above.append(self._model.joints[parent])
            link = above[-1].parent
        pose = self._known[link]
        for joint in reversed(above):
            pose = self._known[joint.child] = None if pose is None else self._behind(joint, pose)
        return pose

    def between(self, frame: str, link: str) -> Pose | None:
        """Return the pose of ``link`` in ``frame``, another link; None if the joints between them leave it unknown.

        A joint of unknown position that carries both does not matter.
        """
        (root, pose), (other, seen) = self._in_island(link), self._in_island(frame)
        return compose(inverse(seen), pose) if root == other else None

    def _in_island(self, link: str) -> tuple[str, Pose]:
        """Return the pose of a link in the topmost link to which it is known, and that link."""
        pose, above = ORIGIN, self._model.links[link].parent_joint
        while above is not None:
            joint = self._model.joints[above]
            step = self._behind(joint, ORIGIN)
            if step is None:
                break
            pose, link = compose(step, pose), joint.parent
            above = self._model.links[link].parent_joint
        return link, pose

    def _behind(self, joint: Joint, parent: Pose) -> Pose | None:
        position, orientation = joint.origin.position_m, joint.origin.orientation_xyzw
        if joint.kind is not JointKind.FIXED:
            moved = self._positions.get(joint.name, math.nan) if joint.movable else math.nan
            if not math.isfinite(moved):
                return None
            x, y, z = joint.axis
            if joint.kind is JointKind.PRISMATIC:
                position = _sum(position, _turned((moved * x, moved * y, moved * z), orientation))
            else:
                sine = math.sin(moved / 2)
                orientation = _product(orientation, (sine * x, sine * y, sine * z, math.cos(moved / 2)))
        place = _sum(parent.position_m, _turned(position, parent.orientation_xyzw))
        if not math.isfinite(place[0] + place[1] + place[2]):
            return None  # absurdly large finite positions overflow
        return Pose(place, _signed(_product(parent.orientation_xyzw, orientation)))


def loose_joint(model: RobotModel, link: str) -> Joint | None:
    """Return the nearest floating or planar joint above a link, whose position no agent reports; None without one."""
    above = model.links[link].parent_joint
    while above is not None:
        joint = model.joints[above]
        if joint.kind in (JointKind.FLOATING, JointKind.PLANAR):
            return joint
        above = model.links[joint.parent].parent_joint
    return None


def base_pose(base: Base | None) -> Pose | None:
    """Return the pose of a floating base; None if it is unknown or its orientation is invalid."""
    if base is None:
        return None
    x, y, z, w = base.orientation_xyzw
    length = math.hypot(x, y, z, w)
    if not all(map(math.isfinite, (*base.position_m, length))) or length < 1e-6:
        return None
    return Pose(base.position_m, _signed((x / length, y / length, z / length, w / length)))


def compose(outer: Pose, inner: Pose) -> Pose:
    """Return the pose ``inner``, given in the frame at ``outer``, in the frame of ``outer``."""
    position = _sum(outer.position_m, _turned(inner.position_m, outer.orientation_xyzw))
    return Pose(position, _signed(_product(outer.orientation_xyzw, inner.orientation_xyzw)))


def inverse(pose: Pose) -> Pose:
    """Invert a pose."""
    x, y, z, w = pose.orientation_xyzw
    back = (-x, -y, -z, w)
    a, b, c = _turned(pose.position_m, back)
    return Pose((-a, -b, -c), _signed(back))


def _sum(a: Vector, b: Vector) -> Vector:
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


def _turned(v: Vector, q: Quaternion) -> Vector:
    """Rotate a vector: v + 2 w (q × v) + 2 q × (q × v)."""
    x, y, z, w = q
    a, b, c = v
    i, j, k = 2 * (y * c - z * b), 2 * (z * a - x * c), 2 * (x * b - y * a)
    return a + w * i + y * k - z * j, b + w * j + z * i - x * k, c + w * k + x * j - y * i


def _product(a: Quaternion, b: Quaternion) -> Quaternion:
    ax, ay, az, aw = a
    bx, by, bz, bw = b
    return (
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
        aw * bw - ax * bx - ay * by - az * bz,
    )


def _signed(q: Quaternion) -> Quaternion:
    """Choose one of the two quaternions of a rotation consistently, so that a link at rest does not seem to turn.

    The one with positive w; near half a turn, where w is noise, the one whose largest other component is positive.
    """
    x, y, z, w = q
    lead = w if abs(w) > _HALF_TURN else max(x, y, z, key=abs)
    return (-x, -y, -z, -w) if lead < 0 else q
