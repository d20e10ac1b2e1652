"""Poses in URDF: ``xyz`` with ``rpy`` or, from URDF 1.1, ``quat_xyzw``. Metre and radian.

Sources: https://wiki.ros.org/urdf/XML/joint (origin), and the notes on versions of urdfdom, which defines URDF 1.1.
"""

import math
from dataclasses import dataclass
from xml.etree.ElementTree import Element

from linked_fleet_agent.urdf.document import UrdfError
from linked_fleet_agent.urdf.values import Vector, numbers, vector

Quaternion = tuple[float, float, float, float]
_ZERO: Vector = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Pose:
    """A rigid placement; the quaternion x y z w has unit length."""

    position_m: Vector
    orientation_xyzw: Quaternion


ORIGIN = Pose(_ZERO, (0.0, 0.0, 0.0, 1.0))


def contradicts_itself(origin: Element | None) -> bool:
    """Return True if an ``<origin>`` states two orientations."""
    return origin is not None and "rpy" in origin.attrib and "quat_xyzw" in origin.attrib


def pose_of(origin: Element | None, where: str) -> Pose:
    """Return the pose of an ``<origin>``, by default the identity. Raises UrdfError."""
    if contradicts_itself(origin):
        raise UrdfError(f"the origin of {where} states both rpy and quat_xyzw; it may state one of them")
    position = vector(origin, "xyz", _ZERO, where)
    stated = None if origin is None else origin.get("quat_xyzw")
    if stated is None:
        return Pose(position, quaternion(vector(origin, "rpy", _ZERO, where)))
    x, y, z, w = numbers(stated, 4, f"quat_xyzw of {where}")
    length = math.hypot(x, y, z, w)
    if not 1e-6 < length < math.inf:
        raise UrdfError(f"quat_xyzw of {where} is {stated[:60]!r}, which is no orientation")
    return Pose(position, (x / length, y / length, z / length, w / length))


def quaternion(rpy: Vector) -> Quaternion:
    """Return the quaternion x y z w of fixed-axis roll, pitch, yaw in radian."""
    (sr, sp, sy), (cr, cp, cy) = ([f(angle / 2) for angle in rpy] for f in (math.sin, math.cos))
    return (
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
        cr * cp * cy + sr * sp * sy,
    )


def rotation(q: Quaternion) -> tuple[Vector, Vector, Vector]:
    """Return the rows of the rotation matrix of a unit quaternion x y z w."""
    x, y, z, w = q
    return (
        (1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)),
        (2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)),
        (2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)),
    )


def roll_pitch_yaw(q: Quaternion) -> Vector:
    """Return the fixed-axis angles of a unit quaternion, to the precision of a double also at a pitch of 90°.

    Roll is found in the frame that yaw and pitch leave, so that errors of a yaw that is hardly determined cancel.
    """
    (a, b, c), (d, e, f), (g, _, _) = rotation(q)
    yaw = math.atan2(d, a)
    sine, cosine = math.sin(yaw), math.cos(yaw)
    return math.atan2(sine * c - cosine * f, cosine * e - sine * b), math.atan2(-g, math.hypot(a, d)), yaw
