"""Records and errors of the store besides subscriptions, the runs of gateways that hold them, and confirmation.

The value of a lease changes with each renewal, and observers measure the age of a value with their own monotonic clock.
So nobody seems dead or alive only because the clock of Redis was set.

Replicas confirm that they have an accepted callback. A callback is confirmed if the master of its record has a replica
in step; its lists are then confirmed too where their masters have replicas. Nothing else waits for replicas: a failover
can lose the last moment of deliveries.
"""

import time
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Literal, cast

import msgspec

from linked_fleet_base.errors import RedisUnavailable
from linked_fleet_gateway.resources.subscription import ChangeableOptions, Delivery, DeliveryState, Record, Subscription
from linked_fleet_gateway.subscriptions import redis_scripts as scripts
from linked_fleet_gateway.subscriptions.redis_scripts import Keys
from linked_fleet_runtime.redis import Connection

NewsKind = Literal["removed", "resumed", "replaced", "changed"]


class SubscriptionLimitReached(Exception):  # noqa: N818
    """The client has reached its limit of subscriptions; nothing was stored."""


class SubscriptionNotHeld(Exception):  # noqa: N818
    """The subscription is gone, or another gateway run holds it now."""


@dataclass(frozen=True)
class OutgoingMessage:
    """A representation to be delivered, rendered for the ``revision`` of its subscription."""

    path: str
    version: str
    media_type: str
    body: bytes
    revision: int = 0


@dataclass(frozen=True)
class QueueEntry:
    """A representation in the queue of a callback. ``number`` counts its deliveries from 1 without gaps."""

    entry_id: str
    number: int
    path: str
    version: str
    media_type: str
    body: bytes


@dataclass(frozen=True)
class Backlog:
    """The undelivered entries, oldest first, with the state of the queue.

    ``last_versions``: the version of each resource that was queued last, by path. ``last_number``: that of the last
    entry, delivered or not.
    """

    entries: list[QueueEntry]
    last_versions: dict[str, str]
    last_number: int = 0


@dataclass(frozen=True)
class News:
    """A change by another gateway to a subscription of the run ``holder``.

    ``changed``: it has other options. This concerns every run: one that does not hold it yet may be about to open it.
    ``replaced``: a stream is open there now, unless ``holder`` has taken it back since; its record says who has it.
    """

    kind: NewsKind
    id: str
    holder: str


@dataclass(frozen=True)
class SubscriptionLists:
    """The lists that contain a subscription. The run that holds it writes this before anything else."""

    owner: str
    client: str


def write_lists(held: SubscriptionLists) -> bytes:
    return msgspec.json.encode(held)


def read_lists(text: bytes) -> SubscriptionLists:
    """Parse the output of ``write_held``. Raises ValueError for anything else."""
    return msgspec.json.decode(text, type=SubscriptionLists)


def write_news(news: News) -> tuple[str, ...]:
    return ("what", news.kind, "id", news.id, "holder", news.holder)


def read_news(fields: Mapping[bytes, bytes]) -> News:
    what = cast(NewsKind, fields[b"what"].decode())
    return News(what, fields[b"id"].decode(), fields[b"holder"].decode())


def write_spec(subscription: Subscription) -> tuple[str | bytes, ...]:
    """Return the fields of the client's request.

    Changed options have fields of their own, so that no run overwrites them with what it knew.
    """
    return ("spec", msgspec.json.encode(replace(subscription, revision=0)))


def write_options(options: ChangeableOptions) -> bytes:
    return msgspec.json.encode(options)


def write_delivery(delivery: Delivery) -> tuple[str, ...]:
    """Return names and values in turn; None becomes empty."""
    return (
        *("state", delivery.state.value),
        *("last_ns", "" if delivery.last_ns is None else str(delivery.last_ns)),
        *("last_status", "" if delivery.last_status is None else str(delivery.last_status)),
        *("failures", str(delivery.failures)),
        *("reason", delivery.reason),
        *("consented", "1" if delivery.consented else ""),
        *("allowed_interval_s", repr(delivery.allowed_interval_s)),
    )


def read_record(fields: Mapping[bytes, bytes]) -> Record | None:
    """Return None for no fields; raises ValueError or KeyError for fields that this version does not write."""
    if not fields:
        return None
    subscription = msgspec.json.decode(fields[b"spec"], type=Subscription)
    if (options := fields.get(b"options")) is not None:
        subscription = subscription.with_options(
            msgspec.json.decode(options, type=ChangeableOptions), int(fields[b"revision"])
        )
    delivery = Delivery(
        state=DeliveryState(fields[b"state"].decode()),
        last_ns=_number(fields[b"last_ns"]),
        last_status=_number(fields[b"last_status"]),
        failures=int(fields[b"failures"]),
        reason=fields[b"reason"].decode(),
        consented=bool(fields[b"consented"]),
        allowed_interval_s=float(fields[b"allowed_interval_s"]),
    )
    return Record(subscription, delivery, fields[b"holder"].decode())


