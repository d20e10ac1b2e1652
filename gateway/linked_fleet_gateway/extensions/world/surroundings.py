"""The moving robot and the static bodies around it, in its root frame, and distances between placed shapes. Metre."""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import coal
import numpy as np
import numpy.typing as npt
import pinocchio as pin

from linked_fleet_gateway.extensions.world.map_obstacles import MapObstacles
from linked_fleet_gateway.extensions.world.messages import Check, Kind, Placement, Positions
from linked_fleet_gateway.extensions.world.outline import outline, swept
from linked_fleet_gateway.extensions.world.path import STEP_M, UnknownPosition, moved_positions
from linked_fleet_gateway.extensions.world.robot import Body, Robot, put
from linked_fleet_gateway.extensions.world.surfaces import Array, Surface, winding_number
from linked_fleet_state.model import Pose
from linked_fleet_state.xml import rotation

_NEARLY_M = 4 * STEP_M  # above this, the distance of the hulls replaces that of the surfaces
_REQUEST = coal.DistanceRequest()
_ALWAYS = (-math.inf, math.inf)
_REQUEST.gjk_tolerance = 1e-9  # by default, convex shapes within a micrometre have distance zero


@dataclass(frozen=True)
class Shape:
    """A placed shape.

    ``shape`` is exact; ``hull``, if any, is convex and contains it; ``surface`` is that of a mesh.
    """

    shape: coal.CollisionGeometry
    hull: coal.CollisionGeometry | None
    surface: Surface | None
    at: pin.SE3

    @cached_property
    def place(self) -> coal.Transform3s:
        return coal.Transform3s(self.at.rotation, self.at.translation)


def distance(one: Shape, other: Shape, least_m: float) -> float:
    """Return a lower bound of the distance; exact near ``least_m`` and below, and not above zero for a contact."""
    exact = one.hull is one.shape and other.hull is other.shape
    if not exact and one.hull is not None and other.hull is not None:
        apart = depth(one, other)
        if apart > least_m + _NEARLY_M:
            return apart
    return _distance(one.shape, one, other.shape, other)


def depth(one: Shape, other: Shape) -> float:
    """Return the distance of the convex hulls in metre, negative for a penetration depth."""
    assert one.hull is not None and other.hull is not None
    return _distance(one.hull, one, other.hull, other)


TOUCHING_M = 1e-9
"""Rounding: a larger distance is no contact."""


def free_distance(one: Shape, other: Shape, least_m: float) -> float:
    """Return the distance as ``distance`` does, and zero if one contains the other."""
    apart = distance(one, other, least_m)
    return 0.0 if apart > TOUCHING_M and (is_inside(one, other) or is_inside(other, one)) else apart


def _distance(mine: coal.CollisionGeometry, one: Shape, yours: coal.CollisionGeometry, other: Shape) -> float:
    return float(coal.distance(mine, one.place, yours, other.place, _REQUEST, coal.DistanceResult()))


def meeting_point(one: Shape, other: Shape) -> npt.NDArray[np.float64] | None:
    """Return the middle between the nearest points of both; None if unavailable, as for some intersecting meshes."""
    request, result = coal.DistanceRequest(True), coal.DistanceResult()
    coal.distance(one.shape, one.place, other.shape, other.place, request, result)
    middle = (np.array(result.getNearestPoint1()) + np.array(result.getNearestPoint2())) / 2
    found: npt.NDArray[np.float64] = middle.reshape(3)
    return found if np.isfinite(found).all() else None


def is_inside(one: Shape, other: Shape) -> bool:
    """Return True if ``one`` is inside ``other``, given that their surfaces do not touch."""
    if other.surface is None:
        return False
    one.shape.computeLocalAABB()
    somewhere = one.surface.vertices[0] if one.surface is not None else np.array(one.shape.aabb_center, dtype=float)
    seen = other.at.actInv(one.at.act(somewhere))
    low, high = other.surface.vertices.min(axis=0), other.surface.vertices.max(axis=0)
    if (seen < low).any() or (seen > high).any():
        return False
    return abs(winding_number(other.surface, seen)) > 0.5


