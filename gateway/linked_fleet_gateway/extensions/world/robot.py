"""A robot that is prepared for the check of its motions. Metre."""

from dataclasses import dataclass

import coal
import numpy as np
import pinocchio as pin

from linked_fleet_gateway.extensions.world.surfaces import Array, Surface
from linked_fleet_gateway.fleet.model import RobotModel


@dataclass(frozen=True)
class Body:
    """A part of a link. ``centre`` is in its own frame, and no point of it is further than ``radius`` from that.

    ``shape`` is exact. ``hull`` is convex and contains it, ``surface`` is its mesh where it is not convex.
    """

    link: str
    joint: int
    shape: coal.CollisionGeometry
    hull: coal.CollisionGeometry
    surface: Surface | None
    centre: Array
    radius: float


@dataclass(frozen=True)
class Robot:
    """``geometry`` has a shape for each of ``bodies``, in their order."""

    tree: RobotModel
    model: pin.Model
    geometry: pin.GeometryModel
    bodies: tuple[Body, ...]
    reach_m: Array
    """By joint and body: no point of the body is further from the origin of the joint; 0 where the joint does not move
    it. Row 0 is of the root."""

    pairs: tuple[tuple[int, int], ...] = ()
    """Bodies that are held against each other."""

    @property
    def radius_m(self) -> float:
        """No point of the robot is further from its root."""
        return float(self.reach_m[0].max(initial=0.0))


def put(robot: Robot, q: Array, joint: int, position: float) -> None:
    """Set the position of a joint of the model in a configuration."""
    kind = robot.model.joints[joint]
    if kind.nq == 1:
        q[kind.idx_q] = position
    elif kind.nq == 2:
        q[kind.idx_q : kind.idx_q + 2] = np.cos(position), np.sin(position)
