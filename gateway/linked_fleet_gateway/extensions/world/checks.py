"""Collision checks of motions before they are accepted: questions to the check process, and their answers.

A robot without a placement is not checked. A motion is refused unless its path was found free.
"""

import asyncio
from collections.abc import Awaitable, Callable, Collection, Mapping
from functools import partial
from pathlib import Path
from types import TracebackType
from typing import NamedTuple, Self

from msgspec.structs import replace
from pyoxigraph import NamedNode

from linked_fleet_agent import planar
from linked_fleet_base.errors import Busy, MotionRefused
from linked_fleet_gateway.api import Motion
from linked_fleet_gateway.extensions.models.meshes import Meshes
from linked_fleet_gateway.extensions.world.collisions import Collides, Collisions, Unchecked
from linked_fleet_gateway.extensions.world.descriptions import object_path
from linked_fleet_gateway.extensions.world.driving import (
    Driving,
    on_floor,
    valid_until_ns,
)
from linked_fleet_gateway.extensions.world.floor_map import ID as MAP_ID
from linked_fleet_gateway.extensions.world.floor_map import NO_MAPS, Maps
from linked_fleet_gateway.extensions.world.held import extent_m, held_by
from linked_fleet_gateway.extensions.world.in_time import InTime, Pair
from linked_fleet_gateway.extensions.world.jogging import Jogs
from linked_fleet_gateway.extensions.world.messages import (
    Answer,
    CheckFailed,
    ClosestFound,
    CollisionFound,
    Free,
    Surveyed,
    UncheckedNear,
)
from linked_fleet_gateway.extensions.world.nearby import Surroundings
from linked_fleet_gateway.extensions.world.placement import (
    LF,
    has_placement,
    pose_in_world,
)
from linked_fleet_gateway.extensions.world.process import Checker, Preparation, is_placed, key_of
from linked_fleet_gateway.extensions.world.questions import Questions
from linked_fleet_gateway.extensions.world.refusals import Refusals
from linked_fleet_gateway.extensions.world.scene import SceneObject, Unreadable
from linked_fleet_gateway.extensions.world.schedules import OnTime, Run, Schedules
from linked_fleet_gateway.extensions.world.touch import thing_to_grasp, things_to_touch
from linked_fleet_gateway.faces import ALL, View, unchecked_links
from linked_fleet_gateway.serving import Act, Live, Worker
from linked_fleet_state.closest import Closest
from linked_fleet_state.driving import Drive, FollowedPath, placed
from linked_fleet_state.jogging import JointDrive
from linked_fleet_state.robot import Robot
from linked_fleet_state.unchecked import Finding


class Neighbour(NamedTuple):
    """A robot on the floor: the way that it may take now, None if its place is unknown, and its reach from there."""

    way: tuple[planar.Pose, planar.Pose] | None
    reach_m: float


Neighbours = dict[str, Neighbour]
_MOST_SPEEDS = 5
"""Speeds at which a drive is checked."""
_FLOOR = 0.95
_SLOWER = (1.0, 0.8, 0.4)
"""The largest share of the speed before that is tried next: one that nearly fits needs little less."""
"""Share of the speed that seems to fit at which a drive is checked anew, because its way changes a little."""
CLOSEST_S = 0.2
"""Processor time of a rehearsal for where the robot comes closest to something."""
_TIMEOUT_S = 3.0  # for a check including its wait for a turn and for the processor
_ANSWER_S = 10.0
MOST_WAITING = 16
MOST_EARLY = 64


