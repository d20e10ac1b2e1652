"""Paths of motions round what is in the way: the questions to the process that plans, and what its answers mean."""

import asyncio
import math
from collections import Counter
from contextlib import suppress
from functools import partial
from pathlib import Path as FilePath
from random import Random
from typing import NamedTuple

import msgspec
from msgspec.structs import replace

from linked_fleet_agent.urdf.cruise import RAMP_S
from linked_fleet_agent.wire.messages import Follow, Move
from linked_fleet_base.errors import FleetError, MotionRefused
from linked_fleet_gateway.api import Busy, Conflict, Core, Motion, Pose, Robot, UnprocessableContent
from linked_fleet_gateway.extensions.models.meshes import Meshes
from linked_fleet_gateway.extensions.planning.constraints import carried, constraints_of, is_constrained, refusal
from linked_fleet_gateway.extensions.planning.errors import GoalBlocked, LineLeaves, NoPathFound, StartBlocked
from linked_fleet_gateway.extensions.planning.kept_path import KeptPath, keep, moving_joint
from linked_fleet_gateway.extensions.planning.kept_plans import KeptPlans, plan_of
from linked_fleet_gateway.extensions.planning.messages import (
    BlockedAt,
    Broken,
    FindPath,
    FindStraight,
    JointBounds,
    LineEnds,
    NotFound,
    PathFound,
    PlanAnswer,
    PlanFailed,
    PlanQuestion,
    StraightFound,
)
from linked_fleet_gateway.extensions.planning.terms import LF
from linked_fleet_gateway.extensions.planning.waiting import MOST_WAIT_S, Waits, standing
from linked_fleet_gateway.extensions.reach.extension import prepare_search
from linked_fleet_gateway.extensions.world.collisions import Collides, Unchecked
from linked_fleet_gateway.extensions.world.messages import Answer, Check, Positions
from linked_fleet_gateway.extensions.world.nearby import EARLY_S
from linked_fleet_gateway.extensions.world.placement import has_placement
from linked_fleet_gateway.extensions.world.process import Checker, Preparation
from linked_fleet_gateway.extensions.world.service import World
from linked_fleet_gateway.serving import Caller, MotionPlanner, NoReply, Paths
from linked_fleet_rdf.graph import Node
from linked_fleet_state.kept_plan import KeptPlan
from linked_fleet_state.kinematics import compose
from linked_fleet_state.model import JointKind
from linked_fleet_state.pace import speed_of

MODULE = "linked_fleet_gateway.extensions.planning.planning_process"
SEARCH_S, MOST_SEARCH_S = 2.0, 20.0
"""The time for a search, by default and at most."""
_ANSWER_S = 5.0
"""Time that an answer may take beside the search: a turn, the scene, and the timing of the path."""
MOST_WAITING, MOST_OF_ONE = 16, 4
"""Motions that wait for a plan, of all callers and of one."""
MOST_S = 3600
"""The longest trajectory that an agent takes, in seconds."""
_MOST_PATHS = 4
"""Paths of one motion that the check of motions judges."""
_SEEDS = 1_000
_AT_START = 0.05
"""Share of a path that is its start."""
_MOST_GOALS, _OTHER = 12, 0.1
"""Searches for other positions that reach a pose, and how far (rad, m) one joint of these is from the known ones."""
UPRIGHT = (0.0, 0.0, 0.0, 1.0)


class Search(NamedTuple):
    """A search: the seed of its random numbers, and its time in seconds."""

    seed: int
    within_s: float


class Planned(NamedTuple):
    """A motion on a path that was found, and its refusal if the check refuses it for what is near its start."""

    motion: Motion
    stuck: MotionRefused | None


class PlannerProcess(Checker):
    """The process that plans motions; its shapes are prepared as those of the check."""

    def __init__(self, folder: FilePath) -> None:
        super().__init__(folder, module=MODULE, answers=msgspec.msgpack.Decoder(Answer | PlanAnswer))

    async def find(self, asked: PlanQuestion) -> PlanAnswer:
        """Return the answer to a question."""
        within_s = asked.within_s if isinstance(asked, FindPath) else 0.0
        try:
            answer: PlanAnswer = await self._process.ask(asked, within_s + _ANSWER_S)
        except NoReply:
            self._forget()
            return PlanFailed("the process that plans motions gave no answer in time")
        return answer


