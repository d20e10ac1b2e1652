"""Files of maps: what ROS writes is read, everything else is refused with a sentence."""

import io
import math
import random
import zlib

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from linked_fleet_gateway.extensions.world import floor_map, map_image
from linked_fleet_gateway.extensions.world.floor_map import (
    MAX_CELLS,
    MAX_IMAGE_BYTES,
    FloorMap,
    MapSettings,
    UnusableMap,
    decode,
    encode,
    pgm_of,
)
from linked_fleet_gateway.extensions.world.form_data import BadForm, Part, read_form
from linked_fleet_gateway.extensions.world.map_image import build_map, cells_of, grid_of, read_pgm, rectangles
from linked_fleet_gateway.extensions.world.map_yaml import read_yaml, write_yaml

_OF_ROS1 = b"""image: floor.pgm
resolution: 0.050000
origin: [-12.200000, -13.800000, 0.000000]
negate: 0
occupied_thresh: 0.65
free_thresh: 0.196

"""
_OF_NAV2 = b"""image: "maps/floor.pgm"
mode: trinary
resolution: 0.05
origin:
- -12.2
- -13.8
- 0  # yaw
negate: 0
occupied_thresh: 0.65
free_thresh: 0.196
"""
SETTINGS = MapSettings(
    resolution=0.05, origin=(-12.2, -13.8, 0.0), negate=False, occupied_thresh=0.65, free_thresh=0.196
)


def p5(columns: int, rows: int, pixels: bytes, most: int = 255) -> bytes:
    return b"P5\n# CREATOR: map_saver.cpp 0.050 m/pix\n%d %d\n%d\n" % (columns, rows, most) + pixels


# -- YAML -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("text", [_OF_ROS1, _OF_NAV2, b"---\n" + _OF_NAV2.replace(b"\n", b"\r\n")])
def test_what_programs_of_ros_write_is_read(text: bytes) -> None:
    assert read_yaml(text) == (SETTINGS, "floor.pgm")


def test_a_list_over_several_lines_and_flags_in_words_are_read() -> None:
    text = _OF_ROS1.replace(b"-12.200000, ", b"-12.2,\n         ").replace(b"negate: 0", b"negate: true")
    assert read_yaml(text)[0].negate and read_yaml(text)[0].origin == SETTINGS.origin


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("resolution: 0.050000\n", "", "has no resolution"),
        ("0.050000", "0", "resolution of 0 m is not between 0.001 m and 1 m"),
        ("0.050000", "50", "resolution of 50 m"),
        ("0.050000", ".nan", "resolution in the YAML is a number, not '.nan'"),
        ("0.050000", "1e999", "resolution of inf m"),
        ("[-12.200000, -13.800000, 0.000000]", "[1, 2]", "list of x, y and yaw"),
        ("[-12.200000, -13.800000, 0.000000]", "[1, 2, x]", "origin in the YAML is a number"),
        ("[-12.200000, -13.800000, 0.000000]", "[1e6, 2, 0]", "at most 1000 m"),
        ("[-12.200000, -13.800000, 0.000000]", "[1, 2, 180]", "in radian"),
        ("negate: 0", "negate: 2", "negate in the YAML is one of 0, false"),
        ("0.65", "1.65", "at most 1"),
        ("0.196", "0.7", "below occupied_thresh"),
        ("image: floor.pgm", "image: [a, b]", "name of a file"),
        ("image: floor.pgm", "image: &a floor.pgm", "name of a file"),
        ("image: floor.pgm", "image:", "name of a file"),
        ("negate: 0", "negate: 0\nmode: fuzzy", "one of trinary, scale, raw, not 'fuzzy'"),
        ("negate: 0", "negate: 0\nnegate: 1", "Line 5 of the YAML says negate again"),
        ("negate: 0", "negate: 0\ncolour: red", "Line 5 of the YAML has the key 'colour'"),
        ("negate: 0", "negate: 0\n  - x", "Line 5 of the YAML is no key"),
        ("negate: 0", "negate: 0\n? a", "Line 5"),
        ("negate: 0", "negate: 0\nmode: !!python/object:os.system x", "mode in the YAML is one of"),
    ],
)
def test_a_yaml_file_that_describes_no_map_is_refused_with_a_sentence(old: str, new: str, words: str) -> None:
    text = _OF_ROS1.decode()
    assert old in text
    with pytest.raises(UnusableMap) as refused:
        read_yaml(text.replace(old, new, 1).encode())
    assert words in str(refused.value)


def test_a_long_yaml_file_and_one_in_another_coding_are_refused() -> None:
    with pytest.raises(UnusableMap, match="at most 4096"):
        read_yaml(_OF_ROS1 + b"#" * 5000)
    with pytest.raises(UnusableMap, match="UTF-8"):
        read_yaml(_OF_ROS1 + b"# \xff")


