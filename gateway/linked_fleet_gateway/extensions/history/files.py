"""Histories as files: CSV (RFC 4180), and MCAP with ROS 2 messages.

The MCAP files equal those of ``ros2 bag record /joint_states /robot_description /tf /tf_static /map``, so that
Foxglove, PlotJuggler and ROS 2 tools can open them.
"""

import csv
import io
import math
import struct
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from enum import IntEnum
from typing import TYPE_CHECKING

from linked_fleet_base.lazy_imports import LazyModule
from linked_fleet_gateway.extensions.history.ground import Ground
from linked_fleet_gateway.extensions.history.span import lexical_time
from linked_fleet_gateway.extensions.history.thinning import is_gap
from linked_fleet_gateway.extensions.history.track import Excerpt, Numbers, samples
from linked_fleet_rdf.graph import Unit
from linked_fleet_state.kinematics import compose
from linked_fleet_state.model import Pose

if TYPE_CHECKING:
    from mcap import writer as mcap
else:
    mcap = LazyModule("mcap.writer")

CSV, MCAP = "text/csv", "application/vnd.mcap"
"""RFC 7111; registered with IANA in October 2026."""

# UCUM units of the columns, by the local names of QUDT.
_UCUM = {"RAD": "rad", "M": "m", "RAD-PER-SEC": "rad/s", "M-PER-SEC": "m/s", "N-M": "N.m", "N": "N", "UNITLESS": "1"}

_RULE = "=" * 80
_TIME = f"""{_RULE}
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
"""
_HEADER = f"""{_RULE}
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
{_TIME}"""
_QUATERNION = f"""{_RULE}
MSG: geometry_msgs/Quaternion
float64 x
float64 y
float64 z
float64 w
"""
_SCHEMAS = {
    "nav_msgs/msg/OccupancyGrid": f"""std_msgs/Header header
nav_msgs/MapMetaData info
int8[] data
{_RULE}
MSG: nav_msgs/MapMetaData
builtin_interfaces/Time map_load_time
float32 resolution
uint32 width
uint32 height
geometry_msgs/Pose origin
{_RULE}
MSG: geometry_msgs/Pose
geometry_msgs/Point position
geometry_msgs/Quaternion orientation
{_RULE}
MSG: geometry_msgs/Point
float64 x
float64 y
float64 z
{_QUATERNION}{_HEADER}""",
    "sensor_msgs/msg/JointState": f"""std_msgs/Header header
string[] name
float64[] position
float64[] velocity
float64[] effort
{_HEADER}""",
    "rcl_interfaces/msg/Log": f"""builtin_interfaces/Time stamp
uint8 level
string name
string msg
string file
string function
uint32 line
{_TIME}""",
    "std_msgs/msg/String": "string data\n",
    "tf2_msgs/msg/TFMessage": f"""geometry_msgs/TransformStamped[] transforms
{_RULE}
MSG: geometry_msgs/TransformStamped
std_msgs/Header header
string child_frame_id
geometry_msgs/Transform transform
{_RULE}
MSG: geometry_msgs/Transform
geometry_msgs/Vector3 translation
geometry_msgs/Quaternion rotation
{_RULE}
MSG: geometry_msgs/Vector3
float64 x
float64 y
float64 z
{_QUATERNION}{_HEADER}""",
}
_WORLD = b"world"


class Level(IntEnum):
    """Severities of ``rcl_interfaces/msg/Log``."""

    WARN = 30
    ERROR = 40


@dataclass(frozen=True)
class LogMessage:
    """A message of ``/rosout``; ``name`` is its source."""

    stamp_ns: int
    level: Level
    name: str
    text: str


def table(columns: Sequence[tuple[str, Unit]], rows: Iterable[tuple[int, Numbers]]) -> bytes:
    """Return CSV with a column for time and one for each number with its unit; unknown values are empty."""
    text = io.StringIO(newline="")
    write = csv.writer(text, lineterminator="\r\n")
    write.writerow(["time", *(f"{name} ({_UCUM[unit.qudt.value.rpartition('/')[2]]})" for name, unit in columns)])
    for stamp_ns, numbers in rows:
        write.writerow([lexical_time(stamp_ns), *(value if value == value else "" for value in numbers)])
    return text.getvalue().encode()


