"""The owed stops in Redis, so that a stop outlives the gateway that was asked for it."""

import logging
import time
from collections.abc import Callable, Sequence

import msgspec

from linked_fleet_gateway.actions.redis_scripts import robot_from_tag, robot_tag
from linked_fleet_runtime.redis import Connection
from linked_fleet_state.owed_stops import MAX_OF_ONE, MAX_ROBOTS, Key, OwedStop

_log = logging.getLogger(__name__)
_MAX_BYTES = 512 * 1024  # of an entry: more than a stop can have
_MAX_ENTRIES = MAX_ROBOTS * MAX_OF_ONE


class OwedStopTable:
    """One hash, with an entry for each owed stop. Every method raises RedisUnavailable during an outage.

    Entries expire after ``retention_s``: a robot that no gateway has heard for so long holds by itself. ``tell`` is
    called with robot and id of each changed entry.
    """

    def __init__(self, redis: Connection, key: str, retention_s: float, tell: Callable[[str, str], None]) -> None:
        self._redis, self._key, self._retention_s, self._tell = redis, key, retention_s, tell

    async def write(self, owed: Sequence[OwedStop]) -> None:
        if not owed:
            return
        entries = [part for each in owed for part in (_field(each.key), msgspec.json.encode(each))]
        await self._redis.execute("HSET", self._key, *entries)
        for each in owed:
            self._tell(*each.key)

    async def remove(self, keys: Sequence[Key]) -> None:
        if not keys:
            return
        await self._redis.execute("HDEL", self._key, *map(_field, keys))
        for key in keys:
            self._tell(*key)

    async def read(self, key: Key) -> OwedStop | None:
        body = await self._redis.execute("HGET", self._key, _field(key))
        return None if body is None else _read(key, body)

    async def read_all(self) -> list[OwedStop]:
        """Return all entries, the earliest stops first. Remove those that have expired or cannot be read."""
        content: dict[bytes, bytes] = await self._redis.execute("HGETALL", self._key)
        since_ns = time.time_ns() - int(self._retention_s * 1e9)
        found, useless = list[OwedStop](), list[bytes]()
        for field, body in content.items():
            owed = _read(_key(field), body)
            if owed is None or owed.asked_ns < since_ns or len(found) >= _MAX_ENTRIES:
                useless.append(field)
            else:
                found.append(owed)
        if useless:
            await self._redis.execute("HDEL", self._key, *useless)
        return sorted(found, key=lambda owed: owed.asked_ns)


def _field(key: Key) -> str:
    return f"{robot_tag(key[0])} {key[1]}"  # an escaped name has no space


def _key(field: bytes) -> Key | None:
    try:
        tag, _, id = field.decode().partition(" ")
        return robot_from_tag(tag), id
    except ValueError:
        return None


def _read(key: Key | None, body: bytes) -> OwedStop | None:
    try:
        owed = msgspec.json.decode(body, type=OwedStop) if len(body) <= _MAX_BYTES else None
    except ValueError as error:
        _log.warning("an owed stop is left out, it cannot be read: %r", error)
        return None
    return owed if owed is not None and owed.key == key else None
