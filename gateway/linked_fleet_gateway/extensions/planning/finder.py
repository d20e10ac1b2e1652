"""The search for a path: RRT-Connect in the scene, shortened, as fast as allowed.

Several searches with other random numbers compete for a while, because the first path found is seldom the shortest.
The collision check judges the path after that, in a process of its own.
"""

import tempfile
import time
from collections.abc import Mapping
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import coal
import numpy as np
from msgspec.structs import replace
from roboplan.core import (
    JointConfiguration,
    JointPath,
    PathShortcutter,
    PathShortcuttingOptions,
    hasCollisionsAlongPath,
)
from roboplan.rrt import RRT, RRTOptions

from linked_fleet_gateway.extensions.planning.clearance import hindered, touched
from linked_fleet_gateway.extensions.planning.constrained import Corridor
from linked_fleet_gateway.extensions.planning.keeping import AXES, Keeper
from linked_fleet_gateway.extensions.planning.messages import BlockedAt, FindPath, NotFound, PathFound, PlanAnswer
from linked_fleet_gateway.extensions.planning.planner_scene import PlannerScene, SceneWriter
from linked_fleet_gateway.extensions.planning.refining import refined
from linked_fleet_gateway.extensions.planning.timing import Timed, fastest, quickly_timed_s
from linked_fleet_gateway.extensions.world.collision_check import Maps
from linked_fleet_gateway.extensions.world.held_bodies import Permission, with_held
from linked_fleet_gateway.extensions.world.messages import CollisionFound, MotionPath, PathSegment, Positions
from linked_fleet_gateway.extensions.world.path import configurations
from linked_fleet_gateway.extensions.world.robot import Robot
from linked_fleet_gateway.extensions.world.surfaces import Array
from linked_fleet_gateway.extensions.world.surroundings import (
    MARGIN_M,
    StaticBody,
    map_bodies,
    object_bodies,
    other_robot_bodies,
)

STEP = 0.05
"""Steps in the space of joints (rad, m) at which a path is compared with what is around."""
IMPROVING_S, MOST_IMPROVING_S = 0.05, 0.5
"""Time for further searches after the first path, which have at least as long as the first one took."""
_DETOUR, _PER_DETOUR_S = 1.2, 0.3
"""A path that is longer than this times the straight line gets this much more for each further length of the line."""
REFINING_S = 0.06
"""Time to refine the best path."""
_ENOUGH = 1.03
"""A path no longer than this times the straight line is not searched for again."""
_MOST_TRIES = 24
_SHORTER_TRIES = 60
_FIRST_SHARE = 0.4
"""Share of the time for the first search: a second one with other random numbers may be luckier."""


_STANDING, _STANDING_S = 1e-6, 0.1
"""Nearer than this (rad or m) a goal is where the robot stands; its motion lasts this long."""


class _Candidate(NamedTuple):
    path: JointPath
    duration_s: float
    length: float
    direct: float
    timed: Timed | None = None
    """The motion along the path, if it was timed to see whether it keeps to constraints."""


def find(
    asked: FindPath, robots: Mapping[str, Robot], objects: Mapping[str, coal.CollisionGeometry], maps: Maps
) -> PlanAnswer:
    """Answer a question; ``robots``, ``objects`` and ``maps`` are the prepared shapes by key."""
    ends_s = time.monotonic() + asked.within_s
    around, robots = with_held(asked.around, robots, objects)
    asked, start = replace(asked, around=around), around.paths[0].start
    ways = [MotionPath(start, (PathSegment(goal),)) for goal in asked.goals]
    robot = robots[around.robot.key]
    robot = robot.reaching(configurations(robot, ways))
    things = [*object_bodies(around, objects), *other_robot_bodies(around, robots, robot.radius_m)]
    things += map_bodies(around, maps, robot.radius_m + MARGIN_M)
    goals, blocked = _free_goals(asked, robot, things)
    if not goals:
        assert blocked is not None
        return BlockedAt("goal", blocked)
    keeper = Keeper(around, robot, asked.keeps, tuple(asked.bounds)) if asked.keeps.tip else None
    if keeper is not None:
        kept = [(goal, keeper.broken_at(goal, 1.0)) for goal in goals]
        broken = keeper.broken_at(start, 0.0) or next((each for _, each in kept if each is not None), None)
        goals = [goal for goal, each in kept if each is None]
        if broken is not None and (broken.share == 0.0 or not goals):
            return broken
    with tempfile.TemporaryDirectory(prefix="linked-fleet-plan-") as folder:
        writer = SceneWriter(robot, start, asked.bounds, Path(folder))
        if keeper is not None:
            writer.add_tip(asked.keeps.tip, AXES[keeper.axis])
        scene = writer.build(things, goals, Permission.of(around, robot))
        answer = _Search(asked, robot, scene, ends_s).answer(goals)
    near = hindered(around, robot, things, start, asked.bounds)
    if near is None:
        return answer
    return replace(answer, near=near) if isinstance(answer, PathFound) else BlockedAt("start", near)


def _free_goals(
    asked: FindPath, robot: Robot, things: list[StaticBody]
) -> tuple[list[Positions], CollisionFound | None]:
    """Return the goals at which the robot touches nothing, and what it touches at the first other one."""
    start, met = asked.around.paths[0].start, None
    found: list[Positions] = []
    for goal in asked.goals:
        there = touched(asked.around, robot, things, start, goal)
        if there is None:
            found.append(goal)
        met = met or there
    return found, met


