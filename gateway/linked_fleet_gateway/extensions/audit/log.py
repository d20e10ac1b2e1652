"""The audit log: each command and each change of a subscription is a log record and an entry in Redis.

What pages do by themselves has a stream of its own. Requests do not wait for it. During an outage of Redis entries are
buffered, up to a limit.
"""

import asyncio
import logging
import time
from collections import deque
from itertools import chain
from types import TracebackType
from typing import Self

from msgspec.structs import asdict

from linked_fleet_gateway.api import RequestEvent, cancel_tasks, supervised
from linked_fleet_gateway.extensions.audit.entry import AuditEntry, written
from linked_fleet_gateway.extensions.audit.query import Query
from linked_fleet_gateway.extensions.audit.search import Found, Search
from linked_fleet_gateway.serving import RedisConnection, run_last_step

log = logging.getLogger("gateway.audit")

MAX_ENTRIES = 100_000
"""Approximate number of entries in Redis; older ones are only in the log."""
MAX_BY_PAGES = 20_000
"""The same of what pages did by themselves, so that it displaces no command."""
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
_LOGGED = ("who", "what", "target", "robot", "outcome", "result", "reason")
_GATHER_S = 0.02  # in which entries are collected, because each command costs a third of a millisecond


class AuditLog:
    """Writes and reads the audit log; an async context manager."""

    def __init__(self, url: str, namespace: str) -> None:
        self._key = f"{namespace}:audit"
        self._by_pages = f"{self._key}:pages"
        self._redis = RedisConnection(url, self._key)
        self._search = Search(self._redis, self._key, self._by_pages)
        self._waiting: deque[tuple[bool, AuditEntry]] = deque(maxlen=MAX_WAITING)
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

    def record(self, event: RequestEvent) -> None:
        """Record an event that has just happened."""
        status = "" if event.status is None else str(event.status)
        entry = AuditEntry(
            time.time_ns(), event.client, event.event, event.path, event.robot, status, event.request, event.created,
            event.reason,
        )  # fmt: skip
        said = {name: text for name, text in asdict(entry).items() if name in _LOGGED and text}
        log.info("%s: %s %s %s", entry.who, entry.what, entry.target, status, extra=said)
        if len(self._waiting) == MAX_WAITING:
            log.warning("the oldest entry that waits for Redis is given up; the log has it")
        self._waiting.append((event.by_page, entry))
        self._news.set()

    async def find(self, query: Query) -> Found:
        """Return the entries that a query selects. Raises RedisUnavailable, Busy."""
        return await self._search.find(query)

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
        for by_page, stream, most in ((False, self._key, MAX_ENTRIES), (True, self._by_pages, MAX_BY_PAGES)):
            contents = [written(entry) for of_page, entry in batch if of_page is by_page]
            if contents:
                lines = chain.from_iterable((str(len(each)), *each) for each in contents)
                await self._redis.run_script(_ADD, (stream,), most, *lines)
        for each in batch:
            if self._waiting and self._waiting[0] is each:  # the oldest may have been dropped meanwhile
                self._waiting.popleft()