_FINITE = st.floats(-1000, 1000)


@given(st.floats(0.001, 1), st.tuples(_FINITE, _FINITE, st.floats(-4, 4)), st.booleans(), st.floats(0, 0.5))
def test_what_is_written_is_read_again_exactly(
    resolution: float, origin: tuple[float, float, float], negate: bool, free: float
) -> None:
    said = MapSettings(
        resolution=resolution, origin=origin, negate=negate, occupied_thresh=0.51, free_thresh=free, mode="scale"
    )
    assert read_yaml(write_yaml(said, "map.pgm")) == (said, "map.pgm")


@given(st.text(alphabet="imageorgnst: []-#'\"\n0.1,e+{}&*!|>%\t", max_size=200))
def test_any_text_is_read_or_refused_with_a_sentence(text: str) -> None:
    for content in (text, _OF_ROS1.decode() + text):
        try:
            read_yaml(content.encode())
        except UnusableMap as error:
            assert str(error).endswith((".", "?"))


# -- PGM ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "content",
    [
        p5(3, 2, bytes([0, 100, 255, 7, 8, 9])),
        b"P5 3 2 255\n" + bytes([0, 100, 255, 7, 8, 9]),
        b"P5#a\n#b\r3#c\n\t2#d\n255\n" + bytes([0, 100, 255, 7, 8, 9]),
        b"P2\n# made by hand\n3 2\n255\n0 100 255 # a row\n7 8\n9\n",
    ],
)
def test_both_forms_of_pgm_are_read_with_comments_anywhere(content: bytes) -> None:
    pixels, most = read_pgm(content, SETTINGS)
    assert (pixels.tolist(), most) == ([[0, 100, 255], [7, 8, 9]], 255)


def test_a_byte_after_the_header_that_looks_like_space_is_a_pixel() -> None:
    assert read_pgm(b"P5 2 1 255\n\n ", SETTINGS)[0].tolist() == [[10, 32]]


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "is no PGM"),
        (b"\x89PNG\r\n\x1a\n", "is no PGM"),
        (b"P6 1 1 255\n\0\0\0", "is no PGM"),
        (b"P5 -1 1 255\n\0", "is no PGM"),
        (b"P5 1 1 255", "is no PGM"),
        (b"P5 99999999999999999999 1 255\n\0", "is no PGM"),
        (b"P5 0 1 255\n", "no pixels"),
        (b"P5 2 1 65535\n\0\0\0\0", "white in the image is 65535; images of 8 bits"),
        (b"P5 2 1 0\n\0\0", "white in the image is 0"),
        (b"P5 4001 1 255\n", "at most 4000 × 4000"),
        (b"P5 1 999999999 255\n", "at most 4000 × 4000"),
        (b"P5 2 1 255\n\0", "1 bytes of pixels; its columns and rows are 2"),
        (b"P5 2 1 255\n\0\0\0", "3 bytes of pixels"),
        (b"P5 2 1 100\n\0\xff", "255, above the value of white"),
        (b"P2 2 1 255\n1", "has 1 pixels"),
        (b"P2 2 1 255\n", "has 0 pixels"),
        (b"P2 2 1 255\n1 -1", "no decimal numbers"),
        (b"P2 2 1 255\n1 1e2", "no decimal numbers"),
        (b"P2 2 1 255\n1 256", "pixel of the image is 256"),
        (b"P2 2 1 255\n1 " + b"9" * 400, "no decimal numbers"),
        (b"P5" + b"#\n" * 300 + b" 1 1 255\n\0", "is no PGM"),
    ],
)
def test_what_is_no_image_of_a_map_is_refused_with_a_sentence(content: bytes, words: str) -> None:
    with pytest.raises(UnusableMap) as refused:
        read_pgm(content, SETTINGS)
    assert words in str(refused.value)


def test_an_image_of_more_bytes_or_metres_than_the_limits_is_refused() -> None:
    with pytest.raises(UnusableMap, match="bytes; at most"):
        read_pgm(b"P5 1 1 255\n" + bytes(MAX_IMAGE_BYTES), SETTINGS)
    coarse = MapSettings(resolution=1.0, origin=(0.0, 0.0, 0.0), negate=False, occupied_thresh=0.65, free_thresh=0.2)
    with pytest.raises(UnusableMap, match="longer than 1000 m"):
        read_pgm(p5(1001, 1, bytes(1001)), coarse)


