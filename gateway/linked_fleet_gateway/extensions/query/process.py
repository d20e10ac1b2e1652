"""The query process of a gateway, and the snapshots of the fleet that it gets, reduced to changes.

The process is started for the first query, updated before each, restarted after a crash, and ended when idle.
"""

import asyncio
import logging
import socket
import time
from asyncio.subprocess import DEVNULL
from collections.abc import Callable, Sequence
from itertools import islice

from pyoxigraph import NamedNode

from linked_fleet_base.errors import BadRequest, Busy, FleetError, LibraryMissing
from linked_fleet_gateway.api import robot_path
from linked_fleet_gateway.extensions.query.messages import (
    DONE,
    FORKED,
    PATIENCE,
    REFUSED,
    Member,
    News,
    QueryRequest,
    Refusal,
    RobotFacts,
    contributions,
    decode_refusal,
    encode,
    name_of,
)
from linked_fleet_gateway.extensions.query.turns import QueryTooCostly, ResultTooLarge
from linked_fleet_gateway.faces import PartCopier, parts_of
from linked_fleet_gateway.serving import Worker
from linked_fleet_state.fleet import Fleet
from linked_fleet_state.invocations import FLEET, Invocation, Invocations
from linked_fleet_state.robot import Robot

log = logging.getLogger(__name__)

MAX_ENDED = 20
"""Number of ended invocations sent for each robot and for the fleet: the most recent ones."""
_BEGIN_S = 60.0  # time for the first snapshot of the whole fleet
_GRACE_S = 1.0
_CHUNK = 256 * 1024
# The process forks, and threads do not survive that; single queries do not need them.
_ALONE = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}


Links = Callable[[Robot, str], Sequence[tuple[NamedNode, str]]]
"""Returns predicate and path of the branches that the description of a robot at a path links."""


class Feed:
    """The state known to one query process.

    Call ``news`` and encode its result in one turn of the event loop, because it refers to live objects.
    """

    def __init__(self, fleet: Fleet, invocations: Invocations, links: Links) -> None:
        self._fleet, self._invocations, self._links = fleet, invocations, links
        self._said: dict[str, tuple[object, ...]] = {}
        self._frames: dict[str, bytes | None] = {}
        self._values: dict[str, object] = {}

    def news(self) -> News:
        """Return the changes since the last call."""
        robots, frames, values = [], {}, {}
        for name, robot in self._fleet.robots.items():
            invocations = recent_invocations(self._invocations, name)
            branches = self._links(robot, robot_path(name))
            key = _key(robot, invocations, branches)
            if key != self._said.get(name):
                self._said[name] = key
                robots.append(_said(robot, invocations, [(term.value, path) for term, path in branches]))
            if (frame := robot.payload) is not self._frames.get(name):
                frames[name] = self._frames[name] = frame
            if (copier := _copier(robot)) is not None:
                # Whoever is told about a robot may make its parts anew, without values.
                version, is_told = copier.version(robot), bool(robots) and robots[-1].name == name
                if is_told or version != self._values.get(name):
                    self._values[name], values[name] = version, copier.write(robot)
        forgotten = list(self._said.keys() - set(self._fleet.robots))
        for name in forgotten:
            del self._said[name]
            self._frames.pop(name, None)
            self._values.pop(name, None)
        return News(robots=robots, frames=frames, forgotten=forgotten, values=values)

    def fleet_invocations(self) -> list[Invocation]:
        """Return the invocations of the whole fleet."""
        return recent_invocations(self._invocations, FLEET)


def recent_invocations(invocations: Invocations, robot: str) -> list[Invocation]:
    """Return the invocations that are not over, and the most recent of the others."""
    ended = (each for each in invocations.of_robot(robot) if each.state.terminal)
    return [*invocations.open_of_robot(robot), *islice(ended, MAX_ENDED)]


def _key(robot: Robot, invocations: list[Invocation], branches: object) -> tuple[object, ...]:
    """Return a key that changes whenever anything but a frame changes."""
    known = [
        (one.id, one.state, one.progress, one.reason, one.ended_ns, one.preempted_by, one.feedback, one.outcome)
        for one in invocations
    ]
    said = robot.online, robot.incarnation, robot.news, robot.description, robot.fault
    return *said, robot.lease, robot.settings, dict(robot.targets), known, branches


