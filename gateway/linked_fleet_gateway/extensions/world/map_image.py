"""Images of maps: PGM in, cells and their rectangles, PNG out. It runs in a thread, because it takes a second at most.

Netpbm (https://netpbm.sourceforge.net/doc/pgm.html) defines PGM. The meaning of pixels is that of ``map_server``.
"""

import gzip
import hashlib
import re
import struct
import time
import zlib

import numpy as np
import numpy.typing as npt

from linked_fleet_gateway.extensions.world.floor_map import (
    MAX_IMAGE_BYTES,
    MAX_STORED_BYTES,
    MOST_BOXES,
    FloorMap,
    MapSettings,
    UnusableMap,
    check_size,
    pgm_of,
)
from linked_fleet_gateway.extensions.world.occupancy import FREE, OCCUPIED, UNKNOWN, Bools, OccupancyGrid

Pixels = npt.NDArray[np.uint8]

# Comments go from # to the end of their line; a single space ends the header of P5.
_GAP = rb"(?:[ \t\n\v\f\r]|#[^\n\r]{0,1000}[\n\r]){1,200}"
_HEADER = re.compile(rb"P([25])" + _GAP + rb"(\d{1,9})" + _GAP + rb"(\d{1,9})" + _GAP + rb"(\d{1,9})[ \t\n\v\f\r]")
_MOST_RUNS = 1_000_000
"""Runs of occupied cells in one direction; an array of them takes 12 MB."""


def build_map(
    settings: MapSettings, pgm: bytes, *, title: str, height_m: float, client: str, now_ns: int | None = None
) -> FloorMap:
    """Return the map. Raises UnusableMap with a sentence."""
    pixels, most = read_pgm(pgm, settings)
    cells = cells_of(pixels, most, settings)
    image = gzip.compress(pgm, 6, mtime=0)
    if len(image) > MAX_STORED_BYTES:
        raise UnusableMap(
            f"The image has {len(image)} bytes when it is compressed; that of a map has at most {MAX_STORED_BYTES}. "
            "Save it in the mode trinary, which has three shades."
        )
    return FloorMap(
        title=title,
        settings=settings,
        columns=pixels.shape[1],
        rows=pixels.shape[0],
        height_m=height_m,
        occupied=int(np.count_nonzero(cells == OCCUPIED)),
        free=int(np.count_nonzero(cells == FREE)),
        sha256=hashlib.sha256(pgm).hexdigest(),
        image=image,
        picture=write_png(cells[::-1]),
        boxes=rectangles(cells == OCCUPIED).astype("<u2").tobytes(),
        created_ns=time.time_ns() if now_ns is None else now_ns,
        client=client,
    )


def grid_of(found: FloorMap) -> OccupancyGrid:
    """Return the cells of a map for planners. It takes up to a tenth of a second."""
    pixels, most = read_pgm(pgm_of(found), found.settings)
    return OccupancyGrid(cells_of(pixels, most, found.settings), found.settings.resolution, found.settings.origin)


# -- PGM ------------------------------------------------------------------------------------------------------------


def read_pgm(content: bytes, settings: MapSettings) -> tuple[Pixels, int]:
    """Return the pixels (rows, columns), the topmost row first, and the value of white. Raises UnusableMap."""
    if len(content) > MAX_IMAGE_BYTES:
        raise UnusableMap(
            f"The image has {len(content)} bytes; at most {MAX_IMAGE_BYTES} are read. P5 is shorter than P2."
        )
    header = _HEADER.match(content)
    if header is None:
        raise UnusableMap("The image is no PGM: it begins with P5 or P2, its columns, its rows and the value of white.")
    columns, rows, most = (int(each) for each in header.groups()[1:])
    if not columns or not rows:
        raise UnusableMap("The image has no pixels.")
    if not 1 <= most <= 255:
        raise UnusableMap(f"The value of white in the image is {most}; images of 8 bits, up to 255, are read.")
    check_size(settings, columns, rows)
    body = memoryview(content)[header.end() :]
    found = (_binary if header[1] == b"5" else _decimal)(body, columns * rows)
    if int(found.max()) > most:
        raise UnusableMap(f"A pixel of the image is {int(found.max())}, above the value of white, which is {most}.")
    return found.reshape(rows, columns), most


def _binary(body: memoryview, count: int) -> Pixels:
    if len(body) != count:
        raise UnusableMap(f"The image has {len(body)} bytes of pixels; its columns and rows are {count}.")
    return np.frombuffer(body, dtype=np.uint8)