@given(st.binary(max_size=60), st.sampled_from((b"", b"P5 2 2 255\n", b"P2 2 2 255\n", b"P5\n#")))
def test_any_bytes_are_read_or_refused_with_a_sentence(content: bytes, begin: bytes) -> None:
    try:
        pixels, _ = read_pgm(begin + content, SETTINGS)
        assert pixels.size
    except UnusableMap as error:
        assert str(error).endswith((".", "?"))


# -- cells ----------------------------------------------------------------------------------------------------------


def meaning(value: int, settings: MapSettings, most: int = 255) -> int:
    """Return what map_server makes of a pixel, written from its documentation."""
    shade = value / most
    if settings.mode == "raw":
        percent = round(shade * 255)
        if percent > 100:
            return -1
        probability = percent / 100
    else:
        probability = shade if settings.negate else 1 - shade
    return 100 if probability > settings.occupied_thresh else 0 if probability < settings.free_thresh else -1


@pytest.mark.parametrize("mode", ["trinary", "scale", "raw"])
@pytest.mark.parametrize("negate", [False, True])
@pytest.mark.parametrize("most", [100, 255])
def test_pixels_mean_what_map_server_takes_them_for(mode: floor_map.Mode, negate: bool, most: int) -> None:
    settings = MapSettings(
        resolution=0.05, origin=(0.0, 0.0, 0.0), negate=negate, occupied_thresh=0.65, free_thresh=0.196, mode=mode
    )
    pixels = np.arange(most + 1, dtype=np.uint8).reshape(1, -1)
    expected = [meaning(value, settings, most) for value in range(most + 1)]
    assert cells_of(pixels, most, settings).tolist() == [expected]
    assert set(expected) == {100, 0, -1}


def test_the_shades_of_map_saver_are_occupied_free_and_unknown() -> None:
    assert cells_of(np.array([[0, 254, 205]], dtype=np.uint8), 255, SETTINGS).tolist() == [[100, 0, -1]]


def test_the_lowest_row_of_the_image_is_the_first_of_the_cells() -> None:
    assert cells_of(np.array([[0], [254]], dtype=np.uint8), 255, SETTINGS).tolist() == [[0], [100]]


@given(st.integers(1, 12), st.integers(1, 12), st.integers(0, 2**32), st.floats(0, 1))
def test_rectangles_cover_the_occupied_cells_once(rows: int, columns: int, seed: int, share: float) -> None:
    occupied = np.random.default_rng(seed).random((rows, columns)) < share
    covered = np.zeros(occupied.shape, dtype=int)
    for column, row, wide, high in rectangles(occupied).tolist():
        assert wide > 0 and high > 0
        covered[row : row + high, column : column + wide] += 1
    assert (covered == occupied).all()


def test_walls_along_either_axis_are_few_rectangles() -> None:
    occupied = np.zeros((1000, 1000), dtype=bool)
    occupied[:, ::2] = True
    assert len(rectangles(occupied)) == len(rectangles(occupied.T)) == 500
    occupied[:, ::2], occupied[0], occupied[:, 0] = False, True, True
    assert len(rectangles(occupied)) == 2


def test_a_map_of_noise_is_refused_with_a_sentence() -> None:
    occupied = np.indices((2000, 2000)).sum(axis=0) % 2 == 0
    with pytest.raises(UnusableMap, match="more than 20000 rectangles"):
        rectangles(occupied)
    with pytest.raises(UnusableMap, match="more than 20000 rectangles"):
        rectangles(occupied[:300, :300])


# -- maps -----------------------------------------------------------------------------------------------------------


def sample(most: int = 255) -> tuple[bytes, FloorMap]:
    pgm = p5(5, 3, bytes([0, 0, 254, 205, 205] + [254] * 10), most)
    return pgm, build_map(SETTINGS, pgm, title="hall", height_m=2.0, client="ann", now_ns=5)


def test_a_map_keeps_its_image_byte_by_byte_and_survives_its_record() -> None:
    pgm, found = sample()
    assert pgm_of(found) == pgm and decode(encode(found)) == found
    assert (found.columns, found.rows, found.occupied, found.free, found.unknown) == (5, 3, 2, 11, 2)
    assert found.box_count == 1 and grid_of(found).cells[2].tolist() == [100, 100, 0, -1, -1]


def test_a_record_of_another_version_is_refused() -> None:
    with pytest.raises(msgspec.ValidationError):
        decode(b"\x80")


def test_noise_that_does_not_compress_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(map_image, "MAX_STORED_BYTES", 50_000)
    noise = random.Random(1).randbytes(100_000)
    settings = MapSettings(resolution=0.05, origin=(0, 0, 0), negate=False, occupied_thresh=1.0, free_thresh=0.0)
    with pytest.raises(UnusableMap, match="when it is compressed"):
        build_map(settings, p5(500, 200, noise), title="", height_m=2.0, client="")


