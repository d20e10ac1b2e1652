"""The reply to a ``PictureQuery``: 56 bytes of header, then a JPEG or PNG file or depths (PROTOCOL.md, "Pictures")."""

import struct
from typing import NamedTuple

from linked_fleet_agent.wire.codec import WireError, check_version
from linked_fleet_agent.wire.messages import WIRE_VERSION, PictureFormat

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
        raise WireError(f"a picture of {len(content)} bytes; {MAX_CONTENT_BYTES} are the most")
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
        raise WireError(f"a picture of {len(content)} bytes; {MAX_CONTENT_BYTES} are the most")
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
        raise WireError(f"the content has not the signature of a {format} file")
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
    raise WireError("the JPEG file has no frame header where one belongs")
