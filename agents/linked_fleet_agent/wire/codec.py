"""Encoding of messages. State is a packed little-endian frame, everything else JSON (PROTOCOL.md)."""

import math
import struct
from functools import cache
from typing import NamedTuple, TypeVar

import msgspec

from linked_fleet_agent.wire.messages import (
    MIN_WIRE_VERSION,
    WIRE_VERSION,
    Base,
    Command,
    Description,
    Field,
    PictureQuery,
    Progress,
    Reply,
    State,
    Stop,
)

MAGIC = b"LF"
MAX_JOINTS = 1024
FLOATING = 1  # bit 0 of the flags: the 13 values of the base precede the joints
_HEADER_FORMAT = "<2sHHHQQqq"
_HEADER = struct.Struct(_HEADER_FORMAT)
_BASE_VALUES = 13
_ROWS = ("positions", "velocities", "efforts")

Message = Description | Command | Stop | Progress | PictureQuery
_M = TypeVar("_M", Description, Command, Stop, Progress, PictureQuery)


class WireError(ValueError):
    """A payload that is not a message of this protocol; the text says what is wrong."""


class VersionError(WireError):
    """A well-formed message of an unsupported protocol version."""


def check_version(version: int) -> None:
    if not MIN_WIRE_VERSION <= version <= WIRE_VERSION:
        raise VersionError(f"wire version {version} is not spoken here; {MIN_WIRE_VERSION} to {WIRE_VERSION} are")


def layout(joint_count: int, floating: bool) -> tuple[Field, ...]:
    """Return the fields of a state frame, for decoding with one ``numpy.frombuffer`` (desideratum D5)."""
    fields = [
        Field("magic", "char2", 0, 1),
        Field("version", "uint16", 2, 1),
        Field("flags", "uint16", 4, 1),
        Field("joints", "uint16", 6, 1),
        Field("incarnation", "uint64", 8, 1),
        Field("sequence", "uint64", 16, 1),
        Field("monotonic_ns", "int64", 24, 1),
        Field("wall_ns", "int64", 32, 1),
    ]
    offset = _HEADER.size
    rows = [("base", _BASE_VALUES)] if floating else []
    for name, count in [*rows, *((row, joint_count) for row in _ROWS)]:
        fields.append(Field(name, "float64", offset, count))
        offset += 8 * count
    return tuple(fields)


def encode_state(state: State) -> bytes:
    """Pack a frame: header of 40 bytes, then float64 values; see ``layout``."""
    rows = (state.positions, state.velocities, state.efforts)
    count = len(state.positions)
    if count > MAX_JOINTS or not len(rows[1]) == len(rows[2]) == count:
        raise WireError(f"rows of {[len(row) for row in rows]} values are not three equal rows of at most {MAX_JOINTS}")
    base = state.base
    values = () if base is None else (*base.position_m, *base.orientation_xyzw, *base.linear_m_s, *base.angular_rad_s)
    return _frame(len(values) + 3 * count).pack(
        MAGIC,
        WIRE_VERSION,
        0 if base is None else FLOATING,
        count,
        state.incarnation,
        state.sequence,
        state.monotonic_ns,
        state.wall_ns,
        *values,
        *rows[0],
        *rows[1],
        *rows[2],
    )


@cache
def _frame(values: int) -> struct.Struct:
    """Return the struct of a frame with this many values. The cache holds at most twice MAX_JOINTS entries."""
    return struct.Struct(f"{_HEADER_FORMAT}{values}d")


class Header(NamedTuple):
    """The header of a frame; times in nanoseconds."""

    incarnation: int
    sequence: int
    monotonic_ns: int
    wall_ns: int
    joint_count: int
    floating: bool


def read_header(payload: bytes) -> Header:
    """Read everything but the values. Raises WireError (VersionError) unless the payload is exactly one frame."""
    if len(payload) < _HEADER.size or payload[:2] != MAGIC:
        raise WireError(f"{len(payload)} bytes that do not start with a frame header")
    _, version, flags, count, incarnation, sequence, monotonic_ns, wall_ns = _HEADER.unpack_from(payload)
    check_version(version)
    if incarnation >= 2**63 or monotonic_ns < 0 or wall_ns < 0:
        raise WireError(f"incarnation {incarnation} or the times {monotonic_ns} and {wall_ns} ns are out of range")
    if flags & ~FLOATING or count > MAX_JOINTS:
        raise WireError(f"flags {flags:#x} or {count} joints are out of range")
    total = (_BASE_VALUES if flags & FLOATING else 0) + 3 * count
    if len(payload) != _HEADER.size + 8 * total:
        raise WireError(f"{len(payload)} bytes, but the header announces {_HEADER.size + 8 * total}")
    return Header(incarnation, sequence, monotonic_ns, wall_ns, count, bool(flags & FLOATING))


def decode_state(payload: bytes) -> State:
    """Unpack a frame. Raises WireError (VersionError) unless it is exactly one frame without infinite values."""
    header = read_header(payload)
    base_count, count = _BASE_VALUES if header.floating else 0, header.joint_count
    total = base_count + 3 * count
    values = struct.unpack_from(f"<{total}d", payload, _HEADER.size)
    if any(map(math.isinf, values)):
        raise WireError("a value is infinite")
    b, rows = values[:base_count], values[base_count:]
    return State(
        incarnation=header.incarnation,
        sequence=header.sequence,
        monotonic_ns=header.monotonic_ns,
        wall_ns=header.wall_ns,
        base=Base(b[0:3], b[3:7], b[7:10], b[10:13]) if b else None,
        positions=rows[:count],
        velocities=rows[count : 2 * count],
        efforts=rows[2 * count :],
    )


_encoder = msgspec.json.Encoder()


def encode(message: Message | Reply) -> bytes:
    return _encoder.encode(message)


class _Versioned(msgspec.Struct):
    version: int


def decode(payload: bytes, kind: type[_M]) -> _M:
    """Decode a JSON message. The version is checked first and raises VersionError; other faults raise WireError."""
    try:
        check_version(msgspec.json.decode(payload, type=_Versioned).version)
        return msgspec.json.decode(payload, type=kind)
    except msgspec.MsgspecError as error:
        raise WireError(str(error)) from error
    except (UnicodeDecodeError, RecursionError) as error:
        raise WireError(f"not JSON: {error}") from error


def decode_reply(payload: bytes) -> Reply:
    try:
        reply: Reply = msgspec.json.decode(payload, type=Reply)
        return reply
    except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError) as error:
        raise WireError(str(error)) from error
