"""The objects of the world: this gateway's copy, and changes for all gateways."""

import asyncio
import logging
import uuid
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from types import TracebackType
from typing import Self

from linked_fleet_gateway.base.errors import NoRoom, StoreAway
from linked_fleet_gateway.extensions.world.describe import OBJECTS, object_path
from linked_fleet_gateway.extensions.world.scene import MAX_OBJECTS, SceneObject, decode, encode
from linked_fleet_gateway.extensions.world.store import MAX_BYTES, Changed, Full, ObjectStore, digest
from linked_fleet_gateway.runtime.background import end
from linked_fleet_gateway.runtime.redis import StoreUnavailable
from linked_fleet_gateway.runtime.replica import Replica, follow
from linked_fleet_gateway.subscriptions.live import Live

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
        self._tasks = [await follow("the objects of the world", log, replica.load, replica.refresh, self._store.news)]
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        await end(self._tasks)
        await self._store.close()

    async def add(self, thing: SceneObject) -> str:
        """Add an object and return its id. Raises StoreAway, NoRoom."""
        id = str(uuid.uuid4())
        await self.change(id, thing)
        return id

    async def change(self, id: str, thing: SceneObject | None) -> bool:
        """Replace the known object, or remove it for None. Raises StoreAway, NoRoom.

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
            self._live.fan_out.appeared(object_path(id))
        for path in (object_path(id), OBJECTS):
            self._live.fan_out.touched(path)


def _read(id: str, body: bytes) -> SceneObject | None:
    try:
        return decode(body)
    except ValueError as error:
        log.error("object %s cannot be read, and is not there for this gateway: %r", id, error)
        return None


@asynccontextmanager
async def _refusals() -> AsyncIterator[None]:
    try:
        yield
    except Full as error:
        most = f"at most {MAX_OBJECTS} objects, and {MAX_BYTES // 2**20} MiB of them"
        raise NoRoom(f"There is no room: the world holds {most}.") from error
    except StoreUnavailable as error:
        raise StoreAway(f"Redis is away: {error}. What is known of the world can be read nevertheless.") from error
