"""Series of numbers: those of one property, or all of a robot, by sample."""

import math
import struct
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass

from linked_fleet_agent.wire.codec import layout
from linked_fleet_agent.wire.messages import Base
from linked_fleet_gateway.extensions.history.track import Excerpt, Joints, wall_ns
from linked_fleet_gateway.fleet.kinematics import ORIGIN, LinkPoses, placed
from linked_fleet_gateway.fleet.model import Pose
from linked_fleet_gateway.rdf.units import METRE, METRE_PER_SECOND, RADIAN_PER_SECOND, UNITLESS, Unit
from linked_fleet_gateway.rdf.vocabulary import LF, SPATIAL
from linked_fleet_gateway.resources.joint_kinds import kind_of
from linked_fleet_gateway.resources.paths import joint_path, robot_path
from linked_fleet_gateway.resources.property import Property

Numbers = tuple[float, ...]

_XYZ, _XYZW = ("x", "y", "z"), ("x", "y", "z", "w")
_POSE = tuple((f"position.{axis}", METRE) for axis in _XYZ) + tuple((f"orientation.{axis}", UNITLESS) for axis in _XYZW)
_TWIST = tuple((f"linear.{axis}", METRE_PER_SECOND) for axis in _XYZ) + tuple(
    (f"angular.{axis}", RADIAN_PER_SECOND) for axis in _XYZ
)
_VALUES_AT = next(field.offset for field in layout(1, False) if field.name == "positions")
_ROWS = ("position", "velocity", "effort")
_SHAPES = frozenset({SPATIAL.AxisAngleShape, LF.TranslationShape, LF.ScalarPropertyShape, LF.PoseShape, LF.TwistShape})


@dataclass(frozen=True)
class Series:
    """The numbers of one property: names and units, and their extraction from all numbers of a frame."""

    columns: tuple[tuple[str, Unit], ...]
    of: Callable[[Numbers], Numbers]

    def samples(self, excerpt: Excerpt) -> Iterator[tuple[int, Numbers]]:
        return ((stamp_ns, self.of(numbers)) for stamp_ns, numbers in samples(excerpt))


def remembers(item: Property) -> bool:
    """Return True if the property has a history of its own; that of the joint state is the robot's."""
    return item.measured and item.shape in _SHAPES


def samples(excerpt: Excerpt) -> Iterator[tuple[int, Numbers]]:
    """Yield stamp and numbers of each frame, without frames that contain an infinity, which are invalid."""
    count = 13 * excerpt.joints.floating + 3 * len(excerpt.joints.names)
    unpack = struct.Struct(f"<{count}d").unpack_from
    for frame in excerpt.frames:
        numbers: Numbers = unpack(frame, _VALUES_AT)
        if math.inf not in numbers and -math.inf not in numbers:
            yield wall_ns(frame), numbers


def all_columns(robot: str, joints: Joints) -> list[tuple[str, Unit]]:
    """Return the columns of a whole frame in order, named by paths below the robot."""
    base = [(f"pose.{name}", unit) for name, unit in _POSE] + [(f"twist.{name}", unit) for name, unit in _TWIST]
    found = base if joints.floating else []
    for row in _ROWS:
        for name in joints.names:
            segment, unit = _of_joint(joints, name, row)
            found.append((f"{joint_path(robot, name).removeprefix(robot_path(robot))}/{segment}", unit))
    return found


def of_base(item: Property) -> Series:
    """Return the pose or twist of a floating base."""
    if item.shape == LF.PoseShape:
        return Series(_POSE, lambda numbers: numbers[:7])
    return Series(_TWIST, lambda numbers: numbers[7:13])


def of_joint(joints: Joints, joint: str, item: Property) -> Series | None:
    """Return the series of a joint; None if frames do not contain it."""
    if joint not in joints.names:
        return None
    row = item.segment if item.segment in _ROWS else "position"
    segment, unit = _of_joint(joints, joint, row)
    at = 13 * joints.floating + _ROWS.index(row) * len(joints.names) + joints.names.index(joint)
    return Series(((segment, unit),), lambda numbers: numbers[at : at + 1])


def of_link(joints: Joints, link: str) -> Series:
    """Return poses computed from the positions of the joints above."""
    first, count = 13 * joints.floating, len(joints.names)

    def pose(numbers: Numbers) -> Numbers:
        root = _root(numbers) if joints.floating else ORIGIN
        positions: Mapping[str, float] = dict(zip(joints.names, numbers[first : first + count], strict=True))
        found = LinkPoses(joints.model, positions, root).of(link)
        return (math.nan,) * 7 if found is None else (*found.position_m, *found.orientation_xyzw)

    return Series(_POSE, pose)


def _root(numbers: Numbers) -> Pose | None:
    p, q, v, w = numbers[:3], numbers[3:7], numbers[7:10], numbers[10:13]
    return placed(Base(p, q, v, w))  # type: ignore[arg-type]  # by their number they are what they are


def _of_joint(joints: Joints, name: str, row: str) -> tuple[str, Unit]:
    kind = kind_of(joints.model.joints[name])
    if kind.dimension is None or kind.position is None:
        return row, UNITLESS
    units = {"position": kind.dimension.position, "velocity": kind.dimension.velocity, "effort": kind.dimension.effort}
    return kind.position if row == "position" else row, units[row]
