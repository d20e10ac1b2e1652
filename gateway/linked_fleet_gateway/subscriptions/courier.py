"""Delivery of one callback subscription's messages to its receiver: one at a time, in order, at least once.

A message enters the queue in the store before it is sent, and leaves it when the receiver has accepted it. The watcher
conflates changes in the meantime, so the next message is about the present state.
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

from linked_fleet_base.errors import RedisUnavailable
from linked_fleet_gateway.resources.binary_frames import FRAME_TYPES, layout_path
from linked_fleet_gateway.resources.subscription import DeliveryState, Record, Subscription
from linked_fleet_gateway.resources.subscription_resource import subscription_path
from linked_fleet_gateway.subscriptions.broadcast import Ending, Message
from linked_fleet_gateway.subscriptions.fan_out import FanOut
from linked_fleet_gateway.subscriptions.store import (
    Backlog,
    OutgoingMessage,
    QueueEntry,
    SubscriptionNotHeld,
    SubscriptionStore,
)
from linked_fleet_gateway.subscriptions.watcher import Watcher
from linked_fleet_runtime.background import cancel_tasks
from linked_fleet_runtime.metrics import DeliveryMetrics
from linked_fleet_webhooks import signature
from linked_fleet_webhooks.delivery_pace import SUSPEND_AFTER, backoff_s
from linked_fleet_webhooks.network import ForbiddenHost, UnresolvableHost
from linked_fleet_webhooks.receiver import DeliveryOutcome, NoConsent, Receiver, Verdict

log = logging.getLogger(__name__)
_T = TypeVar("_T")
_STORE_PAUSE_S = 0.25


class Courier:
    """Serves one callback subscription that this run holds, from ``start`` until ``stop`` or until it is lost."""

    def __init__(
        self,
        record: Record,
        store: SubscriptionStore,
        fan_out: FanOut,
        receiver: Receiver,
        *,
        consent_required: bool,
        metrics: DeliveryMetrics | None = None,
    ) -> None:
        self.subscription = record.subscription
        self.delivery = record.delivery
        self._store, self._fan_out, self._receiver = store, fan_out, receiver
        self._about = {"subscription": record.subscription.id}
        self._consent_required = consent_required
        self._metrics = metrics or DeliveryMetrics()
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

    def resume(self) -> None:
        """Try again at once, because the subscription was resumed."""
        self.delivery = replace(self.delivery, state=DeliveryState.ACTIVE, failures=0, reason="")
        self._woken.set()

    def change_options(self, subscription: Subscription) -> None:
        """Apply other options.

        Queued messages go out unchanged, signed with the secret that is valid at each attempt.
        """
        before, self.subscription = self.subscription.options, subscription
        if self._watcher is not None:
            self._fan_out.change_options(self._watcher, subscription)
        else:
            self._anew = self._anew or subscription.options.needs_full_state(before)

    async def suspend(self, reason: str) -> None:
        """Stop deliveries until somebody resumes the subscription."""
        if self._task is not None:
            await cancel_tasks([self._task])
        self.start_suspended(reason)

    def start_suspended(self, reason: str) -> None:
        """Start in the suspended state, until somebody resumes the subscription."""
        self._message, self._idle = None, False
        self._woken.clear()
        self._became(DeliveryState.SUSPENDED, self.delivery.last_status, self.delivery.failures, reason)
        self._task = asyncio.create_task(self._run(note=True), name=f"callback {self.subscription.id}")

    async def stop(self) -> None:
        if self._task is not None:
            await cancel_tasks([self._task])
        await self._receiver.aclose()

    # -- as an outlet of the fan-out ----------------------------------------------------------------------------------

    def writable(self) -> bool:
        return self._idle and self._message is None

    def write(self, message: Message) -> None:
        self._message, self._rendered_for = message, self.subscription.revision
        self._news.set()

    def end(self, ending: Ending) -> None:
        """Do nothing: a callback outlives its resource and its gateway, and only ``stop`` ends it."""

    # -- the work -----------------------------------------------------------------------------------------------------

    async def _run(self, *, note: bool = False) -> None:
        """``note``: write the delivery state to the store first."""
        try:
            if note:
                await self._note()
            await self._serve()
        except SubscriptionNotHeld:
            log.info(
                "callback %s is served by another gateway now, or deleted", self.subscription.id, extra=self._about
            )
        except Exception:
            # The boundary of the task: without this log nobody would learn why the subscription is silent.
            log.exception("callback %s stopped for an unforeseen reason", self.subscription.id, extra=self._about)

    async def _serve(self) -> None:
        id = self.subscription.id
        if self.delivery.state is DeliveryState.SUSPENDED:
            record = await self._insist(lambda: self._store.get_record(id))
            # If it was resumed while it changed hands, the gateway that held it before was told.
            if record is not None and record.delivery.state is DeliveryState.SUSPENDED:
                await self._sleep(None)
        backlog = await self._backlog()
        await self._bring_all(backlog.entries)
        await self._agreed()  # before watching, so that the first message is the present state
        # Options that changed since the backlog was read may invalidate its list of sent versions.
        sent, self._anew = {} if self._anew else backlog.last_versions, False
        watcher = self._watcher = self._fan_out.watch(self.subscription, self, sent, wait_if_absent=True)
        try:
            while True:
                self._idle = True
                watcher.schedule_send()
                await self._news.wait()
                left = tuple(watcher.left_paths)
                await self._relay(left)
                watcher.left_paths.difference_update(left)
        finally:
            self._watcher = None
            watcher.close()

    async def _relay(self, left: tuple[str, ...]) -> None:
        """Queue the current message and deliver it; if the store is unavailable, the message waits and is not lost.

        ``left``: resources whose sent versions may be forgotten.
        """
        message, self._message, self._idle = self._message, None, False
        self._news.clear()
        assert message is not None
        outgoing = OutgoingMessage(message.path, message.version, message.media_type, message.body, self._rendered_for)
        queued = False
        while not queued:
            entries = await self._queue(outgoing, left)
            queued = (outgoing.path, outgoing.version) in [(entry.path, entry.version) for entry in entries]
            await self._bring_all(entries)

    async def _queue(self, outgoing: OutgoingMessage, left: tuple[str, ...]) -> list[QueueEntry]:
        """Queue a message and return its entry, or the entries in the queue if it could not be added.

        After an outage it is unknown whether the command was lost or is still to come. The command names the number of
        the message, which no other message can take afterwards: a late command cannot queue an old state behind a newer
        one.
        """
        try:
            number = self._number + 1
            entry = await self._store.advance_queue(self.subscription.id, None, outgoing, self.delivery, left, number)
        except RedisUnavailable:
            await asyncio.sleep(_STORE_PAUSE_S)
            entry = None
        if entry is None:  # or a command that was thought lost took the number for another message
            return (await self._backlog()).entries
        self._number = entry.number
        return [entry]

    async def _backlog(self) -> Backlog:
        backlog = await self._insist(lambda: self._store.read_backlog(self.subscription.id))
        self._number = backlog.last_number
        return backlog

    async def _bring_all(self, entries: list[QueueEntry]) -> None:
        for entry in entries:
            await self._bring(entry)
            await self._done(entry)

    async def _done(self, entry: QueueEntry) -> None:
        await self._insist(lambda: self._store.advance_queue(self.subscription.id, entry, None, self.delivery))

    async def _bring(self, entry: QueueEntry) -> None:
        """Send an entry until the receiver has accepted it."""
        while True:
            pause_s = self._not_before_s - time.monotonic()
            if pause_s > 0:
                await asyncio.sleep(pause_s)
                await self._note()  # raises SubscriptionNotHeld if another gateway has taken the subscription over
            try:
                outcome = await self._attempt(entry)
            except NoConsent as error:  # the address has changed since it was trusted
                await self._failed(
                    DeliveryState.AWAITING_CONSENT, DeliveryOutcome(Verdict.RETRY, None, None, str(error))
                )
                continue
            if outcome.verdict is Verdict.DELIVERED:
                self._metrics.successful += 1
                self._not_before_s = time.monotonic() + self.delivery.allowed_interval_s
                self._became(DeliveryState.ACTIVE, outcome.status)
                return
            await self._failed(DeliveryState.FAILING, outcome)

    async def _attempt(self, entry: QueueEntry) -> DeliveryOutcome:
        trusted = await self._agreed()
        content_type = entry.media_type + ("; charset=utf-8" if entry.media_type.startswith("text/") else "")
        return await self._receiver.deliver(entry.body, content_type, self._headers(entry), allowed_only=trusted)

    async def _agreed(self) -> bool:
        """Wait until deliveries are permitted; return True if only addresses that need no consent may be used."""
        while self._consent_required and not self.delivery.consented:
            status, verdict, state = None, Verdict.RETRY, DeliveryState.AWAITING_CONSENT
            try:
                if await self._receiver.needs_no_consent():
                    return True
                consent = await self._receiver.request_consent(self._origin)
                if consent.granted:
                    self.delivery = replace(
                        self.delivery, consented=True, allowed_interval_s=consent.interval_s, failures=0
                    )
                    self._became(DeliveryState.ACTIVE, self.delivery.last_status)
                    await self._note()
                    return False
                status, reason = consent.status, consent.reason
                verdict = Verdict.REFUSED if consent.refused else Verdict.RETRY
            except (ForbiddenHost, UnresolvableHost) as error:
                state, reason = DeliveryState.FAILING, str(error)
            await self._failed(state, DeliveryOutcome(verdict, status, None, reason))
        return False

    def _headers(self, entry: QueueEntry) -> dict[str, str]:
        """Return the header fields of a delivery: stable id, version, subject and signature."""
        subscription = self.subscription
        resource, own = subscription.base + entry.path, subscription.base + subscription_path(subscription)
        identity = signature.signature_headers(
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

    async def _failed(self, state: DeliveryState, outcome: DeliveryOutcome) -> None:
        """Record a failure, then wait: for a back-off period, or until somebody resumes the subscription."""
        self._metrics.failed += 1
        failures = self.delivery.failures + 1
        over = outcome.verdict in (Verdict.GONE, Verdict.REFUSED) or failures >= SUSPEND_AFTER
        self._became(DeliveryState.SUSPENDED if over else state, outcome.status, failures, outcome.reason)
        self._woken.clear()
        await self._note()
        if over:
            log.info("callback %s is suspended: %s", self.subscription.id, outcome.reason, extra=self._about)
            await self._sleep(None)
        else:
            pause_s = backoff_s(failures, random.random())  # noqa: S311 (jitter is no secret)
            await self._sleep(max(pause_s, outcome.retry_after_s or 0.0, self.delivery.allowed_interval_s))
        await self._note()  # raises SubscriptionNotHeld if another gateway has taken the subscription over

    async def _sleep(self, pause_s: float | None) -> None:
        """Wait until the pause is over or the courier is resumed."""
        with suppress(TimeoutError):
            async with asyncio.timeout(pause_s):
                await self._woken.wait()
        self._woken.clear()

    async def _note(self) -> None:
        await self._insist(lambda: self._store.store_delivery_state(self.subscription.id, self.delivery))

    async def _insist(self, call: Callable[[], Awaitable[_T]]) -> _T:
        """Repeat a call until the store is available."""
        while True:
            try:
                return await call()
            except RedisUnavailable:
                await asyncio.sleep(_STORE_PAUSE_S)