def _decimal(body: memoryview, count: int) -> Pixels:
    text = re.sub(rb"#[^\n\r]*", b" ", body)
    if text.translate(None, b"0123456789 \t\n\v\f\r") or re.search(rb"\d{6}", text) is not None:
        raise UnusableMap("The pixels of the image are no decimal numbers; is it P5 rather than P2?")
    found = np.fromstring(text, dtype=np.int32, sep=" ") if text.strip() else np.zeros(0, dtype=np.int32)
    if len(found) != count:
        raise UnusableMap(f"The image has {len(found)} pixels; its columns and rows are {count}.")
    if int(found.max()) > 255:
        raise UnusableMap(f"A pixel of the image is {int(found.max())}; images of 8 bits, up to 255, are read.")
    return found.astype(np.uint8)


# -- cells ----------------------------------------------------------------------------------------------------------


def cells_of(pixels: Pixels, most: int, settings: MapSettings) -> npt.NDArray[np.int8]:
    """Return what the pixels mean, the lowest row first."""
    shades = np.minimum(np.arange(256), most) / most
    if settings.mode == "raw":  # the value is a percentage, whatever negate says; above 100 it is unknown
        percent = np.round(shades * 255)
        probability, is_known = percent / 100, percent <= 100
    else:
        probability, is_known = shades if settings.negate else 1 - shades, np.ones(256, dtype=bool)
    meanings = np.full(256, UNKNOWN, dtype=np.int8)
    meanings[is_known & (probability > settings.occupied_thresh)] = OCCUPIED
    meanings[is_known & (probability < settings.free_thresh)] = FREE
    found: npt.NDArray[np.int8] = meanings[pixels[::-1]]
    return found


def rectangles(occupied: Bools) -> npt.NDArray[np.int32]:
    """Return rectangles without overlap that cover the occupied cells: column, row, columns, rows. Raises UnusableMap.

    A run of cells in a row is joined with equal runs in the rows after it; the same is tried with columns, and the
    better of both is taken.
    """
    across, along = _joined(occupied), _joined(occupied.T)
    turned = None if along is None else along[:, (1, 0, 3, 2)]
    best = min((each for each in (across, turned) if each is not None), key=len, default=None)
    if best is None or len(best) > MOST_BOXES:
        raise UnusableMap(
            f"The occupied cells of the map are more than {MOST_BOXES} rectangles, which no check of motions can take. "
            "Remove noise from the image, or save the map at a coarser resolution."
        )
    return best


def _joined(occupied: Bools) -> npt.NDArray[np.int32] | None:
    """Return rectangles of equal runs in successive rows; None if there are too many runs."""
    padded = np.zeros((occupied.shape[0], occupied.shape[1] + 2), dtype=np.int8)
    padded[:, 1:-1] = occupied
    steps = np.diff(padded, axis=1)
    begins = steps == 1
    if np.count_nonzero(begins) > _MOST_RUNS:
        return None
    row, begin = (each.astype(np.int32) for each in np.nonzero(begins))
    end = np.nonzero(steps == -1)[1].astype(np.int32)
    order = np.lexsort((row, end, begin))
    row, begin, end = row[order], begin[order], end[order]
    is_next = (np.diff(row) == 1) & (np.diff(begin) == 0) & (np.diff(end) == 0)
    firsts = np.flatnonzero(np.concatenate(([True], ~is_next))) if len(row) else np.zeros(0, dtype=np.intp)
    counts = np.diff(np.concatenate((firsts, [len(row)])))
    return np.column_stack((begin[firsts], row[firsts], (end - begin)[firsts], counts)).astype(np.int32)


# -- PNG ------------------------------------------------------------------------------------------------------------

_SHADES = {OCCUPIED: (1, b"\x00\x00\x00"), FREE: (2, b"\xfe\xfe\xfe"), UNKNOWN: (0, b"\xcd\xcd\xcd")}
"""Index and colour of cells in the palette: the shades of ``map_saver``."""


def write_png(cells: npt.NDArray[np.int8]) -> bytes:
    """Return a picture of cells, the topmost row first: two bits for each cell, which are indices of a palette."""
    rows, columns = cells.shape
    indices = np.zeros((rows, -(-columns // 4) * 4), dtype=np.uint8)
    for value, (index, _) in _SHADES.items():
        indices[:, :columns][cells == value] = index
    lines = np.zeros((rows, 1 + indices.shape[1] // 4), dtype=np.uint8)  # each line begins with its filter, none
    for place, shift in enumerate((6, 4, 2, 0)):
        lines[:, 1:] |= indices[:, place::4] << shift
    colours = b"".join(colour for _, colour in sorted(_SHADES.values()))
    parts = (
        (b"IHDR", struct.pack(">IIBBBBB", columns, rows, 2, 3, 0, 0, 0)),
        (b"PLTE", colours),
        (b"IDAT", zlib.compress(lines.tobytes(), 6)),
        (b"IEND", b""),
    )
    return b"\x89PNG\r\n\x1a\n" + b"".join(map(_chunk, parts))


def _chunk(part: tuple[bytes, bytes]) -> bytes:
    kind, content = part
    return struct.pack(">I", len(content)) + kind + content + struct.pack(">I", zlib.crc32(kind + content))
