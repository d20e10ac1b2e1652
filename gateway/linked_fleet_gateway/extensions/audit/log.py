"""The audit log: each command and each change of a subscription is a log record and an entry in Redis.

Requests do not wait for it. During an outage of Redis entries are buffered, up to a limit.
"""

import asyncio
import logging
import re
import time
from collections import deque
from collections.abc import Mapping
from itertools import chain
from types import TracebackType
from typing import Self

from msgspec import Struct
from msgspec.structs import asdict, fields

from linked_fleet_gateway.api import cancel_tasks, supervised
from linked_fleet_gateway.serving import RedisConnection, run_last_step

log = logging.getLogger("gateway.audit")

MAX_ENTRIES = 100_000
"""Approximate number of entries in Redis; older ones are only in the log."""
PAGE_SIZE = 100
MAX_WAITING = 10_000
_AT_ONCE = 256
# KEYS: stream; ARGV: number of entries to keep, then for each entry the number of its names and values, and these. One
# answer for all entries, because reading an answer takes redis-py longer than writing an entry takes Redis.
_ADD = """
local at = 2
while at <= #ARGV do
  local last = at + tonumber(ARGV[at])
  redis.call('XADD', KEYS[1], 'MAXLEN', '~', ARGV[1], '*', unpack(ARGV, at + 1, last))
  at = last + 1
end
return 1
"""
_ID = re.compile(r"[0-9]{1,20}-[0-9]{1,20}", re.ASCII)
_GATHER_S = 0.02  # in which entries are collected, because each command costs a third of a millisecond


class AuditEntry(Struct, frozen=True):
    """One entry. ``what`` is the method, or the event of a stream; ``outcome`` the response status, empty for an end.

    ``result`` is the path of the created invocation or subscription. ``at_ns`` is gateway wall time.
    """

    at_ns: int
    who: str
    what: str
    target: str
    robot: str
    outcome: str
    request: str
    result: str


class AuditLog:
    """Writes and reads the audit log; an async context manager."""

    def __init__(self, url: str, namespace: str) -> None:
        self._key = f"{namespace}:audit"
        self._redis = RedisConnection(url, self._key)
        self._waiting: deque[AuditEntry] = deque(maxlen=MAX_WAITING)
        self._news = asyncio.Event()
        self._tasks: list[asyncio.Task[None]] = []

    async def __aenter__(self) -> Self:
        failed = "Redis does not have the audit yet"
        self._tasks = [supervised(self._write_all, "write the audit", log, failed, _GATHER_S)]
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        await cancel_tasks(self._tasks)
        if self._waiting:
            await run_last_step(self._write_all(), log, "the last entries are only in the log")
        await self._redis.close()

    def record(
        self, who: str, what: str, target: str, robot: str, outcome: str, request: str, result: str = ""
    ) -> None:
        """Record an event that has just happened."""
        entry = AuditEntry(time.time_ns(), who, what, target, robot, outcome, request, result)
        said = {"who": who, "what": what, "target": target, "robot": robot, "outcome": outcome, "result": result}
        log.info("%s: %s %s %s", who, what, target, outcome, extra={name: text for name, text in said.items() if text})
        if len(self._waiting) == MAX_WAITING:
            log.warning("the oldest entry that waits for Redis is given up; the log has it")
        self._waiting.append(entry)
        self._news.set()

    async def read_page(self, before: str) -> list[tuple[str, AuditEntry]]:
        """Return the newest entries with their ids, or those before the id ``before``.

        Raises RedisUnavailable, ValueError.
        """
        if before and not _ID.fullmatch(before):
            raise ValueError(f"{before[:50]!r} is no id of an entry")
        last = f"({before}" if before else "+"
        found = await self._redis.execute("XREVRANGE", self._key, last, "-", "COUNT", PAGE_SIZE)
        return [(id.decode(), _read(pairs)) for id, pairs in found]

    async def _write_all(self) -> None:
        """Write the entries that wait. Those that come meanwhile are gathered for the next call."""
        await self._news.wait()
        for _ in range(0, len(self._waiting), _AT_ONCE):
            await self._write()
        if not self._waiting:
            self._news.clear()

    async def _write(self) -> None:
        """Write the oldest entries. After an outage some may be written twice, because the result was unknown."""
        batch = [self._waiting[n] for n in range(min(_AT_ONCE, len(self._waiting)))]
        await self._redis.run_script(_ADD, (self._key,), MAX_ENTRIES, *chain.from_iterable(map(_written, batch)))
        for each in batch:
            if self._waiting and self._waiting[0] is each:  # the oldest may have been dropped meanwhile
                self._waiting.popleft()


def _written(entry: AuditEntry) -> list[str | int]:
    """Return the fields of an entry as the script takes them, after their number."""
    words = [text for name, value in asdict(entry).items() if value for text in (name, str(value))]
    return [len(words), *words]


def _read(pairs: list[bytes] | Mapping[bytes, bytes]) -> AuditEntry:
    items = list(pairs.items()) if isinstance(pairs, Mapping) else list(zip(pairs[::2], pairs[1::2], strict=True))
    said = {name.decode(): text.decode(errors="replace") for name, text in items}
    texts = {each.name: said.get(each.name, "") for each in fields(AuditEntry) if each.name != "at_ns"}
    return AuditEntry(int(said.get("at_ns", "0")), **texts)