def read_entry(entry_id: bytes, pairs: list[bytes]) -> QueueEntry:
    fields = read_pairs(pairs)
    return QueueEntry(
        entry_id.decode(),
        int(fields[b"number"]),
        fields[b"path"].decode(),
        fields[b"version"].decode(),
        fields[b"media_type"].decode(),
        fields[b"body"],
    )


def read_pairs(pairs: list[bytes]) -> dict[bytes, bytes]:
    """Return a hash from the names and values in turn that scripts return."""
    return dict(zip(pairs[::2], pairs[1::2], strict=True))


def _number(text: bytes) -> int | None:
    return int(text) if text else None


_LEFT = b"left"


class Runs:
    """All runs as seen by the run ``run``. Every method raises RedisUnavailable."""

    def __init__(self, redis: Connection, keys: Keys, run: str, lease_s: float) -> None:
        self._redis = redis
        self._keys = keys
        self._run = run
        self._lease_s = lease_s
        self._renewals = 0
        self._heard: dict[str, tuple[bytes, float]] = {}  # lease value of each other run, and when it was first seen

    async def renew_lease(self) -> None:
        self._renewals += 1
        await self._say(f"{self._renewals} {self._lease_s}")
        await self._redis.execute("SADD", self._keys.runs, self._run)

    async def announce_end(self) -> None:
        await self._say(_LEFT)
        await self.remove_run(self._run)

    async def _say(self, what: str | bytes) -> None:
        await self._redis.execute("SET", self._keys.lease(self._run), what, "PX", round(self._lease_s * 1000))

    async def dead_runs(self) -> list[str]:
        """Return the runs without a lease.

        None for half a lease after an outage, in which living runs could not renew theirs.
        """
        runs = {run.decode() for run in await self._redis.execute("SMEMBERS", self._keys.runs)} - {self._run}
        self._heard = {run: heard for run, heard in self._heard.items() if run in runs}
        dead = runs - await self.living_runs(runs)
        return sorted(dead) if self._redis.since_outage_s > self._lease_s / 2 else []

    async def living_runs(self, runs: Iterable[str]) -> set[str]:
        """Return those of ``runs`` that have renewed their lease recently; a run without a known lease has not."""
        asked = list(runs)
        leases = await self._redis.execute("MGET", *map(self._keys.lease, asked)) if asked else ()
        now_s = time.monotonic()
        return {run for run, lease in zip(asked, leases, strict=True) if self._lives(run, lease, now_s)}

    def _lives(self, run: str, lease: bytes | None, now_s: float) -> bool:
        if lease is not None and (run not in self._heard or self._heard[run][0] != lease):
            self._heard[run] = lease, now_s
        said, since_s = self._heard.get(run, (_LEFT, now_s))
        return said != _LEFT and now_s - since_s < float(said.partition(b" ")[2])

    async def remove_run(self, run: str) -> None:
        """Forget a dead run that holds nothing."""
        keys = (self._keys.runs, self._keys.held(run), self._keys.lease(run))
        await self._redis.run_script(scripts.RETIRE, keys, run, _LEFT)

    async def held_subscriptions(self, run: str) -> dict[str, SubscriptionLists]:
        """Return what a run holds, has begun to add or has not finished removing, by id."""
        held = await self._redis.execute("HGETALL", self._keys.held(run))
        return {id.decode(): read_lists(text) for id, text in held.items()}

    async def add_held(self, held: Mapping[str, SubscriptionLists], run: str) -> None:
        """Record what ``run`` is about to hold, by id; not empty."""
        # The hash before the set: a run that is in the set and holds something is never retired.
        fields = (part for id, one in held.items() for part in (id, write_lists(one)))
        await self._redis.execute("HSET", self._keys.held(run), *fields)
        await self._redis.execute("SADD", self._keys.runs, run)

    async def remove_held(self, ids: Collection[str], run: str) -> None:
        """Remove ``ids`` from what ``run`` holds."""
        if ids:
            await self._redis.execute("HDEL", self._keys.held(run), *ids)


async def wait_for_replicas(redis: Connection, keys: Keys, run: str, subscription: Subscription) -> None:
    """Wait until a replica confirms a callback that ``run`` holds, and one of each other master its lists.

    Raises RedisUnavailable if none confirms in time, or if the callback is gone.
    """
    id = subscription.id
    lists = (keys.held(run), keys.owner(subscription.owner), keys.client(subscription.client))
    others = await redis.keys_on_other_masters(keys.record(id), lists)
    online = await redis.execute_all([("EVAL", scripts.REPLICAS, 1, key) for key in others])
    replicated = [key for key, is_so in zip(others, online, strict=True) if is_so]
    for key, member in [(keys.record(id), "holder"), *((key, id) for key in replicated)]:
        found, confirmed = await redis.run_replicated_script(scripts.REPEAT, key, member)
        if not found:  # a failover lost it, or it has been removed already
            raise RedisUnavailable(f"subscription {id} was gone before a replica had it")
        if not confirmed:
            raise RedisUnavailable(f"no replica of Redis confirmed subscription {id} in time")
