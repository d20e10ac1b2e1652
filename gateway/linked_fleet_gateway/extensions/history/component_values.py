"""Finds what the components of robots said, for the history on disk: values that have changed, and events.

They are looked at once a second. So of a value that changes more often the last one of each second is kept, and of an
event that occurs more often the last occurrence.
"""

import logging
import time
from collections.abc import AsyncIterator, Callable, Iterator, Sequence
from contextlib import asynccontextmanager

import msgspec

from linked_fleet_gateway.api import Core, Robot, cancel_tasks, robot_path, supervised, time_sliced
from linked_fleet_gateway.extensions.components.part import ComponentPart
from linked_fleet_gateway.extensions.history.archive import Archive
from linked_fleet_gateway.extensions.history.segment import EVENT, UNKNOWN, VALUE, Said

log = logging.getLogger(__name__)

LOOK_S = 1.0


class ValueWatch:
    """Finds what has changed since it looked last."""

    def __init__(self, now_ns: Callable[[], int] = lambda: time.time_ns()) -> None:
        self._now_ns = now_ns
        self._seen: dict[str, object] = {}
        self._values: dict[str, dict[str, str]] = {}
        self._events: dict[str, dict[str, int]] = {}

    def look(self, robot: Robot) -> list[Said]:
        """Return what the components of a robot have said since the last look."""
        parts = [each for each in robot.parts.values() if isinstance(each, ComponentPart)]
        if not parts and robot.name not in self._seen:
            return []
        online = robot.presence != "offline"
        seen = tuple((each.whole.incarnation, each.whole.changes, each.is_current, online) for each in parts)
        if self._seen.get(robot.name) == seen:
            return []
        self._seen[robot.name] = seen
        found = [said for each in parts for said in (*self._changed(robot, each), *self._occurred(robot, each))]
        found += self._ended(robot, parts)
        return sorted(found, key=lambda each: each.stamp_ns)

    def forget(self, names: set[str]) -> None:
        """Forget all robots but these."""
        for name in self._seen.keys() - names:
            del self._seen[name]
            self._values.pop(name, None)
            self._events.pop(name, None)

    def _changed(self, robot: Robot, part: ComponentPart) -> Iterator[Said]:
        known, state = self._values.setdefault(robot.name, {}), part.state
        for name in part.declared.properties:
            value = state.value(name) if part.is_current and robot.presence != "offline" else None
            text = _json(value)
            path = part.path_of(name).removeprefix(robot_path(robot.name))
            if known.get(path) != text:  # also a first one that is unknown: it ends what was known before a restart
                known[path] = text
                stamp_ns = self._now_ns() if value is None else state.times_ns[name]
                yield Said(robot.name, path, VALUE, text, stamp_ns)

    def _ended(self, robot: Robot, parts: Sequence[ComponentPart]) -> Iterator[Said]:
        """Yield that nothing is known of properties that the robot has no longer."""
        known, own = self._values.get(robot.name, {}), robot_path(robot.name)
        present = {part.path_of(name).removeprefix(own) for part in parts for name in part.declared.properties}
        for path in known.keys() - present:
            if known.pop(path) != UNKNOWN:
                yield Said(robot.name, path, VALUE, UNKNOWN, self._now_ns())

    def _occurred(self, robot: Robot, part: ComponentPart) -> Iterator[Said]:
        known = self._events.setdefault(robot.name, {})
        for name, happened in part.state.events.items():
            path = part.path_of(name).removeprefix(robot_path(robot.name))
            if known.get(path) != happened.wall_ns:
                known[path] = happened.wall_ns
                yield Said(robot.name, path, EVENT, _json(happened.data), happened.wall_ns)


def _json(value: object) -> str:
    return msgspec.json.encode(value).decode()


@asynccontextmanager
async def watching_values(core: Core, archive: Archive) -> AsyncIterator[None]:
    """Write what components say to disk while the context lasts."""
    watch = ValueWatch()

    async def look() -> None:
        watch.forget(set(core.robots))
        async for robot in time_sliced(list(core.robots.values())):
            archive.add_values(watch.look(robot))

    task = supervised(look, "values of components on disk", log, "values of components are not kept", LOOK_S)
    try:
        yield
    finally:
        await cancel_tasks([task])
