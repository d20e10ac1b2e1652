"""The history on disk: what is written into segments, how long it is kept, and how it is read (README.md).

The event loop only collects what is to be written. A thread writes a batch every ``BATCH_S``, and others read.
"""

import asyncio
import logging
import re
import secrets
import sqlite3
import threading
import time
from collections import deque
from collections.abc import AsyncIterator, Callable, Iterator, Mapping, Sequence
from contextlib import asynccontextmanager, suppress
from dataclasses import dataclass, field
from heapq import heappop, heappush
from pathlib import Path
from typing import TypeVar

from linked_fleet_gateway.api import cancel_tasks, supervised
from linked_fleet_gateway.extensions.history.segment import (
    SUFFIX,
    DamagedSegment,
    Layout,
    Range,
    Reader,
    Said,
    Writer,
    finish_left,
)
from linked_fleet_gateway.extensions.history.thinning import GAP_NS, STILL_NS, Thinning, gap_after, is_gap
from linked_fleet_gateway.extensions.history.track import wall_ns

log = logging.getLogger(__name__)

BATCH_S = 1.0
_SEGMENT_NS = 3600 * 10**9
"""The time of one segment."""
_SHARE = 16
"""A segment that is larger than this part of all that may be kept is finished early."""
_PRUNE_S = 60.0
_MOST_PENDING = 200_000
"""Frames that wait for the thread; more are lost, and counted."""
HELD_NS = STILL_NS + GAP_NS
"""A frame holds for as long: while a robot is heard, another one is kept until then."""
_LATEST_NS = 2**63 - 1
_NAME = re.compile(r"([0-9]{20})-[0-9a-f]{8}\.sqlite", re.ASCII)
_T = TypeVar("_T")


@dataclass(frozen=True)
class Found:
    """Frames of one layout in temporal order, and the stamps of the nearest frames that did not fit."""

    layout: Layout | None = None
    frames: tuple[bytes, ...] = ()
    before: int | None = None
    after: int | None = None


@dataclass
class _Robot:
    layout: Layout
    thinning: Thinning
    heard_s: float = 0.0


@dataclass
class _Batch:
    frames: list[tuple[str, Layout, bytes]] = field(default_factory=list)
    values: list[Said] = field(default_factory=list)


@dataclass
class _File:
    """A segment in the folder. ``ranges`` are known once it is finished."""

    path: Path
    begin_ns: int
    ranges: Mapping[str, Range] | None = None
    damage: str = ""


