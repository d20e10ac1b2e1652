"""The segments of the history in a folder, and what is read from them. Threads may use it at the same time."""

import logging
import re
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from heapq import heappop, heappush
from pathlib import Path
from typing import TypeVar

from linked_fleet_gateway.extensions.history.segment import (
    SUFFIX,
    WORLD,
    DamagedSegmentError,
    Layout,
    Range,
    Reader,
    Said,
    UnreadableSegmentError,
    finish_left,
    forget_in,
)
from linked_fleet_gateway.extensions.history.thinning import GAP_NS, STILL_NS, is_gap
from linked_fleet_gateway.extensions.history.track import LATEST_NS, wall_ns

log = logging.getLogger(__name__)

SEGMENT_NS = 3600 * 10**9
"""The time of one segment."""
HELD_NS = STILL_NS + GAP_NS
"""A frame holds for as long: while a robot is heard, another one is kept until then."""
MOST_BYTES = 8 * 2**20
"""Most bytes of frames that are read at once, and in one file; a longer history needs several files."""
_MOST_SAID_BYTES = 2**20
"""Most bytes of values of components that are read at once."""
_YOUNG_NS = 60 * 10**9
"""A file that is not older may not have its tables yet."""
_AROUND_NS = 60 * 10**9
"""The time around the frames of a segment in which its values may be."""
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
    trouble: str = ""
    """The reason why it could not be read last time; it is tried again."""


