"""Collision check of a path. No obstacle is passed by, however thin it is or however fast the motion.

Runs in the process that checks motions. The margin is kept to objects and other robots, and ``CLEARANCE_M`` between
parts of the robot itself. A pair that is further apart is looked at again when it may have come so near: no pair comes
nearer by more than its joints go, each times its reach. So no contact is between two looks.

What is nearer than that at the start already may stay so, and may not come nearer: so a robot that stands in a zone
moves out, and not further in. Parts of the robot may come nearer than they are, but not touch: where they might have
touched between two looks, they are looked at again, at most every ``FINEST_M``, so that no contact is deeper than half
of that. Those that touch each other at the start are left to themselves.
"""

import math
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import coal
import numpy as np
import numpy.typing as npt

from linked_fleet_gateway.extensions.world.contact import Shape, depth, distance, is_inside, meeting_point
from linked_fleet_gateway.extensions.world.messages import Answer, Check, Free, Kind, Meets, Positions, Unable
from linked_fleet_gateway.extensions.world.path import STEP_M, Path, Unknown, changed, path_of
from linked_fleet_gateway.extensions.world.robot import Robot
from linked_fleet_gateway.extensions.world.surfaces import Array
from linked_fleet_gateway.extensions.world.surroundings import MARGIN_M, Mover, Thing, objects_of, others_of, se3
from linked_fleet_gateway.fleet.xml import Vector

CLEARANCE_M = 0.001  # half a step, so that parts that keep it at two neighbouring places do not touch between them
_TOUCHING_M = 1e-9  # rounding: what is further apart does not touch
_NEAREST_M = 1e-5  # of what does not touch at the start
_SLACK_M = 0.001  # what was near and does not move comes nearer by rounding
_MOST_PAIRS = 100_000
_WINDOW, _ROOM = 512, 1_000_000  # places that are looked ahead, and numbers that this may take
_TOO_LONG = "it takes too long to be checked; go it in parts"
_ALIGNED = 8  # places: pairs that are far apart are looked at together

Indices = npt.NDArray[np.intp]


@dataclass
class _Pair:
    """A body of the robot, and another one or a thing, which keep ``least_m`` of distance, or of depth ``by_depth``."""

    body: int
    other: int
    thing: Thing | None
    least_m: float
    by_depth: bool = False
    fine: bool = False  # it keeps so little that it might touch between two places of the path


def check(asked: Check, robots: Mapping[str, Robot], objects: Mapping[str, coal.CollisionGeometry]) -> Answer:
    """``robots`` and ``objects`` are what was prepared, by key."""
    ends_s = time.thread_time() + asked.within_s
    try:
        missing = [each.key for each in (asked.robot, *asked.robots) if each.key not in robots]
        if missing or any(each.key not in objects for each in asked.objects):
            raise Unknown("something of it has to be prepared again")
        robot = robots[asked.robot.key]
        things = [*objects_of(asked, objects), *others_of(asked, robots)]
        return _Sweep(asked, robot, things, ends_s).answer()
    except Unknown as error:
        return Unable(str(error))


