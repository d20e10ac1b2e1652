"""Recording of frames: sampling, retention and memory (README.md).

Arriving frames cause no work: a timer samples the latest frame of each robot at the configured rate and stores its
bytes. They are decoded on request.
"""

import asyncio
import logging
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from types import TracebackType
from typing import Self

from linked_fleet_base.errors import Busy
from linked_fleet_base.faults import Faults
from linked_fleet_gateway.api import cancel_tasks, supervised, time_sliced
from linked_fleet_gateway.extensions.history.archive import Archive
from linked_fleet_gateway.extensions.history.segment import Layout
from linked_fleet_gateway.extensions.history.thinning import AHEAD_NS, GAP_NS, gap_after
from linked_fleet_gateway.extensions.history.track import Track, joints_of, wall_ns
from linked_fleet_state.events import Latest
from linked_fleet_state.fleet import Fleet
from linked_fleet_state.robot import Robot

log = logging.getLogger(__name__)

_ROOM = 0.75
"""Share of its memory limit to which a track is reduced when it exceeds it; without slack it would do so with each
frame.
"""
FILES = 16
"""Files sent concurrently; further requests get 503."""
_WORKERS = 2
MAX_WAITING = 64
"""Requests that wait for a thread; further ones get 503."""


class History:
    """Records histories; an async context manager.

    ``span_s`` is the retention time, ``rate_hz`` the highest number of samples per second and robot, ``most_bytes`` the
    memory of all robots together. If it is short, each robot gets an equal share. ``archive`` is what is kept on disk.
    """

    def __init__(
        self,
        fleet: Fleet,
        span_s: float,
        rate_hz: float,
        most_bytes: int,
        archive: Archive | None = None,
        faults: Faults | None = None,
    ) -> None:
        self.span_s, self.rate_hz, self.most_bytes = span_s, rate_hz, most_bytes
        self.archive = archive
        self.ahead: dict[str, int] = {}
        """The number of frames that were not recorded, by robot: its clock is ahead of that of the gateway."""
        self._refused: dict[str, bytes] = {}
        self.bytes = 0
        self.files = asyncio.Semaphore(FILES)
        self._workers = asyncio.Semaphore(_WORKERS)
        self._waiting = 0
        self._fleet, self._faults = fleet, Faults() if faults is None else faults
        self._tracks: dict[str, Track] = {}
        self._tasks: list[asyncio.Task[None]] = []

    async def __aenter__(self) -> Self:
        if self.span_s > 0:
            self._tasks = [supervised(self._run, "history", log, "frames are not recorded")]
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        await cancel_tasks(self._tasks)

    @property
    def samples(self) -> int:
        return sum(map(len, list(self._tracks.values())))

    @property
    def findings(self) -> list[str]:
        """Sentences for readers about what is not recorded, and what cannot be read."""
        ahead = [f"Robots whose clocks are too far ahead to be recorded: {len(self.ahead)}"] if self.ahead else []
        return ahead if self.archive is None else ahead + self.archive.findings

    @asynccontextmanager
    async def worker(self) -> AsyncIterator[None]:
        """Hold one of the few places for work in a thread. Raises Busy if too many requests wait for one."""
        if self._waiting >= MAX_WAITING:
            raise Busy("Too many histories are being asked for; try again.")
        self._waiting += 1
        try:
            await self._workers.acquire()
        finally:
            self._waiting -= 1
        try:
            yield
        finally:
            self._workers.release()

    def track(self, robot: Robot) -> Track | None:
        """Return the track of a robot, if its frames still have the meaning of the robot's frames."""
        track, joints = self._tracks.get(robot.name), joints_of(robot)
        if track is None or robot.model is not track.joints.model:
            return None
        # Until another run has described itself, the description of the previous one holds.
        return track if joints is None or track.joints.has_same_layout(joints) else None

    async def _run(self) -> None:
        period_s = 1 / self.rate_hz
        due_s = time.monotonic()
        while True:
            await self._sample_all()
            if self.bytes > self.most_bytes:
                await self._thin_all()
            due_s = max(due_s + period_s, time.monotonic())
            await asyncio.sleep(due_s - time.monotonic())

    async def _sample_all(self) -> None:
        for name in self._tracks.keys() - set(self._fleet.robots):
            self._forget(name)
        async for latest in time_sliced(self._fleet.frames.latest_frames()):
            self.sample(latest)
        self._end_silent()

    async def _thin_all(self) -> None:
        share = self.most_bytes / len(self._tracks)
        async for track in time_sliced(list(self._tracks.values())):
            if track.bytes > share:
                self.bytes -= track.bytes
                track.shrink_to(_ROOM * share)
                self.bytes += track.bytes

    def sample(self, latest: Latest) -> None:
        """Store the latest frame, unless it is stored already or its joints are unknown."""
        track = self._tracks.get(latest.robot)
        if track is None or track.run is not latest:
            if not self._fleet.frames.is_open(latest):  # closed since the look began, so its joints are unknown
                return
            track = self._begin(latest, track)
        frame = latest.frame[0]
        if track is None or frame is track.heard or self._is_ahead(latest.robot, frame):
            return
        if track.heard is not None and wall_ns(frame) - wall_ns(track.heard) > GAP_NS:
            self._append(track, gap_after(track.heard))
        self._append(track, frame)
        track.heard, track.heard_s = frame, time.monotonic()
        if self.archive is not None:
            self.archive.add(latest.robot, frame)

    def _is_ahead(self, robot: str, frame: bytes) -> bool:
        """Return True for a frame of the future, which is counted; the first one of a robot is logged."""
        ahead_ns = wall_ns(frame) - time.time_ns()
        if ahead_ns <= AHEAD_NS:
            self.ahead.pop(robot, None)
            self._refused.pop(robot, None)
            return False
        if frame is self._refused.get(robot):
            return True
        self._refused[robot] = frame
        if robot not in self.ahead:
            text = "the history of robot %s has a gap: its clock is ahead by %.0f s"
            log.warning(text, robot, ahead_ns / 1e9, extra={"robot": robot})
        self.ahead[robot] = self.ahead.get(robot, 0) + 1
        if self.archive is not None:
            self.archive.lost += 1
        return True

    def _append(self, track: Track, frame: bytes) -> None:
        self.bytes -= track.bytes
        track.append(frame, int(self.span_s * 1e9))
        self.bytes += track.bytes

    def _end_silent(self) -> None:
        """Add the gap of each robot that is heard no longer."""
        before_s = time.monotonic() - GAP_NS / 1e9
        for name, track in self._tracks.items():
            if track.heard_s < before_s and track.heard is not None and track.heard is track.newest:
                with self._faults.guard("History", name, "the gap"):
                    self._append(track, gap_after(track.heard))

    def _begin(self, latest: Latest, before: Track | None) -> Track | None:
        """Start a track for another run or description; other joints start a new history."""
        robot = self._fleet.robots.get(latest.robot)
        joints = None if robot is None else joints_of(robot)
        if robot is None or joints is None:
            return None
        if before is not None and before.joints.has_same_layout(joints):
            before.run = latest
            return before
        self._forget(robot.name)
        if self.archive is not None and robot.description is not None:
            urdf = robot.description.urdf
            self.archive.begin(Layout(robot.name, joints.names, joints.floating, urdf))
        track = self._tracks[robot.name] = Track(latest, joints)
        return track

    def _forget(self, name: str) -> None:
        track = self._tracks.pop(name, None)
        self.ahead.pop(name, None)
        self._refused.pop(name, None)
        self.bytes -= 0 if track is None else track.bytes
