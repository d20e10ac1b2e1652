"""The objects of the world in Redis, shared by all gateways and stored permanently."""

from collections.abc import AsyncGenerator
from contextlib import aclosing
from hashlib import sha1

from linked_fleet_gateway.extensions.world.scene import MAX_OBJECTS
from linked_fleet_gateway.runtime.redis import Connection

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

    During an outage every method except ``news`` raises StoreUnavailable, with unknown effect.
    """

    def __init__(self, url: str, namespace: str) -> None:
        # One hash tag, so that a change and its notification are atomic in a cluster too.
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

    async def change(self, id: str, present: str, body: bytes | None) -> None:
        """Replace the body with the digest ``present`` by ``body``, or remove it for None. Raises Changed, Full."""
        put = () if body is None else (body, MAX_OBJECTS, MAX_BYTES)
        said = await self._redis.run(_CHANGE, (self._objects, self._news), id, present, _NEWS, *put)
        if said == b"changed":
            raise Changed(id)
        if said == b"full":
            raise Full(id)

    async def news(self) -> AsyncGenerator[str | None, None]:
        """Yield ids of changed objects; None after an outage, when all must be read again."""
        async with aclosing(self._redis.news()) as news:
            async for fields in news:
                yield None if fields is None else fields[b"id"].decode()
