"""The history on disk: what is written into segments, and how long it is kept (README.md).

The event loop only collects what is to be written. A thread writes a batch every ``BATCH_S``.
"""

import asyncio
import logging
import math
import secrets
import sqlite3
import threading
import time
from collections import deque
from collections.abc import AsyncIterator, Callable, Sequence
from contextlib import asynccontextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path

from linked_fleet_gateway.api import cancel_tasks, supervised
from linked_fleet_gateway.extensions.history.kept_values import KeptValues, size_in_file
from linked_fleet_gateway.extensions.history.segment import (
    PLACEMENTS,
    SUFFIX,
    WORLD,
    DamagedSegmentError,
    Layout,
    Said,
    UnreadableSegmentError,
    Writer,
    finish_left,
)
from linked_fleet_gateway.extensions.history.shelf import SEGMENT_NS, Shelf, remove, size_of
from linked_fleet_gateway.extensions.history.thinning import AHEAD_NS, GAP_NS, Thinning, gap_after, is_gap

log = logging.getLogger(__name__)

BATCH_S = 1.0
_SHARE = 16
"""A segment that is larger than this part of all that may be kept is finished early."""
_PRUNE_S = 60.0
_MOST_PENDING = 200_000
"""Frames that wait for the thread; more are lost, and counted."""
_MOST_PENDING_BYTES = 32 * 2**20
"""Bytes of values of components that wait for the thread; more are lost, and counted."""
_FORGETS = 5
"""Batches in which a removed robot is looked for in files that somebody reads or writes."""


@dataclass
class _Robot:
    layout: Layout
    thinning: Thinning
    heard_s: float = 0.0


