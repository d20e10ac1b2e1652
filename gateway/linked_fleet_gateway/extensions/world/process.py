"""The gateway's side of the check process: started for the first question, restarted after a crash, ended when idle.

Collision shapes are prepared as soon as a robot is placed; motions that need them earlier wait.
"""

import asyncio
import logging
import math
from collections import Counter
from collections.abc import Collection, Mapping, Set
from contextlib import AbstractContextManager
from functools import lru_cache
from hashlib import blake2b
from pathlib import Path
from typing import Any

import msgspec

from linked_fleet_agent.wire.messages import Description
from linked_fleet_base.errors import FleetError
from linked_fleet_gateway.api import cancel_tasks, supervised
from linked_fleet_gateway.extensions.models.geometry import file_name, meshes_of
from linked_fleet_gateway.extensions.models.meshes import Meshes
from linked_fleet_gateway.extensions.world.floor_map import OBSTACLES_KEY, FloorMap
from linked_fleet_gateway.extensions.world.messages import (
    Answer,
    CheckFailed,
    MeshesMissing,
    Prepare,
    PrepareMap,
    PrepareMesh,
    PrepareObject,
    Question,
    Ready,
)
from linked_fleet_gateway.extensions.world.placement import placement_of
from linked_fleet_gateway.extensions.world.scene import MAX_OBJECTS, SceneObject
from linked_fleet_gateway.serving import Live, NoReply, QuestionProcess, Worker
from linked_fleet_state.robot import Robot
from linked_fleet_state.unchecked import UncheckedLink, in_words

_log = logging.getLogger(__name__)

_ANSWERS = msgspec.msgpack.Decoder(Answer)
NO_ANSWER = CheckFailed("the process that checks motions gave no answer")


class Checker:
    """Sends one question at a time. Meshes are cached in ``folder``. The process may answer further questions."""

    MODULE = "linked_fleet_gateway.extensions.world.check_process"

    def __init__(
        self,
        folder: Path,
        idle_s: float = Worker.IDLE_S,
        module: str = MODULE,
        answers: "msgspec.msgpack.Decoder[Any]" = _ANSWERS,
    ) -> None:
        self._known: set[str] = set()
        self._known_before = frozenset[str]()
        self._process = QuestionProcess[Any, Any](
            module,
            answers,
            str(folder),
            idle_s=idle_s,
            on_idle=self._end_idle,
        )

    def is_prepared(self, key: str) -> bool:
        """Return True if the present process has prepared it."""
        return key in self._known and self._process.running

    def was_prepared(self, key: str) -> bool:
        """Return True if a process that has ended because it was idle had prepared it.

        Its meshes are on disk, so that the next motion waits for it only briefly.
        """
        return key in self._known_before

    def forget_others(self, present: Set[str]) -> None:
        """Forget what ended processes had prepared, except what is in ``present``."""
        self._known_before &= present

    def forget_maps_except(self, key: str) -> None:
        """Forget other maps: the process keeps the latest one."""
        self._known -= {each for each in self._known if each.startswith(OBSTACLES_KEY) and each != key}

    def in_use(self) -> AbstractContextManager[None]:
        """Keep the process, if it runs, from ending because it is idle."""
        return self._process.in_use()

    async def ask(self, question: Question, timeout_s: float) -> Answer:
        """Return the answer, or ``NO_ANSWER`` after ``timeout_s``, when the process is killed.

        Not affected by cancellation.
        """
        return await asyncio.shield(asyncio.create_task(self._ask(question, timeout_s)))

    async def _ask(self, question: Question, timeout_s: float) -> Answer:
        if not self._process.running:
            self._known.clear()
        try:
            answer: Answer = await self._process.ask(question, timeout_s)
        except NoReply:
            self._forget()
            return NO_ANSWER
        if isinstance(question, Prepare | PrepareObject | PrepareMap) and isinstance(answer, Ready):
            self._known.add(question.key)
            self._known_before -= {question.key}
        return answer

    def _forget(self) -> None:
        self._known.clear()
        self._known_before = frozenset()

    async def close(self) -> None:
        self._forget()
        await self._process.end()

    async def _end_idle(self) -> None:
        if self._process.running:
            self._known_before |= self._known
        self._known.clear()
        await self._process.end()


_PREPARE_S, _OBJECT_S = 60.0, 3.0
_LOOK_S = 0.5
NO_MESHES = "its agent does not deliver the meshes"
_ENDED = "the process that checks motions ended several times"
_MOST_TRIES = 3  # attempts for a robot during whose preparation the process ended, possibly for another reason


