"""The moving robot and the static bodies around it, in its root frame. Metre."""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import coal
import numpy as np
import numpy.typing as npt
import pinocchio as pin

from linked_fleet_gateway.extensions.world.contact import Shape
from linked_fleet_gateway.extensions.world.messages import Check, Kind, Positions
from linked_fleet_gateway.extensions.world.path import Unknown, follow
from linked_fleet_gateway.extensions.world.robot import Body, Robot, put
from linked_fleet_gateway.extensions.world.surfaces import Array
from linked_fleet_gateway.fleet.model import Pose
from linked_fleet_gateway.fleet.xml import rotation

MARGIN_M = 0.01
"""Margin in metre to everything except the robot itself."""


@dataclass(frozen=True)
class Thing:
    """A static body in the root frame of the moving robot. The surface of an object has no hull."""

    kind: Kind
    name: str
    link: str
    shape: Shape
    centre: Array
    radius: float


class Mover:
    """A robot with adjustable joint positions."""

    def __init__(self, robot: Robot, start: Positions) -> None:
        self.robot = robot
        self._data, self._placed = robot.model.createData(), pin.GeometryData(robot.geometry)
        self._q = _configuration(robot, start)
        self.stand(start)

    def stand(self, moved: Positions) -> None:
        """Set the positions: those of the start, except of joints that have ``moved``."""
        model = self.robot.model
        for name, position in moved.items():
            if model.existJointName(name):
                put(self.robot, self._q, model.getJointId(name), position)
        pin.updateGeometryPlacements(model, self._data, self.robot.geometry, self._placed, self._q)

    def at(self, body: int) -> pin.SE3:
        return self._placed.oMg[body]

    def shape(self, body: int) -> Shape:
        return _shape(self.robot.bodies[body], self.at(body))

    def centres(self, bodies: npt.NDArray[np.intp]) -> Array:
        found = np.zeros((len(self.robot.bodies), 3))
        for i in np.unique(bodies).tolist():
            found[i] = self.at(i).act(self.robot.bodies[i].centre)
        return found


def objects_of(asked: Check, objects: Mapping[str, coal.CollisionGeometry]) -> Iterator[Thing]:
    root = se3(asked.robot.base).inverse()
    for each in asked.objects:
        shape = objects[each.key]
        shape.computeLocalAABB()
        at = root * se3(each.base)
        centre = at.act(np.array(shape.aabb_center, dtype=float))
        hull = None if isinstance(shape, coal.BVHModelOBBRSS) else shape
        yield Thing("object", each.name, "", Shape(shape, hull, None, at), centre, float(shape.aabb_radius))


def others_of(asked: Check, robots: Mapping[str, Robot]) -> Iterator[Thing]:
    """Yield the bodies of other robots within reach, in each of their stances."""
    root, near = se3(asked.robot.base).inverse(), robots[asked.robot.key].radius_m + MARGIN_M
    for each in asked.robots:
        other, base = robots[each.key], root * se3(each.base)
        if float(np.linalg.norm(base.translation)) > near + other.radius_m:
            continue
        try:
            stood = Mover(other, each.stances[0])
        except Unknown as error:
            raise Unknown(f"of {each.name or 'another robot'} {error}") from error
        seen: set[tuple[int, bytes]] = set()
        for stance in each.stances:
            stood.stand(follow(other, each.stances[0], stance))  # type: ignore[arg-type]  # of numbers, numbers
            for i, body in enumerate(other.bodies):
                at = base * stood.at(i)
                centre = at.act(body.centre)
                place = (i, np.round(at.homogeneous, 6).tobytes())
                if float(np.linalg.norm(centre)) <= near + body.radius and place not in seen:
                    seen.add(place)
                    yield Thing("robot", each.name, body.link, _shape(body, at), centre, body.radius)


def _shape(body: Body, at: pin.SE3) -> Shape:
    return Shape(body.shape, body.hull, body.surface, at)


def se3(pose: Pose) -> pin.SE3:
    return pin.SE3(np.array(rotation(pose.orientation_xyzw)), np.array(pose.position_m))


def _configuration(robot: Robot, positions: Mapping[str, float]) -> Array:
    model = robot.model
    q: Array = pin.neutral(model)
    for index in range(1, model.njoints):
        name, joint = model.names[index], model.joints[index]
        position = positions.get(name, math.nan)
        if not math.isfinite(position) or joint.nq > 2:
            raise Unknown(f"it is unknown where joint {name} is")
        put(robot, q, index, position)
    return q
