"""The live fleet, connected to its link and to its subscribers (flow "state")."""

import asyncio
import logging
import time
from collections import deque
from collections.abc import Awaitable, Callable, Collection, Mapping, Sequence
from contextlib import suppress
from types import TracebackType

from linked_fleet_agent.wire.keys import Keys
from linked_fleet_agent.wire.messages import Accepted, Progress, Reply, Stop
from linked_fleet_base.faults import Faults
from linked_fleet_gateway.resources.branches import Branch, Branches
from linked_fleet_gateway.resources.invocation import invocation_path, invocations_path
from linked_fleet_gateway.resources.part import RobotPart
from linked_fleet_gateway.resources.paths import joint_path, robot_path
from linked_fleet_gateway.resources.things import NO_SUBSCRIPTIONS, SubscriptionsByOwner
from linked_fleet_gateway.resources.tree import Tree
from linked_fleet_gateway.subscriptions.fan_out import FanOut
from linked_fleet_identity.rights import ALL, View
from linked_fleet_link.fleet_link import FleetLink
from linked_fleet_link.transport import Session
from linked_fleet_runtime.background import SLICE_S, Turns
from linked_fleet_runtime.replica import Copies
from linked_fleet_state.events import Appeared, Described, Event, Framed, Frames
from linked_fleet_state.fleet import Change, Fleet
from linked_fleet_state.invocations import Invocation, Invocations
from linked_fleet_state.presence import Run, SilentRuns
from linked_fleet_state.robot import KeptPose, Robot

_MEETING_S = 2.0  # longest wait for robots at the start, before the gateway serves without knowing all of them
_PAUSE_S = 0.05
_SWEEP_S = 0.25

log = logging.getLogger(__name__)


