"""The live fleet: ``apply(event, now) -> changes``. Pure; the clock is passed in as wall time in nanoseconds.

A run of an agent is an incarnation. While several runs of one robot are present (a restart before the lease of the dead
one has expired), the highest incarnation is the present one.

A robot is shown with its description, or with the reason why it has none, so that its joints are there when it is.
Without either it is shown after ``DESCRIPTION_WAIT_NS``.

A robot that has described itself stays in the fleet, as offline, after its agent has gone. One that never has is then
forgotten. At most ``MAX_UNDESCRIBED`` of these are shown; of the others only the runs are kept until they describe
themselves.
"""

import logging
from bisect import bisect_left, insort
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any, Literal

from linked_fleet_agent.wire.codec import WireError, read_header
from linked_fleet_agent.wire.messages import Description
from linked_fleet_state.answers import RejectedMessages
from linked_fleet_state.events import (
    Appeared,
    Conditioned,
    Described,
    DescriptionRejected,
    Event,
    Framed,
    Frames,
    Vanished,
)
from linked_fleet_state.invocation import Lease
from linked_fleet_state.limit_watch import LimitWatch
from linked_fleet_state.movement import MovementWatch
from linked_fleet_state.observation import Observation
from linked_fleet_state.presence import MAX_RUNS
from linked_fleet_state.reception import ReceptionWatch
from linked_fleet_state.robot import Robot

__all__ = [
    "Appeared",
    "Change",
    "Described",
    "DescriptionRejected",
    "Event",
    "Fleet",
    "Framed",
    "Observation",
    "Robot",
    "Vanished",
]

MAX_ROBOTS = 10_000
MAX_UNDESCRIBED = 64
"""Most robots that are shown without ever having described themselves."""
DESCRIPTION_WAIT_NS = 10**9
"""Time after the token of a new robot in which its description is awaited before the robot is shown without one."""
_HIDDEN = "(undescribed)"
_log = logging.getLogger(__name__)

What = Literal["appeared", "vanished", "removed", "described", "faulty", "recovered", "configured", "frame"]


@dataclass(frozen=True)
class Change:
    """A change of a robot."""

    robot: str
    what: What


@dataclass
class _Entry:
    """A robot and the present runs of its agent, each with its description, or the reason why that is unusable."""

    robot: Robot
    runs: dict[int, Description | str | None] = field(default_factory=dict)
    described: bool = False
    """True if any run of it has sent a usable description."""
    appeared_ns: int = 0
    limits: LimitWatch = field(default_factory=LimitWatch)
    movement: MovementWatch = field(default_factory=MovementWatch)
    reception: ReceptionWatch = field(default_factory=ReceptionWatch)


class _ByName(Mapping[str, Robot]):
    """Robots in the order of their names. Iteration is not disturbed by robots that are added meanwhile.

    A robot is returned with its latest frame.
    """

    def __init__(self) -> None:
        self._robots: dict[str, Robot] = {}
        self._names: list[str] = []

    def __getitem__(self, name: str) -> Robot:
        robot = self._robots[name]
        robot.adopt_latest_frame()
        return robot

    def get(self, name: str, default: Any = None) -> Any:  # the inherited one takes three times as long
        robot = self._robots.get(name)
        if robot is not None:
            robot.adopt_latest_frame()
        return default if robot is None else robot

    def __iter__(self) -> Iterator[str]:
        return iter(self._names.copy())

    def __len__(self) -> int:
        return len(self._names)

    def add(self, robot: Robot) -> None:
        self._robots[robot.name] = robot
        insort(self._names, robot.name)  # sorting them all would dominate the cost of adding a robot

    def remove(self, name: str) -> None:
        del self._robots[name], self._names[bisect_left(self._names, name)]