def _said(robot: Robot, invocations: list[Invocation], branches: list[Member]) -> RobotFacts:
    return RobotFacts(
        name=robot.name,
        online=robot.online,
        incarnation=robot.incarnation,
        description=robot.description,  # type: ignore[arg-type]  # without components it is decoded as one with none
        fault=robot.fault,
        limit_fault=robot.limit_fault,
        agent_fault=robot.agent_fault,
        sensor_faults=dict(robot.sensor_faults),
        unchecked=robot.unchecked,
        last_seen_ns=robot.last_seen_ns,
        lease=robot.lease,
        settings=dict(robot.settings),
        targets=robot.targets,
        branches=branches,
        invocations=invocations,
        copier="" if (copier := _copier(robot)) is None else name_of(copier),
        findings=robot.findings,
        kept_poses=dict(robot.kept_poses),
    )


def _copier(robot: Robot) -> type[PartCopier] | None:
    part = next(iter(parts_of(robot).values()), None)
    return None if part is None else part.copier


class QueryProcess:
    """The process and its feed; ``feed`` creates one for a process without any state."""

    def __init__(self, feed: Callable[[], Feed], idle_s: float = Worker.IDLE_S) -> None:
        self._new_feed = feed
        self._feed = feed()
        self._control: socket.socket | None = None
        self._worker = Worker("linked_fleet_gateway.extensions.query.worker", _ALONE, idle_s=idle_s, on_idle=self.close)
        self._telling = asyncio.Lock()

    async def ask(self, make: Callable[[Feed], QueryRequest]) -> bytes:
        """Return the result of the query that ``make`` builds from the present snapshot. Raises FleetError."""
        with self._worker.in_use():
            return await self._ask(make)

    async def _ask(self, make: Callable[[Feed], QueryRequest]) -> bytes:
        ours, theirs = socket.socketpair()
        with ours, theirs:
            ours.setblocking(False)
            limit_s = await self._begin(make, ours, theirs)
            started = time.monotonic()
            answer = await _read_all(ours, limit_s * PATIENCE + _GRACE_S)
        return _result(answer, time.monotonic() - started >= limit_s)

    @property
    def running(self) -> bool:
        return self._control is not None

    async def close(self) -> None:
        if self._control is not None:
            self._control.close()
            self._control = None
        await self._worker.end()

    async def _begin(self, make: Callable[[Feed], QueryRequest], ours: socket.socket, theirs: socket.socket) -> float:
        """Start a query in the process. Return its time limit in seconds."""
        async with self._telling:
            try:
                control = await self._running()
                ask = make(self._feed)
                await _send(control, encode(ask), theirs)
                theirs.close()
                async with asyncio.timeout(_BEGIN_S):
                    first = await asyncio.get_running_loop().sock_recv(ours, 1)
                if first != FORKED:
                    raise ConnectionError("the process that answers queries has ended")
                return ask.limit_s
            except (OSError, TimeoutError) as error:
                log.warning("the query process is restarted: %s", error)
                await self.close()
                raise Busy("Queries cannot be answered at the moment; try again.") from error
            except BaseException:  # it has received a part of a message
                await self.close()
                raise

    async def _running(self) -> socket.socket:
        if self._control is not None and self._worker.running:
            return self._control
        await self.close()
        self._feed = self._new_feed()
        ours, theirs = socket.socketpair()
        with theirs:
            await self._worker.start(str(theirs.fileno()), contributions(), pass_fds=[theirs.fileno()], stdin=DEVNULL)
        ours.setblocking(False)
        self._control = ours
        return ours


async def _send(control: socket.socket, content: bytes, answer: socket.socket) -> None:
    """Send the length together with the answer socket, then the content. Earlier messages have been received."""
    socket.send_fds(control, [len(content).to_bytes(8)], [answer.fileno()])
    await asyncio.get_running_loop().sock_sendall(control, content)


async def _read_all(ours: socket.socket, timeout_s: float) -> bytearray:
    content = bytearray()
    try:
        async with asyncio.timeout(timeout_s):
            while chunk := await asyncio.get_running_loop().sock_recv(ours, _CHUNK):
                content += chunk
    except (TimeoutError, ConnectionError):
        content.clear()
    return content


def _result(answer: bytearray, late: bool) -> bytes:
    end, content = bytes(answer[-1:]), bytes(answer[:-1])
    if end == DONE:
        return content
    if end == REFUSED:
        raise _error(decode_refusal(content))
    if late:
        raise QueryTooCostly("The query exceeded its time limit. Query fewer robots, or use fewer unbounded paths.")
    raise QueryTooCostly(
        "The query exceeded its memory limit, or is nested too deeply. Query fewer robots, or split it."
    )


def _error(refusal: Refusal) -> FleetError:
    if refusal.reason == "wrong":
        return BadRequest(refusal.detail, line=refusal.line, column=refusal.column)
    if refusal.reason == "large":
        return ResultTooLarge(refusal.detail)
    if refusal.reason == "missing":
        return LibraryMissing(refusal.detail)
    return QueryTooCostly("The query exceeded its memory limit. Query fewer robots, or split it.")
