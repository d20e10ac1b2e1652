"""Collision check of a path. No obstacle is skipped, however thin it is or fast the motion.

Runs in the check process. The margin applies to objects and other robots, ``CLEARANCE_M`` to parts of the robot itself.
The distance of a pair decreases by no more than the motion of its joints, each times its reach. So a pair that is
further apart is checked again only when it may have come near, and no contact is missed.

A pair that is nearer than its margin at the start may stay so but not come nearer: a robot in a zone can move out but
not further in. Parts of the robot may come nearer but not touch: where they might have touched between two places, the
path is refined down to ``FINEST_M``, so that no contact is deeper than half of that. Parts that touch at the start are
not checked.
"""

import math
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from types import MappingProxyType

import coal
import numpy as np
import numpy.typing as npt
from msgspec.structs import replace

from linked_fleet_gateway.extensions.world.closest import find_closest
from linked_fleet_gateway.extensions.world.coverage import Coverage
from linked_fleet_gateway.extensions.world.held_bodies import Permission, with_held
from linked_fleet_gateway.extensions.world.map_obstacles import MapObstacles
from linked_fleet_gateway.extensions.world.messages import (
    Answer,
    Check,
    CheckFailed,
    CollisionFound,
    Free,
    MotionPath,
    Positions,
)
from linked_fleet_gateway.extensions.world.path import (
    STEP_M,
    Path,
    UnknownPosition,
    configurations,
    joint_changes,
    path_of,
    times_along,
)
from linked_fleet_gateway.extensions.world.plane import driven_paths
from linked_fleet_gateway.extensions.world.robot import Robot
from linked_fleet_gateway.extensions.world.surfaces import Array
from linked_fleet_gateway.extensions.world.surroundings import (
    MARGIN_M,
    TOUCHING_M,
    MovingRobot,
    Shape,
    StaticBody,
    depth,
    distance,
    free_distance,
    map_bodies,
    meeting_point,
    object_bodies,
    other_robot_bodies,
    se3,
)
from linked_fleet_state.xml import Vector

CLEARANCE_M = 0.001  # half a step, so that parts that keep it at two neighbouring places do not touch between them
_NEAREST_M = 1e-5  # least margin of a pair that does not touch at the start
SLACK_M = 0.001  # the distance of a near pair that does not move varies by rounding
_MOST_PAIRS = 100_000
_WINDOW, _ROOM = 512, 1_000_000  # places evaluated ahead, and limit of the numbers that this takes
_TOO_LONG = "the check takes too long; split the motion"
_ALIGNED = 8  # places: pairs that are far apart are evaluated together

Indices = npt.NDArray[np.intp]


@dataclass
class _Pair:
    """A body of the robot and another body or a thing, which must keep the distance ``least_m``.

    With ``by_depth`` the limit is a penetration depth.
    """

    body: int
    other: int
    thing: StaticBody | None
    least_m: float
    by_depth: bool = False
    fine: bool = False  # its margin is so small that it might touch between two places of the path


Maps = Mapping[str, MapObstacles]
NO_MAPS: Maps = MappingProxyType({})


def check(
    asked: Check,
    robots: Mapping[str, Robot],
    objects: Mapping[str, coal.CollisionGeometry],
    maps: Maps = NO_MAPS,
) -> Answer:
    """Check the paths of a question; ``robots``, ``objects`` and ``maps`` are the prepared shapes by key."""
    ends_s = time.thread_time() + asked.within_s
    try:
        missing = [each.key for each in (asked.robot, *asked.robots) if each.key not in robots]
        if missing or any(each.key not in objects for each in asked.objects) or asked.map not in {"", *maps}:
            raise UnknownPosition("something of it has to be prepared again")
        if asked.driven is not None:
            asked = replace(asked, paths=(*asked.paths, *driven_paths(asked.driven)))
        asked, robots = with_held(asked, robots, objects)
        robot = robots[asked.robot.key]
        robot = robot.reaching(configurations(robot, asked.paths))
        coverage = Coverage(asked, robot, robots, maps)
        if (near := coverage.refusal(objects)) is not None:
            return near
        things = [*object_bodies(asked, objects), *other_robot_bodies(asked, robots, robot.radius_m)]
        things += map_bodies(asked, maps, robot.radius_m + MARGIN_M)
        answer = _Sweep(asked, robot, things, ends_s).answer()
        if isinstance(answer, Free):
            closest = find_closest(asked, robot, things) if asked.closest_within_s else None
            return Free(answer.samples, coverage.accepted(), bool(robot.bodies) or not robot.unchecked, closest)
        return answer
    except UnknownPosition as error:
        return CheckFailed(str(error))


