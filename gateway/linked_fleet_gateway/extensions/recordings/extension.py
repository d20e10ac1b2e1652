"""The extension ``recordings``: the last 30 s of a robot, kept as MCAP when a motion fails or somebody stops it."""

import asyncio
import fcntl
import hashlib
import logging
import os
import secrets
import time
from collections import defaultdict
from collections.abc import AsyncIterator, Iterable, Iterator
from contextlib import asynccontextmanager, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from uuid import UUID

from pyoxigraph import Literal, NamedNode

from linked_fleet_gateway.api import (
    CONTAINER,
    Core,
    Extension,
    Found,
    Mount,
    RequestView,
    Resource,
    RobotBranch,
    Source,
    cancel_tasks,
    robot_path,
    supervised,
)
from linked_fleet_gateway.extensions.history.files import MCAP, Level, LogMessage, recording
from linked_fleet_gateway.extensions.history.ground import Ground, ground_of
from linked_fleet_gateway.extensions.history.recorder import History
from linked_fleet_gateway.extensions.history.track import Excerpt, wall_ns
from linked_fleet_gateway.extensions.world.service import World
from linked_fleet_gateway.fleet.invocation import Invocation, InvocationState
from linked_fleet_gateway.fleet.robot import Robot
from linked_fleet_gateway.rdf.graph import Graph, timestamp
from linked_fleet_gateway.rdf.serialise import NoContentYet
from linked_fleet_gateway.rdf.vocabulary import DCTERMS, LDP, RDFS
from linked_fleet_gateway.serving import Rendition

log = logging.getLogger(__name__)

SEGMENT, TERMS = "recordings", "https://w3id.org/linked-fleet/recordings#"
SPAN_NS, PAUSE_S = 30 * 10**9, 5.0
"""Length of a recording, and the shortest time between two of a robot, since a stop is often pressed twice."""
_UNFINISHED = ".new"
MOST_WAITING, MOST_OF_ROBOT, MOST_FRAMES, _MOST_KNOWN = 64, 8, 3001, 4096


@dataclass(frozen=True)
class Job:
    """A recording that waits to be written."""

    robot: str
    excerpt: Excerpt
    urdf: bytes
    invocation: Invocation
    at_ns: int
    ground: Ground | None = None

    @property
    def content(self) -> bytes:
        """The file: the frames, followed by the outcome of the invocation."""
        one, last_ns = self.invocation, max(map(wall_ns, self.excerpt.frames[-1:]), default=self.at_ns)
        level = Level.ERROR if one.state is InvocationState.FAILED else Level.WARN
        text = f"{one.action}: {one.state}" + (f", {one.reason}" if one.reason else "")
        said = {"id": str(one.id), "action": one.action, "client": one.client, "state": one.state, "reason": one.reason}
        about = {name: str(value) for name, value in said.items() if value}
        log = [LogMessage(last_ns, level, self.robot, text)]
        return recording(self.excerpt, self.urdf, log, {"invocation": about}, self.ground)


