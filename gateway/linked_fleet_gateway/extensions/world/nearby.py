"""The robots that a motion may meet, and the preparation of their shapes in a process."""

import asyncio
import math
from collections.abc import Collection, Mapping

from linked_fleet_gateway.extensions.world.collisions import Unchecked
from linked_fleet_gateway.extensions.world.floor_map import ID as MAP_ID
from linked_fleet_gateway.extensions.world.floor_map import Maps
from linked_fleet_gateway.extensions.world.placement import (
    accepts_unchecked,
    has_placement,
    placement_of,
    pose_in_world,
)
from linked_fleet_gateway.extensions.world.process import Preparation, is_placed
from linked_fleet_gateway.extensions.world.questions import base_of
from linked_fleet_gateway.extensions.world.scene import SceneObject, Unreadable
from linked_fleet_gateway.faces import View
from linked_fleet_gateway.serving import Live
from linked_fleet_state.robot import Robot
from linked_fleet_state.xml import Vector

EARLY_S = 30.0
"""Longest wait of a motion for the start of the process and for shapes that are being prepared."""
NEAR_M = 25.0
"""Robots whose roots are further apart than this are not checked against each other."""


class Surroundings:
    """The surroundings of robots with a placement, prepared by ``preparation``.

    ``unreadable`` returns the paths of objects, or of the map, whose records cannot be read.
    """

    def __init__(
        self,
        live: Live,
        preparation: Preparation,
        objects: Mapping[str, SceneObject],
        maps: Maps,
        unreadable: Unreadable = tuple,
    ) -> None:
        self._live, self._preparation, self._objects, self._maps = live, preparation, objects, maps
        self._unreadable = unreadable

    async def prepare(self, robots: Collection[Robot]) -> str | None:
        """Prepare the robots, all objects and the map. Return why one of these cannot be prepared. Raises Unchecked."""
        try:
            async with asyncio.timeout(EARLY_S):
                await self._preparation.prepare_robots(robots)
                why = await self._preparation.prepare_objects(self._objects)
                return why or await self._preparation.prepare_map(self._maps.get(MAP_ID))
        except TimeoutError as error:
            raise Unchecked("The shapes around the robot are still being prepared; try again.") from error

    def around(self, robot: Robot, sees: View) -> list[Robot]:
        """Return the robots near enough to collide, including the robot itself. Raises Unchecked."""
        for path in self._unreadable():  # it may be anywhere
            raise Unchecked(f"{path} cannot be read; PUT or DELETE it.")
        for each in self._live.fleet.robots.values():
            if has_placement(each) and placement_of(each) is None:  # it may be anywhere
                raise Unchecked(f"The placement of {_name(each, sees)} cannot be read; PUT or DELETE it.")
        if not is_placed(robot):
            raise Unchecked(f"{robot.name} has no placement or no description any more.")
        here = base_of(robot, sees).position_m
        found = []
        for each in self._live.fleet.robots.values():
            if is_placed(each):
                if math.dist(base_of(each, sees).position_m, here) <= NEAR_M:
                    found.append(each)
            elif self._is_unknown_near(each, here):
                raise Unchecked(f"The shape of {_name(each, sees)} is unknown, because it has no usable description.")
        return found

    def _is_unknown_near(self, robot: Robot, here: Vector) -> bool:
        """Return True if a robot without a usable description stands nearby, and its placement does not accept that."""
        placement = placement_of(robot)
        near = placement is not None and math.dist(placement.position_m, here) <= NEAR_M
        return near and not accepts_unchecked(robot)

    def perhaps_around(self, robot: Robot) -> list[Robot]:
        """Return the robots near enough to collide, and those whose place is not known yet."""
        placed = {each.name: each for each in self._live.fleet.robots.values() if is_placed(each)}
        bases = {name: pose_in_world(each, each.model.root) for name, each in placed.items() if each.model is not None}
        here = bases.get(robot.name)
        far = {
            name
            for name, there in bases.items()
            if here is not None and there is not None and math.dist(there.position_m, here.position_m) > NEAR_M
        }
        return [each for name, each in placed.items() if name not in far]

    def prepared_around(self, robot: Robot, sees: View) -> list[Robot]:
        """Return the robots near enough to collide. Raises Unchecked if one of them is not prepared."""
        return self.prepared(robot, self.around(robot, sees), sees)

    def among(self, robot: Robot, names: Collection[str]) -> list[Robot]:
        """Return a robot and those of others that are still there."""
        return [robot, *(self._live.fleet.robots[name] for name in names if name in self._live.fleet.robots)]

    def prepared(self, robot: Robot, robots: list[Robot], sees: View) -> list[Robot]:
        """Return these robots. Raises Unchecked if one of them is not prepared."""
        for each in robots:
            if (why := self._preparation.unprepared_reason(each, beside=each.name != robot.name)) is not None:
                seen = sees.includes(each.name)
                name, why = (each.name, why) if seen else ("another robot", "ask again")
                raise Unchecked(f"The shape of {name} is not known yet: {why}.")
        return robots


def _name(robot: Robot, sees: View) -> str:
    return robot.name if sees.includes(robot.name) else "another robot"