class Planner(MotionPlanner):
    """The planner of the gateway. It must be closed."""

    def __init__(self, core: Core, world: World, meshes: Meshes, folder: FilePath) -> None:
        self._core, self._checks = core, world.checks
        self._process, self.plans = PlannerProcess(folder), KeptPlans(core.redis_url, core.namespace)
        self._preparation = Preparation(core.live, meshes, self._process)
        self._nearby, self._questions = world.checks.asked_elsewhere(self._preparation)
        self._waiting = Counter[str]()

    async def close(self) -> None:
        await self._preparation.close()
        await self._process.close()
        await self.plans.close()

    def waits(self, motion: Motion, own_id: str) -> Waits:
        """Return the direct path of a motion after waits."""
        return Waits(self._questions, motion, own_id)

    def paths(self, motion: Motion, caller: Caller, own_id: str) -> "PlannedPaths | KeptPath | None":
        """Return the paths of a motion that asks for another one than the direct one, or that may take one."""
        if not isinstance(motion.motion, Move) or motion.request is None:
            return None
        if (plan := plan_of(motion)) is not None:
            return KeptPath(self.plans, self._core.live, motion, caller, own_id, plan)
        kind, body = kind_of(motion), motion.request.body
        if is_constrained(body) and kind not in {LF.Planned, LF.Straight}:
            raise UnprocessableContent(
                "A motion keeps to constraints on a planned path or a straight line: add lf:path lf:Planned or "
                "lf:Straight."
            )
        if is_constrained(body):
            constraints_of(motion)  # raises early what is wrong with them
        if kind in {LF.Planned, LF.Straight} and not has_placement(motion.robot):
            raise Conflict(
                f"{motion.robot.name} has no placement in the world, so it is unknown what is in its way: PUT its "
                "placement, or leave lf:path out."
            )
        if kind in {LF.Planned, LF.Straight} or (kind is None and body.node(body.root, LF.ofLink) is not None):
            return PlannedPaths(self, motion, caller, own_id)
        return None

    def advise(self, motion: Motion, refused: MotionRefused) -> None:
        """Say in the refusal of a direct path that a way round what is in the way can be asked for, or to wait for it.

        A single joint has no other way.
        """
        if not isinstance(motion.motion, Move) or motion.request is None or not isinstance(refused, Collides):
            return
        if len(motion.targets) > 1:
            refused.advise("With lf:path lf:Planned a way round it is searched for.", {"path": LF.Planned.value})
        elif refused.after_s is not None and refused.after_s <= MOST_WAIT_S:
            refused.advise("With lf:path lf:Planned the motion waits for that.", {"path": LF.Planned.value})

    async def plan(self, motion: Motion, caller: Caller, own_id: str, search: "Search") -> "Planned":
        """Return the motion on a path that was found. Raises MotionRefused, Conflict, Busy."""
        if self._waiting.total() >= MOST_WAITING or self._waiting[caller.name] >= MOST_OF_ONE:
            raise Busy("Too many motions are being planned; ask again.")
        self._waiting[caller.name] += 1
        try:
            answer, asked = await self._ask(motion, caller, own_id, search)
        finally:
            self._waiting -= Counter([caller.name])
        near = answer.near if isinstance(answer, PathFound) else None
        stuck = None if near is None else self._refusal(motion.robot, BlockedAt("start", near), asked)
        return Planned(self._on_path(motion, answer, asked), stuck)

    async def _ask(
        self, motion: Motion, caller: Caller, own_id: str, search: "Search"
    ) -> tuple[PlanAnswer, PlanQuestion]:
        robot, sees = motion.robot, caller.visible_robots
        with self._process.in_use():
            if (why := await self._nearby.prepare(self._nearby.around(robot, sees))) is not None:
                raise Unchecked(why)
            robots = motion.among(self._nearby.prepared_around(robot, sees))
            self._check_still(motion, own_id)
            around = self._questions.about(motion, robots, sees, own_id)
            asked = self._question(motion, around, search)
            answer = await self._process.find(asked)
            is_goal_bad = (isinstance(answer, BlockedAt) and answer.place == "goal") or (
                isinstance(answer, Broken) and answer.share == 1.0
            )
            if is_goal_bad and isinstance(asked, FindPath):
                asked = replace(asked, goals=await asyncio.to_thread(other_goals, motion, asked))
                answer = await self._process.find(asked) if asked.goals else answer
            return answer, asked

    def _question(self, motion: Motion, around: Check, search: "Search") -> PlanQuestion:
        bounds, goal = self._bounds(motion, around), dict(motion.targets)
        keeps = constraints_of(motion)
        if kind_of(motion) != LF.Straight:
            return FindPath(around, bounds, (goal,), search.within_s, search.seed, keeps)
        assert motion.request is not None
        body = motion.request.body
        link = body.node(body.root, LF.ofLink)
        if link is None:
            return FindStraight(around, bounds, carried(motion), goal, turns=True, exact=True, keeps=keeps)
        turns = body.node(body.root, LF.orientation) is not None
        return FindStraight(around, bounds, motion.request.link_at(link), goal, turns, exact=False, keeps=keeps)

    def _check_still(self, motion: Motion, own_id: str) -> None:
        """Check that no other motion moves the joints, because a path begins where they stand. Raises Conflict."""
        if (moving := moving_joint(self._core.live, motion, own_id)) is not None:
            raise Conflict(
                f"{moving} of {motion.robot.name} is moving, and a planned path begins where it stands: stop it, or "
                "wait until it stands."
            )

    def _bounds(self, motion: Motion, around: Check) -> dict[str, JointBounds]:
        start = around.paths[0].start
        speeds = motion.motion.speeds if isinstance(motion.motion, Move) else {}
        return {
            name: bounds_of(motion.robot, name, (start[name], goal), motion.speed_scale, speeds.get(name, math.inf))
            for name, goal in motion.targets.items()
        }

    def _on_path(self, motion: Motion, answer: PlanAnswer, asked: PlanQuestion) -> Motion:
        if isinstance(answer, PlanFailed):
            raise Unchecked(f"No path of {motion.robot.name} could be planned: {answer.reason}.")
        if not isinstance(answer, PathFound | StraightFound):
            raise self._refusal(motion.robot, answer, asked)
        if (long_s := answer.times_s[-1]) > MOST_S:
            raise Conflict(
                f"The motion of {motion.robot.name} would take {long_s:.0f} s; a command takes at most {MOST_S} s. "
                "Allow a higher speed, or move in steps."
            )
        start = asked.around.paths[0].start
        stands = standing(motion.robot, {name: start[name] for name in answer.joints})
        follow = Follow(answer.joints, answer.times_s, answer.positions)
        ends = dict(zip(answer.joints, answer.positions[-1], strict=True))
        facts = dict(motion.facts)
        if isinstance(answer, StraightFound):
            facts["pathDeviation"] = answer.off_m
        if answer.least is not None:
            facts |= {"leastManipulability": answer.least.value, "leastManipulabilityTime": answer.least.at_s}
        expected = {**stands, **motion.expectations}
        return replace(motion, motion=follow, targets=ends, facts=facts, expectations=expected)

    def _refusal(
        self, robot: Robot, answer: LineEnds | BlockedAt | Broken | NotFound, asked: PlanQuestion
    ) -> MotionRefused:
        if isinstance(answer, Broken):
            return refusal(robot, asked.keeps.tip, answer)
        if isinstance(answer, LineEnds):
            joint = f"{answer.joint}: " if answer.joint else ""
            base = asked.around.robot.base
            return LineLeaves(
                f"The straight line of {robot.name} ends after {100 * answer.share:.0f} % of the way: "
                f"{joint}{answer.why}. lf:Planned takes another path.",
                reason="the straight line leaves what its joints can do",
                share=answer.share,
                point=compose(base, Pose(answer.at, UPRIGHT)).position_m,
            )
        if isinstance(answer, BlockedAt):
            met = self._checks.collision(robot, answer.by)
            what = met.names[1] if len(met.names) > 1 else "another robot"
            if answer.place == "start":
                return StartBlocked(
                    f"No path of {robot.name} was found from where it stands: {answer.by.link} touches {what} there, "
                    "or is nearer than 1 cm. Move one of them away first, or name it by lf:mayTouch if a hand may "
                    "touch it.",
                    reason="something is where it would begin",
                    met=met,
                )
            detail = f"The goal is blocked: {answer.by.link} of {robot.name} would meet {what} there."
            return GoalBlocked(detail, reason="something is where it would end", met=met)
        if len(asked.bounds) == 1:
            (alone,) = asked.bounds
            detail = (
                f"{alone} of {robot.name} alone has no way round what is in the way. Name further joints that may move "
                "too: with the values at which they stand, they end there."
            )
            return NoPathFound(detail, reason="one joint alone has no way round")
        within_s = asked.within_s if isinstance(asked, FindPath) else SEARCH_S
        keeping = " that keeps to its constraints" if asked.keeps.shape_the_path else ""
        detail = (
            f"No path of {robot.name}{keeping} was found in {within_s:.2g} s. There may be one: give the search more "
            f"time by Prefer: wait, of which up to {MOST_SEARCH_S:g} s are used, or move in steps."
        )
        return NoPathFound(detail, reason="no path was found in time")