class Live:
    """Owner of the fleet, the known invocations and the link; an async context manager."""

    def __init__(
        self, namespace: str, name: str, open_session: Callable[[], Awaitable[Session]], secured: bool = False
    ) -> None:
        """``name``: this gateway's name among the gateways. ``secured``: whether clients must authenticate."""
        keys = Keys(namespace)
        self.fleet = Fleet(Frames(lambda robot: keys.robot(robot, "state")))
        self.invocations = Invocations()
        self.faults = Faults()
        self.copies = Copies()
        self.fan_out = FanOut(self.tree, self.fleet.next_moved, lambda path: self._branches.reading(path))
        self.fleet.frames.watched = self.fan_out.watched_robots
        self._invocation_listeners: dict[Callable[[Invocation], None], str] = {}
        self._branches = Branches()
        self._secured = secured
        self._judged = 0
        self._silences = SilentRuns()
        self._finds_silences = False
        self._unchecked = deque[str]()
        self._checks = Turns(self._check_robots)
        self._heard = asyncio.Event()
        # Set by whoever executes actions: called for lost robots, for the progress that robots report, and for robots
        # that are heard from: by a token, a description, or a frame that ``hear_next_frame`` has asked for.
        self.on_progress: Callable[[str, Progress], None] = lambda robot, progress: None
        self.on_lost: Callable[[str], None] = lambda robot: None
        # Called for robots that clients have removed, by whoever keeps something about each robot.
        self.on_removed: dict[Callable[[str], None], None] = {}
        # Called for robots that have described themselves, or are back.
        self.on_described: dict[Callable[[str], None], None] = {}
        self.on_heard: Callable[[str], None] = lambda robot: None
        self.link = FleetLink(
            keys,
            name,
            open_session,
            self._on_events,
            lambda robot, progress: self.on_progress(robot, progress),
            self.fleet.frames,
        )

    @property
    def accepted_frames(self) -> int:
        """Number of frames accepted."""
        return self._judged + self.fleet.frames.taken

    async def __aenter__(self) -> "Live":
        self.fleet.frames.reader.open(self.fan_out.waker())
        await self.link.__aenter__()
        self._sweep()
        return self

    def _sweep(self) -> None:
        """Report frames that arrived while somebody was about to watch and that no other frame has followed.

        Also begin to check every robot, unless the former check is still under way.
        """
        loop = asyncio.get_running_loop()
        self._sweeping = loop.call_later(_SWEEP_S, self._sweep)  # first, so that no error ends the sweeps
        self.fleet.frames.schedule_missed()
        for change in self.fleet.show_awaited(time.time_ns()):
            self._on_change(change)
        self.faults.forget_others(self.fleet.robots)
        if not self._unchecked:
            self._unchecked.extend(self.fleet.robots)
            self._finds_silences = self._silences.begin_round(loop.time())
            self._checks.schedule()

    def _check_robots(self, begun_s: float) -> bool:
        """Check robots for ``SLICE_S``. Return True if there are more; after an error the next turn has the others."""
        now_ns, until_s = time.time_ns(), begun_s + SLICE_S
        while self._unchecked:
            self._check(self._unchecked.popleft(), now_ns)
            if time.perf_counter() > until_s:
                break
        return bool(self._unchecked)

    def _check(self, name: str, now_ns: int) -> None:
        """Evaluate what is the absence of an event: limits that were left for a while, movement, lost frames."""
        if change := self.fleet.check_limits(name, now_ns):
            self._on_change(change)
        if change := self.fleet.check_movement(name, now_ns):
            self._on_change(change)
        if change := self.fleet.check_reception(name, now_ns):
            self._on_change(change)
        robot = self.fleet.robots.get(name)
        if not self._finds_silences or robot is None or robot.incarnation is None:
            return
        if robot.online and robot.described:
            check = self._silences.check(Run(name, robot.incarnation, robot.last_sequence()))
            if check is not None:
                self.link.verify_presence(check)

    async def admit_robots(self) -> None:
        """Let robots join. Robots report recently ended actions at once, so register listeners before this call."""
        await self.link.join()
        with suppress(TimeoutError):
            async with asyncio.timeout(_MEETING_S):
                await self._meet()

    async def _meet(self) -> None:
        """Wait for the robots that are already present, so that a replacing gateway knows what the former one knew."""
        while not self.link.is_connected:  # noqa: ASYNC110 - Zenoh does not notify about this
            await asyncio.sleep(_PAUSE_S)
        awaited = await self.link.list_robots(_MEETING_S)
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
        self._unchecked.clear()
        self.fleet.frames.reader.close()
        await self.link.__aexit__(kind, error, trace)

    def tree(self, base: str, view: View = ALL, subscriptions: SubscriptionsByOwner = NO_SUBSCRIPTIONS) -> Tree:
        """Return the present resource tree under one base URL as seen by ``view``; ``subscriptions``: those to show."""
        return Tree(self.fleet, self.invocations, base, subscriptions, view, self._branches, self._secured, self.faults)

    @property
    def branches(self) -> Branches:
        """The branches that extensions have added to the tree."""
        return self._branches

    def add_branches(self, *branches: Branch) -> None:
        """Add branches to the tree, such as those of extensions."""
        self._branches = self._branches.with_branches(*branches)

    def add_listener(self, listener: Callable[[str | None], None]) -> None:
        """Call ``listener`` at every change of any robot, watched or not.

        It is given the robot's name for a frame, even if no value changed, and None for anything else.
        """
        name = name_of(listener)
        self.fan_out.listeners[listener] = lambda error: self.faults.note("listeners", error, thing=name)
        self.fleet.frames.has_listeners = True

    def remove_listener(self, listener: Callable[[str | None], None]) -> None:
        """Remove a listener; does nothing if it is not registered."""
        self.fan_out.listeners.pop(listener, None)
        self.fleet.frames.has_listeners = bool(self.fan_out.listeners)

    def add_value_listener(self, listener: Callable[[str], None]) -> None:
        """Call ``listener`` with the name of a robot whenever values of it have changed that come in no frame."""
        name = name_of(listener)
        self.fan_out.value_listeners[listener] = lambda error: self.faults.note("listeners", error, thing=name)

    def remove_value_listener(self, listener: Callable[[str], None]) -> None:
        """Remove a listener; does nothing if it is not registered."""
        self.fan_out.value_listeners.pop(listener, None)

    def add_invocation_listener(self, listener: Callable[[Invocation], None]) -> None:
        """Call ``listener`` whenever a field of an invocation changes, and once more when it is forgotten.

        It is always given the same object, whose fields change. Invocations of other gateways are included, and at the
        start those that Redis has kept, most of which ended long ago.
        """
        self._invocation_listeners[listener] = name_of(listener)

    def remove_invocation_listener(self, listener: Callable[[Invocation], None]) -> None:
        """Remove a listener; does nothing if it is not registered."""
        self._invocation_listeners.pop(listener, None)

    async def halt(
        self,
        robots: Collection[str] | None,
        stop: Stop,
        timeout_s: float,
        on_reply: Callable[[str, Reply], None] = lambda robot, reply: None,
    ) -> dict[str, Reply]:
        """Stop robots, and note when they stopped, so that later requests are not taken for earlier ones.

        ``on_reply`` is called for each reply as it arrives.
        """
        online = [] if robots is not None else [name for name, robot in self.fleet.robots.items() if robot.online]

        def note(name: str, reply: Reply) -> None:
            robot = self.fleet.robots.get(name)
            if robot is not None and isinstance(reply, Accepted) and not stop.command:
                robot.stopped_ns = reply.at_ns
            on_reply(name, reply)

        return await self.link.stop(robots, stop, timeout_s, online, note)

    def set_parts(self, robot: str, parts: Mapping[str, RobotPart], findings: Sequence[str] = ()) -> None:
        """Replace the parts of a robot that are neither joints nor links, by path segment.

        ``findings`` are sentences about parts that could not be taken.
        """
        if (known := self.fleet.robots.get(robot)) is not None:
            known.set_parts(parts, findings)
            self.fan_out.mark_robot_changed(robot)

    def set_poses(self, robot: str, poses: Mapping[str, KeptPose]) -> None:
        """Replace the poses that are kept for a robot, by title; does nothing if these are its poses already."""
        known = self.fleet.robots.get(robot)
        if known is not None and known.kept_poses != poses:
            known.set_poses(poses)
            self.fan_out.mark_robot_changed(robot)

    def hear_next_frame(self, robot: str) -> None:
        """Call ``on_heard`` for the next frame of a robot."""
        self.fleet.check_next_frame(robot)

    def forget_robot(self, robot: str) -> None:
        """Remove a robot that is offline from the fleet."""
        for change in self.fleet.forget(robot):
            self._on_change(change)
            for forget in self.on_removed:
                forget(robot)

    def _on_events(self, events: list[Event]) -> None:
        now_ns = time.time_ns()
        for event in events:
            if isinstance(event, Appeared | Framed):
                self.on_heard(event.robot)
            elif isinstance(event, Described):
                self.on_heard(event.description.robot)
            for change in self.fleet.apply(event, now_ns):
                if change.what == "frame":
                    self._judged += 1
                    self.fan_out.mark_moved(change.robot)
                    continue
                self._on_change(change)
        self._heard.set()

    def _on_change(self, change: Change) -> None:
        log.info("robot %s: %s", change.robot, change.what, extra={"robot": change.robot})
        self._retarget(self.fleet.robots.get(change.robot))
        self.fan_out.mark_robot_changed(change.robot)
        if change.what in ("described", "appeared"):
            for described in list(self.on_described):
                with self.faults.guard("listeners", change.robot, name_of(described)):
                    described(change.robot)
        if change.what == "vanished":
            self.on_lost(change.robot)

    def mark_invocation_changed(self, invocation: Invocation) -> None:
        """Tell the resources that mention an invocation of its change: container, fleet, robot and joints."""
        robots = self.fleet.robots
        robot = robots.get(invocation.robot)
        if robot is not None:
            robot.count_change()
        # A motion changes no targets but those of its joints.
        moved = invocation.targets if invocation.stops is None else None
        changed = {invocation.robot: self._retarget(robot, moved)}
        for name in invocation.robots:
            changed[name] = self._retarget(robots.get(name), moved)
        self.fan_out.mark_changed(*(self._mentions(invocation, changed) if self.fan_out.has_watchers else ()))
        for hear, name in list(self._invocation_listeners.items()):
            # An error of one, such as an extension, must not keep an invocation from its end, least of all a stop.
            with self.faults.guard("listeners", thing=name):
                hear(invocation)

    def _mentions(self, invocation: Invocation, changed: Mapping[str, set[str]]) -> list[str]:
        """Return the paths of what mentions an invocation; ``changed`` are joints with another target, by robot."""
        paths = [invocation_path(invocation), invocations_path(invocation.action)]
        # the fleet's representation only shows beginnings and ends
        if invocation.state.terminal or not invocation.progress:
            paths.append("/")
        if not invocation.targets:
            thing = invocation.action.rpartition("/actions/")[0]
            paths += thing, thing.rpartition("/")[0]
        if invocation.robot in self.fleet.robots:
            paths.append(robot_path(invocation.robot))
        for name, joints in changed.items():
            for joint in joints.union(invocation.targets if name == invocation.robot else ()):
                joint = joint_path(name, joint)
                paths += joint, f"{joint}/targetRotation", f"{joint}/targetTranslation"
        return paths

    def _retarget(self, robot: Robot | None, joints: Collection[str] | None = None) -> set[str]:
        """Update the last commanded positions of the robot's joints from its invocations; return the changed joints.

        ``joints`` are those that can have changed; all for None.
        """
        if robot is None:
            return set()
        before, found = robot.targets, self.invocations.targets(robot.name, robot.incarnation, joints)
        looked_at = before.keys() | found.keys() if joints is None else joints
        changed = {joint for joint in looked_at if before.get(joint) != found.get(joint)}
        if changed:
            robot.targets = {joint: at for joint, at in before.items() if joint not in looked_at} | found
            robot.count_change()
        return changed


def name_of(listener: Callable[..., object]) -> str:
    """Return the name of a listener in faults."""
    return f"{getattr(listener, '__module__', '')}.{getattr(listener, '__qualname__', type(listener).__name__)}"
