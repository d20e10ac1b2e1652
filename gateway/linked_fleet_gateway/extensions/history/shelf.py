"""The segments of the history in a folder, and what is read from them. Threads may use it at the same time."""

import logging
import re
import sqlite3
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from heapq import heappop, heappush
from pathlib import Path
from typing import TypeVar

from linked_fleet_gateway.extensions.history.segment import (
    SUFFIX,
    DamagedSegmentError,
    Layout,
    Range,
    Reader,
    Said,
    finish_left,
)
from linked_fleet_gateway.extensions.history.thinning import GAP_NS, STILL_NS, is_gap
from linked_fleet_gateway.extensions.history.track import wall_ns

log = logging.getLogger(__name__)

SEGMENT_NS = 3600 * 10**9
"""The time of one segment."""
HELD_NS = STILL_NS + GAP_NS
"""A frame holds for as long: while a robot is heard, another one is kept until then."""
_LATEST_NS = 2**63 - 1
_NAME = re.compile(r"([0-9]{20})-[0-9a-f]{8}\.sqlite", re.ASCII)
_T = TypeVar("_T")
_Stamped = tuple[int, Layout, bytes]


@dataclass(frozen=True)
class Found:
    """Frames of one layout in temporal order, and the stamps of the nearest frames that did not fit."""

    layout: Layout | None = None
    frames: tuple[bytes, ...] = ()
    before: int | None = None
    after: int | None = None


@dataclass
class _File:
    """A segment in the folder. ``ranges`` are known once it is finished, or while it is written here."""

    path: Path
    begin_ns: int
    ranges: Mapping[str, Range] | None = None
    damage: str = ""


