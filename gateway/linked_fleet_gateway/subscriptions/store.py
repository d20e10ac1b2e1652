"""Subscriptions in Redis: which run holds which, and what is still to be delivered.

Writes are ordered so that nothing is visible that was not accepted: first the holder's list, then the client's count
and the owner's index, last the record: once it is written, the subscription is accepted. NewsKind a crash leaves behind
is found through the list of the crashed run.

"Accepted" means on disk if the server reports ``appendonly yes`` and ``appendfsync always`` (otherwise a warning is
logged), and in the memory of a replica where there is one (``records``).
"""

import asyncio
import logging
from collections.abc import AsyncIterator, Iterable, Mapping, Sequence
from contextlib import aclosing, suppress
from dataclasses import astuple, replace
from typing import Self

from linked_fleet_base.errors import RedisUnavailable
from linked_fleet_gateway.resources.subscription import ChangeableOptions, Delivery, Record, Subscription
from linked_fleet_gateway.subscriptions import redis_scripts as scripts
from linked_fleet_gateway.subscriptions.records import (
    Backlog,
    News,
    NewsKind,
    OutgoingMessage,
    QueueEntry,
    Runs,
    SubscriptionLimitReached,
    SubscriptionLists,
    SubscriptionNotHeld,
    read_entry,
    read_news,
    read_pairs,
    read_record,
    wait_for_replicas,
    write_delivery,
    write_news,
    write_options,
    write_spec,
)
from linked_fleet_gateway.subscriptions.redis_scripts import Keys
from linked_fleet_runtime.redis import BACKGROUND_BATCH_SIZE, BATCH_SIZE, Connection

__all__ = [
    "LEASE_S",
    "Backlog",
    "News",
    "OutgoingMessage",
    "QueueEntry",
    "SubscriptionLimitReached",
    "SubscriptionNotHeld",
    "SubscriptionStore",
]
_log = logging.getLogger(__name__)

LEASE_S = 3.0  # a run that has not renewed its lease for this long counts as dead
_TAKEN_AT_ONCE = 64  # subscriptions taken over together, before they are served
_GONE_MS = 30_000  # longer than it takes to delete a subscription
_ATTEMPTS, _CLEARING_S = 20, 0.05  # to add a subscription that other runs are deleting
_NEWS = 1_000  # approximate number of entries kept
_GROUP = "callback"


