"""Records robots: when, what, and how many recordings are kept."""

import asyncio
import logging
import time
from collections import defaultdict
from collections.abc import AsyncIterator, Mapping
from contextlib import asynccontextmanager
from dataclasses import dataclass
from pathlib import Path

from linked_fleet_gateway.api import Core, cancel_tasks, robot_path, supervised
from linked_fleet_gateway.extensions.history.files import Level, LogMessage, recording
from linked_fleet_gateway.extensions.history.ground import Ground, ground_of
from linked_fleet_gateway.extensions.history.recorder import History
from linked_fleet_gateway.extensions.history.track import Excerpt, wall_ns
from linked_fleet_gateway.extensions.recordings.folder import (
    Recorded,
    file_path,
    folder_name,
    look_up,
    remove,
    remove_unfinished,
    write,
)
from linked_fleet_gateway.extensions.recordings.occasion import Occasion, outcome
from linked_fleet_gateway.extensions.world.service import World
from linked_fleet_state.invocation import Invocation, InvocationState

log = logging.getLogger(__name__)

SEGMENT = "recordings"
SPAN_NS, PAUSE_S = 30 * 10**9, 5.0
"""Length of a recording, and the shortest time between two of a robot, since a stop is often pressed twice."""
MOST_WAITING, MOST_OF_ROBOT, MOST_FRAMES, _MOST_KNOWN = 64, 8, 3001, 4096


@dataclass(frozen=True)
class Job:
    """A recording that waits to be written. ``at_ns`` is when it was asked for."""

    robot: str
    excerpt: Excerpt
    urdf: bytes
    occasion: Occasion
    at_ns: int
    ground: Ground | None = None

    @property
    def content(self) -> bytes:
        """The file: the frames, followed by what happened."""
        one, last_ns = self.occasion, max(map(wall_ns, self.excerpt.frames[-1:]), default=self.at_ns)
        log = [LogMessage(last_ns, Level.ERROR if one.is_error else Level.WARN, self.robot, one.says)]
        about = {**one.about, "says": one.says}
        return recording(self.excerpt, self.urdf, log, {one.name: about}, self.ground)

    @property
    def length_s(self) -> float:
        frames = self.excerpt.frames
        return max(0, wall_ns(frames[-1]) - wall_ns(frames[0])) / 1e9 if frames else 0.0

    def write(self, path: Path) -> Recorded:
        """Write the file. Raises OSError."""
        content = self.content
        write(path, content)
        return Recorded(path, self.occasion.says, self.length_s, len(content))


class Recorder:
    """Writes recordings to ``folder``, which outlives the process."""

    def __init__(self, core: Core, history: History, world: World | None, folder: Path) -> None:
        self._core, self._history, self._world, self._folder = core, history, world, folder
        self._begun_ns = time.time_ns()
        self._over: dict[str, bool] = {}  # by invocation id; oldest first
        self._last_s: dict[str, float] = {}
        self._files: dict[str, dict[str, Recorded]] = defaultdict(dict)
        self.waiting: asyncio.Queue[Job] = asyncio.Queue(MOST_WAITING)

    @asynccontextmanager
    async def running(self) -> AsyncIterator[None]:
        await asyncio.to_thread(remove_unfinished, self._folder)
        self._files.update(await asyncio.to_thread(look_up, self._folder))
        writing = supervised(self._write_next, "recordings", log, "a recording is lost", 0.0)
        try:
            with self._core.listening_to_invocations(self.record_outcome):
                yield
        finally:
            await cancel_tasks([writing])

    def of(self, robot: str) -> Mapping[str, Recorded]:
        """Return the recordings of a robot by id, the oldest first."""
        return self._files.get(folder_name(robot), {})

    def path_of(self, robot: str, id: str) -> str:
        """Return the path of the recording of an occasion of a robot; empty if there is none here."""
        return f"{recordings_path(robot)}/{id}" if id in self.of(robot) else ""

    def record_outcome(self, invocation: Invocation) -> None:
        """Record once when a motion fails or a stop begins.

        Ignores invocations that ended before this gateway began, which come from Redis.
        """
        known, ends = self._over.get(invocation.id), invocation.state.terminal or invocation.stops is not None
        self._over[invocation.id] = ends
        if len(self._over) > _MOST_KNOWN:
            del self._over[next(iter(self._over))]
        old = known is None and self.is_old(invocation.created_ns)
        if known or not ends or old:
            return
        if invocation.stops is not None or invocation.state is InvocationState.FAILED:
            for name in invocation.robots or (invocation.robot,):
                self.record(name, outcome(invocation))

    def is_old(self, at_ns: int) -> bool:
        """Return True for a time that is not in what a recording would show."""
        return at_ns < max(self._begun_ns, time.time_ns() - SPAN_NS)

    def record(self, name: str, occasion: Occasion) -> None:
        """Record a robot, unless that was done just before."""
        robot, now_s = self._core.robots.get(name), time.monotonic()
        track = None if robot is None else self._history.track(robot)
        if robot is None or robot.description is None or track is None or track.time_range is None:
            return
        if now_s < self._last_s.get(name, -PAUSE_S) + PAUSE_S:
            return
        excerpt = track.excerpt(track.time_range[1] - SPAN_NS, None, MOST_FRAMES)
        urdf, ground = robot.description.urdf.encode(), ground_of(self._world, robot)
        try:
            self.waiting.put_nowait(Job(name, excerpt, urdf, occasion, time.time_ns(), ground))
            self._last_s[name] = now_s
        except asyncio.QueueFull:
            log.warning("robot %s is not recorded: %d recordings wait", name, MOST_WAITING, extra={"robot": name})

    async def _write_next(self) -> None:
        job = await self.waiting.get()
        path = file_path(self._folder, job.robot, job.occasion.at_ns, job.occasion.id)
        try:
            written = await asyncio.to_thread(job.write, path)
        except OSError as error:
            log.error("the recording of robot %s is lost: %s", job.robot, error, extra={"robot": job.robot})
            return
        files = self._files[path.parent.name]
        files[job.occasion.id] = written
        await asyncio.to_thread(remove, [files.pop(id) for id in list(files)[:-MOST_OF_ROBOT]])
        if robot := self._core.robots.get(job.robot):
            robot.count_change()
            self._core.mark_changed(robot_path(robot.name), recordings_path(robot.name))


def recordings_path(robot: str) -> str:
    return robot_path(robot) + SEGMENT
