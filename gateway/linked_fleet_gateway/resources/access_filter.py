"""The part of the fleet that a caller may see. The tree accesses robots and invocations only through these views."""

from collections.abc import Iterator, Mapping

from linked_fleet_gateway.resources.paths import robot_of
from linked_fleet_identity.rights import View
from linked_fleet_state.invocations import FLEET, Invocation, Invocations
from linked_fleet_state.robot import Robot
from linked_fleet_state.unchecked import UncheckedLink


class RobotsInView(Mapping[str, Robot]):
    """Visible robots by name. An invisible name is rejected before any lookup, so that timing reveals nothing."""

    def __init__(self, robots: Mapping[str, Robot], visible_robots: View) -> None:
        self._robots, self._visible_robots = robots, visible_robots

    def __getitem__(self, name: str) -> Robot:
        if not self._visible_robots.includes(name):
            raise KeyError(name)
        return self._robots[name]

    def __iter__(self) -> Iterator[str]:
        return (name for name in self._robots if self._visible_robots.includes(name))

    def __len__(self) -> int:
        return sum(1 for _ in self)


class InvocationsInView:
    """Invocations of visible robots, and those of the fleet that are the caller's own or concern visible robots
    only.
    """

    def __init__(self, invocations: Invocations, visible_robots: View) -> None:
        self._invocations, self._visible_robots = invocations, visible_robots

    def get(self, id: str) -> Invocation | None:
        found = self._invocations.get(id)
        return found if found is not None and self._shows(found) else None

    def of_action(self, action: str) -> list[Invocation]:
        return self._seen(self._invocations.of_action(action))

    def open_of_action(self, action: str) -> list[Invocation]:
        return self._seen(self._invocations.open_of_action(action))

    def of_robot(self, robot: str) -> list[Invocation]:
        """Return the invocations of one robot, newest first; those of the fleet for ``FLEET``."""
        return self._seen(self._invocations.of_robot(robot))

    def open_of_robot(self, robot: str) -> list[Invocation]:
        return self._seen(self._invocations.open_of_robot(robot))

    def last_motion_ns(self, robot: str) -> int | None:
        """Return the end of the robot's last accepted motion (wall ns); None if none is stored."""
        return self._invocations.last_motion_ns(robot) if self._visible_robots.includes(robot) else None

    def answers(self, invocation: Invocation) -> dict[str, str]:
        """Return the answers of the visible robots to an invocation of the fleet."""
        if self._visible_robots.includes_all:
            return invocation.robots
        return {robot: answer for robot, answer in invocation.robots.items() if self._visible_robots.includes(robot)}

    def unchecked(self, invocation: Invocation) -> list[tuple[str, UncheckedLink]]:
        """Return the links of visible robots that the check of a motion did not cover."""
        return [each for each in invocation.unchecked if self._includes(each[0])]

    def _includes(self, path: str) -> bool:
        robot = robot_of(path)
        return robot is not None and self._visible_robots.includes(robot)

    def _seen(self, invocations: list[Invocation]) -> list[Invocation]:
        return invocations if self._visible_robots.includes_all else [each for each in invocations if self._shows(each)]

    def _shows(self, invocation: Invocation) -> bool:
        if self._visible_robots.includes_all:
            return True
        if invocation.robot != FLEET:
            return self._visible_robots.includes(invocation.robot)
        return invocation.client == self._visible_robots.name or all(
            map(self._visible_robots.includes, (*invocation.robots, *invocation.about))
        )