class SubscriptionStore:
    """The store as used by one gateway run, an async context manager; ``run`` is unique to it.

    Opens without contact and recovers by itself: while Redis is unavailable, every method but ``news`` raises
    RedisUnavailable. Raises ValueError for an invalid URL or namespace.
    """

    def __init__(self, url: str, namespace: str, run: str, lease_s: float = LEASE_S) -> None:
        self._keys = Keys(namespace)
        self._run = run
        self._redis = Connection(url, self._keys.news)
        self._runs = Runs(self._redis, self._keys, run, lease_s)

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(self, *_: object) -> None:
        await self._redis.close()

    # Runs

    async def renew_lease(self) -> None:
        """Renew the lease of this run."""
        await self._runs.renew_lease()

    async def announce_end(self) -> None:
        """Announce the end of this run; others may adopt what it holds at once."""
        await self._runs.announce_end()

    async def dead_runs(self) -> list[str]:
        """Return the other runs without a lease; none for half a lease after an outage."""
        return await self._runs.dead_runs()

    async def take_over(self, dead_run: str) -> AsyncIterator[Record]:
        """Take over the callbacks of a dead run, yield each record that this run has won, and delete its streams.

        Several gateways may do so at once and may die meanwhile. After RedisUnavailable, or if the iteration is
        abandoned, ``held_records`` returns what was won.
        """
        held = await self._runs.held_subscriptions(dead_run)
        records = await self._records(held)
        found = [record for record in records.values() if record is not None]
        living = await self._runs.living_runs({dead_run, *(record.holder for record in found)}) | {self._run}
        if dead_run in living:
            return
        orphans = [record for record in found if record.holder not in living]
        lasting = [record for record in orphans if record.is_durable]
        streams = {record.subscription.id: record.holder for record in orphans if not record.is_durable}
        rest = set(records)
        for first in range(0, len(lasting), _TAKEN_AT_ONCE):
            won = await self._take(lasting[first : first + _TAKEN_AT_ONCE], held)
            for record in won:
                yield record
            done = {record.subscription.id for record in won}
            await self._runs.remove_held(done, dead_run)
            rest -= done
        removed = await self._remove(streams)  # unless a run has taken them over since
        rest -= {id for id, record in removed.items() if record.holder == dead_run}
        await self._runs.remove_held(await self._reclaim({id: held[id] for id in rest}, dead_run), dead_run)
        await self._runs.remove_run(dead_run)

    async def held_records(self) -> list[Record]:
        """Return what this run holds now; incomplete additions and removals are cleaned up."""
        held = await self._runs.held_subscriptions(self._run)
        records = await self._records(held, BACKGROUND_BATCH_SIZE)
        await self._reclaim({id: held[id] for id, record in records.items() if record is None}, self._run)
        return [record for record in records.values() if record is not None and record.holder == self._run]

    # Subscriptions

    async def add(
        self, subscription: Subscription, delivery: Delivery, limit: int, *, take_over: bool = True, known: bool = False
    ) -> None:
        """Accept a subscription and hold it; SubscriptionLimitReached when its client has ``limit`` already.

        A stream that another run holds is taken over and that run is told, or SubscriptionNotHeld is raised unless
        ``take_over``. A callback stays with another run. ``known``: it was accepted before; raises
        SubscriptionNotHeld if it has been deleted. May be repeated after an outage or RedisUnavailable. When this
        returns, a callback is on disk and, where there are replicas, on one of them; if no replica confirms in time it
        is removed again and RedisUnavailable is raised.
        """
        id, group = subscription.id, "" if subscription.kind.is_stream else _GROUP
        keys = (self._keys.record(id), self._keys.queue(id), self._keys.gone(id))
        fields = (*write_spec(subscription), *write_delivery(delivery))
        take_over = take_over and subscription.kind.is_stream
        for _ in range(_ATTEMPTS):
            await self._list(subscription, limit)
            committed, before = await self._redis.run_script(
                scripts.COMMIT, keys, self._run, group, int(take_over), int(known), *fields
            )
            if committed == scripts.DELETED:
                with suppress(RedisUnavailable):  # ``held_records`` cleans up later
                    await self._reclaim({id: SubscriptionLists(subscription.owner, subscription.client)}, self._run)
                raise SubscriptionNotHeld(id)
            if committed == scripts.TO_BE_CONFIRMED:
                await self._confirm(subscription)
            if committed and before.decode() not in ("", self._run):
                await self._part(subscription, before.decode(), take_over)
            if committed:
                return
            await asyncio.sleep(_CLEARING_S)  # the others took this run for dead
        raise RedisUnavailable(f"other gateways are clearing subscription {id} away")

    async def get_record(self, id: str) -> Record | None:
        return (await self._records([id])).get(id)

    async def records_of_owner(self, owner: str) -> list[Record]:
        """Return the subscriptions of ``owner``, oldest first; streams only while the lease of their holder lasts."""
        ids = [id.decode() for id in await self._redis.execute("SMEMBERS", self._keys.owner(owner))]
        records = [record for record in (await self._records(ids)).values() if record is not None]
        living = await self._runs.living_runs(
            {record.holder for record in records if record.subscription.kind.is_stream}
        )
        shown = [one for one in records if not one.subscription.kind.is_stream or one.holder in living]
        return sorted(shown, key=lambda record: (record.subscription.created_ns, record.subscription.id))

    async def remove(self, id: str, *, only_if_held: bool = False) -> Record | None:
        """Remove a subscription, whoever holds it, and tell another holder; return None if there is none.

        ``only_if_held``: only if this run still holds it.
        """
        record = (await self._remove({id: self._run if only_if_held else ""})).get(id)
        if record is not None and record.holder != self._run:
            await self._tell("removed", id, record.holder)
        return record

    async def change_options(self, before: Subscription, options: ChangeableOptions) -> bool:
        """Replace the options of a subscription as it was read, whoever holds it, and tell every run.

        Returns False, without a change, if it is gone or has other options by now.
        """
        keys = self._keys.record(before.id), self._keys.sent(before.id)
        anew = options.needs_full_state(before.options)
        holder = await self._redis.run_script(scripts.CHANGE, keys, before.revision, write_options(options), int(anew))
        if holder is not None:
            await self._tell("changed", before.id, holder.decode())
        return holder is not None

    async def resume(self, id: str) -> Record | None:
        """Retry the deliveries of a callback at once, and tell its holder; a stream stays as it is."""
        record = await self.get_record(id)
        if record is None or record.subscription.kind.is_stream:
            return record
        resumed = read_record(read_pairs(await self._redis.run_script(scripts.WAKE, (self._keys.record(id),))))
        if resumed is not None:
            await self._tell("resumed", id, resumed.holder)
        return resumed

    async def store_delivery_state(self, id: str, delivery: Delivery, subscription: Subscription | None = None) -> None:
        """Write the state of deliveries, and optionally of the subscription.

        Raises SubscriptionNotHeld if this run does not hold it.
        """
        fields = (*(() if subscription is None else write_spec(subscription)), *write_delivery(delivery))
        if not await self._redis.run_script(scripts.NOTE, (self._keys.record(id),), self._run, *fields):
            raise SubscriptionNotHeld(id)

    async def store_delivery_states(self, deliveries: Mapping[str, Delivery]) -> set[str]:
        """Do ``store_delivery_state`` for many at once.

        Return the ids that this run does not hold, which stay unchanged.
        """
        answers = await self._redis.execute_all(
            [
                ("EVAL", scripts.NOTE, 1, self._keys.record(id), self._run, *write_delivery(delivery))
                for id, delivery in deliveries.items()
            ],
            BACKGROUND_BATCH_SIZE,
        )
        return {id for id, noted in zip(deliveries, answers, strict=True) if not noted}

    # Deliveries of a callback

    async def read_backlog(self, id: str) -> Backlog:
        """Return the pending deliveries, whoever queued them.

        Raises SubscriptionNotHeld if this run does not hold the subscription.
        """
        found = await self._redis.run_script(scripts.BACKLOG, self._queue(id), self._run, _GROUP)
        if found is None:
            raise SubscriptionNotHeld(id)
        entries, sent, number = found
        versions = {path.decode(): version.decode() for path, version in read_pairs(sent).items()}
        return Backlog([read_entry(entry_id, pairs) for entry_id, pairs in entries], versions, number)

    async def advance_queue(
        self, id: str, delivered: QueueEntry | None, outgoing: OutgoingMessage | None, delivery: Delivery,
        forgotten_paths: Sequence[str] = (), number: int | None = None,
    ) -> QueueEntry | None:  # fmt: skip
        """Remove the entry ``delivered``, write ``delivery``, and queue and return ``outgoing``, in one step.

        ``forgotten_paths``: paths of resources that no longer exist; otherwise the backlog would grow with each
        invocation. ``number``: the number that ``outgoing`` must get. If it is not the next number, nothing is done and
        None is returned. Raises SubscriptionNotHeld if this run does not hold the subscription. After RedisUnavailable
        read the backlog: the step may have been executed, or may still be unless its number is used for something else.
        """
        fields, wanted = write_delivery(delivery), "" if number is None else number
        parts = () if outgoing is None else (*astuple(outgoing), wanted)
        entry = "" if delivered is None else delivered.entry_id
        arguments = (self._run, _GROUP, entry, len(fields), *fields, len(forgotten_paths), *forgotten_paths, *parts)
        queued = await self._redis.run_script(scripts.ADVANCE, self._queue(id), *arguments)
        if queued is None:
            raise SubscriptionNotHeld(id)
        if outgoing is None or not queued:
            return None
        entry_id, given = queued
        return QueueEntry(entry_id.decode(), given, outgoing.path, outgoing.version, outgoing.media_type, outgoing.body)

    # News

    async def news(self) -> AsyncIterator[News]:
        """Yield the changes by other gateways since the first contact; outages are waited out, none is missed."""
        async with aclosing(self._redis.stream_entries()) as news:
            async for fields in news:
                if fields is not None:
                    yield read_news(fields)

    async def _tell(self, what: NewsKind, id: str, holder: str) -> None:
        fields = write_news(News(what, id, holder))
        await self._redis.execute("XADD", self._keys.news, "MAXLEN", "~", _NEWS, "*", *fields)

    # Steps

    def _queue(self, id: str) -> tuple[str, str, str]:
        return self._keys.record(id), self._keys.queue(id), self._keys.sent(id)

    async def _records(self, ids: Iterable[str], at_once: int = BATCH_SIZE) -> dict[str, Record | None]:
        """Return the records of the ids, without those written by another version that this one cannot read."""
        asked, records = list(ids), dict[str, Record | None]()
        for first in range(0, len(asked), at_once):  # in parts, so that other requests are served in between
            part = asked[first : first + at_once]
            answers = await self._redis.execute_all([("HGETALL", self._keys.record(id)) for id in part], at_once)
            for id, fields in zip(part, answers, strict=True):
                try:
                    records[id] = read_record(fields)
                except (ValueError, KeyError) as error:
                    _log.warning("subscription %s is left alone, it cannot be read: %r", id, error)
        return records

    async def _list(self, subscription: Subscription, limit: int) -> None:
        id, client = subscription.id, subscription.client
        await self._runs.add_held({id: SubscriptionLists(subscription.owner, client)}, self._run)
        if not await self._redis.run_script(scripts.COUNT, (self._keys.client(client),), id, limit):
            await self._runs.remove_held([id], self._run)
            raise SubscriptionLimitReached(f"{client} has {limit} subscriptions already")
        await self._redis.execute("SADD", self._keys.owner(subscription.owner), id)

    async def _confirm(self, subscription: Subscription) -> None:
        """Wait until replicas have a callback; otherwise remove it and raise RedisUnavailable."""
        try:
            await wait_for_replicas(self._redis, self._keys, self._run, subscription)
        except RedisUnavailable:
            with suppress(RedisUnavailable):
                await self.remove(subscription.id)
            raise

    async def _part(self, subscription: Subscription, other: str, taken: bool) -> None:
        """Leave the subscription with one of two runs; ``other`` held it before."""
        id, held = subscription.id, SubscriptionLists(subscription.owner, subscription.client)
        if taken:
            # again: the other may have removed it just before this run took it
            await self._runs.add_held({id: held}, self._run)
        await self._let_go(id, held, other if taken else self._run)
        if taken:
            await self._tell("replaced", id, other)
        elif subscription.kind.is_stream:
            raise SubscriptionNotHeld(id)

    async def _let_go(self, id: str, held: SubscriptionLists, run: str) -> None:
        await self._runs.remove_held([id], run)
        record = await self.get_record(id)
        if record is not None and record.holder == run:  # it has taken the stream back meanwhile
            await self._runs.add_held({id: held}, run)

    async def _take(self, records: Iterable[Record], held: Mapping[str, SubscriptionLists]) -> list[Record]:
        """Make this run the holder of the records; return those that no other run won."""
        asked = {record.subscription.id: record for record in records}
        await self._runs.add_held({id: held[id] for id in asked}, self._run)
        takes = [
            ("EVAL", scripts.TAKE, 1, self._keys.record(id), record.holder, self._run) for id, record in asked.items()
        ]
        answers = dict(zip(asked, await self._redis.execute_all(takes), strict=True))
        mine = self._run.encode()
        await self._runs.remove_held([id for id, (_, holder) in answers.items() if holder != mine], self._run)
        return [replace(asked[id], holder=self._run) for id, (won, _) in answers.items() if won]

    async def _remove(self, holders: Mapping[str, str]) -> dict[str, Record]:
        """Remove each id if the given run holds it (any run if empty); return the removed records."""
        removes = [
            ("EVAL", scripts.REMOVE, 4, *self._queue(id), self._keys.gone(id), _GONE_MS, holder)
            for id, holder in holders.items()
        ]
        answers = await self._redis.execute_all(removes)
        records = {id: read_record(read_pairs(fields)) for id, fields in zip(holders, answers, strict=True)}
        removed = {id: record for id, record in records.items() if record is not None}
        listed = {id: SubscriptionLists(one.subscription.owner, one.subscription.client) for id, one in removed.items()}
        await self._clear(listed, {id: record.holder for id, record in removed.items()})
        return removed

    async def _reclaim(self, held: Mapping[str, SubscriptionLists], run: str) -> set[str]:
        """Delete what was listed but never accepted, or removed incompletely; return the ids that have a record."""
        reclaims = [("EVAL", scripts.RECLAIM, 2, self._keys.record(id), self._keys.gone(id), _GONE_MS) for id in held]
        answers = dict(zip(held, await self._redis.execute_all(reclaims), strict=True))
        await self._clear({id: held[id] for id, gone in answers.items() if gone}, dict.fromkeys(held, run))
        return {id for id, gone in answers.items() if not gone}

    async def _clear(self, listed: Mapping[str, SubscriptionLists], runs: Mapping[str, str]) -> None:
        """Remove ids without a record from all lists; from the run's list last, through which the others are found."""
        keys = self._keys
        await self._redis.execute_all(
            [("SREM", keys.owner(held.owner), id) for id, held in listed.items()]
            + [("SREM", keys.client(held.client), id) for id, held in listed.items()]
        )
        await self._redis.execute_all([("HDEL", keys.held(runs[id]), id) for id in listed])
        await self._redis.execute_all([("EVAL", scripts.CLEARED, 1, keys.gone(id)) for id in listed])