class Fleet:
    """Every robot that has described itself, and some that have not.

    ``malformed`` and ``dropped`` count refused messages by robot: malformed ones are faults of the sender, dropped ones
    (late, or of another run) are normal. ``frames`` receives frames that continue a run, without an event.
    """

    def __init__(self, frames: Frames | None = None) -> None:
        self.frames = frames or Frames()
        self._entries: dict[str, _Entry] = {}
        self._undescribed: set[str] = set()
        self._awaited: set[str] = set()  # new robots whose description is awaited before they are shown
        self._hidden: dict[str, set[int]] = {}
        self._robots = _ByName()
        self._rejected = RejectedMessages(_log)
        self._settings: dict[str, Mapping[str, str]] = {}
        self._leases: dict[str, Lease] = {}
        self.dropped: Counter[str] = Counter()
        self._handlers: dict[type, Callable[[Any, int], list[Change]]] = {
            Appeared: self._appeared,
            Vanished: self._vanished,
            Described: self._described,
            DescriptionRejected: self._not_described,
            Framed: self._framed,
            Conditioned: self._conditioned,
        }

    @property
    def robots(self) -> Mapping[str, Robot]:
        """The robots by name, in the order of names; a read-only live view."""
        return self._robots

    @property
    def malformed_counts(self) -> Counter[str]:
        return self._rejected.counts

    def configure(self, robot: str, settings: Mapping[str, str]) -> list[Change]:
        """Store settings made by clients, also for a robot that is not known yet. Unknown names have no effect."""
        if settings:
            self._settings[robot] = settings
        else:
            self._settings.pop(robot, None)
        entry = self._entries.get(robot)
        if entry is None or entry.robot.settings == settings:
            return []
        entry.robot.settings = settings
        entry.robot.count_change()
        return [Change(robot, "configured")]

    def control(self, robot: str, lease: Lease | None) -> list[Change]:
        """Store the control lease of a robot, which need not be known yet."""
        if lease is None:
            self._leases.pop(robot, None)
        else:
            self._leases[robot] = lease
        entry = self._entries.get(robot)
        if entry is None or entry.robot.lease == lease:
            return []
        entry.robot.lease = lease
        entry.robot.count_change()
        return [Change(robot, "configured")]

    def forget(self, robot: str) -> list[Change]:
        """Remove a robot that is offline."""
        entry = self._entries.get(robot)
        if entry is None or entry.robot.online:
            return []
        self._remove(entry)
        return [Change(robot, "removed")]

    @property
    def settings(self) -> Mapping[str, Mapping[str, str]]:
        """The settings by robot and name, including robots that are not present."""
        return MappingProxyType(self._settings)

    @property
    def leases(self) -> Mapping[str, Lease]:
        return MappingProxyType(self._leases)

    def apply(self, event: Event, now_ns: int) -> list[Change]:
        """Apply an event at gateway wall time ``now_ns`` and return the changes."""
        return self._handlers[type(event)](event, now_ns)

    def next_moved(self) -> str | None:
        """Make the latest frame of the next robot of ``frames.next_moved`` the present one.

        Return its name, for its watchers to be told; None if there is none.
        """
        while (name := self.frames.next_moved()) is not None:
            entry = self._entries.get(name)
            if entry is not None and entry.robot.mark_reported():
                return name
        return None

    def show_awaited(self, now_ns: int) -> list[Change]:
        """Show the new robots whose descriptions have been awaited for too long."""
        overdue = [n for n in self._awaited if now_ns >= self._entries[n].appeared_ns + DESCRIPTION_WAIT_NS]
        for name in overdue:
            self._show(self._entries[name])
        return [Change(name, "appeared") for name in overdue]

    def check_next_frame(self, robot: str) -> None:
        """Let the next frame of a robot be an event, also if it continues a run."""
        entry = self._entries.get(robot)
        if entry is not None:
            entry.robot.check_next_frame()

    def check_limits(self, robot: str, now_ns: int) -> Change | None:
        """Compare the latest frame of a robot with the limits in its URDF."""
        entry = self._entries.get(robot)
        what = None if entry is None else entry.limits.check(entry.robot, now_ns, self._rejected.add)
        return None if what is None else Change(robot, what)

    def check_movement(self, robot: str, now_ns: int) -> Change | None:
        """Compare the latest frame of a robot with former ones."""
        entry = self._entries.get(robot)
        return Change(robot, "configured") if entry is not None and entry.movement.check(entry.robot, now_ns) else None

    def check_reception(self, robot: str, now_ns: int) -> Change | None:
        """Judge how well the frames of a robot arrive."""
        entry = self._entries.get(robot)
        return Change(robot, "configured") if entry is not None and entry.reception.check(entry.robot, now_ns) else None

    def _appeared(self, event: Appeared, now_ns: int) -> list[Change]:
        entry, changes = self._entries.get(event.robot), list[Change]()
        if entry is None and (event.robot in self._hidden or len(self._undescribed) >= MAX_UNDESCRIBED):
            self._hide(event)
            return []
        if entry is None:
            entry, changes = self._enter(event.robot, now_ns)
        if entry is None or (len(entry.runs) >= MAX_RUNS and event.incarnation not in entry.runs):
            self._rejected.add(event.robot, f"more than {MAX_ROBOTS} robots or {MAX_RUNS} runs of one")
            return changes
        entry.runs.setdefault(event.incarnation, None)
        entry.robot.heard_ns = now_ns
        return [*changes, *self._elect(entry)]

    def _vanished(self, event: Vanished, now_ns: int) -> list[Change]:
        entry = self._entries.get(event.robot)
        if entry is None:
            self._unhide(event)
            return []
        if event.incarnation not in entry.runs:
            return []
        del entry.runs[event.incarnation]
        if entry.runs:
            return self._elect(entry)
        entry.robot.set_online(False)
        if not entry.described:
            self._remove(entry)
        return [Change(event.robot, "vanished")]

    def _hide(self, event: Appeared) -> None:
        if event.robot not in self._hidden and len(self._hidden) >= MAX_ROBOTS:
            return
        runs = self._hidden.setdefault(event.robot, set())
        if len(runs) < MAX_RUNS:
            runs.add(event.incarnation)

    def _unhide(self, event: Vanished) -> None:
        runs = self._hidden.get(event.robot, set())
        runs.discard(event.incarnation)
        if not runs:
            self._hidden.pop(event.robot, None)

    def _elect(self, entry: _Entry) -> list[Change]:
        """Make the highest incarnation the present one."""
        robot, incarnation = entry.robot, max(entry.runs)
        if robot.online and robot.incarnation == incarnation:
            return []
        changes = [Change(robot.name, "appeared")]
        new = robot.incarnation != incarnation
        if new:
            robot.start_run(incarnation)
        robot.set_online(True)
        if new:
            changes += self._tell(entry)
        return changes

    def _described(self, event: Described, now_ns: int) -> list[Change]:
        return self._said(event.description.robot, event.description.incarnation, event.description, now_ns)

    def _not_described(self, event: DescriptionRejected, now_ns: int) -> list[Change]:
        self._rejected.add(event.robot if event.robot in self._entries else _HIDDEN, event.reason)
        return self._said(event.robot, event.incarnation, event.reason, now_ns)

    def _said(self, robot: str, incarnation: int, said: Description | str, now_ns: int) -> list[Change]:
        if incarnation in self._hidden.get(robot, ()) and isinstance(said, Description):
            return self._unhide_described(said, now_ns)
        entry = self._entries.get(robot)
        if entry is None or incarnation not in entry.runs:
            return []  # the run ended while the query was running
        entry.robot.heard_ns = now_ns
        entry.runs[incarnation] = said
        changes = self._tell(entry) if incarnation == entry.robot.incarnation else []
        if entry.robot.model is not None:
            entry.described = True
            self._undescribed.discard(robot)
        return changes

    def _unhide_described(self, said: Description, now_ns: int) -> list[Change]:
        """Show a hidden robot; hide it again if its description is unusable."""
        runs = self._hidden.pop(said.robot)
        entry, changes = self._enter(said.robot, now_ns)
        if entry is None:
            self._hidden[said.robot] = runs
            return changes
        entry.runs = dict.fromkeys(runs)
        told = [*self._elect(entry), *self._said(said.robot, said.incarnation, said, now_ns)]
        if not entry.described and len(self._undescribed) > MAX_UNDESCRIBED:
            self._remove(entry)
            self._hidden[said.robot] = runs
            return changes
        return [*changes, *told]

    def _tell(self, entry: _Entry) -> list[Change]:
        """Apply the description of the present run to the robot, if it differs."""
        robot = entry.robot
        said = None if robot.incarnation is None else entry.runs.get(robot.incarnation)
        if said is None or robot.matches_description(said):
            return []
        self._show(entry)
        if isinstance(said, str):
            robot.reject_description(said)
            return [Change(robot.name, "faulty")]
        robot.describe(said)
        if robot.fault:
            self._rejected.add(robot.name, robot.fault)
            return [Change(robot.name, "faulty")]
        return [Change(robot.name, "described"), *self._early_frame(robot)]

    def _early_frame(self, robot: Robot) -> list[Change]:
        """Check a frame that arrived before the description."""
        if robot.payload is None:
            return []
        reason = robot.frame_mismatch(read_header(robot.payload))
        if reason is None:
            robot.accept_frame()
            return [Change(robot.name, "frame")]
        self._rejected.add(robot.name, reason)
        robot.drop_frame()
        return []

    def _framed(self, event: Framed, now_ns: int) -> list[Change]:
        entry = self._entries.get(event.robot)
        try:
            header = read_header(event.payload)
        except WireError as error:
            self._rejected.add(event.robot, error)
            return []
        if entry is None or entry.robot.incarnation != header.incarnation:
            self.dropped[event.robot if entry else "(unknown)"] += 1
            return []
        robot = entry.robot
        robot.adopt_latest_frame()
        reason = robot.frame_mismatch(header)
        if reason is not None:
            self._rejected.add(event.robot, reason)
            return []
        if header.sequence <= robot.last_sequence():
            self.dropped[event.robot] += 1
            return []
        robot.store_frame(header, event.payload, now_ns)
        return [Change(event.robot, "frame")] if robot.described else []

    def _conditioned(self, event: Conditioned, now_ns: int) -> list[Change]:
        entry, said = self._entries.get(event.robot), event.condition
        if entry is None or entry.robot.incarnation != said.incarnation:
            self.dropped[event.robot if entry else "(unknown)"] += 1
            return []
        robot, before = entry.robot, entry.robot.presence
        robot.heard_ns = now_ns
        if not robot.set_condition(said):
            return []
        what = robot.presence
        return [Change(robot.name, "configured" if what == before else "faulty" if what == "faulty" else "recovered")]

    def _enter(self, name: str, now_ns: int) -> tuple[_Entry | None, list[Change]]:
        """Return a new entry, at the limit in place of the robot that was offline longest; None without one."""
        changes = list[Change]()
        if len(self._entries) >= MAX_ROBOTS:
            offline = [each for each in self._entries.values() if not each.robot.online]
            if not offline:
                return None, []
            oldest = min(offline, key=lambda each: each.robot.last_seen_ns or 0)
            self._remove(oldest)
            changes.append(Change(oldest.robot.name, "vanished"))
        entry = self._entries[name] = _Entry(Robot(name, self._rejected.add, self.frames), appeared_ns=now_ns)
        entry.robot.settings, entry.robot.lease = self._settings.get(name, {}), self._leases.get(name)
        self._undescribed.add(name)
        self._awaited.add(name)
        return entry, changes

    def _show(self, entry: _Entry) -> None:
        if entry.robot.name in self._awaited:
            self._awaited.discard(entry.robot.name)
            self._robots.add(entry.robot)

    def _remove(self, entry: _Entry) -> None:
        name = entry.robot.name
        entry.robot.drop_frame()
        del self._entries[name]
        self._undescribed.discard(name)
        if name not in self._awaited:
            self._robots.remove(name)
        self._awaited.discard(name)
        self._rejected.forget(name)
        self.dropped["(unknown)"] += self.dropped.pop(name, 0)
