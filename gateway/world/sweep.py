"""Whether a robot meets anything on its way: sampled so finely that nothing is passed by between two samples.

Runs in the process that checks motions. Between two samples no point of the robot moves further than twice the margin
that is kept to objects and other robots, by the triangle inequality. Two parts of the robot itself, between which there
are more than two joints, may come near and must not touch.

What is nearer than the margin at the start already may stay so, and may not come nearer: so a robot that stands in a
zone moves out, and not further in. Parts of the robot that touch each other at the start are left to themselves.
"""

import math
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import coal
import numpy as np
import pinocchio as pin

from gateway.fleet.model import Pose
from gateway.fleet.xml import rotation
from gateway.world.messages import Answer, Check, Free, Kind, Leg, Meets, Positions, Unable, Way
from gateway.world.shapes import Array, Robot

MARGIN_M = 0.01
_SLACK_M = 0.001  # what was near and does not move comes nearer by rounding
_APART = 2  # joints between parts of one robot that are not held against each other: hulls of neighbours overlap
_MOST_SAMPLES = 20_000
_EASING = 2.0  # a cubic is at most so much faster than its mean


class Unknown(Exception):  # noqa: N818
    """It cannot be told where something is."""


@dataclass(frozen=True)
class _Thing:
    """A shape that stands still, seen from the root of the robot that moves. ``radius`` is infinite for large ones."""

    kind: Kind
    name: str
    link: str
    shape: coal.CollisionGeometry
    at: coal.Transform3s
    centre: Array
    radius: float


class _Mover:
    """The robot that moves, at any positions of its joints."""

    def __init__(self, robot: Robot) -> None:
        self.robot = robot
        self._data, self._placed = robot.model.createData(), pin.GeometryData(robot.geometry)
        self._centres = [body.centre for body in robot.bodies]

    def stand(self, positions: Mapping[str, float]) -> None:
        model = self.robot.model
        q = _configuration(self.robot, positions)
        pin.updateGeometryPlacements(model, self._data, self.robot.geometry, self._placed, q)

    def at(self, body: int) -> pin.SE3:
        return self._placed.oMg[body]

    def centres(self, bodies: list[int]) -> Array:
        return np.array([self._placed.oMg[i].act(self._centres[i]) for i in bodies]).reshape(-1, 3)


def check(asked: Check, robots: Mapping[str, Robot], objects: Mapping[str, coal.CollisionGeometry]) -> Answer:
    """``robots`` and ``objects`` are what was prepared, by key."""
    started_s = time.monotonic()
    try:
        mover = robots[asked.robot.key]
        things = [*_objects(asked, objects), *_others(asked, robots)]
        sweep = _Sweep(asked, mover, things)
        samples = 0
        for way in asked.ways:
            steps = _steps(mover, way)
            samples += steps
            if samples > _MOST_SAMPLES:
                raise Unknown("the way is too long to be checked; go it in parts")
            for at, positions in enumerate(_along(mover, way, steps)):
                if time.monotonic() > started_s + asked.within_s:
                    raise Unknown("it takes too long to be checked; go it in parts")
                met = sweep.met(positions)
                if met is not None:
                    link, kind, name, other = met
                    return Meets(link, kind, name, other, round(at / steps, 3))
    except Unknown as error:
        return Unable(str(error))
    return Free(samples)


# -- what stands still ----------------------------------------------------------------------------------------------


def _objects(asked: Check, objects: Mapping[str, coal.CollisionGeometry]) -> Iterator[_Thing]:
    root = _se3(asked.robot.base).inverse()
    for each in asked.objects:
        shape = objects[each.key]
        shape.computeLocalAABB()
        at = root * _se3(each.base)
        centre = at.act(np.array(shape.aabb_center, dtype=float))
        yield _Thing("object", each.name, "", shape, _transform(at), centre, float(shape.aabb_radius))


def _others(asked: Check, robots: Mapping[str, Robot]) -> Iterator[_Thing]:
    """Of other robots what can be reached: all their parts, in each of their stances."""
    root, near = _se3(asked.robot.base).inverse(), robots[asked.robot.key].reach_m[0] + MARGIN_M
    for each in asked.robots:
        other, base = robots[each.key], root * _se3(each.base)
        if float(np.linalg.norm(base.translation)) > near + other.reach_m[0]:
            continue
        stood = _Mover(other)
        for stance in each.stances:
            try:
                stood.stand(_follow(other, each.stances[0], stance))
            except Unknown as error:
                raise Unknown(f"of {each.name or 'another robot'} {error}") from error
            for i, body in enumerate(other.bodies):
                at = base * stood.at(i)
                centre = at.act(body.centre)
                if float(np.linalg.norm(centre)) <= near + body.radius:
                    yield _Thing("robot", each.name, body.link, body.shape, _transform(at), centre, body.radius)