class Checks:
    """Implements ``MotionGuard``; an async context manager. It starts no process before a robot is placed.

    Meshes are cached in ``folder``; ``collisions`` keeps the refused motions. After ``idle_s`` seconds without a
    motion or a new robot the process ends, and the next motion waits until it has been started again. ``settled`` waits
    until it is known what robots hold.
    """

    finding_predicate = LF.collisionFree

    def __init__(
        self,
        live: Live,
        meshes: Meshes,
        objects: Mapping[str, SceneObject],
        folder: Path,
        collisions: Collisions | None = None,
        idle_s: float = Worker.IDLE_S,
        maps: Maps = NO_MAPS,
        settled: Callable[[], Awaitable[None]] | None = None,
        unreadable: Unreadable = tuple,
    ) -> None:
        self._live, self._objects, self._maps, self._unreadable = live, objects, maps, unreadable
        self._settled = settled
        self._checker = Checker(folder, idle_s)
        self._preparation = Preparation(live, meshes, self._checker)
        self._nearby = Surroundings(live, self._preparation, objects, maps, unreadable)
        self._collisions = collisions or Collisions(live.fan_out.mark_changed)
        self._refusals = Refusals(live.fleet.robots, objects, maps)
        self._waiting = self._early = 0
        self._driving, self._jogs = Driving(), Jogs()
        self.schedules = Schedules(live.invocations.open_of_robot)
        self._questions = self._create_questions(self._preparation)
        self._in_time = InTime(self._questions, self.schedules, partial(self._checker.ask, timeout_s=_ANSWER_S))

    async def __aenter__(self) -> Self:
        self._preparation.open()
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        await self._preparation.close()
        await self._checker.close()

    def asked_elsewhere(self, preparation: Preparation) -> tuple[Surroundings, Questions]:
        """Return what is around robots, and the questions about their motions, for the process of ``preparation``."""
        nearby = Surroundings(self._live, preparation, self._objects, self._maps, self._unreadable)
        return nearby, self._create_questions(preparation)

    def _create_questions(self, preparation: Preparation) -> Questions:
        known = self._driving, self._jogs, self._objects, self._maps, self.schedules
        return Questions(self._live, preparation, *known)

    @property
    def prepared(self) -> bool:
        """True if the shapes of all placed robots are prepared, as far as available."""
        return self._preparation.is_complete()

    async def wait_until_ready(self, robot: Robot, visible_robots: View) -> None:
        """Wait for the shapes of the robot and of everything around it. Raises Unchecked, Busy."""
        if self._settled is not None:
            await self._settled()
        if not has_placement(robot):
            return
        if self._early >= MOST_EARLY:
            raise Busy(f"{MOST_EARLY} motions wait for shapes that are being prepared; try again.")
        self._early += 1
        try:
            with self._checker.in_use():  # it does not end before the check
                await self._nearby.prepare(self._nearby.perhaps_around(robot))
        finally:
            self._early -= 1

    async def check_path(self, motion: Motion, visible_robots: View, own_id: str) -> Finding:
        """Check a motion. A drive that would meet something is checked at less speed, until its way is free.

        The finding is not free if the robot has no placement. Raises Collides, UncheckedLinks; Unchecked, also if too
        many wait.
        """
        things = self._things(motion, visible_robots)
        if not has_placement(motion.robot) or _way_is_unknown(motion):
            return Finding(False, things=things)
        if self._waiting >= MOST_WAITING:
            raise Unchecked(f"{MOST_WAITING} motions are being checked; try again.")
        self._waiting += 1
        try:
            with self._checker.in_use():  # between the preparation and the check too
                # Mostly they are prepared; the process may have ended since the motion waited for it.
                if (why := await self._nearby.prepare(self._nearby.around(motion.robot, visible_robots))) is not None:
                    raise Unchecked(why)
                async with asyncio.timeout(_TIMEOUT_S):
                    return replace(await self._check(motion, visible_robots, own_id), things=things)
        except TimeoutError as error:
            raise Unchecked("The check of the motion took too long; try again.") from error
        finally:
            self._waiting -= 1

    def _things(self, motion: Motion, sees: View) -> tuple[tuple[NamedNode, str], ...]:
        """Return the objects that a motion names. Raises UnprocessableContent, Conflict."""
        touched = things_to_touch(motion, self._objects, sees)
        grasped = thing_to_grasp(motion, self._objects, sees) if isinstance(motion.motion, Act) else ""
        named = [*((LF.mayTouch, id) for id in touched), *([(LF.object, grasped)] if grasped else [])]
        return tuple((predicate, object_path(id)) for predicate, id in named)

    async def _check(self, motion: Motion, sees: View, own: str) -> Finding:
        # Nothing is awaited between the next two steps, so that no robot that has come meanwhile is left out.
        robots = motion.among(self._nearby.prepared_around(motion.robot, sees))
        if isinstance(act := motion.motion, Act) and act.drive is not None:
            return await self._check_drive(motion.robot, act.drive, robots, sees, own)
        if own and isinstance(act, Act) and act.path is not None:
            return await self._check_path(motion.robot, act.path, robots, sees, own)
        judged = await self._in_time.judge(motion, robots, sees, own, closest_s=CLOSEST_S)
        finding = self._finding(motion.robot, judged.answer, judged.after_s)
        if own:
            self._in_time.begin(motion.robot, own, judged)
        return replace(finding, until_ns=judged.until_ns)

    async def _check_path(self, robot: Robot, path: FollowedPath, robots: list[Robot], sees: View, own: str) -> Finding:
        """Check a path that others see already: of two that begin at once, at least one sees the other."""
        self._driving.follow(robot, path)
        try:
            question = self._questions.followed(robot, path, robots, sees, own)
            return self._finding(robot, await self._checker.ask(question, _ANSWER_S))
        except MotionRefused:
            self._driving.forget(robot)
            raise

    # -- paths that are followed ------------------------------------------------------------------------------------

    @property
    def surroundings(self) -> object:
        """A value that differs once an object, a zone or the map has changed."""
        floor = self._maps.get(MAP_ID)
        known = {id: (key_of(each), each.held or each.pose) for id, each in self._objects.items()}
        return known, floor and floor.obstacles_key

    def path_of(self, robot: Robot) -> FollowedPath | None:
        """Return the path that the base of a robot with a placement follows."""
        return self._driving.path_of(robot) if is_placed(robot) else None

    def neighbours(self) -> Neighbours:
        """Return where the robots with a placement are, and may come while others follow their paths."""
        found: Neighbours = {}
        for robot in self._live.fleet.robots.values():
            if is_placed(robot) and robot.model is not None:
                at, end = on_floor(pose_in_world(robot, robot.model.root)), self._driving.end(robot)
                way = None if at is None else (at, at if end is None else placed(end, at))
                held = held_by(robot, self._objects).values()
                held_m = max((extent_m(each.held, each.geometry) for each in held if each.held), default=0.0)
                found[robot.name] = Neighbour(way, self._preparation.reach_m(robot) + held_m)
        return found

    async def survey(self, robot: Robot, sees: View) -> Surveyed:
        """Return what stands around a robot with a placement, prepared if needed. Raises Unchecked, Busy."""
        await self.wait_until_ready(robot, sees)
        with self._checker.in_use():
            if (why := await self._nearby.prepare(self._nearby.around(robot, sees))) is not None:
                raise Unchecked(why)
            question = self._questions.survey(robot, self._nearby.prepared_around(robot, sees), sees)
            answer = await self._checker.ask(question, _ANSWER_S)
        if not isinstance(answer, Surveyed):
            reason = answer.reason if isinstance(answer, CheckFailed) else "the check process gave another answer"
            raise Unchecked(f"What stands around {robot.name} is unknown: {reason}.")
        return answer

    async def check_ahead(
        self, robot: Robot, path: FollowedPath, own: str, near: Collection[str] | None = None
    ) -> None:
        """Check a path that a robot follows, among others as they are now. Raises Collides, Unchecked.

        ``near`` are the others that it could meet; None means that this is unknown.
        """
        with self._checker.in_use():
            robots = self._nearby.prepared(
                robot, self._nearby.around(robot, ALL) if near is None else self._nearby.among(robot, near), ALL
            )
            question = self._questions.followed(robot, path, robots, ALL, own, as_they_are=True)
            answer = await self._checker.ask(question, _ANSWER_S)
        if isinstance(answer, CollisionFound):
            raise self.collision(robot, answer)
        if isinstance(answer, CheckFailed):
            raise Unchecked(answer.reason)

    # -- motions that rely on the times of others --------------------------------------------------------------------

    @property
    def pairs(self) -> dict[Pair, float]:
        """The motions that rely on each other's times, with the monotonic time (s) at which they were found free."""
        return self._in_time.pairs

    def on_time(self, robot: Robot) -> OnTime | None:
        """Return the motion of a robot that keeps its times."""
        return self._questions.on_time([robot]).get(robot.name)

    async def check_rest(self, run: Run) -> None:
        """Check the rest of a motion that has begun, among others as they move now. Raises Collides, Unchecked."""
        robot, course = self._live.fleet.robots.get(run.robot), self.schedules.course(run)
        if robot is None or course is None:
            raise Unchecked("The rest of the motion is unknown.")
        with self._checker.in_use():
            robots = self._nearby.prepared_around(robot, ALL)
            answer = await self._checker.ask(self._questions.rest(robot, course, robots, ALL), _ANSWER_S)
        if isinstance(answer, CollisionFound):
            raise self.collision(robot, answer)
        if isinstance(answer, CheckFailed):
            raise Unchecked(answer.reason)

    async def _check_drive(
        self, robot: Robot, drive: Drive | JointDrive, robots: list[Robot], sees: View, own: str
    ) -> Finding:
        if drive.standing:
            return Finding(True)  # to brake is always free
        limited, share = "", 1.0
        for attempt in range(_MOST_SPEEDS):
            slower = drive.slowed(share)
            until_ns = valid_until_ns(robot)
            question = self._questions.driven(robot, slower, robots, sees, own)
            answer = await self._checker.ask(question, _ANSWER_S)
            if not isinstance(answer, CollisionFound):
                break
            share *= min(_FLOOR * slower.fitting_share(answer.share), _SLOWER[min(attempt, len(_SLOWER) - 1)])
            if drive.slowed(share).is_too_slow:
                break
            limited = self.collision(robot, answer).reason
        found = self._finding(robot, answer)
        if own:
            self._begin(robot, slower)
        return replace(found, speed_share=share, limited=limited, until_ns=until_ns)

    def _begin(self, robot: Robot, drive: Drive | JointDrive) -> None:
        if isinstance(drive, JointDrive):
            self._jogs.begin(robot, drive)
        else:
            self._driving.begin(robot, drive)

    def collision(self, robot: Robot, answer: CollisionFound) -> Collides:
        """Return the refusal of a motion that would meet something."""
        assert robot.model is not None  # of a prepared robot
        return self._refusals.collision(robot, robot.model, answer)

    def _finding(self, robot: Robot, answer: Answer, after_s: float | None = None) -> Finding:
        """Return what was found, which will be free ``after_s`` if that is known.

        Raises Collides, UncheckedLinks, Unchecked.
        """
        if isinstance(answer, CollisionFound):
            collides = self.collision(robot, answer)
            if after_s is not None:
                collides.promise(after_s)
            self._collisions.add(robot.name, collides)
            raise collides
        if isinstance(answer, CheckFailed):
            raise Unchecked(f"It is unknown if {robot.name} would collide: {answer.reason}.")
        if isinstance(answer, UncheckedNear):
            raise self._refusals.unchecked_links(robot, answer)
        assert isinstance(answer, Free)
        self._collisions.forget(robot.name)
        near = [self._live.fleet.robots.get(name) for name in answer.unchecked]
        known = [robot, *(each for each in near if each is not None)]
        links = tuple(link for each in known for link in unchecked_links(each))
        return Finding(answer.covered, links, closest=self._closest(robot, answer.closest))

    def _closest(self, robot: Robot, found: ClosestFound | None) -> Closest | None:
        if found is None:
            return None
        met = self.collision(robot, found.met)
        names, share = tuple(met.names), found.met.share
        return Closest(found.apart_m, found.uncertain_m, share, tuple(met.things), names, found.at_s, met.point)


def _way_is_unknown(motion: Motion) -> bool:
    return isinstance(act := motion.motion, Act) and act.drive is None and act.path is None
