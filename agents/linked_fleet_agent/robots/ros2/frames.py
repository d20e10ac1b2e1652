"""Frames of the robot as ``/tf`` and ``/tf_static`` tell them: where its base is in the odometry frame and on the map.

Pure. Poses are position (m) and quaternion (x, y, z, w). Only what was heard last counts, whatever its time stamp.
"""

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

MAX_FRAMES = 4096
"""Most frames that are remembered, so that a hostile publisher costs a bounded amount of memory."""
_DEEPEST = 64
_FARTHEST_M = 1e6
_Vector = tuple[float, float, float]
_Quaternion = tuple[float, float, float, float]


class Transform(NamedTuple):
    """The pose of a frame in another one."""

    position: _Vector = (0.0, 0.0, 0.0)
    rotation: _Quaternion = (0.0, 0.0, 0.0, 1.0)

    def then(self, other: "Transform") -> "Transform":
        """Return the pose, in the outer frame of this one, of what has the pose ``other`` in the inner frame."""
        turned = _rotated(self.rotation, other.position)
        x, y, z = (at + by for at, by in zip(self.position, turned, strict=True))
        return Transform((x, y, z), _product(self.rotation, other.rotation))

    @property
    def heading(self) -> float:
        """The angle about the vertical axis, in rad."""
        x, y, z, w = self.rotation
        return math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))


def transform_of(position: Mapping[str, Any], rotation: Mapping[str, Any]) -> Transform | None:
    """Return a pose of a message, or None if it is none: not finite, too far away, or no rotation."""
    x, y, z = (float(position[each]) for each in "xyz")
    qx, qy, qz, qw = (float(rotation[each]) for each in "xyzw")
    length = math.hypot(qx, qy, qz, qw)
    if not (math.hypot(x, y, z) <= _FARTHEST_M and 0.5 < length < 2.0):
        return None
    return Transform((x, y, z), (qx / length, qy / length, qz / length, qw / length))


class Frames:
    """The tree of frames: the parent of each, and its pose there."""

    def __init__(self) -> None:
        self._frames: dict[str, tuple[str, Transform, float]] = {}
        self.dropped = 0

    def update(self, message: Mapping[str, Any], at_s: float) -> None:
        """Note the transforms of a tf2_msgs/TFMessage that arrived at a monotonic time; ``inf`` if they are static."""
        for each in message["transforms"]:
            child, parent = each["child_frame_id"].strip("/"), each["header"]["frame_id"].strip("/")
            pose = transform_of(each["transform"]["translation"], each["transform"]["rotation"])
            if pose is None or not child or (child not in self._frames and len(self._frames) >= MAX_FRAMES):
                self.dropped += 1
            else:
                self._frames[child] = parent, pose, at_s

    def parent_of(self, frame: str) -> str:
        """Return the parent of a frame; empty if it has none."""
        return self._frames[frame][0] if frame in self._frames else ""

    def pose(self, frame: str, outer: str) -> tuple[Transform, float] | None:
        """Return the pose of ``frame`` in ``outer``, above it in the tree, and the time of its oldest part, or None."""
        found, oldest_s = Transform(), math.inf
        for _ in range(_DEEPEST):
            if frame == outer:
                return found, oldest_s
            if frame not in self._frames:
                return None
            frame, step, at_s = self._frames[frame]
            found, oldest_s = step.then(found), min(oldest_s, at_s)
        return None

    def prefix_of(self, root: str) -> str:
        """Return what stands before the names of links here, as by ``frame_prefix`` of robot_state_publisher."""
        if root in self._frames:
            return ""
        names = {*self._frames, *(parent for parent, _, _ in self._frames.values())}
        if root in names:
            return ""
        longer = sorted((each for each in names if each.endswith(f"/{root}") or each.endswith(f"_{root}")), key=len)
        return longer[0].removesuffix(root) if longer else ""

    def above(self, frame: str) -> list[str]:
        """Return the frames above one, the nearest first."""
        found = list[str]()
        while len(found) < _DEEPEST and (parent := self.parent_of(frame)) and parent not in found:
            found.append(parent)
            frame = parent
        return found


def _product(a: _Quaternion, b: _Quaternion) -> _Quaternion:
    ax, ay, az, aw = a
    bx, by, bz, bw = b
    return (
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
        aw * bw - ax * bx - ay * by - az * bz,
    )


def _rotated(q: _Quaternion, v: _Vector) -> _Vector:
    x, y, z, _ = _product(_product(q, (*v, 0.0)), (-q[0], -q[1], -q[2], q[3]))
    return x, y, z
