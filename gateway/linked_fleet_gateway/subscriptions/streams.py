"""The open streams of this gateway, and their records in the store, by which every gateway lists them.

Streams live on connections and continue while the store is unavailable; it is updated later. A stream that was created
by POST waits for a while between its connections.
"""

import asyncio
import logging
from collections import Counter
from collections.abc import Awaitable, Callable
from contextlib import suppress
from dataclasses import replace

from linked_fleet_base.errors import RedisUnavailable
from linked_fleet_gateway.resources.subscription import Delivery, DeliveryState, Depth, Kind, Record, Subscription
from linked_fleet_gateway.subscriptions.broadcast import Ending, Outlet
from linked_fleet_gateway.subscriptions.fan_out import FanOut
from linked_fleet_gateway.subscriptions.store import SubscriptionLimitReached, SubscriptionNotHeld, SubscriptionStore
from linked_fleet_gateway.subscriptions.watcher import Watcher
from linked_fleet_runtime.background import cancel_tasks

log = logging.getLogger(__name__)

UNOPENED_S = 60.0
"""Time that a stream created by POST waits to be opened, at first and again after each connection."""
_LAST_S = 1.0  # limit for reporting closed streams to the store when this gateway ends


class Streams:
    """``limit``: subscriptions per client."""

    def __init__(self, store: SubscriptionStore, run: str, fan_out: FanOut, limit: int) -> None:
        self._store, self._run, self._fan_out, self._limit = store, run, fan_out, limit
        self._open: dict[str, Watcher] = {}
        self._coming: set[str] = set()
        self._cancelled: set[str] = set()  # deleted while they were being registered
        self._changed: dict[str, Subscription] = {}  # changed while they were being registered, with their new options
        self._expiries: dict[str, asyncio.TimerHandle] = {}
        # What the store is still to be told, and the differences found by the last comparison.
        self._unlisted: set[str] = set()
        self._ended: set[str] = set()
        self._missed: set[str] = set()
        self._strays: set[str] = set()
        self._noted: dict[str, int | None] = {}
        self._background: set[asyncio.Task[None]] = set()

    def count_by_kind(self) -> Counter[str]:
        """Return the number of open streams by kind."""
        return Counter(watcher.subscription.kind.value for watcher in list(self._open.values()))

    # -- connections --------------------------------------------------------------------------------------------------

    async def register(self, subscription: Subscription, *, posted: bool = False) -> None:
        """List a stream before it is opened; SubscriptionLimitReached if the client has too many subscriptions.

        Raises SubscriptionNotHeld if it was created by POST (``posted``) and has been deleted.
        """
        id = subscription.id
        waited = id in self._expiries
        self._coming.add(id)
        self._ended.discard(id)
        self._stop_waiting(id)
        try:
            await self._list(subscription, posted)
        except SubscriptionNotHeld:
            self._leave(id)
            raise
        except BaseException:
            self._leave(id)
            if waited:
                self._expire(id)
            else:
                self._ended.add(id)  # it may be stored
            raise

    async def _list(self, subscription: Subscription, posted: bool) -> None:
        try:
            await self._store.add(subscription, Delivery(), self._limit, known=posted)
        except RedisUnavailable:
            mine = [each for each in self._open.values() if each.subscription.client == subscription.client]
            if len(mine) >= self._limit:
                raise SubscriptionLimitReached(f"{subscription.client} has {len(mine)} subscriptions already") from None
            self._unlisted.add(subscription.id)

    def open(self, subscription: Subscription, outlet: Outlet, last_event_id: str | None) -> Watcher:
        """Open a registered stream; ``last_event_id`` is the id of the message that the subscriber saw last.

        It ends at once if the resource no longer exists. For a subtree, the id is that of any one of its resources and
        says nothing about the others: all of them are sent again.
        """
        id = subscription.id
        if (changed := self._changed.get(id)) is not None:
            subscription = subscription.with_options(changed.options, changed.revision)
        seen = None if subscription.depth is Depth.SUBTREE else last_event_id
        watcher = self._fan_out.watch(subscription, outlet, last_event_id=seen)
        if id in self._cancelled:
            watcher.end(Ending.CANCELLED)
            self._ended.add(id)  # it may have been listed after it was deleted
        else:
            if (other := self._open.get(id)) is not None:
                other.end(Ending.REPLACED)
            self._open[id] = watcher
        self._leave(id)
        return watcher

    def close(self, subscription: Subscription, watcher: Watcher | None, *, reopenable: bool) -> None:
        """Handle the end of a stream's connection; a stream that was created by POST waits for the next one."""
        id, last_ns = subscription.id, None
        if watcher is None:
            reopenable = reopenable and id not in self._cancelled
            self._leave(id)
        else:
            watcher.close()
            subscription, last_ns = watcher.subscription, watcher.last_sent_ns
            if self._open.get(id) is not watcher:
                return  # cancelled, or opened on another connection
            del self._open[id]
            self._noted.pop(id, None)
        if reopenable:
            self._later(lambda: self._offer_again(subscription, last_ns))
        else:
            self._later(lambda: self._forget(id))

    def revoke(self, id: str) -> None:
        """End a stream for good whose client has lost the right to it; does nothing if it has ended."""
        if id in self._open:
            self.end_stream(id, Ending.UNENTITLED)
            self._later(lambda: self._forget(id))

    def end_all(self) -> None:
        """Close every stream because the gateway ends; clients reconnect to another one, or later."""
        for watcher in list(self._open.values()):
            watcher.end(Ending.SHUTDOWN)
        self._open.clear()

    async def aclose(self) -> None:
        """Finish after all connections are closed; streams created by POST are left to wait at another gateway."""
        self.end_all()
        for timer in self._expiries.values():
            timer.cancel()
        if self._background:
            await asyncio.wait(self._background, timeout=_LAST_S)
        await cancel_tasks(self._background)

    # -- between connections ------------------------------------------------------------------------------------------

    async def add_unopened(self, subscription: Subscription) -> None:
        """Store a stream that nobody has opened yet, for a while.

        Raises SubscriptionLimitReached, RedisUnavailable.
        """
        try:
            await self._store.add(subscription, Delivery(DeliveryState.WAITING), self._limit)
        except SubscriptionLimitReached:
            raise
        except BaseException:
            self._ended.add(subscription.id)  # it may be stored, although its client is told that it is not
            raise
        self._expire(subscription.id)

    def take_over(self, id: str) -> None:
        """Keep a stream of a dead gateway until its client opens it here."""
        if not self.serves(id):
            self._expire(id)

    async def _offer_again(self, subscription: Subscription, last_ns: int | None) -> None:
        id, unopened = subscription.id, replace(subscription, kind=Kind.STREAM)
        if self.serves(id):
            return
        waiting = Delivery(DeliveryState.WAITING, last_ns)
        try:
            if id in self._unlisted:
                await self._store.add(unopened, waiting, self._limit, take_over=False)
            else:
                await self._store.store_delivery_state(
                    id, waiting, unopened
                )  # a stream that was deleted just now must not come back
        except SubscriptionNotHeld:
            return  # it was opened through another gateway, or deleted
        except (RedisUnavailable, SubscriptionLimitReached):
            await self._forget(id)
            return
        if self.serves(id):
            self._unlisted.add(id)  # opened again meanwhile: list it again
        else:
            self._expire(id)

    def _leave(self, id: str) -> None:
        """Forget that a stream was being registered."""
        self._coming.discard(id)
        self._cancelled.discard(id)
        self._changed.pop(id, None)

    def serves(self, id: str) -> bool:
        """Return True if a stream is open or being registered here."""
        return id in self._open or id in self._coming

    def _expire(self, id: str) -> None:
        self._stop_waiting(id)
        loop = asyncio.get_running_loop()
        self._expiries[id] = loop.call_later(UNOPENED_S, lambda: self._later(lambda: self._abandon(id)))

    def _stop_waiting(self, id: str) -> None:
        if (expiry := self._expiries.pop(id, None)) is not None:
            expiry.cancel()

    async def _abandon(self, id: str) -> None:
        self._expiries.pop(id, None)
        if not self.serves(id):
            await self._forget(id)

    async def _forget(self, id: str) -> None:
        self._unlisted.discard(id)
        self._ended.add(id)
        with suppress(RedisUnavailable):
            await self._strike_out(id)

    async def _strike_out(self, id: str) -> None:
        """Remove an ended stream from the store. Raises RedisUnavailable."""
        await self._store.remove(id, only_if_held=True)  # another gateway may have it by now
        self._ended.discard(id)
        if self.serves(id):
            self._unlisted.add(id)  # opened again meanwhile: list it again

    # -- what others do -----------------------------------------------------------------------------------------------

    def end_stream(self, id: str, ending: Ending) -> None:
        """End a stream that is open here; the store is already up to date."""
        self._noted.pop(id, None)
        self._unlisted.discard(id)
        self._stop_waiting(id)
        if ending is Ending.CANCELLED and id in self._coming:
            self._cancelled.add(id)
        if (watcher := self._open.pop(id, None)) is not None:
            watcher.end(ending)

    def has_options(self, subscription: Subscription) -> bool:
        """Return True if a stream uses these options, or is not open here."""
        watcher = self._open.get(subscription.id)
        return watcher is None or watcher.subscription.options == subscription.options

    def change_options(self, subscription: Subscription) -> None:
        """Apply the options of the stored record to a stream of this gateway."""
        id = subscription.id
        if (watcher := self._open.get(id)) is not None:
            if not self.has_options(subscription):
                options, revision = subscription.options, subscription.revision
                self._fan_out.change_options(watcher, watcher.subscription.with_options(options, revision))
        elif id in self._coming:
            self._changed[id] = subscription

    async def end_replaced(self, id: str) -> None:
        """End a stream that was opened through another gateway, unless it has come back since."""
        found = await self._store.get_record(id)
        if found is not None and found.holder != self._run:
            self.end_stream(id, Ending.REPLACED)

    def with_last_message_time(self, record: Record) -> Record:
        """Add the time of the last message, which this gateway knows better than the store."""
        watcher = self._open.get(record.subscription.id)
        if watcher is None or record.holder != self._run:
            return record
        return replace(record, delivery=replace(record.delivery, last_ns=watcher.last_sent_ns))

    # -- what the store is told ---------------------------------------------------------------------------------------

    async def store_missed_changes(self) -> None:
        """Store the streams that began and ended while the store was unavailable."""
        for id in list(self._ended):
            if id in self._ended:  # not opened again meanwhile
                await self._strike_out(id)
        for id in list(self._unlisted):
            if (watcher := self._open.get(id)) is not None:
                try:
                    await self._store.add(watcher.subscription, Delivery(last_ns=watcher.last_sent_ns), self._limit)
                except SubscriptionLimitReached:
                    self.end_stream(id, Ending.CANCELLED)
                else:
                    if not self.serves(id) and id not in self._expiries:  # closed meanwhile
                        self._ended.add(id)
            if id not in self._coming:
                self._unlisted.discard(id)

    async def store_message_times(self) -> None:
        """Store when the last message of each stream was sent."""
        moved = {
            id: each.last_sent_ns
            for id, each in self._open.items()
            if id not in self._unlisted and each.last_sent_ns != self._noted.get(id)
        }
        lost = await self._store.store_delivery_states({id: Delivery(last_ns=last_ns) for id, last_ns in moved.items()})
        self._noted.update((id, last_ns) for id, last_ns in moved.items() if id in self._open and id not in lost)

    async def reconcile(self, held: dict[str, Record]) -> None:
        """Reconcile the streams with those that the store assigns to this run.

        Some are missing if this run was taken for dead; some are left over if a command reached the store after this
        run had given it up.
        """
        missing = {id for id in self._open if id not in held and id not in self._unlisted}
        for id in missing & self._missed:  # missing twice: news of its end would have arrived by now
            found = await self._store.get_record(id)
            if found is not None and found.holder != self._run:
                self.end_stream(id, Ending.REPLACED)
            elif id in self._open:
                self._unlisted.add(id)
        self._missed = missing
        streams = {id for id, record in held.items() if record.subscription.kind.is_stream}
        strays = {id for id in streams if not self.serves(id) and id not in self._expiries}
        self._ended |= strays & self._strays  # present twice: commands under way have arrived by now
        self._strays = strays

    def _later(self, call: Callable[[], Awaitable[None]]) -> None:
        task = asyncio.ensure_future(self._guarded(call))
        self._background.add(task)
        task.add_done_callback(self._background.discard)

    async def _guarded(self, call: Callable[[], Awaitable[None]]) -> None:
        try:
            await call()
        except Exception:
            # The boundary of the task: its connection is gone, so nobody waits for the result.
            log.exception("a stream was not put away as it should")
