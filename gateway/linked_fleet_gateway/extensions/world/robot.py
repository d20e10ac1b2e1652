"""A robot prepared for collision checks. Metre."""

from dataclasses import dataclass

import coal
import numpy as np
import pinocchio as pin

from linked_fleet_gateway.extensions.world.surfaces import Array, Surface
from linked_fleet_gateway.fleet.model import RobotModel


@dataclass(frozen=True)
class Body:
    """A collision body of a link. ``centre`` is in its own frame; all its points are within ``radius`` of it.

    ``shape`` is exact. ``hull`` is convex and contains it. ``surface`` is the mesh of a non-convex body.
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
    """A prepared robot; ``geometry`` has one shape for each of ``bodies``, in order."""

    tree: RobotModel
    model: pin.Model
    geometry: pin.GeometryModel
    bodies: tuple[Body, ...]
    reach_m: Array
    """By joint and body: bound of the distance of the body from the origin of the joint.

    0 if the joint does not move the body. Row 0 is that of the root.
    """

    pairs: tuple[tuple[int, int], ...] = ()
    """Pairs of bodies to check against each other."""

    @property
    def radius_m(self) -> float:
        """Bound of the distance of the robot from its root."""
        return float(self.reach_m[0].max(initial=0.0))


def put(robot: Robot, q: Array, joint: int, position: float) -> None:
    """Set the position of a joint of the model in a configuration."""
    kind = robot.model.joints[joint]
    if kind.nq == 1:
        q[kind.idx_q] = position
    elif kind.nq == 2:
        q[kind.idx_q : kind.idx_q + 2] = np.cos(position), np.sin(position)