def _se3(pose: Pose) -> pin.SE3:
    return pin.SE3(np.array(rotation(pose.orientation_xyzw)), np.array(pose.position_m))


def _transform(at: pin.SE3) -> coal.Transform3s:
    return coal.Transform3s(at.rotation, at.translation)


# -- what moves -----------------------------------------------------------------------------------------------------


def _configuration(robot: Robot, positions: Mapping[str, float]) -> Array:
    model = robot.model
    q: Array = pin.neutral(model)
    for index in range(1, model.njoints):
        name, joint = model.names[index], model.joints[index]
        position = positions.get(name, math.nan)
        if not math.isfinite(position) or joint.nq > 2:
            raise Unknown(f"it is unknown where joint {name} is")
        if joint.nq == 1:
            q[joint.idx_q] = position
        else:
            q[joint.idx_q : joint.idx_q + 2] = math.cos(position), math.sin(position)
    return q


def _travel(robot: Robot, changes: Mapping[str, float]) -> float:
    """How far any point of the robot goes at most (m) when its joints move by ``changes``."""
    model, far = robot.model, 0.0
    for index in range(1, model.njoints):
        change = abs(changes.get(model.names[index], 0.0))
        slides = robot.tree.joints[model.names[index]].kind == "prismatic"
        far += change if slides else change * robot.reach_m[index]
    return far


def _follow(robot: Robot, start: Positions, moved: Mapping[str, float]) -> Positions:
    """All positions when some joints have ``moved`` to others: those that mimic them follow."""
    found = {**start, **moved}
    for name, joint in robot.tree.joints.items():
        driver, factor = joint, 1.0
        for _ in range(len(robot.tree.joints)):
            if driver.mimic is None:
                break
            factor *= driver.mimic.multiplier
            driver = robot.tree.joints[driver.mimic.joint]
        if driver is not joint and driver.name in moved:
            found[name] = start.get(name, math.nan) + factor * (moved[driver.name] - start.get(driver.name, math.nan))
    return found


def _changed(robot: Robot, way: Way) -> dict[str, float]:
    """By joint the way that it goes in all."""
    sums: dict[str, float] = {}
    for before, after, _ in _between(robot, way):
        for name, end in after.items():
            sums[name] = sums.get(name, 0.0) + abs(end - before[name])
    return sums


def _between(robot: Robot, way: Way) -> Iterator[tuple[Positions, Positions, Leg]]:
    before, moved = way.start, dict[str, float]()
    for leg in way.legs:
        moved |= leg.ends
        after = _follow(robot, way.start, moved)
        yield before, after, leg
        before = after


def _of_leg(robot: Robot, before: Positions, after: Positions, leg: Leg) -> int:
    """In how many steps it is gone."""
    far = _travel(robot, {name: end - before[name] for name, end in after.items()})
    return max(1, math.ceil(far * (_EASING if leg.duration_s else 1.0) / (2 * MARGIN_M)))


def _steps(robot: Robot, way: Way) -> int:
    return sum(_of_leg(robot, *between) for between in _between(robot, way))


def _along(robot: Robot, way: Way, steps: int) -> Iterator[Positions]:
    """The start, and the end of each step."""
    yield way.start
    moved = dict[str, float]()
    for before, after, leg in _between(robot, way):
        count = _of_leg(robot, before, after, leg)
        for step in range(1, count + 1):
            now = {name: _on_leg(leg, name, before[name], step / count) for name in leg.ends}
            yield _follow(robot, way.start, moved | now)
        moved |= leg.ends


def _on_leg(leg: Leg, name: str, start: float, share: float) -> float:
    """A cubic of Hermite, or a straight way."""
    end = leg.ends[name]
    if not leg.duration_s:
        return start + share * (end - start)
    enters, leaves = leg.enters.get(name, 0.0) * leg.duration_s, leg.leaves.get(name, 0.0) * leg.duration_s
    a, b = 2 * (start - end) + enters + leaves, 3 * (end - start) - 2 * enters - leaves
    return start + share * (enters + share * (b + share * a))


# -- both -----------------------------------------------------------------------------------------------------------


