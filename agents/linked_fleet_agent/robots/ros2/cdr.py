"""The messages of joints and descriptions, as typed values. Pure."""

import math
from collections.abc import Iterable, Sequence
from typing import NamedTuple

from linked_fleet_agent.robots.ros2.serialization import CdrError as CdrError
from linked_fleet_agent.robots.ros2.types import MessageTypes

STRING, JOINT_STATE = "std_msgs/msg/String", "sensor_msgs/msg/JointState"
JOINT_TRAJECTORY = "trajectory_msgs/msg/JointTrajectory"
MAX_STATE_BYTES, MAX_TEXT_BYTES = 262_144, 8_000_000
MAX_JOINTS = 1024
"""The wire protocol allows no more joints (wire/codec.py)."""

# The messages used here are the same in all distributions.
_TYPES = MessageTypes()
_STRING, _JOINT_STATE, _TRAJECTORY = (_TYPES.message(each) for each in (STRING, JOINT_STATE, JOINT_TRAJECTORY))


class JointState(NamedTuple):
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
    return _TYPES.message(message).hash


def read_string(payload: bytes) -> str:
    """Return the text of a ``std_msgs/String``. Raises CdrError."""
    text: str = _STRING.read(payload, MAX_TEXT_BYTES)["data"]
    return text


def read_joint_state(payload: bytes, most_bytes: int = MAX_STATE_BYTES) -> JointState:
    """Parse a joint state.

    Raises CdrError, also if a row is neither empty nor as long as the names, or a joint repeats.
    """
    said = _JOINT_STATE.read(payload, most_bytes)
    names = tuple(said["name"])
    if len(names) > MAX_JOINTS:
        raise CdrError(f"{len(names)} joints are too many; {MAX_JOINTS} is the maximum")
    if len(set(names)) < len(names):
        raise CdrError("a joint is named twice")
    rows = [tuple(said[row]) for row in ("position", "velocity", "effort")]
    if wrong := next((row for row in rows if len(row) not in (0, len(names))), None):
        raise CdrError(f"a row has {len(wrong)} values for {len(names)} joints; it may be empty or have one for each")
    stamp = said["header"]["stamp"]
    return JointState(stamp["sec"] * 1_000_000_000 + stamp["nanosec"], names, *known(rows, len(names)))


def write_trajectory(joints: Sequence[str], positions: Sequence[float], reached_in_s: float) -> bytes:
    """Return a ``trajectory_msgs/JointTrajectory`` with one point, reached ``reached_in_s`` after its arrival."""
    seconds, nanoseconds = divmod(round(reached_in_s * 1e9), 1_000_000_000)
    point = {"positions": list(positions), "time_from_start": {"sec": seconds, "nanosec": nanoseconds}}
    return _TRAJECTORY.write({"joint_names": list(joints), "points": [point]})


def known(rows: Iterable[tuple[float, ...]], count: int) -> list[tuple[float, ...]]:
    """Return rows for so many joints, in which ``math.nan`` is what is not finite, and all of an empty row."""
    return [(row if math.isfinite(math.hypot(*row)) else _finite(row)) or (math.nan,) * count for row in rows]


def _finite(row: Iterable[float]) -> tuple[float, ...]:
    return tuple(value if math.isfinite(value) else math.nan for value in row)
