"""Motions against the world, before they are accepted: what is asked of the process that checks, and what it means.

A robot that nobody has placed is checked against nothing. What cannot be told is refused: a motion is begun when its
way was found free, and only then.
"""

import asyncio
import logging
import math
from collections.abc import Mapping
from functools import lru_cache
from hashlib import blake2b
from types import TracebackType
from typing import Self

import msgspec

from agents.wire.messages import Description
from gateway.actions.plan import Motion
from gateway.ending import end
from gateway.errors import Busy, Collides, FleetError, Unchecked
from gateway.fleet.geometry import SUFFIXES, meshes_of
from gateway.fleet.model import Pose
from gateway.fleet.robot import Robot
from gateway.graph.paths import link_path
from gateway.identity.rights import View
from gateway.live import Live
from gateway.world.describe import object_path
from gateway.world.messages import Check, Meets, Positions, Prepare, PrepareObject, Stood, Unable
from gateway.world.placement import placement_of, pose_in_world
from gateway.world.process import Checker
from gateway.world.scene import MAX_OBJECTS, SceneObject
from gateway.world.ways import stances_of, ways_of

log = logging.getLogger(__name__)

WITHIN_S = 1.0
_PATIENCE_S = 1.5  # for all of it: a command is too late after two seconds
_ANSWER_S, _PREPARE_S = 3.0, 60.0
_LOOK_S = 1.0
MOST_WAITING = 16
NEAR_M = 25.0
"""Robots whose roots are further from each other than this do not meet."""


