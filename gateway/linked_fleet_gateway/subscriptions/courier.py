"""Brings the messages of one callback subscription to its receiver: one at a time, in order, at least once.

A message is in the store's queue before it is sent, and leaves it when the receiver has taken it. What changes in the
meantime is conflated by the watcher; the present state goes out next.
"""

import asyncio
import logging
import random
import time
from collections.abc import Awaitable, Callable
from contextlib import suppress
from dataclasses import replace
from typing import TypeVar
from urllib.parse import urlsplit

from linked_fleet_gateway.resources import signature
from linked_fleet_gateway.resources.binary_frames import FRAME_TYPES, layout_path
from linked_fleet_gateway.resources.subscription import DeliveryState, Record, Subscription
from linked_fleet_gateway.resources.subscription_resource import subscription_path
from linked_fleet_gateway.runtime.cancellation import end
from linked_fleet_gateway.runtime.counters import Deliveries
from linked_fleet_gateway.subscriptions.fan_out import FanOut
from linked_fleet_gateway.subscriptions.message import Ending, Message
from linked_fleet_gateway.subscriptions.network import Forbidden, Unresolvable
from linked_fleet_gateway.subscriptions.receiver import NoConsent, Outcome, Receiver, Verdict
from linked_fleet_gateway.subscriptions.retry import SUSPEND_AFTER, delay_s
from linked_fleet_gateway.subscriptions.store import Backlog, Entry, Lost, Outgoing, Store, StoreUnavailable
from linked_fleet_gateway.subscriptions.watcher import Watcher

log = logging.getLogger(__name__)
_T = TypeVar("_T")
_STORE_PAUSE_S = 0.25


