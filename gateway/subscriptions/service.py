"""Subscriptions of this gateway and what the store knows of all: made, listed, cancelled, taken over (R1.8).

Streams live here and are only registered in the store, so that every gateway lists them; they go on while the store is
away. Callbacks live in the store, and are served by the run that holds them.
"""

import asyncio
import logging
import ssl
import time
import uuid
from collections.abc import Awaitable, Callable
from contextlib import suppress
from dataclasses import replace
from types import TracebackType

from gateway.subscriptions.courier import Courier
from gateway.subscriptions.fan_out import FanOut
from gateway.subscriptions.message import Ending, Outlet
from gateway.subscriptions.network import Network, Unresolvable
from gateway.subscriptions.receiver import Receiver
from gateway.subscriptions.store import News, Store, StoreUnavailable, TooMany
from gateway.subscriptions.subscription import Delivery, DeliveryState, Depth, Kind, Record, Subscription
from gateway.subscriptions.watcher import Watcher

log = logging.getLogger(__name__)

KEEP_S = 0.5
"""Between two looks at leases; with the store's lease of 3 s a dead gateway's callbacks move within 5 s."""
RECONCILE_S = 10.0
UNOPENED_S = 60.0
"""How long a stream that was made by POST waits to be opened, at first and again after each connection."""


