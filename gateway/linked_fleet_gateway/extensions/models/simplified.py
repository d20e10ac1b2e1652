"""Simplified meshes: made once by a process of their own, and kept in memory within a bound."""

import asyncio
import logging
from collections import Counter, OrderedDict

import msgspec

from linked_fleet_agent.wire.messages import Mesh
from linked_fleet_gateway.api import Busy, Content, Robot
from linked_fleet_gateway.extensions.models.geometry import SUFFIXES
from linked_fleet_gateway.extensions.models.meshes import MAX_UNDER_WAY, Meshes
from linked_fleet_gateway.extensions.models.simplify_messages import (
    Simplified,
    Simplify,
    SimplifyAnswer,
)
from linked_fleet_gateway.serving import NoReply, QuestionProcess

MAX_HELD_BYTES = 32 * 2**20
MAX_UNDER_WAY_OF_A_ROBOT = 64
_MAX_FAILED = 1_000
_TIMEOUT_S = 30.0

_Key = tuple[str, str]
"""Digest and media type: the same bytes are another mesh in another format."""

_log = logging.getLogger(__name__)
_ANSWERS = msgspec.msgpack.Decoder(SimplifyAnswer)


class SimplifiedMeshes:
    """The simplified forms of ``meshes``. Must be closed by ``aclose``."""

    MODULE = "linked_fleet_gateway.extensions.models.simplify_process"

    def __init__(self, meshes: Meshes, module: str = MODULE) -> None:
        self._meshes = meshes
        self._process = QuestionProcess[Simplify, SimplifyAnswer](module, _ANSWERS)
        self._held: OrderedDict[_Key, Content] = OrderedDict()
        self._held_bytes = 0
        self._failed: OrderedDict[_Key, str] = OrderedDict()
        self._under_way: dict[_Key, asyncio.Task[Content | None]] = {}
        self._of_robot = Counter[str]()

    async def get(self, robot: Robot, mesh: Mesh) -> Content | None:
        """Return the simplified form of a mesh of the robot, or None if it has none.

        Raises Offline, AgentTimeout or Busy.
        """
        key = mesh.sha256, mesh.type
        if (held := self._held.get(key)) is not None:
            self._held.move_to_end(key)
            return held
        if key in self._failed:
            return None
        task = self._under_way.get(key)
        if task is None:
            # One process does it, so that a robot with meshes that take long must not keep it from others.
            if len(self._under_way) >= MAX_UNDER_WAY or self._of_robot[robot.name] >= MAX_UNDER_WAY_OF_A_ROBOT:
                raise Busy("Too many meshes are being simplified; ask again in a moment.")
            self._of_robot[robot.name] += 1
            task = self._under_way[key] = asyncio.create_task(self._simplify(robot, mesh))
            task.add_done_callback(lambda done: self._ended(robot.name, key, done))
        # other requests may wait for the same one, so a cancelled one does not end it
        return await asyncio.shield(task)

    async def aclose(self) -> None:
        for task in self._under_way.values():
            task.cancel()
        await self._process.end()

    def _ended(self, robot: str, key: "_Key", task: "asyncio.Task[Content | None]") -> None:
        del self._under_way[key]
        self._of_robot -= Counter({robot: 1})  # which forgets robots that have none
        if not task.cancelled():
            task.exception()  # retrieved even if nobody waits any more

    async def _simplify(self, robot: Robot, mesh: Mesh) -> Content | None:
        content = await self._meshes.get(robot, mesh)
        try:
            answer = await self._process.ask(Simplify(SUFFIXES[mesh.type], content), _TIMEOUT_S)
        except NoReply:  # another time it may have the time or the memory
            return None
        if isinstance(answer, Simplified):
            return self._keep((mesh.sha256, mesh.type), await asyncio.to_thread(Content.of, answer.content))
        _log.info("the mesh %s of %s is served as it is: %s", mesh.uri, robot.name, answer.reason)
        self._failed[mesh.sha256, mesh.type] = answer.reason
        if len(self._failed) > _MAX_FAILED:
            self._failed.popitem(last=False)
        return None

    def _keep(self, key: "_Key", content: Content) -> Content:
        self._held[key] = content
        self._held_bytes += content.size
        while self._held_bytes > MAX_HELD_BYTES and len(self._held) > 1:
            _, oldest = self._held.popitem(last=False)
            self._held_bytes -= oldest.size
        return content
