"""Links that the check does not cover, and what they may meet. Metre."""

from collections.abc import Iterator, Mapping

import coal
import numpy as np

from linked_fleet_gateway.extensions.world.map_obstacles import MapObstacles
from linked_fleet_gateway.extensions.world.messages import Check, Placement, UncheckedNear
from linked_fleet_gateway.extensions.world.robot import Robot
from linked_fleet_gateway.extensions.world.surroundings import (
    MARGIN_M,
    map_bodies,
    object_bodies,
    se3,
    standing,
)


class Coverage:
    """The unchecked links in a question: those of the moving ``robot``, and those of the others."""

    def __init__(
        self, asked: Check, robot: Robot, robots: Mapping[str, Robot], maps: Mapping[str, MapObstacles]
    ) -> None:
        self._asked, self._robot, self._robots, self._maps = asked, robot, robots, maps

    def refusal(self, objects: Mapping[str, coal.CollisionGeometry]) -> UncheckedNear | None:
        """Return links that may meet something, and which no placement accepts; None if there are none."""
        if self._robot.unchecked and not self._asked.robot.accepts_unchecked:
            met = self._meets_own(objects)
            if met is not None:
                return met
        other = next((each for each in self._neighbours() if not each.accepts_unchecked), None)
        return None if other is None else UncheckedNear(False, "robot", other.name)

    def accepted(self) -> tuple[str, ...]:
        """Return the names of the other robots whose unchecked links are near and accepted."""
        return tuple(each.name for each in self._neighbours())

    def _meets_own(self, objects: Mapping[str, coal.CollisionGeometry]) -> UncheckedNear | None:
        reach_m = self._robot.unchecked_m + MARGIN_M
        for thing in object_bodies(self._asked, objects):
            if float(np.linalg.norm(thing.centre)) <= reach_m + thing.radius:
                return UncheckedNear(True, "object", thing.name)
        if next(map_bodies(self._asked, self._maps, reach_m), None) is not None:
            return UncheckedNear(True, "map", "")
        for each in self._asked.robots:
            if self._apart_m(each) <= reach_m + standing(each, self._robots).whole_m:
                return UncheckedNear(True, "robot", each.name)
        return None

    def _neighbours(self) -> Iterator[Placement]:
        """Yield the other robots with unchecked links that may meet the moving robot."""
        for each in self._asked.robots:
            if not self._robots[each.key].unchecked:
                continue
            far_m = standing(each, self._robots).unchecked_m
            if self._apart_m(each) <= far_m + MARGIN_M + self._robot.whole_m:
                yield each

    def _apart_m(self, other: Placement) -> float:
        return float(np.linalg.norm((se3(self._asked.robot.base).inverse() * se3(other.base)).translation))
