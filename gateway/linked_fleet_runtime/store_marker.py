"""A mark in an external Redis by which a gateway notices that its data are lost, as after FLUSHALL.

Callbacks and streams that gateways share end then as if somebody had deleted them, so their end alone says nothing.
"""

import asyncio
import logging
import secrets
from types import TracebackType
from typing import Self

from linked_fleet_runtime.background import cancel_tasks, supervised
from linked_fleet_runtime.redis import Connection

log = logging.getLogger(__name__)

LOST_DATA = (
    "subscriptions and messages that were not delivered, invocations, idempotency keys, control leases, settings and "
    "annotations of robots, objects of the world, rules, sessions and the audit"
)
"""All data that gateways keep in Redis, as text."""
CHECK_S = 5.0
"""Seconds between two looks at the mark."""
LOSS = (
    "Redis has lost the data that gateways keep there: somebody has emptied or replaced it. Forgotten are "
    f"{LOST_DATA}. Settings and objects last until the gateways restart. Restore Redis from its backup, or create "
    "subscriptions and rules anew; then restart the gateways to end this warning."
)


class StoreMarker:
    """Looks at the mark; an async context manager. ``warning``: a sentence about lost data, empty without any."""

    def __init__(self, url: str, namespace: str, check_s: float = CHECK_S) -> None:
        self._key, self._check_s = f"{namespace}:mark", check_s
        self._redis = Connection(url, self._key)
        self._seen: bytes | None = None
        self._tasks: list[asyncio.Task[None]] = []
        self.warning = ""

    async def __aenter__(self) -> Self:
        failed = "it is not known whether Redis keeps its data"
        self._tasks = [supervised(self._look, "look at the mark in Redis", log, failed, self._check_s)]
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        await cancel_tasks(self._tasks)
        await self._redis.close()

    async def _look(self) -> None:
        found = await self._redis.execute("GET", self._key)
        if found is None:
            await self._redis.execute("SET", self._key, secrets.token_hex(16), "NX")
            found = await self._redis.execute("GET", self._key)
        if self._seen is not None and found != self._seen:
            self.warning = LOSS
            log.error("%s", LOSS)
        self._seen = found