class Courier:
    """Serves one callback subscription that this run holds, from ``start`` until ``stop`` or until it is lost."""

    def __init__(
        self,
        record: Record,
        store: Store,
        fan_out: FanOut,
        receiver: Receiver,
        *,
        consent: bool,
        deliveries: Deliveries | None = None,
    ) -> None:
        self.subscription = record.subscription
        self.delivery = record.delivery
        self._store, self._fan_out, self._receiver = store, fan_out, receiver
        self._about = {"subscription": record.subscription.id}
        self._consent_needed = consent
        self._deliveries = deliveries or Deliveries()
        self._message: Message | None = None
        self._rendered_for = 0
        self._watcher: Watcher | None = None
        self._anew = False
        self._idle = False
        self._news = asyncio.Event()
        self._woken = asyncio.Event()
        self._not_before_s = 0.0
        self._number = 0
        self._task: asyncio.Task[None] | None = None

    def start(self) -> None:
        name = f"callback {self.subscription.id}"
        self._task = asyncio.create_task(self._run(), name=name)

    @property
    def running(self) -> bool:
        return self._task is not None and not self._task.done()

    def wake(self) -> None:
        """Somebody resumed the subscription: try at once."""
        self.delivery = replace(self.delivery, state=DeliveryState.ACTIVE, failures=0, reason="")
        self._woken.set()

    def change(self, subscription: Subscription) -> None:
        """Go by other options. What is queued goes out as it is, signed by the secret of the attempt."""
        before, self.subscription = self.subscription.options, subscription
        if self._watcher is not None:
            self._fan_out.change(self._watcher, subscription)
        else:
            self._anew = self._anew or subscription.options.begins_anew(before)

    async def suspend(self, reason: str) -> None:
        """Deliver nothing more until somebody resumes it."""
        if self._task is not None:
            await end([self._task])
        self.start_suspended(reason)

    def start_suspended(self, reason: str) -> None:
        """``start``, and wait until somebody resumes it."""
        self._message, self._idle = None, False
        self._woken.clear()
        self._became(DeliveryState.SUSPENDED, self.delivery.last_status, self.delivery.failures, reason)
        self._task = asyncio.create_task(self._run(note=True), name=f"callback {self.subscription.id}")

    async def stop(self) -> None:
        if self._task is not None:
            await end([self._task])
        await self._receiver.aclose()

    # -- as an outlet of the fan-out ----------------------------------------------------------------------------------

    def writable(self) -> bool:
        return self._idle and self._message is None

    def write(self, message: Message) -> None:
        self._message, self._rendered_for = message, self.subscription.revision
        self._news.set()

    def end(self, ending: Ending) -> None:
        """A callback outlives its resource and its gateway: what ends it is ``stop``."""

    # -- the work -----------------------------------------------------------------------------------------------------

    async def _run(self, *, note: bool = False) -> None:
        """``note``: what it is like has not been noted yet."""
        try:
            if note:
                await self._note()
            await self._serve()
        except Lost:
            log.info(
                "callback %s is served by another gateway now, or deleted", self.subscription.id, extra=self._about
            )
        except Exception:
            # The boundary of the task: nobody else would ever see it, and the subscription would be silent.
            log.exception("callback %s stopped for an unforeseen reason", self.subscription.id, extra=self._about)

    async def _serve(self) -> None:
        id = self.subscription.id
        if self.delivery.state is DeliveryState.SUSPENDED:
            record = await self._insist(lambda: self._store.record(id))
            # Whoever resumed it while it changed hands told the gateway that held it before.
            if record is not None and record.delivery.state is DeliveryState.SUSPENDED:
                await self._sleep(None)
        backlog = await self._backlog()
        await self._bring_all(backlog.entries)
        await self._agreed()  # before there is anything to say: what is said then is the present state
        # A change since the backlog was asked for may have made what it says was sent void.
        sent, self._anew = {} if self._anew else backlog.sent, False
        watcher = self._watcher = self._fan_out.watch(self.subscription, self, sent, patient=True)
        try:
            while True:
                self._idle = True
                watcher.ready()
                await self._news.wait()
                left = tuple(watcher.left)
                await self._relay(left)
                watcher.left.difference_update(left)
        finally:
            self._watcher = None
            watcher.close()

    async def _relay(self, left: tuple[str, ...]) -> None:
        """Queue the message at hand and bring it; while the store is away the message waits and is not lost.

        ``left``: resources of which nothing needs to be remembered any more.
        """
        message, self._message, self._idle = self._message, None, False
        self._news.clear()
        assert message is not None
        outgoing = Outgoing(message.path, message.version, message.media_type, message.body, self._rendered_for)
        queued = False
        while not queued:
            entries = await self._queue(outgoing, left)
            queued = (outgoing.path, outgoing.version) in [(entry.path, entry.version) for entry in entries]
            await self._bring_all(entries)

    async def _queue(self, outgoing: Outgoing, left: tuple[str, ...]) -> list[Entry]:
        """The entry of a message, or what is in the queue without it.

        After an outage nobody knows whether the command was lost, or comes yet. It names the number of the message,
        which no other can get then: a late one could put what was true before behind what is true now.
        """
        try:
            number = self._number + 1
            entry = await self._store.advance(self.subscription.id, None, outgoing, self.delivery, left, number)
        except StoreUnavailable:
            await asyncio.sleep(_STORE_PAUSE_S)
            entry = None
        if entry is None:  # or the number was given to a message by a command that was thought lost
            return (await self._backlog()).entries
        self._number = entry.number
        return [entry]

    async def _backlog(self) -> Backlog:
        backlog = await self._insist(lambda: self._store.backlog(self.subscription.id))
        self._number = backlog.number
        return backlog

    async def _bring_all(self, entries: list[Entry]) -> None:
        for entry in entries:
            await self._bring(entry)
            await self._done(entry)

    async def _done(self, entry: Entry) -> None:
        await self._insist(lambda: self._store.advance(self.subscription.id, entry, None, self.delivery))

    async def _bring(self, entry: Entry) -> None:
        """Send an entry until the receiver has taken it."""
        while True:
            pause_s = self._not_before_s - time.monotonic()
            if pause_s > 0:
                await asyncio.sleep(pause_s)
                await self._note()  # Lost if another gateway has taken it over meanwhile
            try:
                outcome = await self._attempt(entry)
            except NoConsent as error:  # its address changed since it was trusted
                await self._failed(DeliveryState.AWAITING_CONSENT, Outcome(Verdict.RETRY, None, None, str(error)))
                continue
            if outcome.verdict is Verdict.DELIVERED:
                self._deliveries.taken += 1
                self._not_before_s = time.monotonic() + self.delivery.allowed_interval_s
                self._became(DeliveryState.ACTIVE, outcome.status)
                return
            await self._failed(DeliveryState.FAILING, outcome)

    async def _attempt(self, entry: Entry) -> Outcome:
        trusted = await self._agreed()
        content_type = entry.media_type + ("; charset=utf-8" if entry.media_type.startswith("text/") else "")
        return await self._receiver.deliver(entry.body, content_type, self._headers(entry), allowed_only=trusted)

    async def _agreed(self) -> bool:
        """Wait until deliveries are welcome; whether only those addresses may be used that need no consent."""
        while self._consent_needed and not self.delivery.consented:
            status, verdict, state = None, Verdict.RETRY, DeliveryState.AWAITING_CONSENT
            try:
                if await self._receiver.trusted():
                    return True
                consent = await self._receiver.consent(self._origin)
                if consent.granted:
                    self.delivery = replace(
                        self.delivery, consented=True, allowed_interval_s=consent.interval_s, failures=0
                    )
                    self._became(DeliveryState.ACTIVE, self.delivery.last_status)
                    await self._note()
                    return False
                status, reason = consent.status, consent.reason
                verdict = Verdict.REFUSED if consent.refused else Verdict.RETRY
            except (Forbidden, Unresolvable) as error:
                state, reason = DeliveryState.FAILING, str(error)
            await self._failed(state, Outcome(verdict, status, None, reason))
        return False

    def _headers(self, entry: Entry) -> dict[str, str]:
        """The fields of a delivery: its stable id, the version, its subject, and its signature."""
        subscription = self.subscription
        resource, own = subscription.base + entry.path, subscription.base + subscription_path(subscription)
        identity = signature.headers(
            subscription.secret, f"{subscription.id}.{entry.number}", int(time.time()), entry.body
        )
        links = f'<{resource}>; rel="self", <{own}>; rel="related"; title="subscription"'
        if entry.media_type in FRAME_TYPES:
            links += f', <{layout_path(resource)}>; rel="describedby"'
        consent = {"WebHook-Request-Origin": self._origin} if self.delivery.consented else {}
        return {
            **identity,
            **consent,
            "Link": links,
            "Linked-Fleet-Delivery": str(entry.number),
            "Linked-Fleet-Version": entry.version,
        }

    @property
    def _origin(self) -> str:
        return urlsplit(self.subscription.base).hostname or ""

    # -- what became of it --------------------------------------------------------------------------------------------

    def _became(self, state: DeliveryState, status: int | None, failures: int = 0, reason: str = "") -> None:
        self.delivery = replace(
            self.delivery, state=state, last_ns=time.time_ns(), last_status=status, failures=failures, reason=reason
        )

    async def _failed(self, state: DeliveryState, outcome: Outcome) -> None:
        """Note a failure and wait as long as it takes: a while, or until somebody resumes the subscription."""
        self._deliveries.failed += 1
        failures = self.delivery.failures + 1
        over = outcome.verdict in (Verdict.GONE, Verdict.REFUSED) or failures >= SUSPEND_AFTER
        self._became(DeliveryState.SUSPENDED if over else state, outcome.status, failures, outcome.reason)
        self._woken.clear()
        await self._note()
        if over:
            log.info("callback %s is suspended: %s", self.subscription.id, outcome.reason, extra=self._about)
            await self._sleep(None)
        else:
            pause_s = delay_s(failures, random.random())  # noqa: S311 (jitter is no secret)
            await self._sleep(max(pause_s, outcome.retry_after_s or 0.0, self.delivery.allowed_interval_s))
        await self._note()  # Lost if another gateway has taken it over meanwhile

    async def _sleep(self, pause_s: float | None) -> None:
        """Until the pause is over, or somebody wakes us."""
        with suppress(TimeoutError):
            async with asyncio.timeout(pause_s):
                await self._woken.wait()
        self._woken.clear()

    async def _note(self) -> None:
        await self._insist(lambda: self._store.note(self.subscription.id, self.delivery))

    async def _insist(self, call: Callable[[], Awaitable[_T]]) -> _T:
        """Do it as soon as the store is there."""
        while True:
            try:
                return await call()
            except StoreUnavailable:
                await asyncio.sleep(_STORE_PAUSE_S)