class _Search:
    """The searches for one question."""

    def __init__(self, asked: FindPath, robot: Robot, made: PlannerScene, ends_s: float) -> None:
        self._asked, self._scene, self._joints, self._ends_s = asked, made.scene, made.joints, ends_s
        self._names = made.scene.getJointNames()
        self._start = self._row(asked.around.paths[0].start)
        self._speeds = np.array([asked.bounds[name].speed for name in self._joints])
        self._keeper = Keeper(asked.around, robot, asked.keeps, made.joints) if asked.keeps.tip else None
        self._corridor: Corridor | None = None
        self._tries = 0

    def answer(self, goals: list[Positions]) -> PathFound | NotFound:
        rows = sorted(map(self._row, goals), key=self._far)
        if self._far(rows[0]) < _STANDING:
            return self._standing(rows[0])
        keeps = self._asked.keeps
        if keeps.shape_the_path:
            self._corridor = Corridor(self._scene, self._asked.around, keeps, [self._start, *rows], STEP)
        best = self._best(rows)
        timed = None if best is None else best.timed or self._timed(best.path)
        if best is None or timed is None:
            return NotFound()
        least = None
        if self._keeper is not None:
            timed = self._keeper.slowed(timed)
            least = self._keeper.least(timed)
        found = tuple(tuple(row) for row in timed.positions.tolist())
        times_s = tuple(timed.times_s.tolist()[1:])
        return PathFound(self._joints, times_s, found[1:], best.length, best.direct, self._tries, least)

    def _standing(self, goal: Array) -> PathFound:
        """Return the motion to where the robot stands, which has no length and could not be timed."""
        timed = Timed([0.0, _STANDING_S], np.array([self._start, goal]))
        least = None if self._keeper is None else self._keeper.least(timed)
        return PathFound(self._joints, (_STANDING_S,), (tuple(goal.tolist()),), 0.0, 0.0, self._tries, least)

    def _timed(self, path: JointPath) -> Timed | None:
        """Return the fastest motion along a path, or one beside it."""
        within_s = min(REFINING_S, self._ends_s - time.monotonic())
        quicker = refined(self._scene, path, self._speeds, STEP, within_s, self._asked.seed)
        return fastest(self._scene, path, self._speeds, refined=None if quicker is path else quicker)

    def _far(self, goal: Array) -> float:
        return float(np.abs(goal - self._start).max())

    def _best(self, goals: list[Array]) -> _Candidate | None:
        """Return the fastest of the paths that several searches find; None if none was found in time."""
        best: _Candidate | None = None
        began_s = first_s = time.monotonic()
        ends_s = self._ends_s
        most = len(goals) if len(self._joints) == 1 else _MOST_TRIES
        while time.monotonic() < ends_s and self._tries < most:
            found = self._candidate(goals[self._tries % len(goals)])
            if found is None:
                continue
            if best is None:
                first_s = time.monotonic()
            if best is None or found.duration_s < best.duration_s:
                best = found
            if best.length <= _ENOUGH * best.direct:
                break
            ends_s = min(self._ends_s, first_s + max(first_s - began_s, _worth_s(best)))
        return best

    def _candidate(self, goal: Array) -> _Candidate | None:
        path, timed = self._path(goal), None
        if path is not None and self._corridor is not None:
            timed = fastest(self._scene, path, self._speeds, self._keeps)
            duration_s = None if timed is None else timed.duration_s
        else:
            duration_s = None if path is None else quickly_timed_s(self._scene, path)
        if path is None or duration_s is None:
            return None
        points = [np.array(each) for each in path.positions]
        length = sum(float(np.linalg.norm(after - before)) for before, after in pairwise(points))
        return _Candidate(path, duration_s, length, float(np.linalg.norm(goal - self._start)), timed)

    def _keeps(self, timed: Timed) -> bool:
        return self._keeper is None or self._keeper.judged(timed) is None

    def _path(self, goal: Array) -> JointPath | None:
        """Return a path that the scene finds free, shortened; None if none was found in time."""
        self._tries += 1
        if (self._tries == 1 or len(self._joints) == 1) and self._is_free(self._start, goal):
            straight = JointPath()
            straight.joint_names, straight.positions = self._names, [self._start, goal]
            return straight
        left_s = self._ends_s - time.monotonic()
        if left_s <= 0.0 or len(self._joints) == 1:  # one joint has no other path
            return None
        seed = self._asked.seed + self._tries
        rrt = RRT(self._scene, self._options(left_s * (_FIRST_SHARE if self._tries == 1 else 1.0)))
        rrt.setRngSeed(seed)
        try:
            start, end = (JointConfiguration(self._names, each) for each in (self._start, goal))
            found = rrt.plan(start, end, [] if self._corridor is None else self._corridor.constraints)
        except RuntimeError:  # not in time
            return None
        if self._corridor is not None:
            return self._corridor.shortened(found, seed)
        shorter = PathShortcuttingOptions(max_step_size=STEP, max_iters=_SHORTER_TRIES, seed=seed)
        return PathShortcutter(self._scene, shorter).shortcut(found)

    def _is_free(self, one: Array, other: Array) -> bool:
        if self._corridor is not None:
            return self._corridor.contains(one, other)
        return not hasCollisionsAlongPath(self._scene, one, other, STEP)

    def _options(self, within_s: float) -> RRTOptions:
        return RRTOptions(
            max_nodes=1_000_000,
            max_connection_distance=1.0,
            collision_check_step_size=STEP,
            max_planning_time=within_s,
            rrt_connect=True,
        )

    def _row(self, positions: Positions) -> Array:
        return np.array([positions[name] for name in self._joints])


def _worth_s(best: _Candidate) -> float:
    """Return the time for further searches: more after a long way round, because another one may be shorter."""
    detour = best.length / max(best.direct, 1e-6) - _DETOUR
    return min(MOST_IMPROVING_S, IMPROVING_S + max(detour, 0.0) * _PER_DETOUR_S)