@dataclass
class _Batch:
    frames: list[tuple[str, Layout, bytes]] = field(default_factory=list)
    values: list[Said] = field(default_factory=list)


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
        now_ns: Callable[[], int] = lambda: time.time_ns(),
        open_writer: Callable[[Path], Writer] = Writer,
    ) -> None:
        self.keep_s, self.most_bytes, self.rate_hz = keep_s, most_bytes, rate_hz
        self.shelf = Shelf(folder, now_ns)
        self.lost = 0
        """Frames and values that could not be written."""
        self.failure = ""
        """The reason why nothing is written at present."""
        self.bytes = 0
        self._failed, self._now_ns, self._open_writer = failed, now_ns, open_writer
        self._layouts: dict[str, Layout] = {}
        self._pending: deque[tuple[str, Layout, bytes]] = deque()
        self._values: list[Said] = []
        self._value_bytes = 0
        self._robots: dict[str, _Robot] = {}
        self._told: set[str] = set()
        """Robots of which it was logged that something of them is lost."""
        self._kept = KeptValues(most_bytes, self._lose_value)
        self._in_parts: set[Path] = set()
        """Finished segments that somebody has read since, so that they are no single files yet."""
        self._forgotten: dict[str, int] = {}
        """Robots that were removed, with the number of further tries to remove them from files."""
        self._lock = threading.Lock()
        self._closed = False
        self._writer: Writer | None = None
        self._begin_ns = 0
        self._pruned_s = -math.inf

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
        latest_ns = self._now_ns() + AHEAD_NS
        for each in values:
            size = size_in_file(each)
            if not 0 <= each.stamp_ns <= latest_ns or self._value_bytes + size > _MOST_PENDING_BYTES:
                self.lost += 1
                self._tell(each.robot, "a value is lost: it comes from the future, or too many others wait")
            else:
                self._values.append(each)
                self._value_bytes += size

    def forget(self, robot: str) -> None:
        """Remove all of a robot that was removed, with the next batch."""
        self._pending = deque(each for each in self._pending if each[0] != robot)
        place = (WORLD, PLACEMENTS + robot)
        self._values = [each for each in self._values if each.robot != robot and (each.robot, each.path) != place]
        self._forgotten[robot] = _FORGETS

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
        values, self._values, self._value_bytes = self._values, [], 0
        return _Batch(list(frames), values)

    # -- the thread that writes ---------------------------------------------------------------------------------------

    def look_around(self) -> None:
        """Find what is there, and finish what killed processes have left."""
        try:
            self.shelf.folder.mkdir(parents=True, exist_ok=True)
            self.shelf.look()
            self.shelf.finish_left()
            self._prune()
        except OSError as error:
            self._say(error)

    def write(self, batch: _Batch, now_s: float) -> None:
        """Write what is worth it of a batch; ``now_s`` is monotonic."""
        with self._lock:
            self._write(batch, now_s)
            if self._closed:  # this thread has begun when the gateway had ended already
                self._finish_last()

    def _write(self, batch: _Batch, now_s: float) -> None:
        chosen, wrote = list[tuple[Layout, bytes]](), False
        try:
            if self._writer is not None:
                self._roll_if_due(self._writer)
            self._forget_all()
            chosen = self._chosen(batch.frames, now_s)
            if chosen or batch.values:
                writer = self._present_writer()
                writer.write(chosen, self._kept.admitted(batch.values))
                self._kept.holds_known = wrote = True
            if now_s - self._pruned_s >= _PRUNE_S:
                self._pruned_s = now_s
                self._prune()
        except Exception as error:  # noqa: BLE001 - whatever a batch has in it, the next one is written
            if not wrote:
                self.lost += len(chosen or batch.frames) + len(batch.values)
                self._kept.not_written(batch.values, can_be=isinstance(error, (sqlite3.Error, OSError)))
                self._robots.clear()  # what comes next begins anew, after a gap
            if not isinstance(error, sqlite3.OperationalError):  # such as a full disk: the segment itself is fine
                self._abandon()
            self._say(error)
        else:
            if self.failure and wrote:
                self._say(None)

    def _forget_all(self) -> None:
        """Remove robots from files, those that are busy later. Raises sqlite3.Error."""
        for robot, tries in list(self._forgotten.items()):
            if tries == _FORGETS:
                self._robots.pop(robot, None)
                self._kept.forget(robot)
                if self._writer is not None:
                    self._writer.forget(robot)
            done = self.shelf.forget(robot)
            if done or tries == 1:
                del self._forgotten[robot]
            else:
                self._forgotten[robot] = tries - 1
            if not done and tries == 1:
                log.warning("samples of the removed robot %s stay in a file that somebody locks", robot)

    def _chosen(self, frames: Sequence[tuple[str, Layout, bytes]], now_s: float) -> list[tuple[Layout, bytes]]:
        found = list[tuple[Layout, bytes]]()
        for name, layout, frame in frames:
            try:
                found += self._taken(name, layout, frame, now_s)
            except Exception as error:  # noqa: BLE001 - whatever is wrong with the frame, those of others are written
                self.lost += 1
                self._robots.pop(name, None)
                self._tell(name, f"a frame is lost: {type(error).__name__}: {error}")
        for name, robot in list(self._robots.items()):
            if now_s - robot.heard_s > GAP_NS / 1e9:
                found += [(robot.layout, each) for each in robot.thinning.end()]
                del self._robots[name]
        return found

    def _taken(self, name: str, layout: Layout, frame: bytes, now_s: float) -> list[tuple[Layout, bytes]]:
        found, robot = list[tuple[Layout, bytes]](), self._robots.get(name)
        if robot is None or robot.layout is not layout:
            found += [(robot.layout, each) for each in robot.thinning.end()] if robot else self._left(name)
            robot = self._robots[name] = _Robot(layout, Thinning(self.rate_hz))
        robot.heard_s = now_s
        return found + [(layout, each) for each in robot.thinning.take(frame)]

    def _lose_value(self, said: Said) -> None:
        self.lost += 1
        self._tell(said.robot, "values of it are lost: they take more bytes in an hour than there are")

    def _tell(self, robot: str, what: str) -> None:
        """Log what is lost of a robot, once until the segment is over."""
        if robot not in self._told:
            self._told.add(robot)
            whose = f"robot {robot}" if robot != WORLD else "the world"
            log.warning("history of %s: %s", whose, what, extra={"robot": robot})

    def _left(self, robot: str) -> list[tuple[Layout, bytes]]:
        """Return the gap after the last frame of a robot that a former process has written."""
        last = self.shelf.read(robot, None, None, 1)
        if last.layout is None or is_gap(last.frames[-1]):
            return []
        return [(last.layout, gap_after(last.frames[-1]))]

    def _present_writer(self) -> Writer:
        """Return the present segment, which begins now if there is none. Raises sqlite3.Error, OSError."""
        if self._writer is None:
            self.shelf.folder.mkdir(parents=True, exist_ok=True)
            self._begin_ns = self._now_ns()
            path = self.shelf.folder / f"{self._begin_ns:020}-{secrets.token_hex(4)}{SUFFIX}"
            try:
                self._writer = self._open_writer(path)
            except sqlite3.Error:
                with suppress(OSError):
                    remove(path)
                raise
            self.shelf.put(path, self._begin_ns, self._writer.ranges)
            self._kept.begin_segment()
            self._told.clear()
        return self._writer

    def _roll_if_due(self, writer: Writer) -> None:
        if not self.shelf.is_usable(writer.path):
            self._abandon()
        elif self._now_ns() - self._begin_ns >= SEGMENT_NS or size_of(writer.path) > self.most_bytes / _SHARE:
            self._finish(writer)
            self._pruned_s = -math.inf

    def _finish(self, writer: Writer) -> None:
        """Finish a segment; one that cannot be finished now costs nothing that is still to be written."""
        self._writer = None
        try:
            writer.finish()
        except sqlite3.Error as error:
            log.warning("a segment of the history is not finished: %s: %s", writer.path.name, error)
        finally:
            with suppress(sqlite3.Error):
                writer.close()
            if not writer.is_single:
                self._in_parts.add(writer.path)
            self.shelf.end_present()

    def _abandon(self) -> None:
        """Begin another segment with the next batch."""
        if (writer := self._writer) is not None:
            self._writer = None
            with suppress(sqlite3.Error):
                writer.close()
            self.shelf.end_present()

    def _say(self, error: Exception | None) -> None:
        """Say what keeps the thread from writing: to readers without the path of the folder, which the log has."""
        why = error.strerror if isinstance(error, OSError) and error.strerror else error
        text = "" if error is None else f"{type(error).__name__}: {why}"
        if text != self.failure:
            self.failure = text
            if error is not None:
                log.warning("the history in %s is not written: %s", self.shelf.folder, error)
            self._failed(OSError(str(why)) if isinstance(error, (sqlite3.Error, OSError)) else error)

    def _prune(self) -> None:
        """Remove the oldest segments beyond the time and the bytes that are kept. Raises OSError."""
        present = None if self._writer is None else self._writer.path
        self._in_parts -= {each for each in self._in_parts if _is_single_now(each)}
        self.bytes = self.shelf.prune(self._now_ns() - int(self.keep_s * 1e9), self.most_bytes, present)

    def close(self) -> None:
        """Write what is pending, and finish the segment."""
        batch = self._take()
        with self._lock:
            self._closed = True
            self._write(batch, time.monotonic())
            self._finish_last()

    def _finish_last(self) -> None:
        chosen = [(each.layout, one) for each in self._robots.values() for one in each.thinning.end()]
        self._robots.clear()
        try:
            if chosen:
                self._present_writer().write(chosen)
            if self._writer is not None:
                self._finish(self._writer)
        except (sqlite3.Error, OSError) as error:
            log.warning("the last frames of the history are lost: %s", error)
            self._abandon()

    @property
    def findings(self) -> list[str]:
        """Sentences for readers about what is not written, and what cannot be read."""
        found = [f"Nothing is written to disk at present: {self.failure}"] if self.failure else []
        if damaged := self.shelf.damaged:
            found.append(f"{len(damaged)} damaged files are skipped, such as {damaged[0]}")
        if unreadable := self.shelf.unreadable:
            found.append(f"{len(unreadable)} files cannot be read at present, such as {unreadable[0]}")
        return found


def _is_single_now(path: Path) -> bool:
    """Make a finished segment a single file. Return False if somebody still reads it."""
    try:
        finish_left(path)
    except UnreadableSegmentError:
        return not path.exists()
    except DamagedSegmentError:
        pass  # readers find it
    return True
