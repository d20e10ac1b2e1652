"""The world: its resources in the tree, its objects, and the checks of motions.

All gateways share the objects through Redis; each has a copy of them.
"""

import asyncio
import logging
import uuid
from collections.abc import AsyncGenerator, AsyncIterator, Iterator, Sequence
from contextlib import AsyncExitStack, aclosing, asynccontextmanager
from hashlib import sha1
from pathlib import Path
from types import TracebackType
from typing import Self

from pyoxigraph import Triple

from linked_fleet_gateway.base.errors import ContainerFull
from linked_fleet_gateway.extensions.world.checks import Checks
from linked_fleet_gateway.extensions.world.collisions import Collisions
from linked_fleet_gateway.extensions.world.descriptions import OBJECTS, describe_frame, describe_objects, object_path
from linked_fleet_gateway.extensions.world.placement import LF, WORLD
from linked_fleet_gateway.extensions.world.resources import resolve_world
from linked_fleet_gateway.extensions.world.scene import MAX_OBJECTS, SceneObject, decode, encode
from linked_fleet_gateway.fleet.kinematics import ORIGIN
from linked_fleet_gateway.fleet.model import Pose
from linked_fleet_gateway.rdf.graph import Graph
from linked_fleet_gateway.resources.branches import FleetBranch, Found, RequestView
from linked_fleet_gateway.runtime.background import cancel_tasks
from linked_fleet_gateway.runtime.redis import Connection
from linked_fleet_gateway.runtime.replica import Replica, follow_changes
from linked_fleet_gateway.subscriptions.live import Live

MAX_BYTES = 32 * 2**20  # of all objects, which each gateway holds in memory
_NEWS = 1_000

# KEYS: objects, news; ARGV: id, digest of the expected body, number of news to keep and, for a write, body, most
# objects, most bytes in total.
_CHANGE = """
local present = redis.call('HGET', KEYS[1], ARGV[1])
if (present and redis.sha1hex(present) or '') ~= ARGV[2] then return 'changed' end
if ARGV[4] then
  if not present and redis.call('HLEN', KEYS[1]) >= tonumber(ARGV[5]) then return 'full' end
  local size = #ARGV[4] - #(present or '')
  for _, id in ipairs(redis.call('HKEYS', KEYS[1])) do size = size + redis.call('HSTRLEN', KEYS[1], id) end
  if size > tonumber(ARGV[6]) then return 'full' end
  redis.call('HSET', KEYS[1], ARGV[1], ARGV[4])
else
  redis.call('HDEL', KEYS[1], ARGV[1])
end
redis.call('XADD', KEYS[2], 'MAXLEN', '~', ARGV[3], '*', 'id', ARGV[1])
return 'done'
"""


class Full(Exception):  # noqa: N818
    """There is no room for another object, or for one of this size."""


class Changed(Exception):  # noqa: N818
    """The object has changed concurrently."""


def digest(body: bytes | None) -> str:
    """Return the digest of a body, which may have hundreds of kilobytes; empty for None."""
    return "" if body is None else sha1(body, usedforsecurity=False).hexdigest()


class ObjectStore:
    """Stored bodies by id.

    During an outage every method except ``news`` raises RedisUnavailable, with unknown effect.
    """

    def __init__(self, url: str, namespace: str) -> None:
        # One hash tag, so that a change and its notification are atomic in a cluster too.
        self._objects, self._news = f"{namespace}:world:{{@world}}:objects", f"{namespace}:world:{{@world}}:news"
        self._redis = Connection(url, self._news)

    async def close(self) -> None:
        await self._redis.close()

    async def load(self) -> dict[str, bytes]:
        found = await self._redis.execute("HGETALL", self._objects)
        return {id.decode(): body for id, body in found.items()}

    async def read(self, id: str) -> bytes | None:
        body: bytes | None = await self._redis.execute("HGET", self._objects, id)
        return body

    async def change(self, id: str, present: str, body: bytes | None) -> None:
        """Replace the body with the digest ``present`` by ``body``, or remove it for None. Raises Changed, Full."""
        put = () if body is None else (body, MAX_OBJECTS, MAX_BYTES)
        said = await self._redis.run_script(_CHANGE, (self._objects, self._news), id, present, _NEWS, *put)
        if said == b"changed":
            raise Changed(id)
        if said == b"full":
            raise Full(id)

    async def news(self) -> AsyncGenerator[str | None, None]:
        """Yield ids of changed objects; None after an outage, when all must be read again."""
        async with aclosing(self._redis.stream_entries()) as news:
            async for fields in news:
                yield None if fields is None else fields[b"id"].decode()


