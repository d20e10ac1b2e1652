"""Detection of changes since the last check; a frame counts only if a value moved."""

import asyncio
from collections.abc import Callable

from linked_fleet_gateway.resources.paths import robot_path
from linked_fleet_gateway.resources.resource import Resource
from linked_fleet_gateway.resources.versioning import Reading
from linked_fleet_gateway.subscriptions.live import Live

LOOK_S = 0.02
"""Time in which frames are collected before a check."""


class Changes:
    """Calls ``tell`` when the fleet has changed, at most every ``LOOK_S``. While closed it costs nothing."""

    def __init__(self, live: Live, tell: Callable[[], None]) -> None:
        self._live, self._tell = live, tell
        self._readings: dict[str, Reading] = {}
        self._moved: set[str] = set()
        self._other = False
        self._looking: asyncio.TimerHandle | None = None

    def open(self) -> None:
        self._live.add_listener(self._hear)

    def shut(self) -> None:
        self._live.remove_listener(self._hear)
        self._readings.clear()
        if self._looking is not None:
            self._looking.cancel()
            self._looking = None

    def _hear(self, robot: str | None) -> None:
        if robot is None:
            self._other = True
        else:
            self._moved.add(robot)
        if self._looking is None:
            self._looking = asyncio.get_running_loop().call_later(LOOK_S, self._look)

    def _look(self) -> None:
        self._looking = None
        moved, self._moved = self._moved, set()
        other, self._other = self._other, False
        tree = self._live.tree("")
        for name in moved:
            found = tree.resolve(robot_path(name))
            if isinstance(found, Resource):
                before, now = self._readings.get(name), found.source.read(True)
                self._readings[name] = now
                other |= before is None or not now.same(before)
        if other:
            self._tell()
