"""The history on disk: what is written into segments, and how long it is kept (README.md).

The event loop only collects what is to be written. A thread writes a batch every ``BATCH_S``.
"""

import asyncio
import logging
import secrets
import sqlite3
import time
from collections import deque
from collections.abc import AsyncIterator, Callable, Iterator, Sequence
from contextlib import asynccontextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path

from linked_fleet_gateway.api import cancel_tasks, supervised
from linked_fleet_gateway.extensions.history.segment import SUFFIX, Layout, Said, Writer
from linked_fleet_gateway.extensions.history.shelf import SEGMENT_NS, Shelf, remove, size_of
from linked_fleet_gateway.extensions.history.thinning import GAP_NS, Thinning, gap_after, is_gap

log = logging.getLogger(__name__)

BATCH_S = 1.0
_SHARE = 16
"""A segment that is larger than this part of all that may be kept is finished early."""
_PRUNE_S = 60.0
_MOST_PENDING = 200_000
"""Frames that wait for the thread; more are lost, and counted."""


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
        self.shelf = Shelf(folder)
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
        self._writer: Writer | None = None
        self._begin_ns = 0
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
        try:
            self.shelf.folder.mkdir(parents=True, exist_ok=True)
            self.shelf.look()
            self.shelf.finish_left()
            self._prune()
        except OSError as error:
            self._say(error)

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
        last = self.shelf.read(robot, None, None, 1)
        if last.layout is not None and not is_gap(last.frames[-1]):
            yield last.layout, gap_after(last.frames[-1])

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
        return self._writer

    def _roll_if_due(self, writer: Writer) -> None:
        if not self.shelf.is_usable(writer.path):
            self._abandon()
        elif self._now_ns() - self._begin_ns >= SEGMENT_NS or size_of(writer.path) > self.most_bytes / _SHARE:
            self._finish(writer)
            self._prune()

    def _finish(self, writer: Writer) -> None:
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
            self._failed(OSError(str(error)) if isinstance(error, sqlite3.Error) else error)

    def _prune(self) -> None:
        """Remove the oldest segments beyond the time and the bytes that are kept. Raises OSError."""
        present = None if self._writer is None else self._writer.path
        self.bytes = self.shelf.prune(self._now_ns() - int(self.keep_s * 1e9), self.most_bytes, present)

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

    @property
    def findings(self) -> list[str]:
        """Sentences for readers about what is not written, and what cannot be read."""
        found = [f"Nothing is written to disk at present: {self.failure}"] if self.failure else []
        if damaged := self.shelf.damaged:
            found.append(f"{len(damaged)} damaged files are skipped, such as {damaged[0]}")
        return found