class PlannedPaths(Paths):
    """The direct path, and planned ones if something is in its way."""

    def __init__(self, planner: Planner, motion: Motion, caller: Caller, own_id: str) -> None:
        self._planner, self._motion, self._caller, self._own_id = planner, motion, caller, own_id
        self._given, self._because = 0, ""
        self._met: Collides | None = None
        self._stuck: MotionRefused | None = None
        self._waits = planner.waits(motion, own_id)
        self._left_s = min(max(caller.patience_s or 0.0, SEARCH_S), MOST_SEARCH_S)
        self.most_s = self._left_s + EARLY_S + _MOST_PATHS * _ANSWER_S

    async def next(self, refused: MotionRefused | None) -> Motion | None:
        """Return the motion on its next path; None after the last one, or after the time for the search.

        The last ones are the direct one again, after waits for other robots, which keeps to no constraint.
        """
        straight, request = kind_of(self._motion) == LF.Straight, self._motion.request
        constrained = request is not None and is_constrained(request.body)
        if refused is None and not straight and not constrained:
            return self._motion
        if _is_other_refusal(refused):
            return None
        if not self._because:
            asked_for = "a straight line was asked for" if straight else "it keeps to constraints"
            self._because = asked_for if refused is None else f"on the direct path {refused.reason}"
            if not constrained:
                self._waits.note(refused)
                self._met = refused if isinstance(refused, Collides) else None
        found = await self._searched(1 if straight else _MOST_PATHS) or self._waits.next(self._because)
        if found is None and self._stuck is not None and _is_of_start(refused):
            raise self._stuck
        return found

    async def _searched(self, most: int) -> Motion | None:
        """Return the motion on another path that is found; a single joint has none but the direct one."""
        if self._given == most or self._left_s <= 0.0 or (self._waits.help and len(self._motion.targets) == 1):
            return None
        self._given += 1
        began_s = asyncio.get_running_loop().time()
        seed, within_s = self._given * _SEEDS, self._left_s
        try:
            planned = await self._planner.plan(self._motion, self._caller, self._own_id, Search(seed, within_s))
        except (GoalBlocked, StartBlocked, NoPathFound) as error:
            if not self._waits.help:
                raise self._explained(error) from error
            self._left_s = 0.0
            return None
        self._left_s -= asyncio.get_running_loop().time() - began_s
        self._stuck = planned.stuck
        return replace(planned.motion, detour=self._because)

    def _explained(self, refused: MotionRefused) -> MotionRefused:
        """Say what is in the way of the direct path if no other one was found."""
        met = self._met
        if not isinstance(refused, NoPathFound) or met is None:
            return refused
        what = f" On the direct path {met.names[0]} would meet {met.names[1]}." if len(met.names) > 1 else ""
        return NoPathFound(refused.detail + what, reason=refused.reason, met=met)

    async def keep(self, motion: Motion) -> KeptPlan | None:
        """Keep a rehearsed motion on one of these paths."""
        return await keep(self._planner.plans, motion, self._caller.name)