def recording(
    excerpt: Excerpt,
    urdf: bytes,
    log: Iterable[LogMessage] = (),
    metadata: Mapping[str, Mapping[str, str]] | None = None,
    ground: Ground | None = None,
) -> bytes:
    """Return an MCAP file with the frames of an excerpt, at the times of the frames.

    It has ``/joint_states``, ``/robot_description`` (the ``urdf``, at the time of the first sample) and, for a floating
    base, its pose as ``/tf``: in the world with a ``ground``, else in its odometry frame, which has the same name. The
    ground adds the placement of another robot as ``/tf_static``, and the map of the floor as ``/map``. ``log`` is
    written as ``/rosout``; ``metadata`` are MCAP metadata records by name. Gaps have no message.
    """
    excerpt = replace(excerpt, frames=tuple(each for each in excerpt.frames if not is_gap(each)))
    out, joints = io.BytesIO(), excerpt.joints
    file = mcap.Writer(out)
    file.start(profile="ros2", library="linked-fleet")
    states, description = _channel(file, "/joint_states", "JointState"), _channel(file, "/robot_description", "String")
    transforms = _channel(file, "/tf", "TFMessage") if joints.floating else 0
    names, count, root = joints.names, len(joints.names), joints.model.root
    for number, (stamp_ns, values) in enumerate(samples(excerpt)):
        if number == 0:
            file.add_message(description, stamp_ns, Cdr().string(urdf).message, stamp_ns)
            if ground is not None:
                _add_ground(file, ground, "" if joints.floating else root, stamp_ns)
        if transforms:
            x, y, z, a, b, c, d = values[:7]
            pose = Pose((x, y, z), (a, b, c, d))
            placed = pose if ground is None else compose(ground.placement, pose)
            file.add_message(transforms, stamp_ns, _transform(root, placed, stamp_ns), stamp_ns)
            values = values[13:]
        state = Cdr().stamp(stamp_ns).string(b"").count(count)
        for name in names:
            state.string(name.encode())
        for row in range(3):
            state.count(count).doubles(values[row * count : (row + 1) * count])
        file.add_message(states, stamp_ns, state.message, stamp_ns)
    for said in log:
        body = Cdr().stamp(said.stamp_ns).octet(said.level).string(said.name.encode()).string(said.text.encode())
        body = body.string(b"").string(b"").count(0)
        file.add_message(_channel(file, "/rosout", "Log"), said.stamp_ns, body.message, said.stamp_ns)
    for name, members in (metadata or {}).items():
        file.add_metadata(name, dict(members))
    file.finish()  # type: ignore[no-untyped-call]
    return out.getvalue()


def _add_ground(file: "mcap.Writer", ground: Ground, root: str, stamp_ns: int) -> None:
    """Add the map, and the placement of a root link; ``root`` is empty if that moves."""
    if root:
        body = _transform(root, ground.placement, stamp_ns)
        file.add_message(_channel(file, "/tf_static", "TFMessage"), stamp_ns, body, stamp_ns)
    if (grid := ground.grid()) is not None and ground.floor is not None:
        rows, columns = grid.cells.shape
        x, y, yaw = grid.origin
        said = Cdr().stamp(stamp_ns).string(_WORLD).stamp(ground.floor.created_ns).single(grid.resolution_m)
        said = said.count(columns).count(rows).doubles((x, y, 0.0, 0.0, 0.0, math.sin(yaw / 2), math.cos(yaw / 2)))
        said = said.count(grid.cells.size).octets(grid.cells.tobytes())
        file.add_message(_channel(file, "/map", "OccupancyGrid"), stamp_ns, said.message, stamp_ns)


def _transform(link: str, pose: Pose, stamp_ns: int) -> bytes:
    """Return a TFMessage with the pose of a link in the world."""
    body = Cdr().count(1).stamp(stamp_ns).string(_WORLD).string(link.encode())
    return body.doubles((*pose.position_m, *pose.orientation_xyzw)).message


def _channel(file: "mcap.Writer", topic: str, kind: str) -> int:
    name, definition = next(each for each in _SCHEMAS.items() if each[0].endswith(f"/{kind}"))
    return file.register_channel(topic, "cdr", file.register_schema(name, "ros2msg", definition.encode()))


class Cdr:
    """Writes a message in plain OMG CDR, little-endian (DDS-XTypes 1.3, 7.4.1): numbers are aligned to their size."""

    _BEGIN = b"\x00\x01\x00\x00"

    def __init__(self) -> None:
        self._body = bytearray()

    @property
    def message(self) -> bytes:
        return self._BEGIN + self._body

    def _align(self, size: int) -> None:
        self._body.extend(bytes(-len(self._body) % size))

    def count(self, value: int) -> "Cdr":
        self._align(4)
        self._body += struct.pack("<I", value)
        return self

    def octet(self, value: int) -> "Cdr":
        self._body.append(value)
        return self

    def octets(self, values: bytes) -> "Cdr":
        self._body += values
        return self

    def single(self, value: float) -> "Cdr":
        self._align(4)
        self._body += struct.pack("<f", value)
        return self

    def stamp(self, stamp_ns: int) -> "Cdr":
        seconds, rest = divmod(stamp_ns, 1_000_000_000)
        return self.count(seconds & 0xFFFF_FFFF).count(rest)  # ROS 2 has 32 bits for seconds, until 2038

    def string(self, text: bytes) -> "Cdr":
        self.count(len(text) + 1)
        self._body += text + b"\0"
        return self

    def doubles(self, values: Sequence[float]) -> "Cdr":
        if values:
            self._align(8)
            self._body += struct.pack(f"<{len(values)}d", *values)
        return self
