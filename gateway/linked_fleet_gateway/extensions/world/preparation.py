"""Preparation of collision shapes as soon as a robot is placed; motions that need them earlier wait."""

import asyncio
import logging
from collections import Counter
from collections.abc import Collection, Mapping
from functools import lru_cache
from hashlib import blake2b

import msgspec

from linked_fleet_agent.wire.messages import Description
from linked_fleet_gateway.base.errors import FleetError
from linked_fleet_gateway.extensions.world.messages import (
    Answer,
    CheckFailed,
    MeshesMissing,
    Prepare,
    PrepareMesh,
    PrepareObject,
)
from linked_fleet_gateway.extensions.world.placement import placement_of
from linked_fleet_gateway.extensions.world.process import NO_ANSWER, Checker
from linked_fleet_gateway.extensions.world.scene import MAX_OBJECTS, SceneObject
from linked_fleet_gateway.fleet.geometry import file_name, meshes_of
from linked_fleet_gateway.fleet.robot import Robot
from linked_fleet_gateway.runtime.background import end, supervised
from linked_fleet_gateway.subscriptions.live import Live

log = logging.getLogger(__name__)

_PREPARE_S, _OBJECT_S = 60.0, 3.0
_LOOK_S = 0.5
_MOST_TRIES = 3  # of a robot during whose preparation the process ended, perhaps for another reason


class Preparation:
    """Sends robots and objects to ``checker``; must be ended by ``close``."""

    def __init__(self, live: Live, checker: Checker) -> None:
        self._live, self._checker = live, checker
        self._under_way: dict[str, asyncio.Task[None]] = {}
        self._unusable: dict[str, str] = {}
        self._unheard: set[str] = set()
        self._ended = Counter[str]()
        self._keys: dict[str, tuple[Description, str]] = {}
        self._tasks: list[asyncio.Task[None]] = []

    def open(self) -> None:
        failed = "robots could not be prepared for checks"
        self._tasks = [supervised(self._look, "prepare robots", log, failed, _LOOK_S)]

    async def close(self) -> None:
        await end([*self._tasks, *self._under_way.values()])

    def key(self, robot: Robot) -> str:
        """Return a key that is equal for robots with equal geometry."""
        description = robot.description
        assert description is not None
        held = self._keys.get(robot.name)
        if held is None or held[0] is not description:
            digest = blake2b(description.urdf.encode(), digest_size=16)
            for mesh in description.meshes:
                digest.update(f"{mesh.uri} {mesh.sha256}\n".encode())
            held = self._keys[robot.name] = description, digest.hexdigest()
        return held[1]

    def is_complete(self) -> bool:
        """Return True if every placed robot is prepared, as far as its shapes are available."""
        keys = {self.key(robot) for robot in self._live.fleet.robots.values() if is_placed(robot)}
        return all(self._checker.knows(key) or key in self._unusable or key in self._unheard for key in keys)

    def missing(self, robot: Robot) -> str | None:
        """Return why the robot is not prepared; None if it is."""
        key = self.key(robot)
        if self._checker.knows(key):
            return None
        return self._unusable.get(key, "it is being prepared, ask again")

    async def robots(self, robots: Collection[Robot]) -> None:
        """Wait until each robot is prepared or cannot be. Cancelling one waiter does not affect others."""
        tasks = [task for robot in robots if (task := self._begin(robot)) is not None]
        if tasks:
            await asyncio.wait(tasks)

    async def objects(self, objects: Mapping[str, SceneObject]) -> str | None:
        """Prepare all objects. Return why one cannot be prepared, or None."""
        for thing in list(objects.values()):
            key = key_of(thing)
            if not self._checker.knows(key):
                answer = await self._checker.ask(PrepareObject(key, thing.geometry), _OBJECT_S)
                if isinstance(answer, CheckFailed):
                    return f"The shape of {thing.title} cannot be used: {answer.reason}."
        return None

    def _begin(self, robot: Robot) -> asyncio.Task[None] | None:
        """Start the preparation of a robot; return None if there is nothing to do."""
        key = self.key(robot)
        if self._checker.knows(key) or key in self._unusable:
            return None
        task = self._under_way.get(key)
        if task is None:
            task = self._under_way[key] = asyncio.create_task(self._prepare(robot, key), name=f"prepare {robot.name}")
            task.add_done_callback(lambda _: self._under_way.pop(key, None))
        return task

    async def _prepare(self, robot: Robot, key: str) -> None:
        try:
            answer = await self._told(robot, key)
        except FleetError as error:  # retried at the next check
            self._unheard.add(key)
            log.info("the shape of %s cannot be had: %s", robot.name, error.detail)
            return
        if answer == NO_ANSWER:
            self._ended[key] += 1
            if self._ended[key] < _MOST_TRIES:
                return
        if isinstance(answer, CheckFailed):
            self._unusable[key] = answer.reason
            log.warning("no motion near %s can be checked: %s", robot.name, answer.reason)

    async def _told(self, robot: Robot, key: str) -> Answer:
        """Return the answer after sending all missing meshes. Raises FleetError for a mesh that is not available."""
        assert robot.description is not None
        meshes = {uri: (file_name(mesh), mesh) for uri, mesh in meshes_of(robot).items()}
        question = Prepare(key, robot.description.urdf, {uri: name for uri, (name, _) in meshes.items()})
        answer = await self._checker.ask(question, _PREPARE_S)
        if not isinstance(answer, MeshesMissing):
            return answer
        by_name = dict(meshes.values())
        for name in answer.meshes:
            content = await self._live.meshes.get(robot, by_name[name])
            read = await self._checker.ask(PrepareMesh(name, content), _PREPARE_S)
            if isinstance(read, CheckFailed):
                return read if read == NO_ANSWER else CheckFailed(f"the mesh {by_name[name].uri}: {read.reason}")
        answer = await self._checker.ask(question, _PREPARE_S)
        return CheckFailed("its meshes are too large to be kept") if isinstance(answer, MeshesMissing) else answer

    async def _look(self) -> None:
        """Prepare newly placed robots, so that the first motion need not wait."""
        self._forget()
        for robot in self._live.fleet.robots.values():
            if is_placed(robot):
                self._begin(robot)

    def _forget(self) -> None:
        """Drop data of descriptions that no robot has any more."""
        robots = self._live.fleet.robots
        self._keys = {name: held for name, held in self._keys.items() if name in robots}
        present = {key for _, key in self._keys.values()}
        self._unusable = {key: why for key, why in self._unusable.items() if key in present}
        self._ended = Counter({key: times for key, times in self._ended.items() if key in present})
        self._unheard &= present


def is_placed(robot: Robot) -> bool:
    """Return True if the robot has a placement and a description."""
    return placement_of(robot) is not None and robot.model is not None and robot.description is not None


@lru_cache(maxsize=2 * MAX_OBJECTS)
def key_of(thing: SceneObject) -> str:
    return "object-" + blake2b(msgspec.msgpack.encode(thing.geometry), digest_size=16).hexdigest()
