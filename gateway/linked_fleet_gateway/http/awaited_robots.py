"""Event streams of robots that a gateway has not met yet since its start.

Any status but 200 ends an EventSource for good (WHATWG HTML, 9.2.3). A gateway that has just started knows no robot
whose agent comes back after it, so it keeps such a stream open and begins it when the robot is there. Bounded are the
time after the start, and the number of streams, of each client too. Beyond that the answer is 404.
"""

import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Final

from linked_fleet_state.robot import Robot

AWAIT_S: Final = 120.0
"""Seconds after the start of a gateway in which streams wait for robots."""
MAX_WAITING: Final = 1000
MAX_WAITING_OF_CLIENT: Final = 100


class AwaitedRobots:
    """The waiting streams of one gateway, counted from its start."""

    def __init__(self, await_s: float = AWAIT_S, clock_s: Callable[[], float] = lambda: time.monotonic()) -> None:
        self._clock_s, self._until_s = clock_s, clock_s() + await_s
        self._waiting = Counter[str]()

    def is_awaited(self, name: str, robot: Robot | None) -> bool:
        """Return True while the robot of this name may still come; ``robot`` is what is known of it."""
        unknown = robot is None or (robot.model is None and not robot.fault)
        return unknown and bool(name) and self._clock_s() < self._until_s

    def has_room(self, client: str) -> bool:
        """Return True if one more stream of the client may wait."""
        return self._waiting.total() < MAX_WAITING and self._waiting[client] < MAX_WAITING_OF_CLIENT

    @contextmanager
    def counted(self, client: str) -> Iterator[None]:
        """Count a waiting stream of the client."""
        self._waiting[client] += 1
        try:
            yield
        finally:
            self._waiting[client] -= 1
            if not self._waiting[client]:
                del self._waiting[client]
