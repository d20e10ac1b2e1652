"""ROS 2 messages in CDR (XTypes 1.3 7.4.3) and type hashes, by rosbags. Pure."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from rosbags.serde import SerdeError
from rosbags.typesys import Stores, get_typestore
from rosbags.typesys.stores.ros2_jazzy import builtin_interfaces__msg__Duration as Duration
from rosbags.typesys.stores.ros2_jazzy import builtin_interfaces__msg__Time as Time
from rosbags.typesys.stores.ros2_jazzy import sensor_msgs__msg__JointState as SaidJointState
from rosbags.typesys.stores.ros2_jazzy import std_msgs__msg__Header as Header
from rosbags.typesys.stores.ros2_jazzy import std_msgs__msg__String as SaidString
from rosbags.typesys.stores.ros2_jazzy import trajectory_msgs__msg__JointTrajectory as Trajectory
from rosbags.typesys.stores.ros2_jazzy import trajectory_msgs__msg__JointTrajectoryPoint as Point

STRING, JOINT_STATE = "std_msgs/msg/String", "sensor_msgs/msg/JointState"
JOINT_TRAJECTORY = "trajectory_msgs/msg/JointTrajectory"
MAX_STATE_BYTES, MAX_TEXT_BYTES = 262_144, 8_000_000
# The wire protocol allows no more joints (wire/codec.py); rosbags rejects longer sequences before allocating them.
MAX_JOINTS = 1024

# The messages used here are the same in Jazzy, Kilted and Lyrical.
_STORE = get_typestore(Stores.ROS2_JAZZY)
_STORE.max_sequence_length = MAX_JOINTS


class CdrError(ValueError):
    """The bytes are not the expected message; the text says why."""


@dataclass(frozen=True)
class JointState:
    """A ``sensor_msgs/JointState``: rows in the order of ``names``, rad or m, NaN for missing values.

    ``stamp_ns`` is the time of measurement by the robot's clock; 0 if not given.
    """

    stamp_ns: int
    names: tuple[str, ...]
    positions: tuple[float, ...]
    velocities: tuple[float, ...]
    efforts: tuple[float, ...]


def type_hash(message: str) -> str:
    """Return the RIHS01 hash (REP 2016) of a type such as ``std_msgs/msg/String``."""
    return _STORE.hash_rihs01(message)


def read_string(payload: bytes) -> str:
    """Return the text of a ``std_msgs/String``. Raises CdrError."""
    said = _read(payload, STRING, MAX_TEXT_BYTES)
    assert isinstance(said, SaidString)
    return said.data


def read_joint_state(payload: bytes) -> JointState:
    """Parse a joint state.

    Raises CdrError, also if a row is neither empty nor as long as the names, or a joint repeats.
    """
    said = _read(payload, JOINT_STATE, MAX_STATE_BYTES)
    assert isinstance(said, SaidJointState)
    names = tuple(said.name)
    if len(set(names)) < len(names):
        raise CdrError("a joint is named twice")
    rows = (_row(row, len(names)) for row in (said.position, said.velocity, said.effort))
    stamp = said.header.stamp
    return JointState(stamp.sec * 1_000_000_000 + stamp.nanosec, names, *rows)


def write_trajectory(joints: Sequence[str], positions: Sequence[float], reached_in_s: float) -> bytes:
    """Return a ``trajectory_msgs/JointTrajectory`` with one point, reached ``reached_in_s`` after its arrival."""
    nothing = np.zeros(0)
    seconds, nanoseconds = divmod(round(reached_in_s * 1e9), 1_000_000_000)
    point = Point(
        positions=np.array(positions, dtype=np.float64),
        velocities=nothing,
        accelerations=nothing,
        effort=nothing,
        time_from_start=Duration(sec=seconds, nanosec=nanoseconds),
    )
    message = Trajectory(Header(Time(0, 0), ""), list(joints), [point])
    return bytes(_STORE.serialize_cdr(message, JOINT_TRAJECTORY, little_endian=True))


def _read(payload: bytes, message: str, most: int) -> object:
    if len(payload) > most:
        raise CdrError(f"{len(payload)} bytes are too many; a {message} may have {most}")
    try:
        return _STORE.deserialize_cdr(payload, message)
    except SerdeError as error:
        raise CdrError(str(error)) from error


def _row(row: "np.typing.NDArray[np.float64]", count: int) -> tuple[float, ...]:
    if len(row) not in (0, count):
        raise CdrError(f"a row has {len(row)} values for {count} joints; it may be empty or have one for each")
    return tuple(value if math.isfinite(value) else math.nan for value in row.tolist()) or (math.nan,) * count