class Subscriptions:
    """An async context manager; ``limit`` is per client address, ``consent`` whether receivers are asked first."""

    def __init__(self, store: Store, run: str, fan_out: FanOut, network: Network, *, consent: bool, limit: int) -> None:
        self._store, self._run, self._fan_out, self._network = store, run, fan_out, network
        self._consent, self._limit = consent, limit
        self._streams: dict[str, Watcher] = {}
        self._couriers: dict[str, Courier] = {}
        self._expiries: dict[str, asyncio.TimerHandle] = {}
        # What the store still has to be told after an outage, or could not find where it should be.
        self._unlisted: set[str] = set()
        self._ended: set[str] = set()
        self._missed: set[str] = set()
        self._noted: dict[str, int | None] = {}
        self._tasks: list[asyncio.Task[None]] = []
        self._background: set[asyncio.Task[None]] = set()
        self._tls = ssl.create_default_context()

    async def __aenter__(self) -> "Subscriptions":
        self._tasks = [
            asyncio.create_task(self._live(), name="renew the lease"),
            asyncio.create_task(self._keep(), name="keep subscriptions"),
            asyncio.create_task(self._hear(), name="hear of subscriptions"),
        ]
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.end_streams()
        for timer in self._expiries.values():
            timer.cancel()
        tasks = [*self._tasks, *self._background]
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
        await asyncio.gather(*(courier.stop() for courier in self._couriers.values()))
        try:
            await self._store.leave()
        except StoreUnavailable as outage:
            log.info("the store could not be told that this gateway ends: %s", outage)

    # -- streams ------------------------------------------------------------------------------------------------------

    async def register(self, subscription: Subscription) -> None:
        """Have a stream listed before it is opened; TooMany when the client has too many subscriptions."""
        if (expiry := self._expiries.pop(subscription.id, None)) is not None:
            expiry.cancel()
        try:
            await self._store.add(subscription, Delivery(last_ns=None), self._limit)
        except StoreUnavailable:
            mine = [each for each in self._streams.values() if each.subscription.client == subscription.client]
            if len(mine) >= self._limit:
                raise TooMany(f"{subscription.client} has {len(mine)} subscriptions already") from None
            self._unlisted.add(subscription.id)

    def open(self, subscription: Subscription, outlet: Outlet, seen: str | None) -> Watcher:
        """Begin a registered stream; ``seen`` is the version that the subscriber saw last.

        It ends at once when there is no such resource any more. Of a subtree, ``seen`` is the version of any one
        resource in it and says nothing about the others: all of them are sent again.
        """
        sent = {subscription.resource: seen} if seen and subscription.depth is not Depth.SUBTREE else {}
        watcher = self._fan_out.watch(subscription, outlet, sent)
        if (other := self._streams.get(subscription.id)) is not None:
            other.end(Ending.REPLACED)
        self._streams[subscription.id] = watcher
        return watcher

    def close(self, subscription: Subscription, watcher: Watcher | None, *, reopenable: bool) -> None:
        """The connection of a registered stream is gone; one that was made by POST waits for another."""
        last_ns = None
        if watcher is not None:
            watcher.close()
            last_ns = watcher.last_ns
            if self._streams.get(subscription.id) is not watcher:
                return  # cancelled, or opened on another connection
            del self._streams[subscription.id]
            self._noted.pop(subscription.id, None)
        if reopenable:
            self._later(lambda: self._offer(subscription, last_ns))
        else:
            self._later(lambda: self._forget(subscription.id))

    async def offer(self, subscription: Subscription) -> None:
        """Keep a stream that nobody has opened yet for a while. TooMany, StoreUnavailable."""
        await self._store.add(subscription, Delivery(DeliveryState.WAITING), self._limit)
        self._expire(subscription.id)

    async def _offer(self, subscription: Subscription, last_ns: int | None) -> None:
        try:
            unopened = replace(subscription, kind=Kind.STREAM)
            await self._store.add(unopened, Delivery(DeliveryState.WAITING, last_ns), self._limit)
            self._expire(subscription.id)
        except (StoreUnavailable, TooMany):
            await self._forget(subscription.id)

    def _expire(self, id: str) -> None:
        loop = asyncio.get_running_loop()
        self._expiries[id] = loop.call_later(UNOPENED_S, lambda: self._later(lambda: self._abandon(id)))

    async def _abandon(self, id: str) -> None:
        del self._expiries[id]
        record = await self._store.record(id)
        if record is not None and record.holder == self._run:  # not opened through another gateway meanwhile
            await self._forget(id)

    async def _forget(self, id: str) -> None:
        self._unlisted.discard(id)
        try:
            await self._store.remove(id)
        except StoreUnavailable:
            self._ended.add(id)

    def end_streams(self) -> None:
        """Close every stream, because the gateway ends; their clients reconnect to another or later."""
        for watcher in list(self._streams.values()):
            watcher.end(Ending.SHUTDOWN)
        self._streams.clear()

    # -- callbacks ----------------------------------------------------------------------------------------------------

    async def accept(self, subscription: Subscription) -> Record:
        """Make a callback subscription; it is in the store when this returns.

        Forbidden when its receiver has no address that may be reached; TooMany, StoreUnavailable.
        """
        receiver = self._receiver(subscription)
        try:
            trusted = not self._consent or await receiver.trusted()
        except Unresolvable:
            trusted = False  # the name may come to be; until then the subscription shows what is wrong
        finally:
            await receiver.aclose()
        state = DeliveryState.ACTIVE if trusted else DeliveryState.AWAITING_CONSENT
        delivery = Delivery(state)
        try:
            await self._store.add(subscription, delivery, self._limit)
        except StoreUnavailable:
            self._ended.add(subscription.id)  # it may be there, although its client is told that it is not
            raise
        record = Record(subscription, delivery, self._run)
        self._serve(record)
        return record

    def _serve(self, record: Record) -> None:
        if record.subscription.id in self._couriers:
            return
        receiver = self._receiver(record.subscription)
        courier = Courier(record, self._store, self._fan_out, receiver, consent=self._consent)
        self._couriers[record.subscription.id] = courier
        courier.start()

    def _receiver(self, subscription: Subscription) -> Receiver:
        return Receiver(self._network, subscription.callback, ssl_context=self._tls)

    async def resume(self, id: str) -> bool:
        """Have a callback tried again at once, by whichever gateway holds it; False when there is none."""
        return await self._store.wake(id) is not None

    # -- of any kind --------------------------------------------------------------------------------------------------

    async def of(self, owner: str) -> list[Record]:
        """All subscriptions of a thing, at whichever gateway; StoreUnavailable."""
        return [self._freshened(record) for record in await self._store.of(owner)]

    async def record(self, id: str) -> Record | None:
        record = await self._store.record(id)
        return None if record is None else self._freshened(record)

    async def cancel(self, id: str) -> bool:
        """Delete a subscription, at whichever gateway it is; False when there is none."""
        record = await self._store.remove(id)
        await self._drop(id, Ending.CANCELLED)
        return record is not None

    def _freshened(self, record: Record) -> Record:
        """What this gateway knows better than the store: a stream's last message."""
        watcher = self._streams.get(record.subscription.id)
        if watcher is None or record.holder != self._run:
            return record
        return replace(record, delivery=replace(record.delivery, last_ns=watcher.last_ns))

    async def _drop(self, id: str, ending: Ending) -> None:
        self._noted.pop(id, None)
        self._unlisted.discard(id)
        if (expiry := self._expiries.pop(id, None)) is not None:
            expiry.cancel()
        if (watcher := self._streams.pop(id, None)) is not None:
            watcher.end(ending)
        if (courier := self._couriers.pop(id, None)) is not None:
            await courier.stop()

    # -- with the other gateways --------------------------------------------------------------------------------------

    async def _hear(self) -> None:
        while True:
            try:
                async for news in self._store.news():
                    if news.holder == self._run:
                        await self._heed(news)
            except Exception:
                log.exception("hearing of subscriptions failed; it is tried again")
            await asyncio.sleep(KEEP_S)

    async def _heed(self, news: News) -> None:
        if news.what == "removed":
            await self._drop(news.id, Ending.CANCELLED)
        elif (courier := self._couriers.get(news.id)) is not None:
            courier.wake()

    async def _live(self) -> None:
        """Renew the lease, also while a thousand callbacks are taken over; outages are told of elsewhere."""
        while True:
            with suppress(StoreUnavailable):
                await self._store.renew()
            await asyncio.sleep(KEEP_S)

    async def _keep(self) -> None:
        away, due_s = False, 0.0
        while True:
            try:
                await self._catch_up()
                for run in await self._store.dead_runs():
                    await self._take_over(run)
                if time.monotonic() >= due_s:
                    await self._reconcile()
                    due_s = time.monotonic() + RECONCILE_S
                away = False
            except StoreUnavailable as error:
                if not away:
                    log.warning("the store is away, callbacks wait for it: %s", error)
                away = True
            except Exception:
                log.exception("keeping subscriptions failed; it is tried again")
            await asyncio.sleep(KEEP_S)

    async def _catch_up(self) -> None:
        """Tell the store what it does not know yet: streams begun and ended while it was away, their last messages."""
        for id in list(self._ended):
            await self._store.remove(id)
            self._ended.discard(id)
        for id in list(self._unlisted):
            if (watcher := self._streams.get(id)) is not None:
                try:
                    await self._store.add(watcher.subscription, Delivery(last_ns=watcher.last_ns), self._limit)
                except TooMany:
                    await self._drop(id, Ending.CANCELLED)
                else:
                    if id not in self._streams and id not in self._expiries:  # closed meanwhile
                        self._ended.add(id)
            self._unlisted.discard(id)
        moved = {
            id: each.last_ns
            for id, each in self._streams.items()
            if id not in self._unlisted and each.last_ns != self._noted.get(id)
        }
        await self._store.note_all({id: Delivery(last_ns=last_ns) for id, last_ns in moved.items()})
        self._noted.update((id, last_ns) for id, last_ns in moved.items() if id in self._streams)

    async def _take_over(self, run: str) -> None:
        records = await self._store.adopt(run)
        if records:
            log.info("took %d callbacks over from gateway run %s", len(records), run)
        for record in records:
            # We may have served it before we were thought dead; what is known from then is out of date.
            await self._drop(record.subscription.id, Ending.REPLACED)
            self._serve(record)

    async def _reconcile(self) -> None:
        """Compare with what the store says this run holds; needed after a time in which we were thought dead."""
        held = {record.subscription.id: record for record in await self._store.held()}
        for id, record in held.items():
            courier = self._couriers.get(id)
            if record.subscription.kind is Kind.CALLBACK and (courier is None or not courier.running):
                await self._drop(id, Ending.CANCELLED)
                self._serve(record)
        for id in [id for id in self._couriers if id not in held]:
            found = await self._store.record(id)  # it may be newer than the answer above
            if found is None or found.holder != self._run:
                await self._drop(id, Ending.REPLACED)
        missing = {id for id in self._streams if id not in held and id not in self._unlisted}
        for id in missing & self._missed:  # the second time: news of its end would have come by now
            found = await self._store.record(id)
            if found is not None and found.holder != self._run:
                await self._drop(id, Ending.REPLACED)
            elif id in self._streams:
                self._unlisted.add(id)
        self._missed = missing

    def _later(self, call: Callable[[], Awaitable[None]]) -> None:
        task = asyncio.ensure_future(self._guarded(call))
        self._background.add(task)
        task.add_done_callback(self._background.discard)

    async def _guarded(self, call: Callable[[], Awaitable[None]]) -> None:
        try:
            await call()
        except StoreUnavailable as error:
            log.info("the store was away: %s", error)
        except Exception:
            log.exception("a subscription was not put away as it should")


def new_run() -> str:
    """A name for one run of a gateway."""
    return uuid.uuid4().hex
