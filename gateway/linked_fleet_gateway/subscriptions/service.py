"""All subscriptions: those served here, the stored ones of others, and the take-over from dead gateways (R1.8)."""

import asyncio
import logging
import time
import uuid
from contextlib import suppress
from types import TracebackType

from linked_fleet_base.errors import RedisUnavailable
from linked_fleet_gateway.resources.subscription import ChangeableOptions, Record, Subscription
from linked_fleet_gateway.subscriptions.broadcast import Ending
from linked_fleet_gateway.subscriptions.callbacks import Callbacks, EntitlementCheck
from linked_fleet_gateway.subscriptions.fan_out import FanOut
from linked_fleet_gateway.subscriptions.store import LEASE_S, News, SubscriptionStore
from linked_fleet_gateway.subscriptions.streams import Streams
from linked_fleet_runtime.background import cancel_tasks, run_last_step, supervised
from linked_fleet_webhooks.network import Network

log = logging.getLogger(__name__)

KEEP_S = 0.5
"""Interval between two checks of leases; with the store's lease of 3 s, a dead gateway's callbacks move within 5 s."""
NOTE_S = 5.0
RECONCILE_S = 10.0


class Subscriptions:
    """An async context manager.

    ``limit``: subscriptions per client address; ``consent_required``: whether receivers must consent.
    """

    def __init__(
        self,
        store: SubscriptionStore,
        run: str,
        fan_out: FanOut,
        network: Network,
        *,
        consent_required: bool,
        limit: int,
        check_entitlement: EntitlementCheck = lambda *_: True,
    ) -> None:
        self._store, self._run = store, run
        self.streams = Streams(store, run, fan_out, limit)
        self.callbacks = Callbacks(store, run, fan_out, network, limit, consent_required, check_entitlement)
        self._refreshing = asyncio.Lock()
        self._tasks: list[asyncio.Task[None]] = []
        self._renewed_s = float("-inf")
        self._away, self._note_s, self._compare_s = False, 0.0, 0.0

    async def __aenter__(self) -> "Subscriptions":
        self._tasks = [
            supervised(self._renew, "renew the lease", log, "the lease could not be renewed", KEEP_S),
            supervised(self._keep, "keep subscriptions", log, "keeping subscriptions failed", KEEP_S),
            supervised(self._hear, "hear of subscriptions", log, "hearing of subscriptions failed", KEEP_S),
        ]
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        await cancel_tasks(self._tasks)
        await asyncio.gather(self.streams.aclose(), self.callbacks.aclose())
        await run_last_step(self._store.announce_end(), log, "the store could not be told that this gateway ends")

    @property
    def store_is_available(self) -> bool:
        """True if the lease of this gateway was renewed recently."""
        return time.monotonic() - self._renewed_s < LEASE_S

    async def records_of_owner(self, owner: str) -> list[Record]:
        """Return all subscriptions of a thing, at all gateways. Raises RedisUnavailable."""
        return [self.streams.with_last_message_time(record) for record in await self._store.records_of_owner(owner)]

    async def get_record(self, id: str) -> Record | None:
        """Return one subscription, at whichever gateway it is. Raises RedisUnavailable."""
        record = await self._store.get_record(id)
        return None if record is None else self.streams.with_last_message_time(record)

    async def cancel(self, id: str) -> bool:
        """Delete a subscription, at whichever gateway it is; return False if there is none. Raises RedisUnavailable."""
        record = await self._store.remove(id)
        await self._drop(id)
        return record is not None

    async def change_options(self, before: Subscription, options: ChangeableOptions) -> bool:
        """Change the options of a subscription at any gateway; return False if ``before`` is out of date."""
        if not await self._store.change_options(before, options):
            return False
        with suppress(RedisUnavailable):  # the change is stored; its news arrives when the store is available again
            await self._refresh(before.id)
        return True

    async def resume(self, id: str) -> bool:
        """Retry a callback at once, at whichever gateway holds it; return False if there is none."""
        return await self._store.resume(id) is not None

    async def _drop(self, id: str) -> None:
        self.streams.end_stream(id, Ending.CANCELLED)
        await self.callbacks.stop_serving(id)

    # -- with the other gateways --------------------------------------------------------------------------------------

    async def _hear(self) -> None:
        async for news in self._store.news():
            if news.holder == self._run or news.kind == "changed":
                await self._apply_news(news)

    async def _apply_news(self, news: News) -> None:
        match news.kind:
            case "removed":
                await self._drop(news.id)
            case "replaced":
                await self.streams.end_replaced(news.id)
            case "resumed":
                self.callbacks.resume(news.id)
            case "changed":
                with suppress(RedisUnavailable):  # ``_keep`` compares later
                    await self._refresh(news.id)

    async def _refresh(self, id: str) -> None:
        """Apply the stored record to what is served here. Serialized, so that an older record never wins."""
        async with self._refreshing:
            if self.streams.serves(id) or self.callbacks.serves(id):
                record = await self._store.get_record(id)
                if record is not None:
                    self.streams.change_options(record.subscription)
                    self.callbacks.change_options(record.subscription)

    async def _renew(self) -> None:
        """Renew the lease, apart from the other work, which may take over a thousand callbacks."""
        try:
            await self._store.renew_lease()
            self._renewed_s = time.monotonic()
        except RedisUnavailable:
            self._renewed_s = float("-inf")

    async def _take_over(self, run: str) -> None:
        count = 0
        async for record in self._store.take_over(run):
            count += 1
            if record.subscription.kind.is_stream:
                self.streams.take_over(record.subscription.id)
            else:
                await self.callbacks.take_over(record)
        if count:
            log.info("took %d subscriptions over from gateway run %s", count, run)

    async def _keep(self) -> None:
        try:
            await self.callbacks.suspend_unentitled()
            await self.callbacks.remove_refused()
            await self.streams.store_missed_changes()
            for run in await self._store.dead_runs():
                await self._take_over(run)
            if time.monotonic() >= self._note_s:
                await self.streams.store_message_times()
                self._note_s = time.monotonic() + NOTE_S
            if time.monotonic() >= self._compare_s:
                await self._compare()
                self._compare_s = time.monotonic() + RECONCILE_S
            self._away = False
        except RedisUnavailable as error:
            if not self._away:
                log.warning("callbacks wait for Redis: %s", error)
            self._away = True

    async def _compare(self) -> None:
        """Serve what the store assigns to this run."""
        held = {record.subscription.id: record for record in await self._store.held_records()}
        await self.callbacks.reconcile(held)
        await self.streams.reconcile(held)
        for id, record in held.items():
            if not (self.streams.has_options(record.subscription) and self.callbacks.has_options(record.subscription)):
                await self._refresh(id)  # it may have changed while this run took it over


def new_run_name() -> str:
    """Return a new name for one run of a gateway."""
    return uuid.uuid4().hex
