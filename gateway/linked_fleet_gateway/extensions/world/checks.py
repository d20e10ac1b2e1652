"""Collision checks of motions before they are accepted: questions to the check process, and their answers.

A robot without a placement is not checked. A motion is refused unless its path was found free.
"""

import asyncio
import math
from collections.abc import Mapping
from pathlib import Path
from types import TracebackType
from typing import Self

from linked_fleet_gateway.actions.plan import Motion
from linked_fleet_gateway.base.errors import Busy
from linked_fleet_gateway.extensions.world.collisions import Collisions
from linked_fleet_gateway.extensions.world.describe import object_path
from linked_fleet_gateway.extensions.world.errors import Collides, Unchecked
from linked_fleet_gateway.extensions.world.messages import Check, CheckFailed, CollisionFound, Placement, Positions
from linked_fleet_gateway.extensions.world.placement import placement_of, pose_in_world
from linked_fleet_gateway.extensions.world.preparation import Preparation, is_placed, key_of
from linked_fleet_gateway.extensions.world.process import Checker
from linked_fleet_gateway.extensions.world.scene import SceneObject
from linked_fleet_gateway.extensions.world.swept_path import paths_of, stances_of
from linked_fleet_gateway.extensions.world.terms import LF
from linked_fleet_gateway.fleet.model import Pose
from linked_fleet_gateway.fleet.robot import Robot
from linked_fleet_gateway.identity.rights import View
from linked_fleet_gateway.resources.paths import link_path
from linked_fleet_gateway.subscriptions.live import Live

WITHIN_S = 1.0
"""Processor time for the check of one motion, in seconds."""
EARLY_S = 5.0
"""Longest wait of a motion for shapes that are being prepared."""
_PATIENCE_S = 3.0  # for a check including its wait for a turn and for the processor
_ANSWER_S = 10.0
MOST_WAITING = 16
MOST_EARLY = 64
NEAR_M = 25.0
"""Robots whose roots are further apart than this are not checked against each other."""