class Recorder:
    """Writes recordings to ``folder``, which outlives the process.

    Each robot has a folder; files are named by the time and id of their invocation.
    """

    def __init__(self, core: Core, history: History, world: World | None, folder: Path) -> None:
        self._core, self._history, self._world, self._folder = core, history, world, folder
        self._begun_ns = time.time_ns()
        self._over: dict[str, bool] = {}  # by invocation id; oldest first
        self._last_s: dict[str, float] = {}
        self._files: dict[str, dict[str, Path]] = defaultdict(dict)
        self.waiting: asyncio.Queue[Job] = asyncio.Queue(MOST_WAITING)

    @asynccontextmanager
    async def running(self) -> AsyncIterator[RobotBranch]:
        await asyncio.to_thread(_remove_unfinished, self._folder)
        for path in await asyncio.to_thread(lambda: sorted(self._folder.glob("*/*.mcap"))):
            self._files[path.parent.name][path.stem.partition("-")[2]] = path
        writing = supervised(self._write_next, "recordings", log, "a recording is lost", 0.0)
        with self._core.listening_to_invocations(self.record_outcome):
            branch = RobotBranch(SEGMENT, NamedNode(TERMS + SEGMENT), self._resolve, lambda of: bool(self._of(of.name)))
            yield branch
        await cancel_tasks([writing])

    def _of(self, robot: str) -> dict[str, Path]:
        return self._files.get(_folder_name(robot), {})

    def path_of(self, robot: str, id: str) -> str:
        """Return the path of the recording of an invocation of a robot; empty if there is none here."""
        return f"{_path(robot)}/{id}" if id in self._of(robot) else ""

    def record_outcome(self, invocation: Invocation) -> None:
        """Record once when a motion fails or a stop begins.

        Ignores invocations that ended before this gateway began, which come from Redis.
        """
        known, ends = self._over.get(invocation.id), invocation.state.terminal or invocation.stops is not None
        self._over[invocation.id] = ends
        if len(self._over) > _MOST_KNOWN:
            del self._over[next(iter(self._over))]
        old = known is None and invocation.created_ns < max(self._begun_ns, time.time_ns() - SPAN_NS)
        if known or not ends or old:
            return
        if invocation.stops is not None or invocation.state is InvocationState.FAILED:
            for name in invocation.robots or (invocation.robot,):
                self._record(name, invocation)

    def _record(self, name: str, invocation: Invocation) -> None:
        robot, now_s = self._core.robots.get(name), time.monotonic()
        track = None if robot is None else self._history.track(robot)
        if robot is None or robot.description is None or track is None or track.time_range is None:
            return
        if now_s < self._last_s.get(name, -PAUSE_S) + PAUSE_S:
            return
        excerpt = track.excerpt(track.time_range[1] - SPAN_NS, None, MOST_FRAMES)
        urdf, ground = robot.description.urdf.encode(), ground_of(self._world, robot)
        job = Job(name, excerpt, urdf, replace(invocation), time.time_ns(), ground)
        try:
            self.waiting.put_nowait(job)
            self._last_s[name] = now_s
        except asyncio.QueueFull:
            log.warning("robot %s is not recorded: %d recordings wait", name, MOST_WAITING, extra={"robot": name})

    async def _write_next(self) -> None:
        job = await self.waiting.get()
        path = _file(self._folder, job)
        try:
            await asyncio.to_thread(_write, path, job)
        except OSError as error:
            log.error("the recording of robot %s is lost: %s", job.robot, error, extra={"robot": job.robot})
            return
        files = self._files[path.parent.name]
        files[str(job.invocation.id)] = path
        old = [files.pop(id) for id in list(files)[:-MOST_OF_ROBOT]]
        await asyncio.to_thread(_remove, old)
        if robot := self._core.robots.get(job.robot):
            robot.count_change()
            self._core.mark_changed(robot_path(robot.name), _path(robot.name))

    def _resolve(self, view: RequestView, robot: Robot, rest: list[str]) -> Found:
        files, path = self._of(robot.name), _path(robot.name)

        def describe(graph: Graph) -> None:
            graph.a(view.iri(path), LDP.BasicContainer, LDP.Container)
            graph.add(view.iri(path), DCTERMS.title, Literal(f"Recordings of {robot.name}"))
            graph.add(view.iri(path), LDP.contains, *(view.iri(f"{path}/{id}") for id in files))

        def describe_one(graph: Graph) -> None:
            iri = view.iri(f"{path}/{rest[0]}")
            graph.a(iri, NamedNode(TERMS + "Recording"))
            graph.add(iri, DCTERMS.title, Literal(f"Recording of {robot.name}"))
            graph.add(iri, DCTERMS.created, timestamp(int(files[rest[0]].stem.partition("-")[0])))
            graph.add(iri, DCTERMS.format, Literal(MCAP))
            graph.add(iri, RDFS.seeAlso, view.iri(robot_path(robot.name)))

        if not rest:
            return Resource(path, f"Recordings of {robot.name}", describe, CONTAINER, Source(lambda: tuple(files)))
        if len(rest) > 1 or rest[0] not in files:
            return None
        file, source = files[rest[0]], Source(lambda: rest[0])
        name = f"{path[1:]}-{rest[0]}.mcap".replace("/", "-")
        title = f"Recording of {robot.name}"
        return Resource(
            f"{path}/{rest[0]}",
            title,
            describe_one,
            source=source,
            documents={MCAP: Rendition(lambda: _read(file), name)},
            publishes_changes=False,
        )


def _path(robot: str) -> str:
    return robot_path(robot) + SEGMENT


def _folder_name(robot: str) -> str:
    """Return a folder name for a robot, whose name may be long and contain anything."""
    return hashlib.sha256(robot.encode()).hexdigest()


def _file(folder: Path, job: Job) -> Path:
    """Return the same path at each gateway, because gateways that share the folder record the same invocations."""
    one = job.invocation
    return folder / _folder_name(job.robot) / f"{one.created_ns:020}-{UUID(one.id)}.mcap"


def _write(path: Path, job: Job) -> None:
    """Write in one step, so that no file is ever incomplete."""
    path.parent.mkdir(parents=True, exist_ok=True)
    new = path.with_name(f"{path.stem}-{secrets.token_hex(4)}{_UNFINISHED}")
    with _locked(path.parent, fcntl.LOCK_SH):
        try:
            new.write_bytes(job.content)
            new.replace(path)
        except OSError:
            new.unlink(missing_ok=True)
            raise


@contextmanager
def _locked(folder: Path, mode: int) -> Iterator[None]:
    """Lock a robot's folder: shared while a gateway writes into it, alone while what others left is removed."""
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        fcntl.flock(descriptor, mode)
        yield
    finally:
        os.close(descriptor)


def _remove_unfinished(recordings: Path) -> None:
    """Remove what killed gateways had begun to write, except where another gateway is writing now."""
    for folder in {path.parent for path in recordings.glob(f"*/*{_UNFINISHED}")}:
        try:
            with _locked(folder, fcntl.LOCK_EX | fcntl.LOCK_NB):
                for path in folder.glob(f"*{_UNFINISHED}"):
                    path.unlink(missing_ok=True)
        except BlockingIOError:
            continue  # the next start will find it
        except OSError as error:
            log.warning("an unfinished recording cannot be removed: %s", error)


def _remove(paths: Iterable[Path]) -> None:
    for each in paths:
        try:
            each.unlink(missing_ok=True)
        except OSError as error:
            log.warning("an old recording cannot be removed: %s", error)


def _read(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError as error:
        raise NoContentYet(f"the recording cannot be read: {error.strerror}") from error


class RecordingsExtension(Extension):
    name = "recordings"
    uses = ("history", "world")
    in_robot = (SEGMENT,)

    @asynccontextmanager
    async def start(self, core: Core) -> AsyncIterator[Mount]:
        history = core.optional_service(History)
        if history is None or not history.span_s:
            yield Mount()
            return
        recorder = Recorder(core, history, core.optional_service(World), core.state_path / "recordings")
        async with recorder.running() as branch:
            yield Mount(branches=(branch,), formats={"mcap": ("MCAP", MCAP)}, services=(recorder,))
