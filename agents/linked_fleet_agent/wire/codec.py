"""Encoding of messages and pictures (PROTOCOL.md).

State is a packed little-endian frame, every other message JSON. The reply to a ``PictureQuery`` has 56 bytes of header,
then a JPEG or PNG file or depths (PROTOCOL.md, "Pictures").
"""

import math
import struct
from functools import cache
from threading import Lock
from typing import Any, NamedTuple, TypeVar

import msgspec

from linked_fleet_agent.wire.components import DescriptionWithComponents, Occurrence, Operate, Sample, Values
from linked_fleet_agent.wire.messages import (
    COMPONENTS_VERSION,
    WIRE_VERSION,
    Base,
    Command,
    Condition,
    Description,
    Field,
    PictureFormat,
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

Message = Description | Command | Stop | Progress | Condition | PictureQuery | Values | Operate | Occurrence | Sample
_M = TypeVar(
    "_M", DescriptionWithComponents, Description, Command, Stop, Progress, Condition, PictureQuery, Values, Operate,
    Occurrence, Sample,
)  # fmt: skip
_T = TypeVar("_T")


class WireError(ValueError):
    """A payload that is not a message of this protocol; the text says what is wrong."""


class VersionError(WireError):
    """A well-formed message of an unsupported protocol version."""


def check_version(version: int, spoken: int = WIRE_VERSION) -> None:
    """Raise VersionError unless a message has the version that its kind has had since."""
    if version != spoken:
        raise VersionError(f"wire version {version} is not supported; these messages have version {spoken}")


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


_REPLY = msgspec.json.Decoder[Reply](Reply)
_decoders: dict[type, msgspec.json.Decoder[Any]] = {}
_making = Lock()


def _decoder(kind: type[_T]) -> msgspec.json.Decoder[_T]:
    """Return the decoder of a structure, made by one thread at a time: more that resolve its types end the process."""
    if (found := _decoders.get(kind)) is None:
        with _making:
            found = _decoders[kind] = _decoders.get(kind) or msgspec.json.Decoder(kind)
    return found


def decode(payload: bytes, kind: type[_M]) -> _M:
    """Decode a JSON message. The version is checked first and raises VersionError; other faults raise WireError."""
    try:
        version = _decoder(_Versioned).decode(payload).version
        check_version(version, COMPONENTS_VERSION if kind in (Values, Operate, Occurrence, Sample) else WIRE_VERSION)
        return _decoder(kind).decode(payload)
    except msgspec.MsgspecError as error:
        raise WireError(str(error)) from error
    except (UnicodeDecodeError, RecursionError) as error:
        raise WireError(f"not JSON: {error}") from error


def decode_reply(payload: bytes) -> Reply:
    try:
        reply: Reply = _REPLY.decode(payload)
        return reply
    except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError) as error:
        raise WireError(str(error)) from error


MAGICS: dict[PictureFormat, bytes] = {"jpeg": b"LJ", "png": b"LP", "depth": b"LD"}
MAX_CONTENT_BYTES = 4 * 2**20
HEADER = struct.Struct("<2sHHHQQqqdd")
_START = {"jpeg": b"\xff\xd8\xff", "png": b"\x89PNG\r\n\x1a\n\x00\x00\x00\rIHDR"}
_DEPTH_BYTES = 4
# Start of frame: baseline, extended and progressive (ITU T.81, B.2.2), and markers without a segment (B.1.1.3).
_FRAMES, _ALONE = (0xC0, 0xC1, 0xC2), (0x01, *range(0xD0, 0xD8))


class PictureHeader(NamedTuple):
    """The state frame that a picture shows, and the size of the picture; times in nanoseconds, lengths in metre."""

    rows: int
    columns: int
    incarnation: int
    sequence: int
    monotonic_ns: int
    wall_ns: int
    near_m: float
    far_m: float


def encode_picture(format: PictureFormat, moment: PictureHeader, content: bytes) -> bytes:
    """Return the payload. Raises WireError if ``content`` is too large."""
    if len(content) > MAX_CONTENT_BYTES:
        raise WireError(f"a picture of {len(content)} bytes; {MAX_CONTENT_BYTES} is the maximum")
    return HEADER.pack(MAGICS[format], WIRE_VERSION, *moment) + content


def decode_picture(payload: bytes, format: PictureFormat) -> tuple[PictureHeader, bytes]:
    """Return the header and the content of a picture. Raises WireError unless it has that format and its stated size.

    For a file only the signature and the size in its header are checked; its decoder checks the rest.
    """
    if len(payload) < HEADER.size or payload[:2] != MAGICS[format]:
        raise WireError(f"{len(payload)} bytes that do not start with the header of a {format} picture")
    _, version, *said = HEADER.unpack_from(payload)
    check_version(version)
    moment, content = PictureHeader(*said), payload[HEADER.size :]
    if moment.incarnation >= 2**63 or moment.sequence >= 2**63 or moment.monotonic_ns < 0 or moment.wall_ns < 0:
        raise WireError("the run, the frame or the times of the picture are out of range")
    if len(content) > MAX_CONTENT_BYTES:
        raise WireError(f"a picture of {len(content)} bytes; {MAX_CONTENT_BYTES} is the maximum")
    size = _size(content, format, moment)
    if size != (moment.rows, moment.columns):
        raise WireError(f"the {format} picture has {size} rows and columns; its header says {moment[:2]}")
    return moment, content


def _size(content: bytes, format: PictureFormat, moment: PictureHeader) -> tuple[int, int]:
    """Return rows and columns according to the content itself."""
    if format == "depth":
        if len(content) != _DEPTH_BYTES * moment.rows * moment.columns:
            raise WireError(f"{len(content)} bytes of depth are not {moment.rows} rows of {moment.columns}")
        return moment.rows, moment.columns
    if not content.startswith(_START[format]):
        raise WireError(f"the content does not have the signature of a {format} file")
    return _size_of_png(content) if format == "png" else _size_of_jpeg(content)


def _size_of_png(content: bytes) -> tuple[int, int]:
    """Return the size in IHDR, which comes first (ISO 15948, 11.2.2)."""
    if len(content) < 24:
        raise WireError("the PNG file ends in its header")
    columns, rows = struct.unpack_from(">II", content, 16)
    return rows, columns


def _size_of_jpeg(content: bytes) -> tuple[int, int]:
    """Return the size in the frame header, which follows after a few segments (ITU T.81, B.2)."""
    at = 2
    for _ in range(64):
        if len(content) < at + 9 or content[at] != 0xFF:
            break
        marker = content[at + 1]
        if marker in _FRAMES:
            rows, columns = struct.unpack_from(">HH", content, at + 5)
            return rows, columns
        at += 2 if marker in _ALONE else 2 + int.from_bytes(content[at + 2 : at + 4], "big")
    raise WireError("the JPEG file has no frame header in the expected place")
