"""The callback subscriptions that this gateway serves: created here, or taken over from dead gateways."""

import asyncio
import ssl
from collections.abc import Callable
from functools import cache

from linked_fleet_base.errors import RedisUnavailable
from linked_fleet_gateway.resources.subscription import Delivery, DeliveryState, Kind, Record, Subscription
from linked_fleet_gateway.subscriptions.courier import Courier
from linked_fleet_gateway.subscriptions.fan_out import FanOut
from linked_fleet_gateway.subscriptions.store import SubscriptionStore
from linked_fleet_identity.rights import View
from linked_fleet_runtime.metrics import DeliveryMetrics
from linked_fleet_webhooks.delivery_pace import ConsentThrottle
from linked_fleet_webhooks.network import Network, UnresolvableHost
from linked_fleet_webhooks.receiver import Receiver

EntitlementCheck = Callable[[str, str, View], bool]
UNENTITLED = "the rights of its creator ended"


class Callbacks:
    """``limit``: subscriptions per client. ``consent_required``: whether receivers must consent to deliveries.

    ``check_entitlement``: returns whether the creator may still subscribe to the resource, and sees what it saw.
    """

    def __init__(
        self,
        store: SubscriptionStore,
        run: str,
        fan_out: FanOut,
        network: Network,
        limit: int,
        consent_required: bool,
        check_entitlement: EntitlementCheck = lambda *_: True,
    ) -> None:
        self._check_entitlement = check_entitlement
        self._store, self._run, self._fan_out, self._network = store, run, fan_out, network
        self._limit, self._consent_required = limit, consent_required
        self._couriers: dict[str, Courier] = {}
        self.delivery_metrics = DeliveryMetrics()
        self._refused: set[str] = set()
        self._consent_throttle = ConsentThrottle()

    @property
    def served_count(self) -> int:
        return len(self._couriers)

    @property
    def suspended_count(self) -> int:
        """Number of served callbacks that are suspended until somebody resumes them."""
        return sum(each.delivery.state is DeliveryState.SUSPENDED for each in list(self._couriers.values()))

    async def create(self, subscription: Subscription) -> Record:
        """Create a callback subscription; it is in the store when this returns.

        Raises ForbiddenHost if the receiver has no address that may be reached, SubscriptionLimitReached,
        RedisUnavailable.
        """
        receiver = self._receiver(subscription)
        try:
            trusted = not self._consent_required or await receiver.needs_no_consent()
        except UnresolvableHost:
            trusted = False  # the name may resolve later; until then the subscription reports the problem
        finally:
            await receiver.aclose()
        delivery = Delivery(DeliveryState.ACTIVE if trusted else DeliveryState.AWAITING_CONSENT)
        try:
            await self._store.add(subscription, delivery, self._limit)
        except RedisUnavailable:
            # the store may have it, although its client is told that it was not created
            self._refused.add(subscription.id)
            raise
        record = Record(subscription, delivery, self._run)
        self._serve(record)
        return record

    async def aclose(self) -> None:
        await asyncio.gather(*(courier.stop() for courier in self._couriers.values()))

    def resume(self, id: str) -> None:
        """Wake the courier of a callback that was resumed."""
        if (courier := self._couriers.get(id)) is not None:
            courier.resume()

    def is_entitled(self, subscription: Subscription) -> bool:
        """Return True if the creator may still have this subscription."""
        return self._check_entitlement(subscription.creator, subscription.resource, subscription.view)

    async def suspend_unentitled(self) -> None:
        """Suspend every callback whose creator has lost the right to it, even one that was resumed."""
        for courier in list(self._couriers.values()):
            suspended = courier.delivery.state is DeliveryState.SUSPENDED
            if not suspended and not self.is_entitled(courier.subscription):
                await courier.suspend(UNENTITLED)

    def serves(self, id: str) -> bool:
        return id in self._couriers

    def has_options(self, subscription: Subscription) -> bool:
        """Return True if a callback uses these options, or is not served here."""
        courier = self._couriers.get(subscription.id)
        return courier is None or courier.subscription.options == subscription.options

    def change_options(self, subscription: Subscription) -> None:
        """Apply the options of the stored record to a callback that is served here."""
        if not self.has_options(subscription):
            self._couriers[subscription.id].change_options(subscription)

    async def stop_serving(self, id: str) -> None:
        """Stop serving a callback, if it is served here."""
        if (courier := self._couriers.pop(id, None)) is not None:
            await courier.stop()

    async def remove_refused(self) -> None:
        """Remove subscriptions from the store that were refused while the store was unavailable."""
        for id in list(self._refused):
            await self._store.remove(id)
            self._refused.discard(id)

    async def take_over(self, record: Record) -> None:
        """Serve a callback of a dead gateway."""
        # This gateway may have served it before it was taken for dead; what it knows from then is out of date.
        await self.stop_serving(record.subscription.id)
        self._serve(record)

    async def reconcile(self, held: dict[str, Record]) -> None:
        """Reconcile the served callbacks with those that the store assigns to this run."""
        for id, record in held.items():
            courier = self._couriers.get(id)
            if record.subscription.kind is Kind.CALLBACK and (courier is None or not courier.running):
                await self.stop_serving(id)
                self._serve(record)
        for id in [id for id in self._couriers if id not in held]:
            found = await self._store.get_record(id)  # it may be newer than ``held``
            if found is None or found.holder != self._run:
                await self.stop_serving(id)

    def _serve(self, record: Record) -> None:
        if record.subscription.id in self._couriers:
            return
        receiver = self._receiver(record.subscription)
        courier = Courier(
            record,
            self._store,
            self._fan_out,
            receiver,
            consent_required=self._consent_required,
            metrics=self.delivery_metrics,
        )
        self._couriers[record.subscription.id] = courier
        if self.is_entitled(record.subscription) or record.delivery.state is DeliveryState.SUSPENDED:
            courier.start()
        else:
            courier.start_suspended(UNENTITLED)

    def _receiver(self, subscription: Subscription) -> Receiver:
        return Receiver(
            self._network, subscription.callback, ssl_context=_tls(), consent_throttle=self._consent_throttle
        )


@cache
def _tls() -> ssl.SSLContext:
    """Return the shared TLS context; its root certificates take more than a megabyte."""
    return ssl.create_default_context()