def _is_other_refusal(refused: MotionRefused | None) -> bool:
    """Return True if another path would be refused as well."""
    return refused is not None and not isinstance(refused, Collides)


def _is_of_start(refused: MotionRefused | None) -> bool:
    """Return True if a path was refused for what the robot meets where it begins."""
    return isinstance(refused, Collides) and refused.share is not None and refused.share < _AT_START


def other_goals(motion: Motion, asked: FindPath) -> tuple[Positions, ...]:
    """Return further positions of the joints that reach the pose that was asked for, if it is one."""
    request = motion.request
    if request is None or request.body.node(request.body.root, LF.ofLink) is None:
        return ()
    random, found = Random(asked.seed), list[Positions]()  # noqa: S311 - where searches begin
    for _ in range(_MOST_GOALS):
        start = {name: random.uniform(each.lower, each.upper) for name, each in asked.bounds.items()}
        with suppress(FleetError):  # this start leads nowhere
            targets = dict(prepare_search(request, start)()[0])
            if targets.keys() == asked.bounds.keys() and all(map(partial(_is_other, targets), (*asked.goals, *found))):
                found.append(targets)
    return tuple(found)


def _is_other(one: Positions, other: Positions) -> bool:
    return any(abs(one[name] - other[name]) > _OTHER for name in one)


def kind_of(motion: Motion) -> Node | None:
    """Return the kind of path that is asked for; None if nothing is said."""
    body = None if motion.request is None else motion.request.body
    return None if body is None else body.node(body.root, LF.path)


def bounds_of(robot: Robot, name: str, ends: tuple[float, float], scale: float, most: float) -> JointBounds:
    """Return what a joint may do on a path: as fast as its agent lets it move, and as fast to that speed.

    ``ends`` are its positions at the start and the goal, ``scale`` is the share of its speed, and ``most`` the highest
    speed that was asked for.
    """
    assert robot.model is not None
    joint, speed = robot.model.joints[name], speed_of(robot, name, scale, most)
    continuous = joint.kind is JointKind.CONTINUOUS
    low, high = joint.limits.lower, joint.limits.upper
    if continuous or low is None or high is None:
        low, high = min(ends) - math.pi, max(ends) + math.pi
    return JointBounds(min(low, *ends), max(high, *ends), speed, speed / RAMP_S)
