"""Tables of records that all gateways share: conditional writes in Redis, news of them, and a local copy.

The copy answers all reads, so that records stay readable during outages of Redis. A write names the record that it
replaces by its digest: of two concurrent writes one is refused, whichever gateways they come from.
"""

import asyncio
import logging
import uuid
from collections.abc import AsyncGenerator, Callable, Mapping
from contextlib import aclosing
from hashlib import sha1
from types import TracebackType
from typing import Generic, Self, TypeVar

from linked_fleet_base.errors import ContainerFull, RedisUnavailable
from linked_fleet_base.faults import Faults
from linked_fleet_base.records import update_record
from linked_fleet_runtime.background import cancel_tasks
from linked_fleet_runtime.redis import Connection
from linked_fleet_runtime.replica import Replica

log = logging.getLogger(__name__)

T = TypeVar("T")

MAX_RECORDS = 10_000
MAX_BYTES = 32 * 2**20
"""Size of all records of a table, which each gateway holds in memory."""
_NEWS = 1_000  # entries kept, approximately
_RETRY_S = 1.0

# KEYS: records, news; ARGV: id, digest of the expected record, number of news to keep, name of the table and, for a
# write, record, most records, most bytes in total.
_CHANGE = """
local present = redis.call('HGET', KEYS[1], ARGV[1])
if (present and redis.sha1hex(present) or '') ~= ARGV[2] then return 'changed' end
if ARGV[5] then
  if not present and redis.call('HLEN', KEYS[1]) >= tonumber(ARGV[6]) then return 'full' end
  local size = #ARGV[5] - #(present or '')
  for _, id in ipairs(redis.call('HKEYS', KEYS[1])) do size = size + redis.call('HSTRLEN', KEYS[1], id) end
  if size > tonumber(ARGV[7]) then return 'full' end
  redis.call('HSET', KEYS[1], ARGV[1], ARGV[5])
else
  redis.call('HDEL', KEYS[1], ARGV[1])
end
redis.call('XADD', KEYS[2], 'MAXLEN', '~', ARGV[3], '*', 'id', ARGV[1], 'table', ARGV[4])
return 'done'
"""


class Full(Exception):  # noqa: N818
    """There is no room for another record, or for one of this size."""


class Changed(Exception):  # noqa: N818
    """The record has changed concurrently."""


def digest(record: bytes | None) -> str:
    """Return the digest of a record, which may have hundreds of kilobytes; empty for None."""
    return "" if record is None else sha1(record, usedforsecurity=False).hexdigest()


class StoredRecords:
    """The records of a table in Redis, by id.

    ``room`` separates the tables of several owners. During an outage every method except ``news`` raises
    RedisUnavailable, with unknown effect.
    """

    def __init__(
        self, url: str, namespace: str, room: str, name: str, max_records: int = MAX_RECORDS, max_bytes: int = MAX_BYTES
    ) -> None:
        # One hash tag, so that a change and its notification are atomic in a cluster too.
        begin = f"{namespace}:{room}:{{@{room}}}"
        self._name, self._records, self._news = name, f"{begin}:{name}", f"{begin}:news"
        self.limits = max_records, max_bytes
        self._redis = Connection(url, self._news)

    async def close(self) -> None:
        await self._redis.close()

    async def load(self) -> dict[str, bytes]:
        found = await self._redis.execute("HGETALL", self._records)
        return {id.decode(): record for id, record in found.items()}

    async def read(self, id: str) -> bytes | None:
        record: bytes | None = await self._redis.execute("HGET", self._records, id)
        return record

    async def change(self, id: str, present: str, record: bytes | None) -> None:
        """Replace the record with the digest ``present`` by another, or remove it for None. Raises Changed, Full."""
        put = () if record is None else (record, *self.limits)
        said = await self._redis.run_script(_CHANGE, (self._records, self._news), id, present, _NEWS, self._name, *put)
        if said == b"changed":
            raise Changed(id)
        if said == b"full":
            raise Full(id)

    async def news(self) -> AsyncGenerator[str | None, None]:
        """Yield ids of changed records; None after an outage, when all must be read again."""
        async with aclosing(self._redis.stream_entries()) as news:
            async for fields in news:
                if fields is None:
                    yield None
                elif fields.get(b"table", self._name.encode()) == self._name.encode():
                    yield fields[b"id"].decode()