class Shelf:
    """The segments in ``folder``. Damaged ones are skipped, and those that cannot be read at present for this time."""

    def __init__(self, folder: Path, now_ns: Callable[[], int] = lambda: time.time_ns()) -> None:
        self.folder = folder
        self._now_ns = now_ns
        self._files: dict[str, _File] = {}
        self._present: _File | None = None
        self._extents: dict[str, Range] = {}
        """Times of robots in all files but the present one, as far as known."""
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
            except UnreadableSegmentError as error:
                log.debug("the segment %s is left as it is: %s", file.path.name, error)  # another gateway writes it
            except DamagedSegmentError as error:
                self._note(file, error)
            self._ranges(file)
        self._collect_extents()

    def put(self, path: Path, begin_ns: int, ranges: Mapping[str, Range]) -> None:
        """Add a segment that begins now, with the growing ``ranges`` of its writer."""
        with self._lock:
            self._files[path.name] = self._present = _File(path, begin_ns, ranges)

    def end_present(self) -> None:
        """Nothing more is written into the segment that was ``put`` last."""
        with self._lock:
            self._present = None
        self._collect_extents()

    def is_usable(self, path: Path) -> bool:
        """Return True if a segment is there and was not found to be damaged."""
        file = self._files.get(path.name)
        return file is not None and not file.damage and path.exists()

    def forget(self, robot: str) -> bool:
        """Remove all of a robot from finished segments. Return False if one cannot be written at present."""
        done = True
        for file in self._known():
            if file is self._present:
                continue
            try:
                forget_in(file.path, robot)
                file.ranges = None
            except DamagedSegmentError as error:
                self._note(file, error)
            except UnreadableSegmentError as error:
                done = done and not file.path.exists()
                log.info("robot %s is not yet removed from %s: %s", robot, file.path.name, error)
            self._ranges(file)
        self._collect_extents()
        return done

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
        self._collect_extents()
        return total

    @property
    def damaged(self) -> list[str]:
        """Sentences about what is wrong with segments that are skipped, one for each."""
        with self._lock:
            return sorted(each.damage for each in self._files.values() if each.damage)

    @property
    def unreadable(self) -> list[str]:
        """Sentences about what kept segments from being read last time, one for each."""
        with self._lock:
            return sorted(each.trouble for each in self._files.values() if each.trouble and not each.damage)

    @property
    def count(self) -> int:
        return len(self._files)

    def extent(self, robot: str) -> Range | None:
        """Return the stamps of the oldest and the newest frame of a robot on disk, as far as known without reading."""
        present = self._present
        now = None if present is None or present.ranges is None else present.ranges.get(robot)
        return _joined(self._extents.get(robot), now)

    def _collect_extents(self) -> None:
        """Join the times of all files, in the thread that writes; ``extent`` is asked for each robot of a list."""
        found: dict[str, Range] = {}
        for file in self._known():
            if file is not self._present:
                for robot, range in dict(file.ranges or {}).items():
                    found[robot] = _joined(found.get(robot), range) or range
        self._extents = found

    def read(
        self, robot: str, begin_ns: int | None, end_ns: int | None, most: int, most_bytes: int = MOST_BYTES
    ) -> Found:
        """Return at most ``most`` frames of one layout from ``begin_ns`` on and before ``end_ns``.

        These are the first ones or, without a beginning, the last ones. They have at most ``most_bytes``, but for one.
        """
        backward = begin_ns is None
        low, high = 0 if begin_ns is None else begin_ns, LATEST_NS if end_ns is None else end_ns
        frames, layout, next_ns, size = list[bytes](), None, None, 0
        for stamp_ns, of, frame in self._frames(robot, low, high, backward):
            is_full = len(frames) >= most or size + len(frame) > most_bytes
            if layout is not None and ((of is not layout and of != layout) or is_full):
                next_ns = stamp_ns
                break
            layout = of
            frames.append(frame)
            size += len(frame)
        if backward:
            return Found(layout, tuple(reversed(frames)), before=next_ns)
        return Found(layout, tuple(frames), after=next_ns)

    def at(self, robot: str, stamp_ns: int) -> Found:
        """Return the frame that held at a time; none if the robot was not heard then."""
        found = self.read(robot, None, min(stamp_ns + 1, LATEST_NS), 1)
        if not found.frames or is_gap(found.frames[0]) or stamp_ns - wall_ns(found.frames[0]) > HELD_NS:
            return Found()
        return Found(found.layout, found.frames)

    def values(
        self,
        robot: str,
        begin_ns: int,
        end_ns: int,
        most: int,
        most_bytes: int = _MOST_SAID_BYTES,
        path: str = "",
        choose: Callable[[Iterable[Said]], Iterable[Said]] = iter,
    ) -> tuple[list[Said], int | None]:
        """Return what components of a robot said from ``begin_ns`` on and before ``end_ns``, the oldest first.

        These are ``most``, or about ``most_bytes``, and the rest of what was said at the time of the last one. The
        second result is the stamp of the next one; None if there is none. What gateways that share the folder have
        written twice comes once. ``path`` is that of the only property that is
        wanted, empty for all; of its values ``choose`` leaves out some.
        """
        found, after = list[Said](), None

        def read(end_ns: int, reader: Reader) -> tuple[list[Said], int | None]:
            return _page(choose(reader.values(robot, begin_ns, end_ns, path)), most, most_bytes)

        for file in self._known():
            more, next_ns = self._with(file, partial(read, end_ns)) or ([], None)
            both = {(each.stamp_ns, each.path, each.kind): each for each in (*found, *more)}
            found, rest_ns = _page((both[key] for key in sorted(both)), most, most_bytes)
            after = min((each for each in (after, next_ns, rest_ns) if each is not None), default=None)
            end_ns = end_ns if after is None else after
        return found, after

    def values_at(self, robot: str, stamp_ns: int) -> dict[str, Said]:
        """Return the value that each property of the components of a robot had at a time, by path below the robot.

        A segment has what was known when it began, so those alone are read in which the robot was heard then.
        """
        around = [file for file, range in self._of_robot(robot) if _is_around(stamp_ns, range)]
        return self._last_values(around, robot, stamp_ns)

    def world_at(self, stamp_ns: int) -> dict[str, Said]:
        """Return what was known of the world at a time, by path; empty if nothing was written then.

        Those segments are read in which any robot was heard around that time.
        """
        ranges = ((file, self._ranges(file).values()) for file in self._known())
        around = (file for file, all_ in ranges if any(_is_around(stamp_ns, each) for each in all_))
        return self._last_values(around, WORLD, stamp_ns)

    def _last_values(self, files: Iterable[_File], robot: str, stamp_ns: int) -> dict[str, Said]:
        """Return the last values of a robot, or of the world, in these segments at a time, by path."""
        found: dict[str, Said] = {}
        for file in files:
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
            for each in reader.frames(robot, low, high, backward):
                file.trouble = ""
                yield each
        except (DamagedSegmentError, UnreadableSegmentError) as error:
            self._note(file, error)
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
        except (DamagedSegmentError, UnreadableSegmentError) as error:
            if file.path.exists():  # else it was too old
                self._note(file, error)
            return None

    def _with(self, file: _File, read: Callable[[Reader], _T]) -> _T | None:
        reader = self._open(file)
        if reader is None:
            return None
        try:
            found = read(reader)
        except (DamagedSegmentError, UnreadableSegmentError) as error:
            self._note(file, error)
            return None
        else:
            file.trouble = ""
            return found
        finally:
            reader.close()

    def _note(self, file: _File, error: Exception) -> None:
        is_young = 0 <= self._now_ns() - file.begin_ns < _YOUNG_NS
        if isinstance(error, DamagedSegmentError) and not is_young:  # else it may have no tables yet
            self._note_damage(file, error)
            return
        text = f"{file.path.name}: {error}"
        if file.trouble != text:
            log.warning("a segment of the history cannot be read at present: %s", text)
        file.trouble = text

    def _note_damage(self, file: _File, damage: Exception) -> None:
        file.damage = f"{file.path.name}: {damage}"
        log.warning("a segment of the history is skipped: %s", file.damage)


def _is_around(stamp_ns: int, heard: Range) -> bool:
    """Return True if something was heard around a time."""
    return heard[0] - _AROUND_NS <= stamp_ns <= heard[1] + _AROUND_NS


def _joined(one: Range | None, other: Range | None) -> Range | None:
    if one is None or other is None:
        return one or other
    return min(one[0], other[0]), max(one[1], other[1])


def _page(said: Iterable[Said], most: int, most_bytes: int) -> tuple[list[Said], int | None]:
    """Return the first ones, with all of the time of the last one, and the stamp of the next one."""
    found, size = list[Said](), 0
    for each in said:
        if found and each.stamp_ns != found[-1].stamp_ns and (len(found) >= most or size >= most_bytes):
            return found, each.stamp_ns
        found.append(each)
        size += len(each.json)
    return found, None


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
