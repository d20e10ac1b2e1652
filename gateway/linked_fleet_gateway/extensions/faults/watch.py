"""What a gateway looks at for faults: all robots in turn, values of components as they change, ends of invocations."""

import time
from collections.abc import Callable

from msgspec.structs import replace

from linked_fleet_gateway.api import Core, Invocation, Robot
from linked_fleet_gateway.extensions.faults.fault import Trouble
from linked_fleet_gateway.extensions.faults.invocations import RUN, of_invocation, of_mission
from linked_fleet_gateway.extensions.faults.kinds import SILENT_S
from linked_fleet_gateway.extensions.faults.robots import (
    components_of,
    events_of,
    of_components,
    of_frame,
    of_robot,
    presence_of,
    signature,
)
from linked_fleet_gateway.extensions.faults.signals import Signals

FRAMES_S = 2.0
"""Time between two looks at the values in the frames of a robot."""
GRACE_S = 10.0
"""How long a robot must be known until the absence of a trouble is believed that another gateway has recorded."""
MOST_KNOWN = 4096

AboutRun = Callable[[str], tuple[str, tuple[str, ...]] | None]
"""Returns the title of the mission of a run, and the robots that it uses, by the id of its invocation."""


class Watch:
    """Tells ``signals`` of all troubles of the fleet."""

    def __init__(self, core: Core, signals: Signals, about_run: AboutRun, recorded: Callable[[Invocation, str], str]):
        self._core, self._signals, self._about_run, self._recorded = core, signals, about_run, recorded
        self._begun_ns = time.time_ns()
        self._seen: dict[str, tuple[object, ...]] = {}
        self._frames_ns: dict[str, int] = {}
        self._signatures: dict[str, tuple[object, ...]] = {}
        self._counts: dict[tuple[str, str], int] = {}
        self._online_ns: dict[str, int] = {}
        self._removed: set[str] = set()
        self._ended: dict[str, None] = {}

    # -- robots -----------------------------------------------------------------------------------------------------

    def look(self) -> None:
        """Look at all robots."""
        now_ns = time.time_ns()
        for robot in list(self._core.robots.values()):
            with self._core.faults.guard("faults", robot.name):
                self._look_at(robot, now_ns)

    def _look_at(self, robot: Robot, now_ns: int) -> None:
        last_ns, name = robot.last_seen_ns, robot.name
        silent = last_ns is not None and now_ns - last_ns > SILENT_S * 1e9
        seen = (robot.online, robot.news, silent)
        self._removed.discard(name)
        if seen != self._seen.get(name):
            if not robot.online or not self._seen.get(name, (False,))[0]:
                self._online_ns[name] = now_ns
            self._seen[name] = seen
            self._signals.show((name, "presence"), presence_of(robot, now_ns), now_ns)
            if robot.online:
                self._signals.show((name, "robot"), of_robot(robot), now_ns)
                self.hear_values(name)
        if robot.online and now_ns - self._frames_ns.get(name, 0) > FRAMES_S * 1e9:
            self._frames_ns[name] = now_ns
            self._signals.show((name, "frame"), of_frame(robot), now_ns)

    def hear_values(self, name: str) -> None:
        """Look at the components of a robot, of which values may have changed."""
        robot = self._core.robots.get(name)
        if robot is None or not robot.online or not (components := components_of(robot)):
            return
        for trouble, id, count in events_of(robot, components):
            if self._counts.get((trouble.id, name)) != count:
                self._counts[trouble.id, name] = count
                self._signals.happen(trouble, id, time.time_ns())
        seen = signature(components)
        if seen != self._signatures.get(name):
            self._signatures[name] = seen
            self._signals.show((name, "components"), of_components(robot, components), time.time_ns())

    def forget(self, name: str) -> None:
        """Forget a robot that was removed, whose troubles are over."""
        now_ns = time.time_ns()
        for source in ("presence", "robot", "frame", "components"):
            self._signals.show((name, source), (), now_ns)
        for known in (self._seen, self._frames_ns, self._signatures, self._online_ns):
            known.pop(name, None)
        self._counts = {key: count for key, count in self._counts.items() if key[1] != name}
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
        found = of_invocation(invocation)
        return None if found is None else self._with_recording(found, invocation)

    def _with_recording(self, trouble: Trouble, invocation: Invocation) -> Trouble:
        return replace(trouble, recording=self._recorded(invocation, trouble.robots[0]))