class Table(Generic[T]):
    """Records of one kind, shared by all gateways; an async context manager.

    ``noun`` names the records in messages, such as "objects of the world". ``decode`` raises ValueError for bytes that
    it does not understand: such a record is left out here, which is a fault of the gateway, and stays in Redis.
    ``on_change`` is called with the id, and the record before and after, for changes of any gateway.
    """

    def __init__(
        self,
        stored: StoredRecords,
        noun: str,
        encode: Callable[[T], bytes],
        decode: Callable[[bytes], T],
        on_change: Callable[[str, T | None, T | None], None] = lambda id, before, after: None,
        faults: Faults | None = None,
    ) -> None:
        self._stored, self.noun, self._encode, self._decode = stored, noun, encode, decode
        self._on_change, self._faults = on_change, faults or Faults()
        self._known: dict[str, T] = {}
        self._digests: dict[str, str] = {}
        self.on_unreadable: Callable[[str], None] = lambda id: None
        """Called with the id of a record that cannot be read, and again when it is gone."""
        self.changes = 0
        """Number of changes so far."""
        self._replica = Replica(stored.load, stored.read, self._take)
        self._tasks: list[asyncio.Task[None]] = []

    @property
    def known(self) -> Mapping[str, T]:
        """The records by id, readable also during outages of Redis."""
        return self._known

    @property
    def unreadable(self) -> list[str]:
        """The ids of records that are there and cannot be read. ``change`` replaces and removes them too."""
        if len(self._digests) == len(self._known):
            return []
        return [id for id in self._digests if id not in self._known]

    @property
    def is_loaded(self) -> bool:
        """True once all records were read; those that cannot be understood are faults."""
        return self._replica.is_loaded

    @property
    def awaits_redis(self) -> bool:
        """True while the table is open, and not read because Redis has not answered since then."""
        return bool(self._tasks) and self._replica.awaits_redis

    async def __aenter__(self) -> Self:
        replica, news = self._replica, self._stored.news
        self._tasks = [await replica.follow(f"the {self.noun}", log, news)]
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        await cancel_tasks(self._tasks)
        self._tasks = []
        await self._stored.close()

    async def add(self, record: T) -> str:
        """Add a record and return its id, a UUID. Raises RedisUnavailable, ContainerFull."""
        id = str(uuid.uuid4())
        await self.change(id, record)
        return id

    async def change(self, id: str, record: T | None) -> bool:
        """Replace the known record, or remove it for None. Raises RedisUnavailable, ContainerFull.

        Returns False, without a change, if another gateway has changed it; its state is then known.
        """
        body = None if record is None else self._encode(record)
        try:
            await self._replica.write(id, self._stored.change(id, self._digests.get(id, ""), body))
        except Changed:
            await self._replica.refresh(id)
            return False
        except Full as error:
            count, size = self._stored.limits
            most = f"at most {count} {self.noun}, and {size // 2**20} MiB of them"
            raise ContainerFull(f"There is no room: there are {most}.") from error
        return True

    async def update(self, id: str, update: Callable[[T], T]) -> T | None:
        """Replace the known record by what ``update`` makes of it, whoever changes it meanwhile.

        Return the record, None if it is not there any more. Raises RedisUnavailable, ContainerFull, and the errors of
        ``update``.
        """
        return await update_record(self, id, update)

    async def update_in_the_end(self, id: str, update: Callable[[T], T]) -> T | None:
        """Do ``update``, however long Redis is away."""
        while True:
            try:
                return await self.update(id, update)
            except RedisUnavailable:
                await asyncio.sleep(_RETRY_S)

    def _take(self, id: str, body: bytes | None) -> None:
        before, found = self._known.get(id), digest(body)
        if before is not None and self._digests.get(id) == found:
            return  # it is known as it is
        after, was_there = self._read(id, body), id in self._digests
        if body is None:
            self._digests.pop(id, None)
        else:
            self._digests[id] = found
        if before is after is None and was_there != (body is not None):
            with self._faults.guard(self.noun, thing="on_unreadable"):
                self.on_unreadable(id)
        if before == after:
            return
        self.changes += 1
        if after is None:
            del self._known[id]
        else:
            self._known[id] = after
        with self._faults.guard(self.noun, thing="on_change"):
            self._on_change(id, before, after)

    def _read(self, id: str, body: bytes | None) -> T | None:
        """Return the record; None also if it cannot be read, which stays a fault until it can, or is removed."""
        with self._faults.guard(self.noun, thing=f"record {id}"):
            return None if body is None else self._decode(body)
        return None
