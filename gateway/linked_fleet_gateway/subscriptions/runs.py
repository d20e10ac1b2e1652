"""The living runs of gateways, and what each of them holds; all in one slot of Redis.

The value of a lease changes with each renewal, and observers measure the age of a value with their own monotonic clock.
So nobody seems dead or alive only because the clock of Redis was set.
"""

import time
from collections.abc import Collection, Iterable, Mapping

from linked_fleet_gateway.runtime.redis import Connection
from linked_fleet_gateway.subscriptions import redis_scripts as scripts
from linked_fleet_gateway.subscriptions.records import Held, read_held, write_held
from linked_fleet_gateway.subscriptions.redis_keys import Keys

_LEFT = b"left"


class Runs:
    """All runs as seen by the run ``run``. Every method raises StoreUnavailable."""

    def __init__(self, redis: Connection, keys: Keys, run: str, lease_s: float) -> None:
        self._redis = redis
        self._keys = keys
        self._run = run
        self._lease_s = lease_s
        self._renewals = 0
        self._heard: dict[str, tuple[bytes, float]] = {}  # lease value of each other run, and when it was first seen

    async def renew(self) -> None:
        self._renewals += 1
        await self._say(f"{self._renewals} {self._lease_s}")
        await self._redis.one("SADD", self._keys.runs, self._run)

    async def leave(self) -> None:
        await self._say(_LEFT)
        await self.retire(self._run)

    async def _say(self, what: str | bytes) -> None:
        await self._redis.one("SET", self._keys.lease(self._run), what, "PX", round(self._lease_s * 1000))

    async def dead(self) -> list[str]:
        """Return the runs without a lease.

        None for half a lease after an outage, in which living runs could not renew theirs.
        """
        runs = {run.decode() for run in await self._redis.one("SMEMBERS", self._keys.runs)} - {self._run}
        self._heard = {run: heard for run, heard in self._heard.items() if run in runs}
        dead = runs - await self.living(runs)
        return sorted(dead) if self._redis.served_s > self._lease_s / 2 else []

    async def living(self, runs: Iterable[str]) -> set[str]:
        """Return those of ``runs`` that have renewed their lease recently; a run without a known lease has not."""
        asked = list(runs)
        leases = await self._redis.one("MGET", *map(self._keys.lease, asked)) if asked else ()
        now_s = time.monotonic()
        return {run for run, lease in zip(asked, leases, strict=True) if self._lives(run, lease, now_s)}

    def _lives(self, run: str, lease: bytes | None, now_s: float) -> bool:
        if lease is not None and (run not in self._heard or self._heard[run][0] != lease):
            self._heard[run] = lease, now_s
        said, since_s = self._heard.get(run, (_LEFT, now_s))
        return said != _LEFT and now_s - since_s < float(said.partition(b" ")[2])

    async def retire(self, run: str) -> None:
        """Forget a dead run that holds nothing."""
        keys = (self._keys.runs, self._keys.held(run), self._keys.lease(run))
        await self._redis.run(scripts.RETIRE, keys, run, _LEFT)

    async def held(self, run: str) -> dict[str, Held]:
        """Return what a run holds, has begun to add or has not finished removing, by id."""
        held = await self._redis.one("HGETALL", self._keys.held(run))
        return {id.decode(): read_held(text) for id, text in held.items()}

    async def hold(self, held: Mapping[str, Held], run: str) -> None:
        """Record what ``run`` is about to hold, by id; not empty."""
        # The hash before the set: a run that is in the set and holds something is never retired.
        fields = (part for id, one in held.items() for part in (id, write_held(one)))
        await self._redis.one("HSET", self._keys.held(run), *fields)
        await self._redis.one("SADD", self._keys.runs, run)

    async def drop(self, ids: Collection[str], run: str) -> None:
        """Remove ``ids`` from what ``run`` holds."""
        if ids:
            await self._redis.one("HDEL", self._keys.held(run), *ids)