def _centre(thing: StaticBody | None) -> Array:
    return np.zeros(3) if thing is None else thing.centre


class _Sweep:
    """The check of all pairs that may come near on any of the paths."""

    def __init__(self, asked: Check, robot: Robot, things: list[StaticBody], ends_s: float) -> None:
        self._ways, self._robot, self._things, self._ends_s = asked.paths, robot, things, ends_s
        self._in_time = asked.in_time
        self._base = se3(asked.robot.base)
        self._permission = Permission.of(asked, robot)
        start = asked.paths[0].start
        self._mover = MovingRobot(robot, start)
        gone = self._furthest(start)
        self._joints = tuple(name for name in gone if robot.model.existJointName(name))
        moving = {name for way in asked.paths[:1] for name in joint_changes(robot, way)}
        self._radii = np.array([body.radius for body in robot.bodies])
        # By joint and body: the most that the body can move per motion of the joint.
        self._reach = robot.reach_by_joint(self._joints)
        self._own = np.array([name in moving for name in self._joints], dtype=bool)
        self._gone = np.array([gone[name] for name in self._joints])
        self._pairs, weights = self._near_pairs()
        self._weights = np.array(weights).reshape(len(self._pairs), len(self._joints))
        self._bodies = np.array([pair.body for pair in self._pairs], dtype=np.intp)
        self._others = np.array([pair.other for pair in self._pairs], dtype=np.intp)
        self._fixed = np.array([pair.thing is not None for pair in self._pairs], dtype=bool)
        # Centres and radii of the things; those of the robot's own bodies differ from place to place.
        self._there = np.array([_centre(pair.thing) for pair in self._pairs]).reshape(len(self._pairs), 3)
        self._their_radii = np.array([0.0 if pair.thing is None else pair.thing.radius for pair in self._pairs])
        self._least = np.array([pair.least_m for pair in self._pairs])
        self._fine = np.array([pair.fine for pair in self._pairs], dtype=bool)
        self._looks = 0

    def _furthest(self, start: Positions) -> dict[str, float]:
        """Return the largest motion of each joint on any path, plus the distance between the starts of the paths."""
        found: dict[str, float] = {}
        for way in self._ways:
            gone = joint_changes(self._robot, way)
            for name, position in way.start.items():
                if position != start[name]:
                    gone[name] = gone.get(name, 0.0) + abs(position - start[name])
            found |= {name: max(way_m, found.get(name, 0.0)) for name, way_m in gone.items()}
        return found

    def _near_pairs(self) -> tuple[list[_Pair], list[Array]]:
        """Return the pairs that the motion may bring near, and by joint their approach per motion of the joint.

        Pairs that are near at the start may stay so.
        """
        centres = self._mover.centres(np.arange(len(self._robot.bodies)))
        found = [*self._near_things(centres), *self._near_own(centres)]
        if len(found) > _MOST_PAIRS:
            raise UnknownPosition("too many bodies are near it")
        kept = [(pair, weights) for pair, weights, gap in found if gap >= pair.least_m or self._settle(pair)]
        return [pair for pair, _ in kept], [weights for _, weights in kept]

    def _near_things(self, centres: Array) -> Iterator[tuple[_Pair, Array, float]]:
        if not self._things or not len(centres):
            return
        there = np.array([thing.centre for thing in self._things])
        radii = np.array([thing.radius for thing in self._things])
        driven = self._reach[self._own].any(axis=0) & self._robot.anchored
        for i in np.nonzero(driven)[0].tolist():
            gaps = np.linalg.norm(there - centres[i], axis=1) - radii - self._radii[i]
            for k in np.nonzero(gaps <= MARGIN_M + self._gone @ self._reach[:, i])[0].tolist():
                if self._permission.allows(i, self._things[k]):
                    continue
                yield _Pair(i, k, self._things[k], MARGIN_M), self._reach[:, i], float(gaps[k])

    def _near_own(self, centres: Array) -> Iterator[tuple[_Pair, Array, float]]:
        pairs = np.array(self._robot.pairs, dtype=np.intp).reshape(-1, 2)
        one, other = self._reach[:, pairs[:, 0]], self._reach[:, pairs[:, 1]]
        weights = np.where((one > 0) & (other > 0), 0.0, one + other)  # a joint below both moves them together
        apart = np.linalg.norm(centres[pairs[:, 0]] - centres[pairs[:, 1]], axis=1)
        gaps = apart - self._radii[pairs].sum(axis=1)
        near = (gaps <= CLEARANCE_M + self._gone @ weights) & weights[self._own].any(axis=0)
        for p in np.nonzero(near)[0].tolist():
            yield _Pair(int(pairs[p, 0]), int(pairs[p, 1]), None, CLEARANCE_M), weights[:, p], float(gaps[p])

    def _settle(self, pair: _Pair) -> bool:
        """Set the margin of a pair by its distance at the start. Return False if it is not checked."""
        if self._in_time and pair.thing is not None and pair.thing.from_s > 0.0:
            return True  # it is not there yet
        if time.thread_time() > self._ends_s:
            raise UnknownPosition(_TOO_LONG)
        one, other = self._shapes(pair)
        apart = free_distance(one, other, pair.least_m)
        if apart >= pair.least_m:
            return True
        solid = pair.thing is not None and one.surface is None and other.surface is None and other.hull is not None
        if apart > TOUCHING_M or solid:
            touch_m = -math.inf if solid else min(_NEAREST_M, apart / 2)  # the depth inside a surface is unknown
            pair.least_m = max(apart - SLACK_M, touch_m)
            pair.fine = apart > TOUCHING_M and pair.least_m < STEP_M / 2
            return True
        if pair.thing is None or other.hull is None:
            return False
        pair.by_depth, pair.least_m = True, depth(one, other) - SLACK_M
        return True

    def answer(self) -> Answer:
        for way in self._ways:
            path = path_of(self._robot, way, self._joints, self._weights)
            met = self._along(path, *self._met_at(path, way))
            if met is not None:
                pair, at = met
                return self._told(pair, round(at / path.steps, 3))
        return Free(self._looks)

    def _met_at(self, path: Path, way: MotionPath) -> tuple[Indices, Indices]:
        """Return the first and the last place of a path at which each pair may meet: the robot is there in its time.

        It stands at the start before, and at the end after its path.
        """
        first, last = np.zeros(len(self._pairs), dtype=np.intp), np.full(len(self._pairs), path.steps, dtype=np.intp)
        if not self._in_time:
            return first, last
        times_s = times_along(path, way)
        from_s, until_s = (
            np.array([end if pair.thing is None else getattr(pair.thing, name) for pair in self._pairs])
            for end, name in ((-math.inf, "from_s"), (math.inf, "until_s"))
        )
        first = np.clip(np.searchsorted(times_s, from_s, "right") - 1, 0, path.steps)
        return first, np.clip(np.searchsorted(times_s, until_s, "left"), 0, path.steps)

    def _along(self, path: Path, due: Indices, last: Indices) -> tuple[_Pair, int] | None:
        """Return the first pair that collides on a path, and the place; None if the path is free.

        ``due`` is the next place to check each pair, up to its ``last``, and ``seen`` the one before.
        """
        seen = due.copy()
        rooms = np.zeros(len(self._pairs))
        while len(due) and (at := int(due.min())) <= path.steps:
            now = np.nonzero(due <= at)[0]
            room, met = self._look(path, at, now)
            if met is not None:
                return met, at
            gone = ((path.accumulated[at] - path.accumulated[seen[now]]) * self._weights[now]).sum(axis=1)
            for n in now[self._fine[now] & (rooms[now] + room < gone)].tolist():
                if self._meets_between(path, at - 1, n):
                    return self._pairs[n], at
            then = at + self._places(path, at, now, room)
            seen[now], rooms[now], due[now] = at, room, np.where(then > last[now], path.steps + 1, then)
        return None

    def _look(self, path: Path, at: int, pairs: Indices) -> tuple[Array, _Pair | None]:
        """Return lower bounds of the free distance of each pair at a place (m), and a colliding pair or None."""
        self._stand(path, at)
        room = self._room(pairs)
        for n in np.nonzero(room <= 2 * STEP_M)[0].tolist():
            pair = self._pairs[pairs[n]]
            room[n] = self._exact_room(pair)
            if room[n] < 0:
                return room, pair
        return room, None

    def _stand(self, path: Path, at: int) -> None:
        if time.thread_time() > self._ends_s:
            raise UnknownPosition(_TOO_LONG)
        self._looks += 1
        self._mover.set_positions(dict(zip(path.joints, path.positions[at].tolist(), strict=True)))

    def _exact_room(self, pair: _Pair) -> float:
        one, other = self._shapes(pair)
        return (depth(one, other) if pair.by_depth else distance(one, other, pair.least_m)) - pair.least_m

    def _meets_between(self, path: Path, place: int, n: int) -> bool:
        """Check a pair between a place and the next, refining down to ``FINEST_M`` where it may collide."""
        finer = path.between(place)
        gone = finer.accumulated @ self._weights[n]
        rooms: dict[int, float] = {}
        pending = [(0, finer.steps)]
        while pending:
            low, high = pending.pop()
            for at in {low, high} - rooms.keys():
                self._stand(finer, at)
                rooms[at] = self._exact_room(self._pairs[n])
                if rooms[at] < 0:
                    return True
            if high - low > 1 and rooms[low] + rooms[high] < gone[high] - gone[low]:
                middle = (low + high) // 2
                pending += [(middle, high), (low, middle)]
        return False

    def _room(self, pairs: Indices) -> Array:
        """Return lower bounds of the free distance of each pair, by bounding spheres."""
        bodies, others, fixed = self._bodies[pairs], self._others[pairs], self._fixed[pairs]
        centres = self._mover.centres(np.concatenate([bodies, others[~fixed]]))
        there, radii = self._there[pairs], self._their_radii[pairs]
        there[~fixed], radii[~fixed] = centres[others[~fixed]], self._radii[others[~fixed]]
        apart: Array = np.linalg.norm(centres[bodies] - there, axis=1)
        found: Array = apart - self._radii[bodies] - radii - self._least[pairs]
        return found

    def _places(self, path: Path, at: int, pairs: Indices, room: Array) -> Indices:
        """Return the number of places until each pair must be checked again, given its free distance ``room``."""
        free = self._free_places(path, at, pairs, room, 4 * _ALIGNED)
        if len(further := np.nonzero(free == 4 * _ALIGNED)[0]):
            window = max(4 * _ALIGNED, min(_WINDOW, _ROOM // len(further)))
            free[further] = self._free_places(path, at, pairs[further], room[further], window)
        return np.where(free > 2 * _ALIGNED, (at + free) // _ALIGNED * _ALIGNED - at, free)

    def _free_places(self, path: Path, at: int, pairs: Indices, room: Array, window: int) -> Indices:
        """Return how many of the next places, this one included, each pair certainly does not collide at."""
        gone = (path.accumulated[at : at + window] - path.accumulated[at]) @ self._weights[pairs].T
        free: Indices = np.maximum(1, (gone <= room).sum(axis=0))
        return free

    def _shapes(self, pair: _Pair) -> tuple[Shape, Shape]:
        other = self._mover.shape(pair.other) if pair.thing is None else pair.thing.shape
        return self._mover.shape(pair.body), other

    def _point(self, pair: _Pair) -> Vector | None:
        """Return the point in the world at which a pair collides, at the present positions."""
        found = meeting_point(*self._shapes(pair))
        if found is None:
            return None
        x, y, z = (round(float(each), 4) for each in self._base.act(found))
        return x, y, z

    def _told(self, pair: _Pair, share: float) -> CollisionFound:
        bodies, point, thing = self._robot.bodies, self._point(pair), pair.thing
        mine = bodies[pair.body]
        if thing is None:
            other = bodies[pair.other]
            return CollisionFound(mine.link, "self", "", other.link, share, point, mine.held, other.held)
        return CollisionFound(mine.link, thing.kind, thing.name, thing.link, share, point, mine.held, thing.held)