log = logging.getLogger(__name__)


class Objects:
    """An async context manager; ``known`` is the copy, which stays readable during outages of Redis."""

    def __init__(self, live: Live, store: ObjectStore) -> None:
        self._live, self._store = live, store
        self.known: dict[str, SceneObject] = {}
        self.changes = 0
        """Number of changes so far."""
        self._digests: dict[str, str] = {}
        self._replica = Replica(store.load, store.read, self._take)
        self._tasks: list[asyncio.Task[None]] = []

    async def __aenter__(self) -> Self:
        replica = self._replica
        self._tasks = [
            await follow_changes("the objects of the world", log, replica.load, replica.refresh, self._store.news)
        ]
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        await cancel_tasks(self._tasks)
        await self._store.close()

    async def add(self, thing: SceneObject) -> str:
        """Add an object and return its id. Raises RedisUnavailable, ContainerFull."""
        id = str(uuid.uuid4())
        await self.change(id, thing)
        return id

    async def change(self, id: str, thing: SceneObject | None) -> bool:
        """Replace the known object, or remove it for None. Raises RedisUnavailable, ContainerFull.

        Returns False, without a change, if another gateway has changed it; its state is then known.
        """
        body = None if thing is None else encode(thing)
        async with _refusals():
            try:
                await self._replica.write(id, self._store.change(id, self._digests.get(id, ""), body))
            except Changed:
                await self._replica.refresh(id)
                return False
        return True

    def _take(self, id: str, body: bytes | None) -> None:
        before, thing = self.known.get(id), None if body is None else _read(id, body)
        if body is None:
            self._digests.pop(id, None)
        else:
            self._digests[id] = digest(body)
        if before == thing:
            return
        self.changes += 1
        if thing is None:
            del self.known[id]
        else:
            self.known[id] = thing
        if before is None:
            self._live.fan_out.add_resource(object_path(id))
        for path in (object_path(id), OBJECTS):
            self._live.fan_out.mark_changed(path)


def _read(id: str, body: bytes) -> SceneObject | None:
    try:
        return decode(body)
    except ValueError as error:
        log.error("object %s cannot be read and is ignored by this gateway: %r", id, error)
        return None


@asynccontextmanager
async def _refusals() -> AsyncIterator[None]:
    try:
        yield
    except Full as error:
        most = f"at most {MAX_OBJECTS} objects, and {MAX_BYTES // 2**20} MiB of them"
        raise ContainerFull(f"There is no room: the world holds {most}.") from error


class World:
    """An async context manager; meshes are cached in ``folder``."""

    def __init__(self, live: Live, url: str, namespace: str, folder: Path) -> None:
        self.objects = Objects(live, ObjectStore(url, namespace))
        self._described: tuple[tuple[str, int], Sequence[Triple]] = (("", 0), ())
        self.collisions = Collisions(live.fan_out.mark_changed)
        self.checks = Checks(live, self.objects.known, folder, self.collisions)
        self._stack = AsyncExitStack()

    @property
    def branch(self) -> FleetBranch:
        objects, collisions = self.objects.known, self.collisions.known

        def resolve(view: RequestView, rest: list[str]) -> Found:
            return resolve_world(view, rest, objects, collisions)

        return FleetBranch(WORLD[1:], LF.world, resolve, graphs=self.triples, poses=self.poses)

    def poses(self) -> dict[str, Pose]:
        """Poses of the frame itself and of the objects in it, by path."""
        return {WORLD: ORIGIN} | {object_path(id): each.pose for id, each in self.objects.known.items()}

    def triples(self, view: RequestView) -> Iterator[tuple[str, Sequence[Triple]]]:
        """Yield all statements about the world, for copies of the fleet. Placements are described with their robots."""
        frame, key, known = Graph(), (view.base, self.objects.changes), self.objects.known
        describe_frame(frame, view.base, view.robots.values())
        yield WORLD, frame.triples
        if self._described[0] != key:
            objects = Graph()
            describe_objects(objects, view.base, known, len(known))
            self._described = key, objects.triples
        yield OBJECTS, self._described[1]

    async def __aenter__(self) -> Self:
        await self._stack.enter_async_context(self.objects)
        await self._stack.enter_async_context(self.checks)
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        await self._stack.aclose()