class Checks:
    """An async context manager; it starts no process before a robot is placed."""

    def __init__(self, live: Live, objects: Mapping[str, SceneObject]) -> None:
        self._live, self._objects = live, objects
        self._checker = Checker()
        self._preparing: dict[str, asyncio.Task[None]] = {}
        self._unusable: dict[str, str] = {}
        self._keys: dict[str, tuple[Description, str]] = {}
        self._waiting = 0
        self._looking: asyncio.Task[None] | None = None

    async def __aenter__(self) -> Self:
        self._looking = asyncio.create_task(self._look_for_ever(), name="prepare robots")
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        await end([*([] if self._looking is None else [self._looking]), *self._preparing.values()])
        await self._checker.close()

    async def judge(self, motion: Motion, sees: View, own: str) -> bool:
        """As ``gateway.actions.service.Judge``; Busy when so many wait that it would be too late."""
        if placement_of(motion.robot) is None:
            return False
        if self._waiting >= MOST_WAITING:
            raise Busy(f"{MOST_WAITING} motions are being checked; ask again.")
        self._waiting += 1
        try:
            async with asyncio.timeout(_PATIENCE_S):
                await self._check(motion, sees, own)
        except TimeoutError as error:
            raise Unchecked("What there is to be met is still being prepared; ask again.") from error
        finally:
            self._waiting -= 1
        return True

    async def _check(self, motion: Motion, sees: View, own: str) -> None:
        here = _base(motion.robot, sees)
        placed = [robot for robot in self._live.fleet.robots.values() if _counts(robot)]
        robots = [robot for robot in placed if math.dist(_base(robot, sees).position_m, here.position_m) <= NEAR_M]
        await self._be_prepared(robots, sees)
        answer = await self._checker.ask(self._question(motion, robots, sees, own), _ANSWER_S)
        if isinstance(answer, Meets):
            raise self._collision(motion.robot, answer)
        if isinstance(answer, Unable):
            raise Unchecked(f"Whether {motion.robot.name} meets anything is unknown: {answer.reason}.")

    # -- the question -----------------------------------------------------------------------------------------------

    def _question(self, motion: Motion, robots: list[Robot], sees: View, own: str) -> Check:
        robot = motion.robot
        start = _positions(robot)
        if missing := [name for name in motion.targets if name not in start]:
            raise Unchecked(f"Whether {robot.name} meets anything is unknown: so is where {missing[0]} is.")
        return Check(
            Stood(robot.name, self._key(robot), _base(robot, sees)),
            ways_of(motion.motion, start, self._underway(robot, own)),
            tuple(self._stood(each, sees) for each in robots if each is not robot),
            tuple(Stood(id, _key_of(thing), thing.pose) for id, thing in self._objects.items()),
            WITHIN_S,
        )

    def _stood(self, robot: Robot, sees: View) -> Stood:
        name = robot.name if sees.sees(robot.name) else ""
        stances = stances_of(_positions(robot), self._underway(robot, ""))
        return Stood(name, self._key(robot), _base(robot, sees), stances)

    def _underway(self, robot: Robot, own: str) -> dict[str, float]:
        """Where its joints go by motions that have not ended."""
        ends: dict[str, float] = {}
        for invocation in reversed(self._live.invocations.open_of(robot.name)):
            if invocation.id != own:
                ends |= invocation.targets
        return ends

    def _collision(self, robot: Robot, met: Meets) -> Collides:
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
            share=met.share,
            reason=f"{met.link} would meet {kind} {after}",
        )

    def _key(self, robot: Robot) -> str:
        """The same for robots that look the same."""
        description = robot.description
        assert description is not None
        held = self._keys.get(robot.name)
        if held is None or held[0] is not description:
            digest = blake2b(description.urdf.encode(), digest_size=16)
            for mesh in description.meshes:
                digest.update(f"{mesh.uri} {mesh.sha256}\n".encode())
            held = self._keys[robot.name] = description, digest.hexdigest()
        return held[1]

    # -- shapes -----------------------------------------------------------------------------------------------------

    async def _be_prepared(self, robots: list[Robot], sees: View) -> None:
        tasks = [task for robot in robots if (task := self._prepare_soon(robot)) is not None]
        if tasks:
            await asyncio.wait(tasks)
        for thing in list(self._objects.values()):
            await self._prepare_object(thing)
        for robot in robots:
            if self._key(robot) in self._checker.known:
                continue
            name = robot.name if sees.sees(robot.name) else "another robot"
            why = self._unusable.get(self._key(robot), "it is being prepared, ask again")
            raise Unchecked(f"The shape of {name} is not known yet: {why if sees.sees(robot.name) else 'ask again'}.")

    def _prepare_soon(self, robot: Robot) -> asyncio.Task[None] | None:
        key = self._key(robot)
        if key in self._checker.known or key in self._unusable:
            return None
        task = self._preparing.get(key)
        if task is None:
            task = self._preparing[key] = asyncio.create_task(self._prepare(robot, key), name=f"prepare {robot.name}")
            task.add_done_callback(lambda _: self._preparing.pop(key, None))
        return task

    async def _prepare(self, robot: Robot, key: str) -> None:
        assert robot.description is not None
        try:
            meshes = {
                uri: (SUFFIXES[mesh.type], await self._live.meshes.get(robot, mesh))
                for uri, mesh in meshes_of(robot).items()
            }
        except FleetError as error:  # tried again at the next look
            log.info("the shape of %s cannot be had: %s", robot.name, error.detail)
            return
        answer = await self._checker.ask(Prepare(key, robot.description.urdf, meshes), _PREPARE_S)
        if isinstance(answer, Unable):
            self._unusable[key] = answer.reason
            log.warning("no motion near %s can be checked: %s", robot.name, answer.reason)
        else:
            self._checker.known.add(key)

    async def _prepare_object(self, thing: SceneObject) -> None:
        key = _key_of(thing)
        if key not in self._checker.known:
            answer = await self._checker.ask(PrepareObject(key, thing.geometry), _ANSWER_S)
            if isinstance(answer, Unable):
                raise Unchecked(f"The shape of {thing.title} cannot be used: {answer.reason}.")
            self._checker.known.add(key)

    async def _look_for_ever(self) -> None:
        """Prepare robots as they are placed: the first motion need not wait for it."""
        while True:
            await asyncio.sleep(_LOOK_S)
            try:
                for robot in self._live.fleet.robots.values():
                    if _counts(robot):
                        self._prepare_soon(robot)
            except Exception:
                # The boundary of the task: without it robots would be prepared at their first motion.
                log.exception("robots could not be prepared for checks; it is tried again")


def _counts(robot: Robot) -> bool:
    """Whether it has a place in the world and a form."""
    return placement_of(robot) is not None and robot.model is not None and robot.description is not None


def _positions(robot: Robot) -> Positions:
    return {name: position for name, position in robot.positions.items() if position == position}


def _base(robot: Robot, sees: View) -> Pose:
    """Where its root is; Unchecked."""
    assert robot.model is not None
    pose = pose_in_world(robot, robot.model.root)
    if pose is None:
        name = robot.name if sees.sees(robot.name) else "another robot"
        raise Unchecked(f"Where {name} is at present is unknown, so nothing is known to be free of it.")
    return pose


@lru_cache(maxsize=2 * MAX_OBJECTS)
def _key_of(thing: SceneObject) -> str:
    return "object-" + blake2b(msgspec.msgpack.encode(thing.geometry), digest_size=16).hexdigest()