class Archive:
    """The history on disk in ``folder``: of the last ``keep_s``, and at most ``most_bytes``.

    At most ``rate_hz`` frames a second of each robot are kept. ``failed`` is called with what keeps the thread from
    writing, and with None when it writes again.
    """

    def __init__(
        self,
        folder: Path,
        keep_s: float,
        most_bytes: int,
        rate_hz: float,
        failed: Callable[[Exception | None], None] = lambda error: None,
        now_ns: Callable[[], int] = time.time_ns,
        open_writer: Callable[[Path], Writer] = Writer,
    ) -> None:
        self.folder, self.keep_s, self.most_bytes, self.rate_hz = folder, keep_s, most_bytes, rate_hz
        self.lost = 0
        """Frames that could not be written."""
        self.failure = ""
        """Why nothing is written at present."""
        self.bytes = 0
        self._failed, self._now_ns, self._open_writer = failed, now_ns, open_writer
        self._layouts: dict[str, Layout] = {}
        self._pending: deque[tuple[str, Layout, bytes]] = deque()
        self._values: list[Said] = []
        self._robots: dict[str, _Robot] = {}
        self._files: dict[str, _File] = {}
        self._lock = threading.Lock()
        self._writer: Writer | None = None
        self._pruned_s = -_PRUNE_S

    # -- the event loop -----------------------------------------------------------------------------------------------

    def begin(self, layout: Layout) -> None:
        """Frames of a robot have another layout from now on."""
        self._layouts[layout.robot] = layout

    def add(self, robot: str, frame: bytes) -> None:
        """Write a frame with the next batch."""
        layout = self._layouts.get(robot)
        if layout is None:
            return
        if len(self._pending) >= _MOST_PENDING:
            self.lost += 1
            return
        self._pending.append((robot, layout, frame))

    def add_values(self, values: Sequence[Said]) -> None:
        """Write values and events of components with the next batch."""
        room = _MOST_PENDING - len(self._values)
        self._values += values[:room]
        self.lost += len(values[room:])

    @asynccontextmanager
    async def running(self) -> AsyncIterator[None]:
        await asyncio.to_thread(self.look_around)
        task = supervised(self._write_batch, "history on disk", log, "the history on disk is not written", BATCH_S)
        try:
            yield
        finally:
            await cancel_tasks([task])
            await asyncio.to_thread(self.close)

    async def _write_batch(self) -> None:
        batch = self._take()
        await asyncio.shield(asyncio.to_thread(self.write, batch, time.monotonic()))

    def _take(self) -> _Batch:
        frames, self._pending = self._pending, deque()
        values, self._values = self._values, []
        return _Batch(list(frames), values)

    # -- the thread that writes ---------------------------------------------------------------------------------------

    def look_around(self) -> None:
        """Find what is there, and finish what killed processes have left."""
        with suppress(OSError):
            self.folder.mkdir(parents=True, exist_ok=True)
        for path in _segments(self.folder):
            try:
                finish_left(path)
            except sqlite3.OperationalError as error:
                log.debug("the segment %s is left as it is: %s", path.name, error)  # another gateway writes it
            except sqlite3.Error as error:
                self._note_damage(self._file(path), str(error))
        with suppress(OSError):
            self._prune()
        for file in self._known():
            self._ranges(file)

    def write(self, batch: _Batch, now_s: float) -> None:
        """Write what is worth it of a batch; ``now_s`` is monotonic."""
        chosen = list(self._chosen(batch.frames, now_s))
        try:
            if self._writer is not None:
                self._roll_if_due(self._writer)
            if chosen or batch.values:
                self._present_writer().write(chosen, batch.values)
            if now_s - self._pruned_s >= _PRUNE_S:
                self._pruned_s = now_s
                self._prune()
        except (sqlite3.Error, OSError) as error:
            self.lost += len(chosen) + len(batch.values)
            self._robots.clear()  # what comes next begins anew, after a gap
            if not isinstance(error, sqlite3.OperationalError):  # such as a full disk: the segment itself is fine
                self._abandon()
            self._say(error)
        else:
            if self.failure and (chosen or batch.values):
                self._say(None)

    def _chosen(self, frames: Sequence[tuple[str, Layout, bytes]], now_s: float) -> Iterator[tuple[Layout, bytes]]:
        for name, layout, frame in frames:
            robot = self._robots.get(name)
            if robot is None or robot.layout is not layout:
                yield from ((robot.layout, each) for each in robot.thinning.end()) if robot else self._left(name)
                robot = self._robots[name] = _Robot(layout, Thinning(self.rate_hz))
            robot.heard_s = now_s
            for each in robot.thinning.take(frame):
                yield layout, each
        for name, robot in list(self._robots.items()):
            if now_s - robot.heard_s > GAP_NS / 1e9:
                yield from ((robot.layout, each) for each in robot.thinning.end())
                del self._robots[name]

    def _left(self, robot: str) -> Iterator[tuple[Layout, bytes]]:
        """Yield the gap after the last frame of a robot that a former process has written."""
        last = self.read(robot, None, None, 1)
        if last.layout is not None and not is_gap(last.frames[-1]):
            yield last.layout, gap_after(last.frames[-1])

    def _present_writer(self) -> Writer:
        """Return the present segment, which begins now if there is none. Raises sqlite3.Error, OSError."""
        if self._writer is None:
            self.folder.mkdir(parents=True, exist_ok=True)
            begin_ns = self._now_ns()
            path = self.folder / f"{begin_ns:020}-{secrets.token_hex(4)}{SUFFIX}"
            try:
                self._writer = self._open_writer(path)
            except sqlite3.Error:
                with suppress(OSError):
                    _remove(path)
                raise
            with self._lock:
                self._files[path.name] = _File(path, begin_ns)
        return self._writer

    def _roll_if_due(self, writer: Writer) -> None:
        file = self._files.get(writer.path.name)
        if file is None or file.damage or not writer.path.exists():
            self._abandon()
        elif self._now_ns() - file.begin_ns >= _SEGMENT_NS or _size(writer.path) > self.most_bytes / _SHARE:
            self._finish(writer)
            self._prune()

    def _finish(self, writer: Writer) -> None:
        if (file := self._files.get(writer.path.name)) is not None:
            file.ranges = dict(writer.ranges)
        self._writer = None
        try:
            writer.finish()
        finally:
            writer.close()

    def _abandon(self) -> None:
        """Begin another segment with the next batch."""
        if (writer := self._writer) is not None:
            self._writer = None
            with suppress(sqlite3.Error):
                writer.close()

    def _say(self, error: Exception | None) -> None:
        text = "" if error is None else f"{type(error).__name__}: {error}"
        if text != self.failure:
            self.failure = text
            self._failed(error)

    def _prune(self) -> None:
        """Remove the oldest segments beyond the time and the bytes that are kept. Raises OSError."""
        with self._lock:
            found = {each.name for each in _segments(self.folder)}
            for name in self._files.keys() - found:
                del self._files[name]
            for name in found - self._files.keys():
                self._file(self.folder / name)
            files = sorted(self._files.values(), key=lambda each: (each.begin_ns, each.path.name))
        sizes = {each.path: _size(each.path) for each in files}
        total, oldest_ns = sum(sizes.values()), self._now_ns() - int(self.keep_s * 1e9)
        present = None if self._writer is None else self._writer.path
        for each in files:
            is_old = each.begin_ns + _SEGMENT_NS < oldest_ns
            if each.path == present or not (is_old or total > self.most_bytes):
                continue
            _remove(each.path)
            total -= sizes[each.path]
            with self._lock:
                self._files.pop(each.path.name, None)
        self.bytes = total

    def _file(self, path: Path) -> _File:
        return self._files.setdefault(path.name, _File(path, _begin_of(path)))

    def close(self) -> None:
        """Write what is pending, and finish the segment."""
        batch = self._take()
        self.write(batch, time.monotonic())
        chosen = [(each.layout, one) for each in self._robots.values() for one in each.thinning.end()]
        self._robots.clear()
        try:
            if chosen:
                self._present_writer().write(chosen)
            if self._writer is not None:
                self._finish(self._writer)
        except (sqlite3.Error, OSError) as error:
            log.warning("the last segment of the history is not finished: %s", error)
            self._abandon()

    # -- threads that read --------------------------------------------------------------------------------------------

    @property
    def damaged(self) -> list[str]:
        """What is wrong with segments that are skipped, a sentence for each."""
        with self._lock:
            return sorted(each.damage for each in self._files.values() if each.damage)

    @property
    def findings(self) -> list[str]:
        """Sentences for readers about what is not written, and what cannot be read."""
        found = [f"Nothing is written to disk at present: {self.failure}"] if self.failure else []
        if damaged := self.damaged:
            found.append(f"{len(damaged)} damaged files are skipped, such as {damaged[0]}")
        return found

    @property
    def segments(self) -> int:
        return len(self._files)

    def extent(self, robot: str) -> Range | None:
        """Return the stamps of the oldest and the newest frame of a robot on disk, as far as known without reading."""
        ranges = [range for file in self._known() if (range := self._known_ranges(file).get(robot)) is not None]
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
        """Yield frames in the order of time or against it, each stamp once; segments are opened when it is their turn."""
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
        except DamagedSegment as damage:
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

    def _known_ranges(self, file: _File) -> Mapping[str, Range]:
        writer = self._writer
        if writer is not None and writer.path == file.path:
            return dict(writer.ranges)
        return file.ranges or {}

    def _ranges(self, file: _File) -> Mapping[str, Range]:
        writer = self._writer
        if file.ranges is not None or (writer is not None and writer.path == file.path):
            return self._known_ranges(file)

        def read(reader: Reader) -> tuple[bool, Mapping[str, Range]]:
            return reader.is_finished(), reader.ranges()

        finished, ranges = self._with(file, read) or (False, {})
        if finished:
            file.ranges = ranges
        return ranges

    def _open(self, file: _File) -> Reader | None:
        try:
            return Reader(file.path)
        except DamagedSegment as damage:
            if file.path.exists():  # else it was too old
                self._note_damage(file, str(damage))
            return None

    def _with(self, file: _File, read: Callable[[Reader], _T]) -> _T | None:
        reader = self._open(file)
        if reader is None:
            return None
        try:
            return read(reader)
        except DamagedSegment as damage:
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


def _size(path: Path) -> int:
    total = 0
    for suffix in ("", "-wal"):
        with suppress(OSError):
            total += path.with_name(path.name + suffix).stat().st_size
    return total


def _remove(path: Path) -> None:
    for suffix in ("", "-wal", "-shm", "-journal"):
        path.with_name(path.name + suffix).unlink(missing_ok=True)