class _Sweep:
    """Every pair that may come near on any of the ways."""

    def __init__(self, asked: Check, robot: Robot, things: list[Thing], ends_s: float) -> None:
        self._ways, self._robot, self._things, self._ends_s = asked.ways, robot, things, ends_s
        self._base = se3(asked.robot.base)
        start = asked.ways[0].start
        self._mover = Mover(robot, start)
        gone = self._furthest(start)
        self._joints = tuple(name for name in gone if robot.model.existJointName(name))
        moving = {name for way in asked.ways[:1] for name in changed(robot, way)}
        self._radii = np.array([body.radius for body in robot.bodies])
        # By joint that moves and body: how far the body goes at most with what the joint goes.
        ids = [robot.model.getJointId(name) for name in self._joints]
        slides = np.array([robot.tree.joints[name].kind == "prismatic" for name in self._joints], dtype=bool)
        reach = robot.reach_m[ids].reshape(len(ids), len(robot.bodies))
        self._reach = np.where(slides[:, None], (reach > 0).astype(float), reach)
        self._own = np.array([name in moving for name in self._joints], dtype=bool)
        self._gone = np.array([gone[name] for name in self._joints])
        self._pairs, weights = self._near_pairs()
        self._weights = np.array(weights).reshape(len(self._pairs), len(self._joints))
        self._bodies = np.array([pair.body for pair in self._pairs], dtype=np.intp)
        self._others = np.array([pair.other for pair in self._pairs], dtype=np.intp)
        self._fixed = np.array([pair.thing is not None for pair in self._pairs], dtype=bool)
        self._least = np.array([pair.least_m for pair in self._pairs])
        self._fine = np.array([pair.fine for pair in self._pairs], dtype=bool)
        self._looks = 0

    def _furthest(self, start: Positions) -> dict[str, float]:
        """By joint the most that it goes on any of the ways, with what lies between their starts."""
        found: dict[str, float] = {}
        for way in self._ways:
            gone = changed(self._robot, way)
            for name, position in way.start.items():
                if position != start[name]:
                    gone[name] = gone.get(name, 0.0) + abs(position - start[name])
            found |= {name: max(way_m, found.get(name, 0.0)) for name, way_m in gone.items()}
        return found

    def _near_pairs(self) -> tuple[list[_Pair], list[Array]]:
        """Pairs that the motion may bring near each other, and their weights: by joint how much nearer by what it goes.

        Those that are near at the start already may stay so.
        """
        centres = self._mover.centres(np.arange(len(self._robot.bodies)))
        found = [*self._near_things(centres), *self._near_own(centres)]
        if len(found) > _MOST_PAIRS:
            raise Unknown("there is too much around it")
        kept = [(pair, weights) for pair, weights, gap in found if gap >= pair.least_m or self._settle(pair)]
        return [pair for pair, _ in kept], [weights for _, weights in kept]

    def _near_things(self, centres: Array) -> Iterator[tuple[_Pair, Array, float]]:
        if not self._things or not len(centres):
            return
        there = np.array([thing.centre for thing in self._things])
        radii = np.array([thing.radius for thing in self._things])
        driven = self._reach[self._own].any(axis=0)
        for i in np.nonzero(driven)[0].tolist():
            gaps = np.linalg.norm(there - centres[i], axis=1) - radii - self._radii[i]
            for k in np.nonzero(gaps <= MARGIN_M + self._gone @ self._reach[:, i])[0].tolist():
                yield _Pair(i, k, self._things[k], MARGIN_M), self._reach[:, i], float(gaps[k])

    def _near_own(self, centres: Array) -> Iterator[tuple[_Pair, Array, float]]:
        pairs = np.array(self._robot.pairs, dtype=np.intp).reshape(-1, 2)
        one, other = self._reach[:, pairs[:, 0]], self._reach[:, pairs[:, 1]]
        weights = np.where((one > 0) & (other > 0), 0.0, one + other)  # a joint below both moves them alike
        apart = np.linalg.norm(centres[pairs[:, 0]] - centres[pairs[:, 1]], axis=1)
        gaps = apart - self._radii[pairs].sum(axis=1)
        near = (gaps <= CLEARANCE_M + self._gone @ weights) & weights[self._own].any(axis=0)
        for p in np.nonzero(near)[0].tolist():
            yield _Pair(int(pairs[p, 0]), int(pairs[p, 1]), None, CLEARANCE_M), weights[:, p], float(gaps[p])

    def _settle(self, pair: _Pair) -> bool:
        """Return the margin that the pair has to keep, by its distance at the start, and if it is checked."""
        if time.thread_time() > self._ends_s:
            raise Unknown(_TOO_LONG)
        one, other = self._shapes(pair)
        apart = distance(one, other, pair.least_m)
        if apart > _TOUCHING_M and (is_inside(one, other) or is_inside(other, one)):
            apart = 0.0
        if apart >= pair.least_m:
            return True
        solid = pair.thing is not None and one.surface is None and other.surface is None and other.hull is not None
        if apart > _TOUCHING_M or solid:
            touch_m = -math.inf if solid else min(_NEAREST_M, apart / 2)  # how deep it is inside a surface is not known
            pair.least_m = max(apart - _SLACK_M, touch_m)
            pair.fine = apart > _TOUCHING_M and pair.least_m < STEP_M / 2
            return True
        if pair.thing is None or other.hull is None:
            return False
        pair.by_depth, pair.least_m = True, depth(one, other) - _SLACK_M
        return True

    def answer(self) -> Answer:
        for way in self._ways:
            path = path_of(self._robot, way, self._joints, self._weights)
            met = self._along(path)
            if met is not None:
                pair, at = met
                link, kind, name, other = self._told(pair)
                return Meets(link, kind, name, other, round(at / path.steps, 3), self._point(pair))
        return Free(self._looks)

    def _along(self, path: Path) -> tuple[_Pair, int] | None:
        """The first pair that meets on a path, and the place.

        ``due`` is the place at which each pair is to be looked at next, ``seen`` where it was last.
        """
        due, seen = np.zeros((2, len(self._pairs)), dtype=np.intp)
        rooms = np.zeros(len(self._pairs))
        while len(due) and (at := int(due.min())) <= path.steps:
            now = np.nonzero(due <= at)[0]
            room, met = self._look(path, at, now)
            if met is not None:
                return met, at
            gone = ((path.gone[at] - path.gone[seen[now]]) * self._weights[now]).sum(axis=1)
            for n in now[self._fine[now] & (rooms[now] + room < gone)].tolist():
                if self._meets_between(path, at - 1, n):
                    return self._pairs[n], at
            seen[now], rooms[now], due[now] = at, room, at + self._places(path, at, now, room)
        return None

    def _look(self, path: Path, at: int, pairs: Indices) -> tuple[Array, _Pair | None]:
        """Return lower bounds of the room that each pair has at a place, and a pair that has none; metres."""
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
            raise Unknown(_TOO_LONG)
        self._looks += 1
        self._mover.stand(dict(zip(path.joints, path.positions[at].tolist(), strict=True)))

    def _exact_room(self, pair: _Pair) -> float:
        one, other = self._shapes(pair)
        return (depth(one, other) if pair.by_depth else distance(one, other, pair.least_m)) - pair.least_m

    def _meets_between(self, path: Path, place: int, n: int) -> bool:
        """Check a pair between a place and the next: wherever it may have used up its room, down to ``FINEST_M``."""
        finer = path.between(place)
        gone = finer.gone @ self._weights[n]
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
        """How far each pair is from what it has to keep, at least, by the balls around both."""
        bodies, others, fixed = self._bodies[pairs], self._others[pairs], self._fixed[pairs]
        centres = self._mover.centres(np.concatenate([bodies, others[~fixed]]))
        there, radii = np.zeros((len(pairs), 3)), np.zeros(len(pairs))
        there[~fixed], radii[~fixed] = centres[others[~fixed]], self._radii[others[~fixed]]
        for n in np.nonzero(fixed)[0].tolist():
            there[n], radii[n] = self._things[others[n]].centre, self._things[others[n]].radius
        apart: Array = np.linalg.norm(centres[bodies] - there, axis=1)
        found: Array = apart - self._radii[bodies] - radii - self._least[pairs]
        return found

    def _places(self, path: Path, at: int, pairs: Indices, room: Array) -> Indices:
        """In how many places each pair is to be looked at again: where it may first have used up its ``room``."""
        window = max(2 * _ALIGNED, min(_WINDOW, _ROOM // len(pairs)))
        gone = (path.gone[at : at + window] - path.gone[at]) @ self._weights[pairs].T
        free: Indices = np.maximum(1, (gone <= room).sum(axis=0))
        return np.where(free > 2 * _ALIGNED, (at + free) // _ALIGNED * _ALIGNED - at, free)

    def _shapes(self, pair: _Pair) -> tuple[Shape, Shape]:
        other = self._mover.shape(pair.other) if pair.thing is None else pair.thing.shape
        return self._mover.shape(pair.body), other

    def _point(self, pair: _Pair) -> Vector | None:
        """The point in the world at which a pair meets, as the robot stands now."""
        found = meeting_point(*self._shapes(pair))
        if found is None:
            return None
        x, y, z = (round(float(each), 4) for each in self._base.act(found))
        return x, y, z

    def _told(self, pair: _Pair) -> tuple[str, Kind, str, str]:
        bodies = self._robot.bodies
        if pair.thing is None:
            return bodies[pair.body].link, "self", "", bodies[pair.other].link
        return bodies[pair.body].link, pair.thing.kind, pair.thing.name, pair.thing.link
