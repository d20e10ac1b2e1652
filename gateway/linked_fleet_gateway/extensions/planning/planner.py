"""Paths of motions round what is in the way: the questions to the process that plans, and what its answers mean."""

import logging
import math
import time
from collections import Counter
from pathlib import Path as FilePath

import msgspec
from msgspec.structs import replace

from linked_fleet_agent.urdf.cruise import RAMP_S, cruise_of
from linked_fleet_agent.urdf.facts import JointFacts
from linked_fleet_agent.wire.messages import Expectation, Follow, Move
from linked_fleet_gateway.api import Busy, Conflict, Core, Motion, Robot
from linked_fleet_gateway.base.errors import MotionRefused
from linked_fleet_gateway.extensions.models.meshes import Meshes
from linked_fleet_gateway.extensions.planning.errors import GoalBlocked, NoPathFound
from linked_fleet_gateway.extensions.planning.messages import (
    BlockedAt,
    FindPath,
    JointBounds,
    NotFound,
    PathFound,
    PlanAnswer,
    PlanFailed,
)
from linked_fleet_gateway.extensions.planning.terms import LF
from linked_fleet_gateway.extensions.world.collisions import Collides, Unchecked
from linked_fleet_gateway.extensions.world.messages import Answer, Check, CollisionFound
from linked_fleet_gateway.extensions.world.placement import has_placement
from linked_fleet_gateway.extensions.world.process import Checker, Preparation
from linked_fleet_gateway.extensions.world.service import World
from linked_fleet_gateway.fleet.model import JointKind
from linked_fleet_gateway.serving import Caller, NoReply

_log = logging.getLogger(__name__)

MODULE = "linked_fleet_gateway.extensions.planning.planning_process"
SEARCH_S, MOST_SEARCH_S = 2.0, 20.0
"""The time for a search, by default and at most."""
_ANSWER_S = 5.0
"""What an answer may take beside the search: a turn, the scene, and the timing of the path."""
MOST_WAITING, MOST_OF_ONE = 16, 4
"""Motions that wait for a plan, of all callers and of one."""
_MOST_PATHS = 4
"""Paths of one motion that the check of motions judges."""
STILL_RAD, STILL_M = 0.01, 0.001
"""How far a joint may be from where its path begins when the robot gets the command."""
_SEEDS = 1_000


class PlannerProcess(Checker):
    """The process that plans motions; its shapes are prepared as those of the check."""

    def __init__(self, folder: FilePath) -> None:
        super().__init__(folder, module=MODULE, answers=msgspec.msgpack.Decoder(Answer | PlanAnswer))

    async def find(self, asked: FindPath) -> PlanAnswer:
        """Return the answer to a question."""
        try:
            answer: PlanAnswer = await self._process.ask(asked, asked.within_s + _ANSWER_S)
        except NoReply:
            self._forget()
            return PlanFailed("the process that plans motions gave no answer in time")
        return answer


