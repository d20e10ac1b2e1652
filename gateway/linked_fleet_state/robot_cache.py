"""Values computed from the description of a robot, which are dropped with it."""

from collections.abc import Callable, Hashable
from typing import Generic, TypeVar
from weakref import WeakKeyDictionary

from linked_fleet_state.robot import Robot

T = TypeVar("T")


class _Values(Generic[T]):
    def __init__(self, known: Hashable) -> None:
        self.known = known
        self.by_key: dict[Hashable, T] = {}


class RobotCache(Generic[T]):
    """Values by key for each robot, and for the fleet as None; of each at most ``most``, the latest.

    No value may refer to its robot, which would then never be dropped.
    """

    def __init__(self, most: int = 1024) -> None:
        self._most = most
        self._of_robots: WeakKeyDictionary[Robot, _Values[T]] = WeakKeyDictionary()
        self._of_fleet = _Values[T](None)

    def get(self, robot: Robot | None, known: Hashable, key: Hashable, compute: Callable[[], T]) -> T:
        """Return the value of ``key``. Values that were computed from other facts than ``known`` are dropped."""
        values = self._values(robot, known)
        if key not in values.by_key:
            values.by_key[key] = compute()
            if len(values.by_key) > self._most:
                del values.by_key[next(iter(values.by_key))]
        return values.by_key[key]

    def _values(self, robot: Robot | None, known: Hashable) -> _Values[T]:
        if robot is None:
            return self._of_fleet
        values = self._of_robots.get(robot)
        if values is None or values.known != known:
            values = self._of_robots[robot] = _Values(known)
        return values
