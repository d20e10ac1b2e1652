"""Meshes of robots: fetched once, verified by digest, and cached in memory within a bound."""

import asyncio
import hashlib
from collections import OrderedDict, defaultdict
from collections.abc import Awaitable, Callable

from linked_fleet_agent.wire.messages import Mesh
from linked_fleet_base.errors import AgentTimeout, Offline
from linked_fleet_gateway.api import Busy, Robot
from linked_fleet_gateway.serving import Live, NoAnswer

MAX_HELD_BYTES = 64 * 2**20
# A robot that does not answer must not block requests to others.
MAX_UNDER_WAY, MAX_UNDER_WAY_OF_A_ROBOT = 256, 64
_AT_ONCE, _AT_ONCE_OF_A_ROBOT = 8, 2
_TIMEOUT_S = 15.0

Ask = Callable[[str, Mesh, float], Awaitable[bytes]]


def read_mesh(answer: bytes | str, mesh: Mesh) -> tuple[bytes | None, str]:
    """Check a mesh by its length only; computing a digest here would take too long."""
    if isinstance(answer, str):
        return None, answer
    if len(answer) != mesh.size:
        return None, f"the answer has {len(answer)} bytes, but the description says {mesh.size}"
    return answer, ""


async def ask(live: Live, robot: str, mesh: Mesh, timeout_s: float) -> bytes:
    """Return the content of a mesh, of the length in ``mesh``. Raises NoAnswer."""
    none = f"no agent hands out meshes of robot {robot!r}"
    payload = mesh.sha256.encode()
    return await live.link.ask_agent(
        robot, "mesh", payload, mesh.size, timeout_s, lambda answer: read_mesh(answer, mesh), none
    )


class Meshes:
    """The mesh cache. ``ask`` fetches a mesh of the stated size from a robot, or raises NoAnswer."""

    def __init__(self, ask: Ask) -> None:
        self._ask = ask
        self._held: OrderedDict[str, bytes] = OrderedDict()
        self._held_bytes = 0
        self._under_way: dict[tuple[str, str], asyncio.Task[bytes]] = {}
        self._room = asyncio.Semaphore(_AT_ONCE)
        self._room_of = defaultdict[str, asyncio.Semaphore](lambda: asyncio.Semaphore(_AT_ONCE_OF_A_ROBOT))

    async def get(self, robot: Robot, mesh: Mesh) -> bytes:
        """Return a mesh that the description of ``robot`` names. Raises Offline, AgentTimeout or Busy."""
        if (held := self._held.get(mesh.sha256)) is not None:
            self._held.move_to_end(mesh.sha256)
            return held
        if not robot.online:
            raise Offline(f"Robot {robot.name!r} is offline, and nobody asked for this mesh lately.")
        key = (robot.name, mesh.sha256)
        task = self._under_way.get(key)
        if task is None:
            of_robot = sum(name == robot.name for name, _ in self._under_way)
            if len(self._under_way) >= MAX_UNDER_WAY or of_robot >= MAX_UNDER_WAY_OF_A_ROBOT:
                raise Busy("Too many meshes are being asked for; ask again in a moment.")
            task = self._under_way[key] = asyncio.create_task(self._fetch(robot.name, mesh))
            task.add_done_callback(lambda done: self._ended(key, done))
        # other requests may wait for the same fetch, so a cancelled one does not end it
        return await asyncio.shield(task)

    def close(self) -> None:
        for task in self._under_way.values():
            task.cancel()

    def _ended(self, key: tuple[str, str], task: asyncio.Task[bytes]) -> None:
        del self._under_way[key]
        if not task.cancelled():
            task.exception()  # retrieved even if nobody waits any more

    async def _fetch(self, robot: str, mesh: Mesh) -> bytes:
        async with self._room_of[robot], self._room:
            try:
                content = await self._ask(robot, mesh, _TIMEOUT_S)
            except NoAnswer as silence:
                raise AgentTimeout(f"The mesh could not be had: {silence.reason}.") from silence
            # Large ones take long enough to delay the event loop.
            digest = await asyncio.to_thread(lambda: hashlib.sha256(content).hexdigest())
        if digest != mesh.sha256:
            raise AgentTimeout(f"Robot {robot!r} gave other bytes than those that its description names.")
        self._keep(digest, content)
        return content

    def _keep(self, digest: str, content: bytes) -> None:
        if digest not in self._held:
            self._held[digest] = content
            self._held_bytes += len(content)
        while self._held_bytes > MAX_HELD_BYTES:
            _, oldest = self._held.popitem(last=False)
            self._held_bytes -= len(oldest)