class Checks:
    """Implements ``MotionGuard``; an async context manager. It starts no process before a robot is placed.

    Meshes are cached in ``folder``; ``collisions`` keeps the refused motions.
    """

    finding = LF.collisionFree

    def __init__(
        self, live: Live, objects: Mapping[str, SceneObject], folder: Path, collisions: Collisions | None = None
    ) -> None:
        self._live, self._objects = live, objects
        self._checker = Checker(folder)
        self._preparation = Preparation(live, self._checker)
        self._collisions = collisions or Collisions(live.fan_out.touched)
        self._waiting = self._early = 0

    async def __aenter__(self) -> Self:
        self._preparation.open()
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        await self._preparation.close()
        await self._checker.close()

    @property
    def prepared(self) -> bool:
        """True if the shapes of all placed robots are prepared, as far as available."""
        return self._preparation.is_complete()

    async def ready(self, robot: Robot, sees: View) -> None:
        """Wait for the shapes of the robot and of everything around it. Raises Unchecked, Busy."""
        if placement_of(robot) is None:
            return
        if self._early >= MOST_EARLY:
            raise Busy(f"{MOST_EARLY} motions wait for shapes that are being prepared; ask again.")
        self._early += 1
        try:
            async with asyncio.timeout(EARLY_S):
                await self._preparation.robots(self._perhaps_around(robot))
                await self._preparation.objects(self._objects)
        except TimeoutError as error:
            raise Unchecked("What there is to be met is still being prepared; ask again.") from error
        finally:
            self._early -= 1

    async def free(self, motion: Motion, sees: View, own: str) -> bool:
        """Check a motion.

        Return False if the robot has no placement. Raises Collides, Unchecked; Busy if too many wait.
        """
        if placement_of(motion.robot) is None:
            return False
        if self._waiting >= MOST_WAITING:
            raise Busy(f"{MOST_WAITING} motions are being checked; ask again.")
        self._waiting += 1
        try:
            async with asyncio.timeout(_PATIENCE_S):
                await self._check(motion, sees, own)
        except TimeoutError as error:
            raise Unchecked("The check of the motion took too long; ask again.") from error
        finally:
            self._waiting -= 1
        return True

    async def _check(self, motion: Motion, sees: View, own: str) -> None:
        robots = self._around(motion.robot, sees)
        await self._be_prepared(robots, sees)
        answer = await self._checker.ask(self._question(motion, robots, sees, own), _ANSWER_S)
        if isinstance(answer, CollisionFound):
            collides = self._collision(motion.robot, answer)
            self._collisions.add(motion.robot.name, collides)
            raise collides
        if isinstance(answer, CheckFailed):
            raise Unchecked(f"Whether {motion.robot.name} meets anything is unknown: {answer.reason}.")
        self._collisions.forget(motion.robot.name)

    def _around(self, robot: Robot, sees: View) -> list[Robot]:
        """Return the robots near enough to collide, including the robot itself."""
        here = _base(robot, sees)
        placed = [each for each in self._live.fleet.robots.values() if is_placed(each)]
        return [each for each in placed if math.dist(_base(each, sees).position_m, here.position_m) <= NEAR_M]

    def _perhaps_around(self, robot: Robot) -> list[Robot]:
        """Return the robots near enough to collide, and those whose place is not known yet."""
        placed = {each.name: each for each in self._live.fleet.robots.values() if is_placed(each)}
        bases = {name: pose_in_world(each, each.model.root) for name, each in placed.items() if each.model is not None}
        here = bases.get(robot.name)
        far = {
            name
            for name, there in bases.items()
            if here is not None and there is not None and math.dist(there.position_m, here.position_m) > NEAR_M
        }
        return [each for name, each in placed.items() if name not in far]

    async def _be_prepared(self, robots: list[Robot], sees: View) -> None:
        await self._preparation.robots(robots)
        if (why := await self._preparation.objects(self._objects)) is not None:
            raise Unchecked(why)
        for robot in robots:
            if (why := self._preparation.missing(robot)) is not None:
                seen = sees.sees(robot.name)
                name, why = (robot.name, why) if seen else ("another robot", "ask again")
                raise Unchecked(f"The shape of {name} is not known yet: {why}.")

    # -- the question -----------------------------------------------------------------------------------------------

    def _question(self, motion: Motion, robots: list[Robot], sees: View, own: str) -> Check:
        robot = motion.robot
        start = _positions(robot)
        if missing := [name for name in motion.targets if name not in start]:
            raise Unchecked(f"Whether {robot.name} meets anything is unknown: so is where {missing[0]} is.")
        return Check(
            Placement(robot.name, self._preparation.key(robot), _base(robot, sees)),
            paths_of(motion.motion, start, self._underway(robot, own)),
            tuple(self._stood(each, sees) for each in robots if each is not robot),
            tuple(Placement(id, key_of(thing), thing.pose) for id, thing in self._objects.items()),
            WITHIN_S,
        )

    def _stood(self, robot: Robot, sees: View) -> Placement:
        name = robot.name if sees.sees(robot.name) else ""
        stances = stances_of(_positions(robot), self._underway(robot, ""))
        return Placement(name, self._preparation.key(robot), _base(robot, sees), stances)

    def _underway(self, robot: Robot, own: str) -> dict[str, float]:
        """Return the targets of its joints in other motions that have not ended."""
        ends: dict[str, float] = {}
        for invocation in reversed(self._live.invocations.open_of(robot.name)):
            if invocation.id != own:
                ends |= invocation.targets
        return ends

    def _collision(self, robot: Robot, met: CollisionFound) -> Collides:
        assert robot.model is not None
        link, other = link_path(robot.name, robot.model, met.link), None
        if met.kind == "self":
            what, other = f"its own {met.other}", link_path(robot.name, robot.model, met.other)
            kind = what
        elif met.kind == "robot":
            there, kind = self._live.fleet.robots.get(met.name), "another robot"
            what = f"{met.other} of {met.name}" if there is not None else kind
            if there is not None and there.model is not None:
                other = link_path(met.name, there.model, met.other)
        else:
            thing = self._objects.get(met.name)
            kind = "a keep-out zone" if thing is not None and thing.kind == "zone" else "an obstacle"
            what = kind if thing is None else f"{thing.title} ({kind.partition(' ')[2]})"
            other = object_path(met.name)
        after = f"after {100 * met.share:.0f} % of the way"
        return Collides(
            f"{met.link} of {robot.name} would meet {what} {after}.",
            things=[link, *([] if other is None else [other])],
            names=[f"{met.link} of {robot.name}", *([] if other is None else [what])],
            share=met.share,
            point=met.point,
            reason=f"{met.link} would meet {kind} {after}",
        )


def _positions(robot: Robot) -> Positions:
    return {name: position for name, position in robot.positions.items() if position == position}


def _base(robot: Robot, sees: View) -> Pose:
    """Return the pose of its root in the world. Raises Unchecked."""
    assert robot.model is not None
    pose = pose_in_world(robot, robot.model.root)
    if pose is None:
        name = robot.name if sees.sees(robot.name) else "another robot"
        raise Unchecked(f"Where {name} is at present is unknown, so nothing is known to be free of it.")
    return pose
