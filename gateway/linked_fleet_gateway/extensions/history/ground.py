"""Finds where a robot stands in the world, and the map of the floor there."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

from linked_fleet_gateway.api import Robot
from linked_fleet_gateway.extensions.world.floor_map import FloorMap
from linked_fleet_gateway.extensions.world.placement import placement_of
from linked_fleet_gateway.extensions.world.service import World
from linked_fleet_state.model import Pose

if TYPE_CHECKING:
    from linked_fleet_gateway.extensions.world.occupancy import OccupancyGrid


@dataclass(frozen=True)
class Ground:
    """``placement`` is that of the root link, or of the odometry frame of a floating base."""

    placement: Pose
    floor: FloorMap | None = None

    def grid(self) -> "OccupancyGrid | None":
        """Return the cells of the map. It takes up to a tenth of a second."""
        if self.floor is None:
            return None
        from linked_fleet_gateway.extensions.world.map_image import grid_of  # imports numpy

        return grid_of(self.floor)


def ground_of(world: World | None, robot: Robot) -> Ground | None:
    """Return the ground of a robot; None if it has no placement."""
    placement = None if world is None else placement_of(robot)
    return None if world is None or placement is None else Ground(placement, world.floor)