class Shelf:
    """The segments in ``folder``. Damaged ones are skipped."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._files: dict[str, _File] = {}
        self._lock = threading.Lock()

    def look(self) -> None:
        """Find what is in the folder now. Raises OSError."""
        with self._lock:
            found = {each.name for each in _segments(self.folder)}
            for name in self._files.keys() - found:
                del self._files[name]
            for name in found - self._files.keys():
                self._files[name] = _File(self.folder / name, _begin_of(self.folder / name))

    def finish_left(self) -> None:
        """Finish what killed processes have left, and read what there is of each robot."""
        for file in self._known():
            try:
                finish_left(file.path)
            except sqlite3.OperationalError as error:
                log.debug("the segment %s is left as it is: %s", file.path.name, error)  # another gateway writes it
            except sqlite3.Error as error:
                self._note_damage(file, str(error))
            self._ranges(file)

    def put(self, path: Path, begin_ns: int, ranges: Mapping[str, Range]) -> None:
        """Add a segment that begins now, with the growing ``ranges`` of its writer."""
        with self._lock:
            self._files[path.name] = _File(path, begin_ns, ranges)

    def is_usable(self, path: Path) -> bool:
        """Return True if a segment is there and was not found to be damaged."""
        file = self._files.get(path.name)
        return file is not None and not file.damage and path.exists()

    def prune(self, oldest_ns: int, most_bytes: int, present: Path | None) -> int:
        """Remove segments that are over before a time, and the oldest ones beyond some bytes, but not the present one.

        Return the size of the rest. Raises OSError.
        """
        self.look()
        with self._lock:
            files = sorted(self._files.values(), key=lambda each: (each.begin_ns, each.path.name))
        sizes = {each.path: size_of(each.path) for each in files}
        total = sum(sizes.values())
        for each in files:
            is_old = each.begin_ns + SEGMENT_NS < oldest_ns
            if each.path == present or not (is_old or total > most_bytes):
                continue
            remove(each.path)
            total -= sizes[each.path]
            with self._lock:
                self._files.pop(each.path.name, None)
        return total

    @property
    def damaged(self) -> list[str]:
        """What is wrong with segments that are skipped, a sentence for each."""
        with self._lock:
            return sorted(each.damage for each in self._files.values() if each.damage)

    @property
    def count(self) -> int:
        return len(self._files)

    def extent(self, robot: str) -> Range | None:
        """Return the stamps of the oldest and the newest frame of a robot on disk, as far as known without reading."""
        ranges = [range for file in self._known() if (range := (file.ranges or {}).get(robot)) is not None]
        return (min(low for low, _ in ranges), max(high for _, high in ranges)) if ranges else None

    def read(self, robot: str, begin_ns: int | None, end_ns: int | None, most: int) -> Found:
        """Return at most ``most`` frames of one layout from ``begin_ns`` on and before ``end_ns``.

        These are the first ones or, without a beginning, the last ones.
        """
        backward = begin_ns is None
        low, high = 0 if begin_ns is None else begin_ns, _LATEST_NS if end_ns is None else end_ns
        frames, layout, next_ns = list[bytes](), None, None
        for stamp_ns, of, frame in self._frames(robot, low, high, backward):
            if layout is not None and ((of is not layout and of != layout) or len(frames) >= most):
                next_ns = stamp_ns
                break
            layout = of
            frames.append(frame)
        if backward:
            return Found(layout, tuple(reversed(frames)), before=next_ns)
        return Found(layout, tuple(frames), after=next_ns)

    def at(self, robot: str, stamp_ns: int) -> Found:
        """Return the frame that held at a time; none if the robot was not heard then."""
        found = self.read(robot, None, stamp_ns + 1, 1)
        if not found.frames or is_gap(found.frames[0]) or stamp_ns - wall_ns(found.frames[0]) > HELD_NS:
            return Found()
        return Found(found.layout, found.frames)

    def values(self, robot: str, begin_ns: int, end_ns: int, most: int) -> list[Said]:
        """Return what components of a robot said from ``begin_ns`` on and before ``end_ns``, the oldest first."""
        found = list[Said]()
        for file in self._known():
            if len(found) < most:
                found += self._with(file, lambda reader: reader.values(robot, begin_ns, end_ns, most)) or []
        return sorted(found, key=lambda each: each.stamp_ns)[:most]

    def values_at(self, robot: str, stamp_ns: int) -> dict[str, Said]:
        """Return the value that each property of the components of a robot had at a time, by path below the robot."""
        found: dict[str, Said] = {}
        for file in self._known():
            for each in self._with(file, lambda reader: reader.last_values(robot, stamp_ns)) or []:
                if each.path not in found or found[each.path].stamp_ns <= each.stamp_ns:
                    found[each.path] = each
        return found

    def _frames(self, robot: str, low: int, high: int, backward: bool) -> Iterator[tuple[int, Layout, bytes]]:
        """Yield frames in the order of time or against it, each stamp once; segments are opened in their turn."""
        sign = -1 if backward else 1
        due = [
            (sign * (range[1] if backward else range[0]), file)
            for file, range in self._of_robot(robot)
            if range[1] >= low and range[0] < high
        ]
        due.sort(key=lambda each: each[0], reverse=True)
        active = list[tuple[int, int, Iterator[tuple[int, Layout, bytes]], tuple[int, Layout, bytes]]]()
        last: int | None = None
        number = 0
        while due or active:
            while due and (not active or due[-1][0] <= active[0][0]):
                stream = self._stream(due.pop()[1], robot, low, high, backward)
                if (first := next(stream, None)) is not None:
                    number += 1
                    heappush(active, (sign * first[0], number, stream, first))
            if not active:
                continue
            _, order, stream, item = heappop(active)
            if last is None or sign * item[0] > last:
                last = sign * item[0]
                yield item
            if (following := next(stream, None)) is not None:
                heappush(active, (sign * following[0], order, stream, following))

    def _stream(
        self, file: _File, robot: str, low: int, high: int, backward: bool
    ) -> Iterator[tuple[int, Layout, bytes]]:
        reader = self._open(file)
        if reader is None:
            return
        try:
            yield from reader.frames(robot, low, high, backward)
        except DamagedSegmentError as damage:
            self._note_damage(file, str(damage))
        finally:
            reader.close()

    def _known(self) -> list[_File]:
        with self._lock:
            files = [each for each in self._files.values() if not each.damage]
        return sorted(files, key=lambda each: (each.begin_ns, each.path.name))

    def _of_robot(self, robot: str) -> list[tuple[_File, Range]]:
        found = [(file, self._ranges(file).get(robot)) for file in self._known()]
        return [(file, range) for file, range in found if range is not None]

    def _ranges(self, file: _File) -> Mapping[str, Range]:
        if file.ranges is not None:
            return dict(file.ranges)

        def read(reader: Reader) -> tuple[bool, Mapping[str, Range]]:
            return reader.is_finished(), reader.ranges()

        finished, ranges = self._with(file, read) or (False, {})
        if finished:
            file.ranges = ranges
        return ranges

    def _open(self, file: _File) -> Reader | None:
        try:
            return Reader(file.path)
        except DamagedSegmentError as damage:
            if file.path.exists():  # else it was too old
                self._note_damage(file, str(damage))
            return None

    def _with(self, file: _File, read: Callable[[Reader], _T]) -> _T | None:
        reader = self._open(file)
        if reader is None:
            return None
        try:
            return read(reader)
        except DamagedSegmentError as damage:
            self._note_damage(file, str(damage))
            return None
        finally:
            reader.close()

    def _note_damage(self, file: _File, damage: str) -> None:
        text = f"{file.path.name}: {damage}"
        log.warning("a segment of the history is skipped: %s", text)
        file.damage = text


def _segments(folder: Path) -> Iterator[Path]:
    """Yield the segments in a folder, and nothing that somebody else has put there."""
    yield from (each for each in folder.glob(f"*{SUFFIX}") if _NAME.fullmatch(each.name))


def _begin_of(path: Path) -> int:
    found = _NAME.fullmatch(path.name)
    return int(found[1]) if found else 0


def size_of(path: Path) -> int:
    total = 0
    for suffix in ("", "-wal"):
        with suppress(OSError):
            total += path.with_name(path.name + suffix).stat().st_size
    return total


def remove(path: Path) -> None:
    for suffix in ("", "-wal", "-shm", "-journal"):
        path.with_name(path.name + suffix).unlink(missing_ok=True)
