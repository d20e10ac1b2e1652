"""Observations of a gateway for faults: robots in turn, values of components as they change, ends of invocations."""

import time
from collections.abc import Callable

from linked_fleet_gateway.api import Core, Invocation, Robot, time_sliced
from linked_fleet_gateway.extensions.faults.fault import Trouble
from linked_fleet_gateway.extensions.faults.invocations import RUN, of_invocation, of_mission
from linked_fleet_gateway.extensions.faults.kinds import SETTLING_S, SILENT_S
from linked_fleet_gateway.extensions.faults.robots import (
    components_of,
    of_component,
    of_event,
    of_frame,
    of_robot,
    presence_of,
    reader_of,
    telling_events,
)
from linked_fleet_gateway.extensions.faults.signals import Signals

FRAMES_S = 2.0
"""Time between two looks at the values in the frames of a robot."""
GRACE_S = 10.0
"""Time that a robot must be known until the absence of a trouble is believed that another gateway has recorded."""
MOST_KNOWN = 4096
PRESENCE, ROBOT, FRAME = "/presence", "/robot", "/frame"
"""The sources of a robot besides its components, which have other names."""

AboutRun = Callable[[str], tuple[str, tuple[str, ...]] | None]
"""Returns the title of the mission of a run, and the robots that it uses, by the id of its invocation."""


class _Parts:
    """The components of a robot, and what was last seen of them."""

    def __init__(self, robot: Robot) -> None:
        self.source = robot.parts
        self.components = components_of(robot)
        self.telling = telling_events(self.components)
        self.counts: dict[tuple[str, str], tuple[int | None, int]] = {}
        self.readers = [(each, reader_of(each)) for each in self.components]
        self.seen: dict[str, tuple[object, ...]] = {}


class Watch:
    """Tells ``signals`` of all troubles of the fleet."""

    def __init__(self, core: Core, signals: Signals, about_run: AboutRun) -> None:
        self._core, self._signals, self._about_run = core, signals, about_run
        self._begun_ns = time.time_ns()
        self._seen: dict[str, tuple[object, ...]] = {}
        self._frames_ns: dict[str, int] = {}
        self._parts: dict[str, _Parts] = {}
        self._online_ns: dict[str, int] = {}
        self._removed: set[str] = set()
        self._ended: dict[str, None] = {}

    # -- robots -----------------------------------------------------------------------------------------------------

    async def look(self) -> None:
        """Look at all robots, giving other tasks their turns."""
        async for robot in time_sliced(list(self._core.robots.values())):
            with self._core.faults.guard("faults", robot.name):
                self._look_at(robot, time.time_ns())

    def _look_at(self, robot: Robot, now_ns: int) -> None:
        last_ns, name = robot.last_seen_ns, robot.name
        silent = last_ns is not None and now_ns - last_ns > SILENT_S * 1e9
        strays = robot.moving and not self._is_commanded(robot, now_ns)
        seen = (robot.online, robot.news, silent, strays)
        self._removed.discard(name)
        if seen != self._seen.get(name):
            if not robot.online or not self._seen.get(name, (False,))[0]:
                self._online_ns[name] = now_ns
            self._seen[name] = seen
            self._signals.show((name, PRESENCE), presence_of(robot, now_ns), now_ns)
            if robot.online:
                self._signals.show((name, ROBOT), of_robot(robot, strays), now_ns)
                self.hear_values(name)
        if robot.online and now_ns - self._frames_ns.get(name, 0) > FRAMES_S * 1e9:
            self._frames_ns[name] = now_ns
            self._signals.show((name, FRAME), of_frame(robot), now_ns)

    def _is_commanded(self, robot: Robot, now_ns: int) -> bool:
        """Return True if the fleet moves a robot, or did so just before."""
        invocations = self._core.live.invocations
        last_ns = invocations.last_motion_ns(robot.name)
        settling = last_ns is not None and now_ns - last_ns < SETTLING_S * 1e9
        return settling or bool(invocations.open_of_robot(robot.name))

    def hear_values(self, name: str) -> None:
        """Look at the components of a robot, of which values may have changed."""
        robot = self._core.robots.get(name)
        if robot is None or not robot.online or not robot.parts:
            return
        parts = self._parts.get(name)
        if parts is None or parts.source is not robot.parts:
            parts = self._parts[name] = _Parts(robot)
        if parts.components and parts.components[0].is_current:
            self._look_at_components(robot, parts)

    def _look_at_components(self, robot: Robot, parts: "_Parts") -> None:
        for part, event in parts.telling:
            last = part.state.events.get(event)
            if last is not None and parts.counts.get((part.name, event)) != (robot.incarnation, last.count):
                parts.counts[part.name, event] = robot.incarnation, last.count
                id = f"{robot.incarnation} {last.wall_ns}"
                self._signals.happen(of_event(robot, part, event, last.data), id, time.time_ns())
        for part, read in parts.readers:
            state = part.state
            seen = state.fault, state.stale, read(part)
            if seen != parts.seen.get(part.name):
                parts.seen[part.name] = seen
                self._signals.show((robot.name, part.name), of_component(robot, part), time.time_ns())

    def forget(self, name: str) -> None:
        """Forget a robot that was removed, whose troubles are over."""
        now_ns = time.time_ns()
        parts = self._parts.get(name)
        of_parts = () if parts is None else [each.name for each in parts.components]
        for source in (PRESENCE, ROBOT, FRAME, *of_parts):
            self._signals.show((name, source), (), now_ns)
        for known in (self._seen, self._frames_ns, self._parts, self._online_ns):
            known.pop(name, None)
        self._removed.add(name)

    def judges(self, trouble: Trouble) -> bool:
        """Return True if a trouble that is not seen here is over: its robots have been looked at for long enough."""
        return bool(trouble.robots) and all(self._judges(each, trouble.kind) for each in trouble.robots)

    def _judges(self, name: str, kind: str) -> bool:
        robot, since_ns = self._core.robots.get(name), self._online_ns.get(name)
        if robot is None:
            return name in self._removed
        return robot.online and since_ns is not None and time.time_ns() - since_ns > GRACE_S * 1e9

    # -- invocations ------------------------------------------------------------------------------------------------

    def hear_invocation(self, invocation: Invocation) -> None:
        """Note once what the end of an invocation tells of."""
        if not invocation.state.terminal or invocation.created_ns < self._begun_ns or invocation.id in self._ended:
            return
        self._ended[invocation.id] = None
        if len(self._ended) > MOST_KNOWN:
            del self._ended[next(iter(self._ended))]
        trouble = self._trouble_of(invocation)
        if trouble is not None:
            self._signals.happen(trouble, invocation.id, time.time_ns())

    def _trouble_of(self, invocation: Invocation) -> Trouble | None:
        if invocation.action.endswith(RUN) and (about := self._about_run(invocation.id)) is not None:
            return of_mission(invocation, *about)
        return of_invocation(invocation)
