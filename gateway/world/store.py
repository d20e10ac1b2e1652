"""The objects of the world in Redis, shared by all gateways and kept for good."""

from collections.abc import AsyncGenerator

from gateway.store.connection import Connection
from gateway.world.scene import MAX_OBJECTS

MAX_BYTES = 32 * 2**20  # of all objects, which each gateway holds in memory
_NEWS = 1_000

# KEYS: objects, news; ARGV: id, body, most objects, most bytes of all. Whether there was room.
_PUT = """
local present = redis.call('HSTRLEN', KEYS[1], ARGV[1])
if present == 0 and redis.call('HLEN', KEYS[1]) >= tonumber(ARGV[3]) then return 0 end
local size = #ARGV[2] - present
for _, id in ipairs(redis.call('HKEYS', KEYS[1])) do size = size + redis.call('HSTRLEN', KEYS[1], id) end
if size > tonumber(ARGV[4]) then return 0 end
redis.call('HSET', KEYS[1], ARGV[1], ARGV[2])
redis.call('XADD', KEYS[2], 'MAXLEN', '~', ARGV[5], '*', 'id', ARGV[1])
return 1
"""
# KEYS: objects, news; ARGV: id. Whether it was there.
_DELETE = """
local there = redis.call('HDEL', KEYS[1], ARGV[1])
if there == 1 then redis.call('XADD', KEYS[2], 'MAXLEN', '~', ARGV[2], '*', 'id', ARGV[1]) end
return there
"""


class Full(Exception):  # noqa: N818
    """There is no room for another object, or for one of this size."""


class ObjectStore:
    """Bodies by id. While Redis is away every method raises StoreUnavailable; what was asked may have been done."""

    def __init__(self, url: str, namespace: str) -> None:
        # One hash tag, so that a change and the news of it are one step in a cluster as well.
        self._objects, self._news = f"{namespace}:world:{{@world}}:objects", f"{namespace}:world:{{@world}}:news"
        self._redis = Connection(url, self._news)

    async def close(self) -> None:
        await self._redis.close()

    async def load(self) -> dict[str, bytes]:
        found = await self._redis.one("HGETALL", self._objects)
        return {id.decode(): body for id, body in found.items()}

    async def read(self, id: str) -> bytes | None:
        body: bytes | None = await self._redis.one("HGET", self._objects, id)
        return body

    async def put(self, id: str, body: bytes) -> None:
        """Full."""
        keys = (self._objects, self._news)
        if not await self._redis.run(_PUT, keys, id, body, MAX_OBJECTS, MAX_BYTES, _NEWS):
            raise Full

    async def delete(self, id: str) -> bool:
        """False when there was none."""
        return bool(await self._redis.run(_DELETE, (self._objects, self._news), id, _NEWS))

    async def news(self) -> AsyncGenerator[str, None]:
        """Ids of objects that anybody put or deleted since the first contact; ends with StoreUnavailable."""
        while True:
            for fields in await self._redis.follow():
                yield fields[b"id"].decode()
