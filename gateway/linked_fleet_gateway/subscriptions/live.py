"""The live fleet joined to its link and to those who watch it (flow "state")."""

import asyncio
import logging
import time
from collections import Counter
from collections.abc import Awaitable, Callable, Collection, Iterator, Mapping
from contextlib import suppress
from types import TracebackType

from linked_fleet_agent.wire.keys import Keys
from linked_fleet_agent.wire.messages import Accepted, Progress, Reply, Stop
from linked_fleet_gateway.fleet.events import Event, Moved
from linked_fleet_gateway.fleet.fleet import Change, Fleet
from linked_fleet_gateway.fleet.frames import Frames
from linked_fleet_gateway.fleet.invocations import Invocation, Invocations
from linked_fleet_gateway.fleet.silences import Run, Silences
from linked_fleet_gateway.identity.rights import ALL, View
from linked_fleet_gateway.link.fleet_link import FleetLink
from linked_fleet_gateway.link.meshes import Meshes
from linked_fleet_gateway.link.transport import Session
from linked_fleet_gateway.resources.branches import Branch, Branches
from linked_fleet_gateway.resources.invocation import invocation_path, invocations_path
from linked_fleet_gateway.resources.paths import joint_path, robot_path
from linked_fleet_gateway.resources.relative_poses import FramedThing
from linked_fleet_gateway.resources.tree import EMPTY, Shelf, Tree
from linked_fleet_gateway.subscriptions.fan_out import FanOut

_SEEN_AGAIN_S = 0.3
_MEETING_S = 2.0  # before a gateway serves although it does not know all robots yet
_PAUSE_S = 0.05
_SWEEP_S = 0.25

log = logging.getLogger(__name__)