class _Sweep:
    """Everything that the robot could meet, asked at each sample in turn."""

    def __init__(self, asked: Check, robot: Robot, things: list[_Thing]) -> None:
        self._mover, self._things = _Mover(robot), things
        moving = {name for way in asked.ways for name, change in _changed(robot, way).items() if change}
        model = robot.model
        driven = [{i for i in model.supports[joint] if model.names[i] in moving} for joint in range(model.njoints)]
        self._bodies = [i for i, body in enumerate(robot.bodies) if driven[body.joint]]
        self._own = np.array(_own_pairs(robot, driven), dtype=int).reshape(-1, 2)
        self._all, self._all_radii = list(range(len(robot.bodies))), np.array([body.radius for body in robot.bodies])
        self._radii = np.array([robot.bodies[i].radius for i in self._bodies])
        self._centres = np.array([thing.centre for thing in things]).reshape(-1, 3)
        self._reach = np.array([thing.radius for thing in things])
        self._wide, self._tight = coal.CollisionRequest(), coal.CollisionRequest()
        self._wide.security_margin = MARGIN_M
        self._near: dict[tuple[int, int], float] = {}
        self._mover.stand(asked.ways[0].start)
        self._near = {pair: self._distance(*pair) for pair in self._candidates() if self._touches(*pair)}
        self._own = self._own[[not self._rubs(*pair) for pair in self._own.tolist()]]
        self._room = self._all_radii[self._own].sum(axis=1)

    def met(self, positions: Positions) -> tuple[str, Kind, str, str] | None:
        """The link that meets something, what kind of thing, its name, and its link if it is a robot's."""
        self._mover.stand(positions)
        for i, k in self._candidates():
            allowed = self._near.get((i, k))
            if allowed is None and not self._touches(i, k):
                continue
            if allowed is not None and (allowed <= 0.0 and _is_surface(self._things[k].shape)):
                continue  # how deep it is inside a surface is not known
            if allowed is not None and self._distance(i, k) >= allowed - _SLACK_M:
                continue
            thing = self._things[k]
            return self._link(i), thing.kind, thing.name, thing.link
        for i, j in self._close():
            if self._rubs(i, j):
                return self._link(i), "self", "", self._link(j)
        return None

    def _close(self) -> list[list[int]]:
        """Pairs of the robot's own bodies whose balls meet."""
        if not len(self._own):
            return []
        centres = self._mover.centres(self._all)
        apart = centres[self._own[:, 0]] - centres[self._own[:, 1]]
        found: list[list[int]] = self._own[np.einsum("ij,ij->i", apart, apart) <= self._room**2].tolist()
        return found

    def _candidates(self) -> list[tuple[int, int]]:
        """Pairs of a body and a thing whose balls come within the margin."""
        if not self._things or not self._bodies:
            return []
        apart = self._mover.centres(self._bodies)[:, None, :] - self._centres[None, :, :]
        room = self._radii[:, None] + self._reach[None, :] + MARGIN_M
        near = np.einsum("ijk,ijk->ij", apart, apart) <= room * room
        return [(self._bodies[i], int(k)) for i, k in zip(*np.nonzero(near), strict=True)]

    def _touches(self, body: int, thing: int) -> bool:
        there = self._things[thing]
        at, found = _transform(self._mover.at(body)), coal.CollisionResult()
        coal.collide(self._shape(body), at, there.shape, there.at, self._wide, found)
        return bool(found.isCollision())

    def _distance(self, body: int, thing: int) -> float:
        there = self._things[thing]
        at = _transform(self._mover.at(body))
        return float(
            coal.distance(self._shape(body), at, there.shape, there.at, coal.DistanceRequest(), coal.DistanceResult())
        )

    def _rubs(self, one: int, other: int) -> bool:
        here, there = _transform(self._mover.at(one)), _transform(self._mover.at(other))
        found = coal.CollisionResult()
        coal.collide(self._shape(one), here, self._shape(other), there, self._tight, found)
        return bool(found.isCollision())

    def _shape(self, body: int) -> coal.CollisionGeometry:
        return self._mover.robot.bodies[body].shape

    def _link(self, body: int) -> str:
        return self._mover.robot.bodies[body].link


def _is_surface(shape: coal.CollisionGeometry) -> bool:
    return isinstance(shape, coal.BVHModelOBBRSS)


def _own_pairs(robot: Robot, driven: list[set[int]]) -> list[tuple[int, int]]:
    """Bodies of the robot that move against each other with more than ``_APART`` joints between them."""
    supports = [set(robot.model.supports[joint]) for joint in range(robot.model.njoints)]
    found = []
    for i, one in enumerate(robot.bodies):
        for j in range(i + 1, len(robot.bodies)):
            other = robot.bodies[j]
            apart = supports[one.joint] ^ supports[other.joint]
            if len(apart) > _APART and driven[one.joint] != driven[other.joint]:
                found.append((i, j))
    return found