MARGIN_M = 0.01
"""Margin in metre to everything except the robot itself."""


@dataclass(frozen=True)
class StaticBody:
    """A static body in the root frame of the moving robot. The surface of an object has no hull.

    A body that another robot holds is the object ``held``. It is there from ``from_s`` until ``until_s`` after the
    start of the path.
    """

    kind: Kind
    name: str
    link: str
    shape: Shape
    centre: Array
    radius: float
    held: str = ""
    from_s: float = -math.inf
    until_s: float = math.inf


class MovingRobot:
    """A robot with adjustable joint positions."""

    def __init__(self, robot: Robot, start: Positions) -> None:
        self.robot = robot
        self._data, self._placed = robot.model.createData(), pin.GeometryData(robot.geometry)
        self._q = _configuration(robot, start)
        self.set_positions(start)

    def set_positions(self, moved: Positions) -> None:
        """Set the positions: those of the start, except of joints that have ``moved``."""
        model = self.robot.model
        for name, position in moved.items():
            if model.existJointName(name):
                put(self.robot, self._q, model.getJointId(name), position)
        pin.updateGeometryPlacements(model, self._data, self.robot.geometry, self._placed, self._q)

    @property
    def configuration(self) -> Array:
        """The present positions in the order of Pinocchio's model."""
        return self._q.copy()

    def at(self, body: int) -> pin.SE3:
        return self._placed.oMg[body]

    def placed_bodies(self) -> list[tuple[Body, pin.SE3]]:
        """Return the bodies whose places are known, with these, in the root frame."""
        return [(body, self.at(i)) for i, body in enumerate(self.robot.bodies) if self.robot.anchored[i]]

    def numbered_bodies(self, base: pin.SE3) -> Iterator[tuple[int, tuple[Body, pin.SE3]]]:
        """Yield the numbers of the bodies whose places are known, with these, in the frame that ``base`` is in."""
        for i, body in enumerate(self.robot.bodies):
            if self.robot.anchored[i]:
                yield i, (body, base * self.at(i))

    def shape(self, body: int) -> Shape:
        return _shape(self.robot.bodies[body], self.at(body))

    def gap(self, one: int, other: int) -> float:
        """Return a lower bound of the distance of two bodies, by their bounding spheres."""
        bodies = self.robot.bodies
        apart = self.at(one).act(bodies[one].centre) - self.at(other).act(bodies[other].centre)
        return float(np.linalg.norm(apart)) - bodies[one].radius - bodies[other].radius

    def gap_to(self, body: int, thing: StaticBody) -> float:
        """Return a lower bound of the distance of a body and something around, by their bounding spheres."""
        mine = self.robot.bodies[body]
        return float(np.linalg.norm(self.at(body).act(mine.centre) - thing.centre)) - mine.radius - thing.radius

    def centres(self, bodies: npt.NDArray[np.intp]) -> Array:
        found = np.zeros((len(self.robot.bodies), 3))
        for i in np.unique(bodies).tolist():
            found[i] = self.at(i).act(self.robot.bodies[i].centre)
        return found


def object_bodies(asked: Check, objects: Mapping[str, coal.CollisionGeometry]) -> Iterator[StaticBody]:
    root = se3(asked.robot.base).inverse()
    for each in asked.objects:
        shape = objects[each.key]
        shape.computeLocalAABB()
        at = root * se3(each.base)
        centre = at.act(np.array(shape.aabb_center, dtype=float))
        hull = None if isinstance(shape, coal.BVHModelOBBRSS) else shape
        yield StaticBody("object", each.name, "", Shape(shape, hull, None, at), centre, float(shape.aabb_radius))


