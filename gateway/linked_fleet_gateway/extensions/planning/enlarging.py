"""Clearances of paths, and by how much shapes may be larger than they are. Metre."""

import coal
import pinocchio as pin

from linked_fleet_gateway.extensions.planning.inflation import Solids, Triangles, inflated
from linked_fleet_gateway.extensions.planning.kept import Kept
from linked_fleet_gateway.extensions.world.robot import Body
from linked_fleet_gateway.extensions.world.surfaces import Surface
from linked_fleet_gateway.extensions.world.surroundings import TOUCHING_M, Shape, distance, free_distance

CLEARANCE_M = 0.0115
"""Clearance of paths: the margin of the collision check, and what a path may deviate between two checked places."""
CORNER_M = 2 * CLEARANCE_M
"""More than a corner of something around moves when that is made larger: by up to √3 times the clearance."""
_NEAR_SLACK_M = 0.0003
"""Share by which the search may come nearer than at the start or a goal, of the 1 mm that the check allows."""
_LESS, _LEAST_M = 0.8, 0.0005
"""Share by which an enlargement is reduced, and that which is none."""
_MOST_TRIANGLES = 3_000
OWN_M = 0.0012
"""Clearance of a hull: that of the check between parts of the robot, and what a path deviates."""
CORNERS = 2.0
"""More than corners of a mesh are further out that is larger, by this times the distance."""
PARTS_M = 0.005
"""Parts whose hulls are nearer at the start or at a goal are compared by their meshes."""
Inflated = tuple[Solids, Triangles | None]


def most_larger(mine: Shape, its: Shape) -> float | None:
    """Return by how much a thing may be larger without touching a body; None if it touches it as it is."""
    apart = free_distance(mine, its, CORNER_M)
    if apart <= TOUCHING_M:
        return None
    by_m = CLEARANCE_M if apart > CLEARANCE_M + _NEAR_SLACK_M else max(apart - _NEAR_SLACK_M, 0.0)
    while by_m > _LEAST_M and _is_in_larger(mine, its, by_m):
        by_m *= _LESS
    return by_m if by_m > _LEAST_M else 0.0


def _is_in_larger(mine: Shape, its: Shape, by_m: float) -> bool:
    """Return True if a body touches a thing that is larger by a distance. A surface of many triangles is not tried."""
    solids, mesh = inflated(its, by_m)
    placed = [Shape(solid, solid, None, its.at * offset) for solid, offset in solids]
    if mesh is not None and len(mesh[1]) <= _MOST_TRIANGLES:
        placed.append(Shape(Surface(*mesh, False).exact_shape(), None, None, its.at))
    return any(distance(mine, each, TOUCHING_M) <= TOUCHING_M for each in placed)


def _larger_hull(solid: coal.CollisionGeometry) -> Inflated:
    return inflated(Shape(solid, solid, None, pin.SE3.Identity()), OWN_M)


_LARGER_SURFACES: Kept[Inflated] = Kept(lambda each: inflated(Shape(each, None, None, pin.SE3.Identity()), OWN_M))
"""Surfaces of parts of robots that are larger, each of which costs 10 ms or more."""


def larger_part(body: Body) -> Inflated:
    """Return a part of a robot that is larger by the clearance between its parts."""
    return (_LARGER_SURFACES if body.hull is not body.shape else _larger_hull)(body.shape)


def triangles_of(body: Body) -> int:
    """Return how many triangles a part has that is compared by its surface."""
    return 0 if body.surface is None or body.hull is body.shape else len(body.surface.triangles)
