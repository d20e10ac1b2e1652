"""Encoded pictures: round trips, and pictures of another size than stated are refused."""

import struct
from io import BytesIO

import pytest

from linked_fleet_agent.wire.codec import (
    HEADER,
    MAX_CONTENT_BYTES,
    PictureHeader,
    WireError,
    decode_picture,
    encode_picture,
)
from linked_fleet_agent.wire.messages import PictureFormat

SHOWN = PictureHeader(rows=2, columns=3, incarnation=7, sequence=41, monotonic_ns=5, wall_ns=6, near_m=0.1, far_m=9.0)
PNG = b"\x89PNG\r\n\x1a\n\x00\x00\x00\rIHDR" + struct.pack(">II", 3, 2) + b"\x08\x02\x00\x00\x00"
JPEG = b"\xff\xd8\xff\xe0\x00\x04ab\xff\xc0\x00\x0b\x08" + struct.pack(">HH", 2, 3) + b"\x03"
DEPTH = struct.pack("<6f", *range(6))


@pytest.mark.parametrize(("format", "content"), [("png", PNG), ("jpeg", JPEG), ("depth", DEPTH)])
def test_a_picture_comes_out_as_it_went_in(format: PictureFormat, content: bytes) -> None:
    assert decode_picture(encode_picture(format, SHOWN, content), format) == (SHOWN, content)


@pytest.mark.parametrize("format", ["png", "jpeg"])
def test_pictures_of_pillow_are_valid(format: PictureFormat) -> None:
    image, to = pytest.importorskip("PIL.Image").new("RGB", (3, 2)), BytesIO()
    image.save(to, format.upper())
    assert decode_picture(encode_picture(format, SHOWN, to.getvalue()), format)[0] == SHOWN


def _with(**changes: int) -> bytes:
    return encode_picture("png", SHOWN._replace(**changes), PNG)


@pytest.mark.parametrize(
    ("format", "payload"),
    [
        ("png", b""),
        ("png", encode_picture("png", SHOWN, PNG)[: HEADER.size - 1]),
        ("png", encode_picture("jpeg", SHOWN, JPEG)),
        ("png", encode_picture("png", SHOWN, JPEG)),
        ("jpeg", encode_picture("jpeg", SHOWN, PNG)),
        ("jpeg", encode_picture("jpeg", SHOWN, b"<html><script>alert(1)</script>")),
        ("png", encode_picture("png", SHOWN, PNG[:18])),
        ("png", _with(rows=3)),
        ("png", _with(incarnation=2**63)),
        ("jpeg", encode_picture("jpeg", SHOWN, JPEG[:12])),
        ("jpeg", encode_picture("jpeg", SHOWN, b"\xff\xd8" + b"\xff\xd0" * 500_000)),
        ("jpeg", encode_picture("jpeg", SHOWN, b"\xff\xd8\xff\xe0\x00\x00" * 1000)),
        ("depth", encode_picture("depth", SHOWN, DEPTH[:-1])),
        ("depth", encode_picture("depth", SHOWN._replace(rows=65_535, columns=65_535), DEPTH)),
        ("depth", encode_picture("depth", SHOWN, DEPTH)[:2] + b"\xff\xff" + encode_picture("depth", SHOWN, DEPTH)[4:]),
        ("depth", HEADER.pack(b"LD", 1, *SHOWN) + bytes(MAX_CONTENT_BYTES + 1)),
    ],
)
def test_pictures_of_another_size_are_refused(format: PictureFormat, payload: bytes) -> None:
    with pytest.raises(WireError):
        decode_picture(payload, format)


def test_too_large_pictures_are_not_sent() -> None:
    with pytest.raises(WireError, match="is the maximum"):
        encode_picture("depth", SHOWN, bytes(MAX_CONTENT_BYTES + 1))