def test_the_picture_has_the_shades_of_the_cells() -> None:
    """Read here by hand: two bits for each pixel, which are indices of a palette of three shades."""
    picture = io.BytesIO(sample()[1].picture)
    assert picture.read(8) == b"\x89PNG\r\n\x1a\n"
    parts: dict[bytes, bytes] = {}
    while head := picture.read(8):
        content = picture.read(int.from_bytes(head[:4], "big"))
        parts[head[4:]] = content
        assert picture.read(4) == zlib.crc32(head[4:] + content).to_bytes(4, "big")
    assert parts[b"IHDR"] == bytes.fromhex("00000005 00000003 02 03 00 00 00")
    lines = zlib.decompress(parts[b"IDAT"])
    shades = [
        [parts[b"PLTE"][3 * (lines[3 * row + 1 + column // 4] >> (6 - 2 * (column % 4)) & 3)] for column in range(5)]
        for row in range(3)
    ]
    assert shades == [[0, 0, 254, 205, 205], [254] * 5, [254] * 5]


def test_the_largest_map_is_read() -> None:
    """With a wall around, the diagonal of a hall, and half of it unknown."""
    side = math.isqrt(MAX_CELLS)
    pixels = np.full((side, side), 205, dtype=np.uint8)
    pixels[: side // 2] = 254
    pixels[[0, -1]] = pixels[:, [0, -1]] = 0
    pixels[np.arange(side), np.arange(side)] = 0
    found = build_map(SETTINGS, p5(side, side, pixels.tobytes()), title="hall", height_m=2.0, client="")
    assert found.box_count < 5000 and len(encode(found)) < 300_000


# -- forms ----------------------------------------------------------------------------------------------------------

_OF_CURL = (
    b"--------------------------d74496d66958873e\r\n"
    b'Content-Disposition: form-data; name="yaml"; filename="floor.yaml"\r\n'
    b"Content-Type: application/octet-stream\r\n\r\n"
    b"a: b\n\r\n"
    b"--------------------------d74496d66958873e\r\n"
    b'Content-Disposition: form-data; name="image"; filename="floor.pgm"\r\n\r\n'
    b"\0\r\n--\xff\r\n"
    b"--------------------------d74496d66958873e\r\n"
    b'Content-Disposition: form-data; name="height"\r\n\r\n'
    b"2.5\r\n"
    b"--------------------------d74496d66958873e--\r\n"
)
_TYPE = "multipart/form-data; boundary=------------------------d74496d66958873e"
_KNOWN = ("yaml", "image", "height")


def test_a_form_is_read_as_curl_sends_it() -> None:
    assert read_form(_OF_CURL, _TYPE, _KNOWN) == {
        "yaml": Part(b"a: b\n", "floor.yaml"),
        "image": Part(b"\0\r\n--\xff", "floor.pgm"),
        "height": Part(b"2.5"),
    }


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        (b'name="height"', b'name="depth"', "has the field 'depth'; its fields are yaml, image, height"),
        (b'name="height"', b'name="yaml"', "yaml twice"),
        (b'form-data; name="height"', b"form-data", "has no name"),
        (b'form-data; name="height"', b'attachment; name="height"', "has no name"),
        (b"\r\n\r\n2.5", b"\r\n2.5", "a blank line after it"),
        (b"3e--\r\n", b"", "no end"),
        (b'3e\r\nContent-Disposition: form-data; name="image"', b"3e x\r\n", "ends its line"),
        (b"application/octet-stream", b"a\r\nContent-Transfer-Encoding: base64", "transfer encoding"),
        (b'filename="floor.yaml"', b'filename="' + b"x" * 2000 + b'"', "header of at most"),
    ],
)
def test_what_is_no_form_is_refused_with_a_sentence(old: bytes, new: bytes, words: str) -> None:
    assert old in _OF_CURL
    with pytest.raises(BadForm) as refused:
        read_form(_OF_CURL.replace(old, new, 1), _TYPE, _KNOWN)
    assert words in str(refused.value)


def test_a_form_without_its_boundary_is_refused() -> None:
    for body, kind in ((_OF_CURL, "multipart/form-data"), (b"nothing", _TYPE), (b"", _TYPE)):
        with pytest.raises(BadForm, match="boundary"):
            read_form(body, kind, _KNOWN)


@given(st.binary(max_size=200), st.integers(0, len(_OF_CURL)), st.integers(0, 60))
def test_any_body_is_a_form_or_refused(more: bytes, at: int, gone: int) -> None:
    try:
        read_form(_OF_CURL[:at] + more + _OF_CURL[at + gone :], _TYPE, _KNOWN)
    except BadForm as error:
        assert str(error)