class Preparation:
    """Sends robots and objects to ``checker``; must be ended by ``close``."""

    def __init__(self, live: Live, meshes: Meshes, checker: Checker) -> None:
        self._live, self._meshes, self._checker = live, meshes, checker
        self._under_way: dict[str, asyncio.Task[None]] = {}
        self._unusable: dict[str, str] = {}
        self._unchecked: dict[str, tuple[UncheckedLink, ...]] = {}
        self._reach_m: dict[str, float] = {}
        self._unusable_meshes: dict[str, dict[str, str]] = {}
        self._logged: set[str] = set()
        self._unheard: set[str] = set()
        self._ended = Counter[tuple[str, str]]()  # by key, and by mesh or empty
        self._keys: dict[str, tuple[Description, str]] = {}
        self._tasks: list[asyncio.Task[None]] = []

    def open(self) -> None:
        failed = "robots could not be prepared for checks"
        self._tasks = [supervised(self._look, "prepare robots", _log, failed, _LOOK_S)]

    async def close(self) -> None:
        await cancel_tasks([*self._tasks, *self._under_way.values()])

    def key(self, robot: Robot) -> str:
        """Return a key that is equal for robots with equal geometry."""
        description = robot.description
        assert description is not None
        held = self._keys.get(robot.name)
        if held is None or held[0] is not description:
            digest = blake2b(f"{description.base} {description.urdf}".encode(), digest_size=16)
            for mesh in description.meshes:
                digest.update(f"{mesh.uri} {mesh.sha256}\n".encode())
            held = self._keys[robot.name] = description, digest.hexdigest()
        return held[1]

    def is_complete(self) -> bool:
        """Return True if every placed robot is prepared, as far as its shapes are available.

        That is also so after the process has ended because it was idle: the next motion starts it again.
        """
        keys = {self.key(robot) for robot in self._live.fleet.robots.values() if is_placed(robot)}
        return all(
            self._checker.is_prepared(key)
            or self._checker.was_prepared(key)
            or key in self._unusable
            or key in self._unheard
            for key in keys
        )

    def unprepared_reason(self, robot: Robot, beside: bool = False) -> str | None:
        """Return why the robot, or one ``beside`` the moving one, is not prepared; None if it is."""
        key = self.key_beside(robot) if beside else self.key(robot)
        if self._checker.is_prepared(key):
            return None
        return self._unusable.get(key, "it is being prepared, try again")

    def key_beside(self, robot: Robot) -> str:
        """Return the key under which a robot beside the moving one is prepared.

        While its agent does not deliver its meshes, it is one of unchecked links.
        """
        key, stand_in = self.key(robot), _stand_in(self.key(robot))
        return stand_in if not self._checker.is_prepared(key) and self._checker.is_prepared(stand_in) else key

    def reach_m(self, robot: Robot) -> float:
        """Return a bound of how far a robot reaches from its root; infinite while that is unknown."""
        return self._reach_m.get(self.key(robot), math.inf)

    async def prepare_robots(self, robots: Collection[Robot]) -> None:
        """Wait until each robot is prepared or cannot be. Cancelling one waiter does not affect others."""
        tasks = [task for robot in robots if (task := self._begin(robot)) is not None]
        if tasks:
            await asyncio.wait(tasks)

    async def prepare_objects(self, objects: Mapping[str, SceneObject]) -> str | None:
        """Prepare all objects. Return why one cannot be prepared, or None."""
        for thing in list(objects.values()):
            key = key_of(thing)
            if not self._checker.is_prepared(key):
                answer = await self._checker.ask(PrepareObject(key, thing.geometry), _OBJECT_S)
                if isinstance(answer, CheckFailed):
                    return f"The shape of {thing.title} cannot be used: {answer.reason}."
        return None

    async def prepare_map(self, found: FloorMap | None) -> str | None:
        """Prepare the map of the floor. Return why it cannot be prepared, or None."""
        if found is None or self._checker.is_prepared(key := found.obstacles_key):
            return None
        settings = found.settings
        question = PrepareMap(key, found.boxes, settings.resolution, settings.origin, found.height_m)
        answer = await self._checker.ask(question, _OBJECT_S)
        if isinstance(answer, CheckFailed):
            return f"The map {found.title} cannot be used: {answer.reason}."
        self._checker.forget_maps_except(key)
        return None

    def _begin(self, robot: Robot) -> asyncio.Task[None] | None:
        """Start the preparation of a robot; return None if there is nothing to do."""
        key = self.key(robot)
        if self._checker.is_prepared(key):
            self._show_unchecked(robot, key)
            return None
        if key in self._unusable:
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
            _log.info("the shape of %s is not available: %s", robot.name, error.detail)
            await self._prepare_stand_in(robot, key)
            return
        if isinstance(answer, Ready):
            self._reach_m[key] = answer.reach_m
            self._unchecked[key] = answer.unchecked
            self._show_unchecked(robot, key)
        elif isinstance(answer, CheckFailed) and answer != NO_ANSWER:
            self._unusable[key] = answer.reason
            _log.warning("no motion near %s can be checked: %s", robot.name, answer.reason)

    async def _prepare_stand_in(self, robot: Robot, key: str) -> None:
        """Prepare the robot without shapes, so that only what is near it waits for its agent."""
        if self._checker.is_prepared(_stand_in(key)):
            return
        assert robot.description is not None
        question = Prepare(_stand_in(key), robot.description.urdf, {}, {}, NO_MESHES, robot.floats)
        answer = await self._checker.ask(question, _PREPARE_S)
        if isinstance(answer, Ready):
            self._unchecked[key] = answer.unchecked
            self._show_unchecked(robot, key)

    def _show_unchecked(self, robot: Robot, key: str) -> None:
        """Store the unchecked links of a robot where its resource shows them, and log them once."""
        unchecked = self._unchecked.get(key, ())
        if robot.unchecked == unchecked:
            return
        robot.unchecked = unchecked
        robot.count_change()
        self._live.fan_out.mark_robot_changed(robot.name)
        if unchecked and key not in self._logged:
            self._logged.add(key)
            _log.warning("%d links of %s are not checked: %s", len(unchecked), robot.name, in_words(unchecked))

    async def _told(self, robot: Robot, key: str) -> Answer:
        """Return the answer after sending all missing meshes. Raises FleetError for a mesh that is not available."""
        assert robot.description is not None
        meshes = {uri: (file_name(mesh), mesh) for uri, mesh in meshes_of(robot).items()}
        names, by_name = {uri: name for uri, (name, _) in meshes.items()}, dict(meshes.values())
        unusable = self._unusable_meshes.setdefault(key, {})
        sent: set[str] = set()
        while True:
            why = f"{_ENDED} while it prepared the robot" if self._ended[key, ""] >= _MOST_TRIES else ""
            question = Prepare(key, robot.description.urdf, names, unusable, why, robot.floats)
            answer = await self._checker.ask(question, _PREPARE_S)
            if not isinstance(answer, MeshesMissing):
                self._ended[key, ""] += answer == NO_ANSWER
                return answer
            unusable |= dict.fromkeys(sent.intersection(answer.meshes), "it is too large to be kept")
            for name in set(answer.meshes) - sent:
                sent.add(name)
                content = await self._meshes.get(robot, by_name[name])
                read = await self._checker.ask(PrepareMesh(name, content), _PREPARE_S)
                if read == NO_ANSWER:
                    self._ended[key, name] += 1
                    if self._ended[key, name] < _MOST_TRIES:
                        return read
                    unusable[name] = f"{_ENDED} while it read the mesh"
                elif isinstance(read, CheckFailed):
                    unusable[name] = read.reason

    async def _look(self) -> None:
        """Prepare newly placed robots, so that the first motion need not wait."""
        self._forget()
        for robot in self._live.fleet.robots.values():
            if not is_placed(robot):
                continue
            if self._checker.was_prepared(key := self.key(robot)):
                self._show_unchecked(robot, key)
            else:
                self._begin(robot)

    def _forget(self) -> None:
        """Drop data of descriptions that no robot has any more."""
        robots = self._live.fleet.robots
        self._keys = {name: held for name, held in self._keys.items() if name in robots}
        present = {key for _, key in self._keys.values()}
        self._unchecked = {key: links for key, links in self._unchecked.items() if key in present}
        self._reach_m = {key: far_m for key, far_m in self._reach_m.items() if key in present}
        self._unusable = {key: why for key, why in self._unusable.items() if key in present}
        self._unusable_meshes = {key: held for key, held in self._unusable_meshes.items() if key in present}
        self._ended = Counter({key: times for key, times in self._ended.items() if key[0] in present})
        self._logged &= present
        self._unheard &= present
        self._checker.forget_others(present)


def is_placed(robot: Robot) -> bool:
    """Return True if the robot has a placement and a description."""
    return placement_of(robot) is not None and robot.model is not None and robot.description is not None


def _stand_in(key: str) -> str:
    return f"{key} without meshes"


@lru_cache(maxsize=2 * MAX_OBJECTS)
def key_of(thing: SceneObject) -> str:
    return "object-" + blake2b(msgspec.msgpack.encode(thing.geometry), digest_size=16).hexdigest()
