"""Which runs of gateways are alive, and what each of them holds; all in one slot of Redis."""

from collections.abc import Collection, Iterable, Mapping

from gateway.store.connection import Connection
from gateway.subscriptions import scripts
from gateway.subscriptions.keys import Keys
from gateway.subscriptions.records import Held, read_held, write_held


class Runs:
    """The runs as one of them, ``run``, sees them. Every method raises StoreUnavailable."""

    def __init__(self, redis: Connection, keys: Keys, run: str, lease_s: float) -> None:
        self._redis = redis
        self._keys = keys
        self._run = run
        self._lease_s = lease_s

    async def renew(self) -> None:
        lease_ms = round(self._lease_s * 1000)
        await self._redis.one("SET", self._keys.lease(self._run), "", "PX", lease_ms)
        await self._redis.one("SADD", self._keys.runs, self._run)

    async def leave(self) -> None:
        await self._redis.one("DEL", self._keys.lease(self._run))
        await self.retire(self._run)

    async def dead(self) -> list[str]:
        """None for half a lease after an outage, in which the living could not renew theirs."""
        runs = {run.decode() for run in await self._redis.one("SMEMBERS", self._keys.runs)} - {self._run}
        dead = runs - await self.living(runs)
        return sorted(dead) if self._redis.served_s > self._lease_s / 2 else []

    async def living(self, runs: Iterable[str]) -> set[str]:
        """Those of ``runs`` that have a lease."""
        asked = list(runs)
        leases = await self._redis.one("MGET", *map(self._keys.lease, asked)) if asked else ()
        return {run for run, lease in zip(asked, leases, strict=True) if lease is not None}

    async def retire(self, run: str) -> None:
        """Forget a run that is dead and holds nothing."""
        await self._redis.run(scripts.RETIRE, (self._keys.runs, self._keys.held(run), self._keys.lease(run)), run)

    async def held(self, run: str) -> dict[str, Held]:
        """By id, what a run holds, began to add or did not finish to remove."""
        held = await self._redis.one("HGETALL", self._keys.held(run))
        return {id.decode(): read_held(text) for id, text in held.items()}

    async def hold(self, held: Mapping[str, Held], run: str) -> None:
        """Note what ``run`` is about to hold, at least one by its id."""
        # The list before the set: a run that is in the set and holds something is never retired from it.
        fields = (part for id, one in held.items() for part in (id, write_held(one)))
        await self._redis.one("HSET", self._keys.held(run), *fields)
        await self._redis.one("SADD", self._keys.runs, run)

    async def drop(self, ids: Collection[str], run: str) -> None:
        """Let ``ids`` be held by ``run`` no longer."""
        if ids:
            await self._redis.one("HDEL", self._keys.held(run), *ids)
