"""The part of the fleet that a caller may see: the tree looks at robots and invocations through these alone."""

from collections.abc import Iterator, Mapping

from linked_fleet_gateway.fleet.invocations import FLEET, Invocation, Invocations
from linked_fleet_gateway.fleet.robot import Robot
from linked_fleet_gateway.identity.rights import View


class RobotsInView(Mapping[str, Robot]):
    """Robots by name. One that is not seen is looked for no further: nothing about it takes time."""

    def __init__(self, robots: Mapping[str, Robot], sees: View) -> None:
        self._robots, self._sees = robots, sees

    def __getitem__(self, name: str) -> Robot:
        if not self._sees.sees(name):
            raise KeyError(name)
        return self._robots[name]

    def __iter__(self) -> Iterator[str]:
        return (name for name in self._robots if self._sees.sees(name))

    def __len__(self) -> int:
        return sum(1 for _ in self)


class InvocationsInView:
    """Those of robots that are seen; those of the whole fleet that are one's own, or about such robots alone."""

    def __init__(self, invocations: Invocations, sees: View) -> None:
        self._invocations, self._sees = invocations, sees

    def get(self, id: str) -> Invocation | None:
        found = self._invocations.get(id)
        return found if found is not None and self._shows(found) else None

    def of(self, action: str) -> list[Invocation]:
        return self._seen(self._invocations.of(action))

    def open_of(self, robot: str) -> list[Invocation]:
        return self._seen(self._invocations.open_of(robot))

    def last_motion_ns(self, robot: str) -> int | None:
        """When the last motion that a robot was commanded to ended; None if none is remembered."""
        return self._invocations.last_motion_ns(robot) if self._sees.sees(robot) else None

    def answers(self, invocation: Invocation) -> dict[str, str]:
        """The answer of each robot that is seen to an invocation of the fleet."""
        if self._sees.all:
            return invocation.robots
        return {robot: answer for robot, answer in invocation.robots.items() if self._sees.sees(robot)}

    def _seen(self, invocations: list[Invocation]) -> list[Invocation]:
        return invocations if self._sees.all else [each for each in invocations if self._shows(each)]

    def _shows(self, invocation: Invocation) -> bool:
        if self._sees.all:
            return True
        if invocation.robot != FLEET:
            return self._sees.sees(invocation.robot)
        return invocation.client == self._sees.name or all(map(self._sees.sees, invocation.robots))
