"""The track of one robot, and the series of numbers in it. Pure; times in nanoseconds.

A track has the frames as received, oldest first. A series has the numbers of one property, or all of a robot, by
sample.
"""

import math
import struct
import sys
from bisect import bisect_left
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass

from linked_fleet_agent.wire.codec import layout
from linked_fleet_agent.wire.messages import Base
from linked_fleet_gateway.api import Property, joint_path, robot_path
from linked_fleet_gateway.faces import kind_of
from linked_fleet_rdf.graph import METRE, METRE_PER_SECOND, RADIAN_PER_SECOND, UNITLESS, Unit
from linked_fleet_rdf.vocabulary import LF, SPATIAL
from linked_fleet_state.events import Latest
from linked_fleet_state.kinematics import ORIGIN, LinkPoses, base_pose
from linked_fleet_state.model import Pose, RobotModel
from linked_fleet_state.robot import Robot

LATEST_NS = 2**63 - 1
"""No frame has a later stamp."""
_WALL = struct.Struct("<q")
_WALL_AT = next(field.offset for field in layout(1, False) if field.name == "wall_ns")
_SLOT_BYTES = 8  # of the list
_FINEST = 1 / 2048
"""The smallest share of its age by which thinned samples are spaced."""


def wall_ns(frame: bytes) -> int:
    """Return the agent's time of the reading, since 1970."""
    stamp: int = _WALL.unpack_from(frame, _WALL_AT)[0]
    return stamp


@dataclass(frozen=True)
class Joints:
    """The layout of the numbers in frames: ``names`` in the order of their rows."""

    model: RobotModel
    names: tuple[str, ...]
    floating: bool

    def has_same_layout(self, other: "Joints") -> bool:
        """Return True if frames of both have the same meaning.

        Models are compared by identity, because they are shared.
        """
        return self.model is other.model and self.names == other.names and self.floating == other.floating


def layout_size(joints: Joints) -> int:
    """Return the size of a frame."""
    last = layout(len(joints.names), joints.floating)[-1]
    return last.offset + 8 * last.count


def joints_of(robot: Robot) -> Joints | None:
    """Return the layout of the robot's frames; None before it has described itself."""
    if not robot.described or robot.model is None or robot.description is None:
        return None
    return Joints(robot.model, robot.description.joints, robot.description.base == "floating")


@dataclass(frozen=True)
class Excerpt:
    """Immutable frames in temporal order with distinct stamps, which another thread may read while the track grows.

    ``before`` and ``after`` are the stamps of the nearest requested frames that did not fit.
    """

    joints: Joints
    frames: tuple[bytes, ...] = ()
    before: int | None = None
    after: int | None = None


class Track:
    """The frames of one robot, all with the same joints. ``run`` is the source of new frames."""

    def __init__(self, run: Latest, joints: Joints) -> None:
        self.run = run
        self.joints = joints
        self.bytes = 0
        self.heard: bytes | None = None
        """The last frame that came; what follows it is a gap."""
        self.heard_s = 0.0
        """Time at which it was taken, by the monotonic clock."""
        self._frames: list[bytes] = []
        self._share = _FINEST

    def __len__(self) -> int:
        return len(self._frames)

    @property
    def newest(self) -> bytes | None:
        return self._frames[-1] if self._frames else None

    @property
    def time_range(self) -> tuple[int, int] | None:
        """The stamps of the oldest and the newest frame."""
        return (wall_ns(self._frames[0]), wall_ns(self._frames[-1])) if self._frames else None

    def append(self, frame: bytes, keep_ns: int) -> None:
        """Add the newest frame, and drop those that are older by more than ``keep_ns``.

        If the agent's clock was set back, frames with later stamps are dropped too, so that stamps stay distinct.
        """
        frames, now_ns = self._frames, wall_ns(frame)
        while frames and wall_ns(frames[-1]) >= now_ns:
            self.bytes -= _size(frames.pop())
        frames.append(frame)
        self.bytes += _size(frame)
        old = bisect_left(frames, now_ns - keep_ns, key=wall_ns) if wall_ns(frames[0]) < now_ns - keep_ns else 0
        self.bytes -= sum(map(_size, frames[:old]))
        del frames[:old]

    def shrink_to(self, most_bytes: float) -> None:
        """Drop samples until the rest takes at most ``most_bytes``; the newest is kept.

        The spacing of the remaining samples is proportional to their age.
        """
        self._share = max(_FINEST, self._share / 4)
        while self.bytes > most_bytes and len(self._frames) > 1:
            self._frames = _spaced(self._frames, self._share) if len(self._frames) > 2 else self._frames[-1:]
            self.bytes = sum(map(_size, self._frames))
            self._share *= 2

    def excerpt(self, begin_ns: int | None, end_ns: int | None, most: int) -> Excerpt:
        """Return at most ``most`` frames from ``begin_ns`` on and before ``end_ns``.

        These are the first ones or, without a beginning, the last ones.
        """
        frames = self._frames
        low = 0 if begin_ns is None else bisect_left(frames, begin_ns, key=wall_ns)
        high = len(frames) if end_ns is None else max(low, bisect_left(frames, end_ns, key=wall_ns))
        first = max(low, high - most) if begin_ns is None else low
        last = min(high, first + most)
        return Excerpt(
            self.joints,
            tuple(frames[first:last]),
            wall_ns(frames[first - 1]) if first > low else None,
            wall_ns(frames[last]) if last < high else None,
        )


