"""The objects of the world as this gateway knows them, and how they are changed for all. Outages are waited out."""

import asyncio
import logging
import uuid
from collections.abc import AsyncIterator
from contextlib import aclosing, asynccontextmanager
from types import TracebackType
from typing import Self

from gateway.base.errors import NoRoom, StoreAway
from gateway.extensions.world.describe import OBJECTS, object_path
from gateway.extensions.world.scene import MAX_OBJECTS, SceneObject, decode, encode
from gateway.extensions.world.store import MAX_BYTES, Changed, Full, ObjectStore, digest
from gateway.runtime.cancellation import end
from gateway.runtime.redis import StoreUnavailable
from gateway.subscriptions.live import Live

log = logging.getLogger(__name__)

_BACKOFF_S = 0.2


class Objects:
    """``known`` is what everything is read from, whether or not Redis is there; an async context manager."""

    def __init__(self, live: Live, store: ObjectStore) -> None:
        self._live, self._store = live, store
        self.known: dict[str, SceneObject] = {}
        self.changes = 0
        """How often anything was put or taken away."""
        self._digests: dict[str, str] = {}
        # One answer after the other, so that none is taken after one that is newer.
        self._reading = asyncio.Lock()
        self._whole = False
        self._following: asyncio.Task[None] | None = None

    async def __aenter__(self) -> Self:
        try:
            await self._load()
        except StoreUnavailable as error:  # it is loaded as soon as it is there
            log.warning("the store is away, the objects of the world are not known yet: %s", error)
        except Exception:
            # The boundary: whatever is in Redis, a gateway starts and stops robots.
            log.exception("the objects of the world cannot be read; the gateway starts without them")
        self._following = asyncio.create_task(self._follow_for_ever(), name="follow objects")
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._following is not None:
            await end([self._following])
        await self._store.close()

    async def add(self, thing: SceneObject) -> str:
        """The id of the new object; StoreAway, NoRoom."""
        id = str(uuid.uuid4())
        await self.change(id, thing)
        return id

    async def change(self, id: str, thing: SceneObject | None) -> bool:
        """Put an object in the place of the one that is known, or None to take that away; StoreAway, NoRoom.
        False, and nothing is changed, when another gateway was faster: what it did is known now."""
        changed, body = True, None if thing is None else encode(thing)
        async with _refusals():
            try:
                await self._store.change(id, self._digests.get(id, ""), body)
            except Changed:
                changed = False
            await self._refresh(id)
        return changed

    async def _refresh(self, id: str) -> None:
        async with self._reading:
            self._take(id, await self._store.read(id))

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

    async def _follow_for_ever(self) -> None:
        """What other gateways change is heard of; after an outage everything is read anew."""
        while True:
            try:
                if not self._whole:
                    await self._load()
                await self._follow()
            except StoreUnavailable as error:
                self._whole = False
                log.debug("the objects of the world may be out of date: %s", error)
            except Exception:
                # The boundary of the task: without it nothing would be heard of any more.
                self._whole = False
                log.exception("the objects of the world are not up to date; they are read anew")
            await asyncio.sleep(_BACKOFF_S)

    async def _follow(self) -> None:
        async with aclosing(self._store.news()) as news:
            async for id in news:
                await self._refresh(id)

    async def _load(self) -> None:
        async with self._reading:
            bodies = await self._store.load()
            for id in {*self._digests, *bodies}:
                self._take(id, bodies.get(id))
        self._whole = True


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