class Live:
    """Owns the fleet, the invocations that are known here, and the link; an async context manager."""

    def __init__(
        self, namespace: str, name: str, open_session: Callable[[], Awaitable[Session]], secured: bool = False
    ) -> None:
        """``name`` is that of the gateway among the gateways. ``secured``: clients have to say who they are."""
        keys = Keys(namespace)
        self.fleet = Fleet(Frames(lambda robot: keys.robot(robot, "state")))
        self.invocations = Invocations()
        self.fan_out = FanOut(self.tree)
        self.fleet.frames.watched = self.fan_out.watched
        self.objects: Callable[[], Mapping[str, FramedThing]] = dict
        """The things that stand in the world besides robots, by id."""
        self._listeners: dict[Callable[[str | None], None], None] = {}
        self._invocation_listeners: dict[Callable[[Invocation], None], None] = {}
        self.fan_out.heard = self._tell_listeners
        self._branches = Branches()
        self._secured = secured
        self._judged = 0
        self._silences = Silences()
        self._heard = asyncio.Event()
        # Who carries out actions hears of robots that are lost, and of the progress that robots report.
        self.on_progress: Callable[[str, Progress], None] = lambda robot, progress: None
        self.on_lost: Callable[[str], None] = lambda robot: None
        self.link = FleetLink(
            keys,
            name,
            open_session,
            self._on_events,
            lambda robot, progress: self.on_progress(robot, progress),
            self.fleet.frames,
        )
        self.meshes = Meshes(self.link.mesh)

    @property
    def frames(self) -> int:
        """How many frames were taken."""
        return self._judged + self.fleet.frames.taken

    async def __aenter__(self) -> "Live":
        await self.link.__aenter__()
        self._sweep()
        return self

    def _sweep(self) -> None:
        """Tell of frames that came while somebody was about to watch, and that no other frame has followed.

        Judge besides what does not come: limits that have been left for a while, and frames.
        """
        frames = self.fleet.frames
        watched = self.fleet.robots if frames.heeded else self.fan_out.watched
        self._on_events([Moved(name) for name in watched if name and frames.untold(name)])
        for change in self.fleet.judge_limits(time.time_ns()):
            self._on_change(change)
        self.link.doubt(self._silences.check(asyncio.get_running_loop().time(), self._present()))
        self._sweeping = asyncio.get_running_loop().call_later(_SWEEP_S, self._sweep)

    def _present(self) -> Iterator[Run]:
        for robot in self.fleet.robots.values():
            if robot.online and robot.described and robot.incarnation is not None:
                yield Run(robot.name, robot.incarnation, robot.last_sequence())

    async def join(self) -> None:
        """Have the fleet come in; robots tell at once what has ended lately, so who wants to hear that comes before."""
        await self.link.join()
        with suppress(TimeoutError):
            async with asyncio.timeout(_MEETING_S):
                await self._meet()

    async def _meet(self) -> None:
        """Wait for the robots that are there already: a gateway in the place of another is to know what that knew."""
        while not self.link.joined:  # noqa: ASYNC110 - Zenoh tells nobody
            await asyncio.sleep(_PAUSE_S)
        awaited = await self.link.roll_call(_MEETING_S)
        while awaited := {name for name in awaited if not self._is_known(name)}:
            self._heard.clear()
            await self._heard.wait()

    def _is_known(self, name: str) -> bool:
        robot = self.fleet.robots.get(name)
        return robot is not None and (robot.model is not None or bool(robot.fault) or not robot.online)

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._sweeping.cancel()
        self.meshes.close()
        await self.link.__aexit__(kind, error, trace)

    def tree(self, base: str, sees: View = ALL, shelf: Shelf = EMPTY) -> Tree:
        """The resource tree as it is now to who ``sees`` it, under one base URL; ``shelf``: subscriptions to show."""
        return Tree(self.fleet, self.invocations, base, shelf, sees, self._branches, self._secured)

    @property
    def branches(self) -> Branches:
        """The branches that extensions have added to the tree."""
        return self._branches

    def add(self, *branches: Branch) -> None:
        """Have the tree show more than the fleet itself, from now on."""
        self._branches = self._branches.having(*branches)

    def add_listener(self, hear: Callable[[str | None], None]) -> None:
        """Have ``hear`` called at every change, of whichever robot, watched or not.

        It is told the robot of which a frame came, whose values need not be others for that; None of anything else.
        """
        self._listeners[hear] = None
        self.fleet.frames.heeded = True

    def remove_listener(self, hear: Callable[[str | None], None]) -> None:
        """Have ``hear`` called no more; nothing if it is no listener."""
        self._listeners.pop(hear, None)
        self.fleet.frames.heeded = bool(self._listeners)

    def add_invocation_listener(self, hear: Callable[[Invocation], None]) -> None:
        """Have ``hear`` called whenever anything of an invocation is different, and once more when it is forgotten.

        It is always given the same object, whose fields change. Invocations of other gateways are told as well, and at
        the start those that Redis has kept, most of which have ended long ago.
        """
        self._invocation_listeners[hear] = None

    def remove_invocation_listener(self, hear: Callable[[Invocation], None]) -> None:
        """Have ``hear`` called no more; nothing if it is no listener."""
        self._invocation_listeners.pop(hear, None)

    def _tell_listeners(self, robot: str | None) -> None:
        for hear in list(self._listeners):
            hear(robot)

    async def halt(self, robots: Collection[str] | None, stop: Stop, timeout_s: float) -> dict[str, Reply]:
        """Stop robots, and wait until they are seen as they are after it: what is asked of them then is no longer late.

        A robot that answered and shows nothing new soon is waited for no longer.
        """
        online = [name for name, robot in self.fleet.robots.items() if robot.online]
        replies = await self.link.stop(robots, stop, timeout_s, online)
        stopped = {name: reply.at_ns for name, reply in replies.items() if isinstance(reply, Accepted)}
        frames, names = self.fleet.frames, Counter(stopped.keys())
        frames.awaited += names
        try:
            async with asyncio.timeout(_SEEN_AGAIN_S):
                while not all(self._seen_after(name, at_ns) for name, at_ns in stopped.items()):
                    self._heard.clear()
                    await self._heard.wait()
        except TimeoutError:
            pass
        finally:
            frames.awaited -= names
        return replies

    def _seen_after(self, name: str, at_ns: int) -> bool:
        robot = self.fleet.robots.get(name)
        header = robot.header if robot is not None else None
        return header is None or header.monotonic_ns > at_ns

    def _on_events(self, events: list[Event]) -> None:
        now_ns = time.time_ns()
        for event in events:
            for change in self.fleet.apply(event, now_ns):
                if change.what == "frame":
                    self._judged += not isinstance(event, Moved)
                    self.fan_out.moved(change.robot)
                    continue
                self._on_change(change)
        self._heard.set()

    def _on_change(self, change: Change) -> None:
        log.info("robot %s: %s", change.robot, change.what, extra={"robot": change.robot})
        self._retarget(change.robot)
        self.fan_out.changed(change.robot)
        if change.what == "vanished":
            self.on_lost(change.robot)

    def tell(self, invocation: Invocation) -> None:
        """An invocation is different now, and so are those that speak of it: its container, fleet, robot and joints."""
        paths = [invocation_path(invocation), invocations_path(invocation.action)]
        if invocation.state.terminal or not invocation.progress:  # the fleet tells of beginnings and ends alone
            paths.append("/")
        robot = self.fleet.robots.get(invocation.robot)
        if robot is not None:
            robot.tell_news()
            paths.append(robot_path(robot.name))
        for path in paths:
            self.fan_out.touched(path)
        for name in {invocation.robot, *invocation.robots}:
            for joint in (*self._retarget(name), *(invocation.targets if name == invocation.robot else ())):
                joint = joint_path(name, joint)
                for path in (joint, f"{joint}/targetRotation", f"{joint}/targetTranslation"):
                    self.fan_out.touched(path)
        for hear in list(self._invocation_listeners):
            hear(invocation)

    def _retarget(self, name: str) -> set[str]:
        """Update the last commanded positions of its joints by the invocations; return the joints that changed."""
        robot = self.fleet.robots.get(name)
        if robot is None:
            return set()
        before, robot.targets = robot.targets, self.invocations.targets(name, robot.incarnation)
        changed = {joint for joint, _ in before.items() ^ robot.targets.items()}
        if changed:
            robot.tell_news()
        return changed