def _size(frame: bytes) -> int:
    return sys.getsizeof(frame) + _SLOT_BYTES


def _spaced(frames: list[bytes], share: float) -> list[bytes]:
    """Return the oldest frame, and each one whose distance to the previously kept one is at least ``share`` of its age.

    The newest is always included.
    """
    newest_ns, last_ns = wall_ns(frames[-1]), wall_ns(frames[0])
    kept = [frames[0]]
    for frame in frames[1:]:
        stamp_ns = wall_ns(frame)
        if stamp_ns - last_ns >= share * (newest_ns - stamp_ns):
            kept.append(frame)
            last_ns = stamp_ns
    return kept


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
    extract: Callable[[Numbers], Numbers]

    def samples(self, excerpt: Excerpt) -> Iterator[tuple[int, Numbers]]:
        return ((stamp_ns, self.extract(numbers)) for stamp_ns, numbers in samples(excerpt))


def has_history(item: Property) -> bool:
    """Return True if the property has its own history. The history of the joint state is that of the robot."""
    return item.is_measured and item.shape in _SHAPES


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


def base_series(item: Property) -> Series:
    """Return the pose or twist of a floating base."""
    if item.shape == LF.PoseShape:
        return Series(_POSE, lambda numbers: numbers[:7])
    return Series(_TWIST, lambda numbers: numbers[7:13])


def joint_series(joints: Joints, joint: str, item: Property) -> Series | None:
    """Return the series of a joint; None if frames do not contain it."""
    if joint not in joints.names:
        return None
    row = item.segment if item.segment in _ROWS else "position"
    segment, unit = _of_joint(joints, joint, row)
    at = 13 * joints.floating + _ROWS.index(row) * len(joints.names) + joints.names.index(joint)
    return Series(((segment, unit),), lambda numbers: numbers[at : at + 1])


def link_series(joints: Joints, link: str) -> Series:
    """Return poses computed from the positions of the joints above."""
    first, count = 13 * joints.floating, len(joints.names)

    def pose(numbers: Numbers) -> Numbers:
        root = _root(numbers) if joints.floating else ORIGIN
        positions: Mapping[str, float] = dict(zip(joints.names, numbers[first : first + count], strict=True))
        found = LinkPoses(joints.model, positions, root).pose(link)
        return (math.nan,) * 7 if found is None else (*found.position_m, *found.orientation_xyzw)

    return Series(_POSE, pose)


def _root(numbers: Numbers) -> Pose | None:
    p, q, v, w = numbers[:3], numbers[3:7], numbers[7:10], numbers[10:13]
    return base_pose(Base(p, q, v, w))  # type: ignore[arg-type]  # by their number they are what they are


def _of_joint(joints: Joints, name: str, row: str) -> tuple[str, Unit]:
    kind = kind_of(joints.model.joints[name])
    if kind.dimension is None or kind.position is None:
        return row, UNITLESS
    units = {"position": kind.dimension.position, "velocity": kind.dimension.velocity, "effort": kind.dimension.effort}
    return kind.position if row == "position" else row, units[row]