class Planner:
    """Implements ``MotionPlanner``. It must be closed."""

    def __init__(self, core: Core, world: World, meshes: Meshes, folder: FilePath) -> None:
        self._core, self._checks = core, world.checks
        self._process = PlannerProcess(folder)
        self._preparation = Preparation(core.live, meshes, self._process)
        self._nearby, self._questions = world.checks.asked_elsewhere(self._preparation)
        self._waiting = Counter[str]()

    async def close(self) -> None:
        await self._preparation.close()
        await self._process.close()

    def paths(self, motion: Motion, caller: Caller, own_id: str) -> "PlannedPaths | None":
        """Return the paths of a motion that asks for another one than the direct one, or that may take one."""
        if not isinstance(motion.motion, Move) or motion.request is None:
            return None
        body = motion.request.body
        asked, reaches = body.node(body.root, LF.path), body.node(body.root, LF.ofLink) is not None
        if asked == LF.Planned and not has_placement(motion.robot):
            raise Conflict(
                f"{motion.robot.name} has no placement in the world, so it is unknown what is in its way: PUT its "
                "placement, or leave lf:path out."
            )
        if asked == LF.Planned or (asked is None and reaches):
            return PlannedPaths(self, motion, caller, own_id)
        return None

    async def plan(self, motion: Motion, caller: Caller, own_id: str, seed: int, because: str) -> Motion:
        """Return the motion on a path that was found. Raises MotionRefused, Conflict, Busy."""
        if self._waiting.total() >= MOST_WAITING or self._waiting[caller.name] >= MOST_OF_ONE:
            raise Busy("Too many motions are being planned; ask again.")
        self._waiting[caller.name] += 1
        began_ns = time.monotonic_ns()
        try:
            answer, asked = await self._asked(motion, caller, own_id, seed)
        finally:
            self._waiting -= Counter([caller.name])
        planned = self._on_path(motion, answer, asked)
        computing_ns = motion.computing_ns + time.monotonic_ns() - began_ns
        return replace(planned, computing_ns=computing_ns, detour=because)

    async def _asked(self, motion: Motion, caller: Caller, own_id: str, seed: int) -> tuple[PlanAnswer, FindPath]:
        robot, sees = motion.robot, caller.visible_robots
        with self._process.in_use():
            if (why := await self._nearby.prepare(self._nearby.around(robot, sees))) is not None:
                raise Unchecked(why)
            robots = self._nearby.prepared_around(robot, sees)
            self._check_still(motion, own_id)
            around = self._questions.about(motion, robots, sees, own_id)
            within_s = min(max(caller.patience_s or SEARCH_S, SEARCH_S), MOST_SEARCH_S)
            asked = FindPath(around, self._bounds(motion, around), (dict(motion.targets),), within_s, seed)
            return await self._process.find(asked), asked

    def _check_still(self, motion: Motion, own_id: str) -> None:
        """Check that no other motion moves the joints, because a path begins where they stand. Raises Conflict."""
        for each in self._core.live.invocations.open_of_robot(motion.robot.name):
            moving = each.targets.keys() & motion.targets.keys() if each.id != own_id else ()
            if moving:
                raise Conflict(
                    f"{min(moving)} of {motion.robot.name} is moving, and a planned path begins where it stands: stop "
                    "it, or wait until it stands."
                )

    def _bounds(self, motion: Motion, around: Check) -> dict[str, JointBounds]:
        start = around.paths[0].start
        return {
            name: bounds_of(motion.robot, name, start[name], goal, motion.speed_scale)
            for name, goal in motion.targets.items()
        }

    def _on_path(self, motion: Motion, answer: PlanAnswer, asked: FindPath) -> Motion:
        robot = motion.robot
        if isinstance(answer, PlanFailed):
            raise Unchecked(f"No path of {robot.name} could be planned: {answer.reason}.")
        if isinstance(answer, BlockedAt):
            met = self._met(robot, answer.by)
            what = met.names[1] if len(met.names) > 1 else "another robot"
            detail = f"The goal is blocked: {answer.by.link} of {robot.name} would meet {what} there."
            raise GoalBlocked(detail, reason="something is where it would end", met=met)
        if isinstance(answer, NotFound):
            detail = (
                f"No path of {robot.name} was found in {asked.within_s:g} s. There may be one: give the search more "
                f"time by Prefer: wait, of which up to {MOST_SEARCH_S:g} s are used, or move in steps."
            )
            raise NoPathFound(detail, reason="no path was found in time")
        assert isinstance(answer, PathFound)
        start, linear = asked.around.paths[0].start, self._linear(robot)
        stands = {
            name: Expectation(start[name], STILL_M if name in linear else STILL_RAD)
            for name in answer.joints
            if name not in motion.expectations
        }
        follow = Follow(answer.joints, answer.times_s, answer.positions)
        return replace(motion, motion=follow, expectations={**stands, **motion.expectations})

    def _met(self, robot: Robot, by: CollisionFound) -> Collides:
        return self._checks.collision(robot, by)

    def _linear(self, robot: Robot) -> set[str]:
        joints = {} if robot.model is None else robot.model.joints
        return {name for name, joint in joints.items() if joint.kind is JointKind.PRISMATIC}


class PlannedPaths:
    """Implements ``Paths``: the direct one, and planned ones if something is in its way."""

    def __init__(self, planner: Planner, motion: Motion, caller: Caller, own_id: str) -> None:
        self._planner, self._motion, self._caller, self._own_id = planner, motion, caller, own_id
        self._given, self._because = 0, ""

    async def next(self, refused: MotionRefused | None) -> Motion | None:
        """Return the motion on its next path; None after the last one."""
        if refused is None:
            return self._motion
        if self._given == _MOST_PATHS or not isinstance(refused, Collides):
            return None
        self._given += 1
        self._because = self._because or f"on the direct path {refused.reason}"
        return await self._planner.plan(self._motion, self._caller, self._own_id, self._given * _SEEDS, self._because)


def bounds_of(robot: Robot, name: str, start: float, goal: float, scale: float) -> JointBounds:
    """Return what a joint may do on a path: as fast as its agent lets it move, and as fast to that speed."""
    assert robot.model is not None
    joint = robot.model.joints[name]
    linear, continuous = joint.kind is JointKind.PRISMATIC, joint.kind is JointKind.CONTINUOUS
    speed = cruise_of(JointFacts(name, linear, joint.limits)) * scale
    low, high = joint.limits.lower, joint.limits.upper
    if continuous or low is None or high is None:
        low, high = min(start, goal) - math.pi, max(start, goal) + math.pi
    return JointBounds(min(low, start, goal), max(high, start, goal), speed, speed / RAMP_S)