def map_bodies(asked: Check, maps: Mapping[str, MapObstacles], reach_m: float) -> Iterator[StaticBody]:
    """Yield the obstacles of the map of the floor that come within ``reach_m`` of the root. Raises UnknownPosition."""
    if not asked.map:
        return
    for box, at in maps[asked.map].near(se3(asked.robot.base), reach_m):
        radius = float(np.linalg.norm(np.array(box.halfSide)))
        yield StaticBody("map", "", "", Shape(box, box, None, at), np.array(at.translation), radius)


def standing(placed: Placement, robots: Mapping[str, Robot]) -> Robot:
    """Return another robot with its reach in its configurations."""
    return robots[placed.key].reaching(placed.configurations)


def farthest_m(placed: Placement, robots: Mapping[str, Robot]) -> float:
    """Return a bound of ``radius_m`` of another robot in its configurations, in less time than ``standing`` takes."""
    return robots[placed.key].radius_m + sum(
        max((abs(each.get(name, 0.0)) for each in placed.configurations), default=0.0)
        for name in robots[placed.key].slides_m
    )


def other_robot_bodies(asked: Check, robots: Mapping[str, Robot], reach_m: float) -> Iterator[StaticBody]:
    """Yield the bodies of other robots that come within ``reach_m`` of the root, in each of their configurations.

    Left out are those whose place is unknown, which placements accept.
    """
    root, near = se3(asked.robot.base).inverse(), reach_m + MARGIN_M
    for each in asked.robots:
        if math.dist(each.base.position_m, asked.robot.base.position_m) > near + farthest_m(each, robots):
            continue
        other, base = standing(each, robots), root * se3(each.base)
        if float(np.linalg.norm(base.translation)) > near + other.radius_m:
            continue
        try:
            stood = MovingRobot(other, each.configurations[0])
        except UnknownPosition as error:
            raise UnknownPosition(f"of {each.name or 'another robot'} {error}") from error
        yield from _in_configurations(each, stood, base, near)
        if each.way:
            stood.set_positions(each.configurations[0])
            yield from _on_its_way(each, stood, base, near)


def _in_configurations(placed: Placement, robot: MovingRobot, base: pin.SE3, near: float) -> Iterator[StaticBody]:
    """Yield the bodies of another robot near the root in its configurations, each place of a body once."""
    found = dict[tuple[int, bytes], StaticBody]()
    times_s = placed.times_s or (_ALWAYS,) * len(placed.configurations)
    for configuration, (from_s, until_s) in zip(placed.configurations, times_s, strict=True):
        robot.set_positions(moved_positions(robot.robot, placed.configurations[0], configuration))  # type: ignore[arg-type]  # of numbers, numbers
        for i, (body, at) in robot.numbered_bodies(base):
            centre = at.act(body.centre)
            place = (i, np.round(at.homogeneous, 6).tobytes())
            if float(np.linalg.norm(centre)) > near + body.radius:
                continue
            if (known := found.get(place)) is None:
                found[place] = StaticBody(
                    "robot", placed.name, body.link, _shape(body, at), centre, body.radius, body.held, from_s, until_s
                )
            elif (from_s, until_s) != (known.from_s, known.until_s):
                first_s, last_s = min(from_s, known.from_s), max(until_s, known.until_s)
                found[place] = replace(known, from_s=first_s, until_s=last_s)
    yield from found.values()


def _on_its_way(placed: Placement, robot: MovingRobot, base: pin.SE3, near: float) -> Iterator[StaticBody]:
    """Yield the spaces that another robot takes on its way, each as a body of its root link."""
    shape = outline(robot.placed_bodies())
    for space in () if shape is None else swept(shape, placed.way):
        space.computeLocalAABB()
        centre, radius = base.act(np.array(space.aabb_center, dtype=float)), float(space.aabb_radius)
        if float(np.linalg.norm(centre)) <= near + radius:
            body = Shape(space, space, None, base)
            yield StaticBody("robot", placed.name, robot.robot.tree.root, body, centre, radius)


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
        if joint.nq > 2:
            continue  # floating or planar: bodies are compared only where it does not matter
        if not math.isfinite(position):
            raise UnknownPosition(f"it is unknown where joint {name} is")
        put(robot, q, index, position)
    return q
