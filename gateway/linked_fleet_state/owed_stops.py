"""Stops that agents have not confirmed.

Pure. A stop is owed from the moment at which it is asked for until the agent answers it or reports on it. Another run
of the agent does not settle it. A new run holds by itself and confirms at once, so the stop costs nothing there; and a
gateway that was cut off from the robot cannot tell if that run began before the stop was asked for.
"""

from msgspec import Struct
from msgspec.structs import replace

from linked_fleet_agent.wire.messages import Stop

MAX_ROBOTS = 10_000
MAX_OF_ONE = 16
"""Most owed stops of one robot. Beyond it they become one stop of the whole robot."""
Key = tuple[str, str]
"""Robot, and id of the stop."""


class OwedStop(Struct, frozen=True):
    """A stop of one robot; ``asked_ns`` is the wall time in ns at which a gateway was asked for it."""

    robot: str
    stop: Stop
    asked_ns: int

    @property
    def key(self) -> Key:
        return self.robot, self.stop.id

    @property
    def of_whole_robot(self) -> bool:
        return not self.stop.joints and not self.stop.command


class OwedStops:
    """The owed stops of each robot in the order in which they were asked for. Memory is bounded."""

    def __init__(self) -> None:
        self._by_robot: dict[str, dict[str, OwedStop]] = {}

    def __contains__(self, robot: object) -> bool:
        return robot in self._by_robot

    def __len__(self) -> int:
        """Return the number of robots that are owed a stop."""
        return len(self._by_robot)

    def of_robot(self, robot: str) -> tuple[OwedStop, ...]:
        return tuple(self._by_robot.get(robot, {}).values())

    def get(self, key: Key) -> OwedStop | None:
        return self._by_robot.get(key[0], {}).get(key[1])

    def add(self, owed: OwedStop) -> list[Key]:
        """Add a stop. Return the keys of those that it replaces.

        A stop of the whole robot replaces all earlier ones, any other those of the same joints or motion.
        """
        held = self._by_robot.setdefault(owed.robot, {})
        covered = [each.key for each in held.values() if _covers(owed, each)]
        if len(held) - len(covered) >= MAX_OF_ONE:
            covered, owed = [*map(_key, held.values())], replace(owed, stop=replace(owed.stop, joints=(), command=""))
        for _, id in covered:
            del held[id]
        held[owed.stop.id] = owed
        return [key for key in covered if key != owed.key] + self._drop_excess()

    def settle(self, key: Key) -> OwedStop | None:
        """Remove a stop that its agent has confirmed. Return None if it is not owed."""
        held = self._by_robot.get(key[0], {})
        found = held.pop(key[1], None)
        if not held:
            self._by_robot.pop(key[0], None)
        return found

    def _drop_excess(self) -> list[Key]:
        if len(self._by_robot) <= MAX_ROBOTS:
            return []
        oldest = self._by_robot.pop(next(iter(self._by_robot)))
        return [*map(_key, oldest.values())]


def _key(owed: OwedStop) -> Key:
    return owed.key


def _covers(owed: OwedStop, earlier: OwedStop) -> bool:
    if owed.key == earlier.key:
        return True
    same = (owed.stop.joints, owed.stop.command) == (earlier.stop.joints, earlier.stop.command)
    return owed.asked_ns >= earlier.asked_ns and (owed.of_whole_robot or same)
