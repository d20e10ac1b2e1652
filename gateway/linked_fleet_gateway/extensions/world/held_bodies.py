"""Held objects as further bodies of robots, and what a hand may touch. Metre.

Runs in the check process. A held object moves with its link. It is compared with what is around and with the parts of
the robot that do not belong to its hand.
"""

from collections import ChainMap
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Self

import coal
import msgspec
import numpy as np
import pinocchio as pin

from linked_fleet_gateway.extensions.world.messages import Check, HeldObject, Placement
from linked_fleet_gateway.extensions.world.path import UnknownPosition
from linked_fleet_gateway.extensions.world.reach import reach_m
from linked_fleet_gateway.extensions.world.robot import Body, Robot
from linked_fleet_gateway.extensions.world.surfaces import Surface
from linked_fleet_gateway.extensions.world.surroundings import StaticBody, se3
from linked_fleet_state.kinematics import loose_joint

Shapes = Mapping[str, coal.CollisionGeometry]


def with_held(asked: Check, robots: Mapping[str, Robot], objects: Shapes) -> tuple[Check, Mapping[str, Robot]]:
    """Return the question and the robots, in which each robot has what it holds as bodies of its own.

    Raises UnknownPosition if the shape of a held object is not prepared.
    """
    if not any(each.holds for each in (asked.robot, *asked.robots)):
        return asked, robots
    found: dict[str, Robot] = {}

    def holding(number: int, placed: Placement) -> Placement:
        if not placed.holds or placed.key not in robots:
            return placed
        key = f"{number}: {placed.key}"
        found[key] = _with_bodies(robots[placed.key], placed.holds, objects)
        return msgspec.structs.replace(placed, key=key, holds=())

    me, *others = (holding(n, each) for n, each in enumerate((asked.robot, *asked.robots)))
    return msgspec.structs.replace(asked, robot=me, robots=tuple(others)), ChainMap(found, dict(robots))


def _with_bodies(robot: Robot, holds: Sequence[HeldObject], objects: Shapes) -> Robot:
    """Return a robot with held objects.

    One on a link whose place is unknown makes the unchecked links of the robot reach further.
    """
    geometry, bodies, pairs, far_m = pin.GeometryModel(robot.geometry), list(robot.bodies), list(robot.pairs), 0.0
    for held in holds:
        if (shape := objects.get(held.key)) is None:
            raise UnknownPosition("something of it has to be prepared again")
        at, frame = se3(held.pose), _frame(robot, held.link)
        body = _body(held, shape, 0 if frame is None else frame.parentJoint)
        if frame is None or loose_joint(robot.tree, held.link) is not None:
            far_m = max(far_m, float(np.linalg.norm(at.act(body.centre))) + body.radius)
            continue
        pairs += [(i, len(bodies)) for i in _others(robot, bodies, held)]
        bodies.append(body)
        geometry.addGeometryObject(
            pin.GeometryObject(f"held {len(bodies)}", body.joint, frame.placement * at, body.shape)
        )
    return replace(
        robot,
        geometry=geometry,
        bodies=tuple(bodies),
        pairs=tuple(pairs),
        reach_m=np.hstack([robot.reach_m, _reach(robot, geometry, bodies)]),
        unchecked_m=robot.unchecked_m + far_m,
    )


def _others(robot: Robot, bodies: Sequence[Body], held: HeldObject) -> Iterator[int]:
    """Yield the bodies with which a held object is compared: those of other links than its hand."""
    anchored = [*robot.anchored.tolist(), *(True for _ in bodies[len(robot.bodies) :])]
    yield from (i for i, each in enumerate(bodies) if each.link not in held.hand and anchored[i])


def _frame(robot: Robot, link: str) -> pin.Frame | None:
    """Return the frame of a link; None in a robot without shapes, of which no link is placed."""
    frames = (each for each in robot.model.frames if each.type == pin.FrameType.BODY)
    return next((each for each in frames if each.name.strip() == link), None)


def _body(held: HeldObject, shape: coal.CollisionGeometry, joint: int) -> Body:
    shape.computeLocalAABB()
    surface = None
    if isinstance(shape, coal.BVHModelOBBRSS):
        corners = np.array(shape.vertices(), dtype=float).reshape(-1, 3)
        surface = Surface(corners, np.arange(len(corners), dtype=np.int32).reshape(-1, 3), False)
    hull = shape if surface is None else surface.hull
    centre, radius = np.array(shape.aabb_center, dtype=float), float(shape.aabb_radius)
    return Body(held.link, joint, shape, hull, surface, centre, radius, held.name)


def _reach(robot: Robot, geometry: pin.GeometryModel, bodies: Sequence[Body]) -> np.ndarray:
    """Return the columns of ``Robot.reach_m`` for the bodies that are added."""
    first = len(robot.bodies)
    placed = zip(bodies[first:], list(geometry.geometryObjects)[first:], strict=True)
    sizes = [float(np.linalg.norm(at.placement.act(body.centre))) + body.radius for body, at in placed]
    return reach_m(robot.tree, robot.model, [each.joint for each in bodies[first:]], sizes)


@dataclass(frozen=True)
class Permission:
    """The objects that bodies of the hand may touch, whoever holds them."""

    objects: frozenset[str]
    bodies: frozenset[int]

    @classmethod
    def of(cls, asked: Check, robot: Robot) -> Self:
        """Return the permission in a question: of the links of the hand, and of what the robot holds."""
        hand = frozenset(i for i, each in enumerate(robot.bodies) if each.held or each.link in asked.hand)
        return cls(frozenset(asked.may_touch), hand)

    def allows(self, body: int, thing: StaticBody) -> bool:
        """Return True if the body may touch the thing: an object, also one that another robot holds."""
        named = thing.name if thing.kind == "object" else thing.held
        return named in self.objects and body in self.bodies


NO_PERMISSION = Permission(frozenset(), frozenset())
