"""The callbacks that this gateway serves: those that were made here, and those of gateways that are gone."""

import asyncio
import ssl
from collections.abc import Callable
from functools import cache

from linked_fleet_gateway.identity.rights import View
from linked_fleet_gateway.resources.paths import robot_of
from linked_fleet_gateway.resources.subscription import Delivery, DeliveryState, Kind, Record, Subscription
from linked_fleet_gateway.runtime.counters import Deliveries
from linked_fleet_gateway.subscriptions.courier import Courier
from linked_fleet_gateway.subscriptions.fan_out import FanOut
from linked_fleet_gateway.subscriptions.handshakes import Handshakes
from linked_fleet_gateway.subscriptions.network import Network, Unresolvable
from linked_fleet_gateway.subscriptions.receiver import Receiver
from linked_fleet_gateway.subscriptions.store import Store, StoreUnavailable

Vouches = Callable[[str, str | None, View], bool]
UNENTITLED = "the rights of its creator ended"


class Callbacks:
    """``limit`` is the number of subscriptions that one client may have, ``consent`` whether receivers are asked,
    ``vouches`` whether a creator still may have the robot told of that he asked for, and sees what he saw."""

    def __init__(
        self,
        store: Store,
        run: str,
        fan_out: FanOut,
        network: Network,
        limit: int,
        consent: bool,
        vouches: Vouches = lambda *_: True,
    ) -> None:
        self._vouches = vouches
        self._store, self._run, self._fan_out, self._network = store, run, fan_out, network
        self._limit, self._consent = limit, consent
        self._couriers: dict[str, Courier] = {}
        self.deliveries = Deliveries()
        self._refused: set[str] = set()
        self._handshakes = Handshakes()

    @property
    def served(self) -> int:
        return len(self._couriers)

    @property
    def suspended(self) -> int:
        """How many of those served wait for somebody to resume them."""
        return sum(each.delivery.state is DeliveryState.SUSPENDED for each in list(self._couriers.values()))

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
        delivery = Delivery(DeliveryState.ACTIVE if trusted else DeliveryState.AWAITING_CONSENT)
        try:
            await self._store.add(subscription, delivery, self._limit)
        except StoreUnavailable:
            self._refused.add(subscription.id)  # it may be there, although its client is told that it is not
            raise
        record = Record(subscription, delivery, self._run)
        self._serve(record)
        return record

    async def aclose(self) -> None:
        await asyncio.gather(*(courier.stop() for courier in self._couriers.values()))

    def woken(self, id: str) -> None:
        """Somebody resumed it."""
        if (courier := self._couriers.get(id)) is not None:
            courier.wake()

    def entitled(self, subscription: Subscription) -> bool:
        """Return True if its creator may have it."""
        return self._vouches(subscription.creator, robot_of(subscription.resource), subscription.view)

    async def suspend_unentitled(self) -> None:
        """Those whose creator may not have them any more, whoever resumed them."""
        for courier in list(self._couriers.values()):
            suspended = courier.delivery.state is DeliveryState.SUSPENDED
            if not suspended and not self.entitled(courier.subscription):
                await courier.suspend(UNENTITLED)

    def serves(self, id: str) -> bool:
        return id in self._couriers

    def obeys(self, subscription: Subscription) -> bool:
        """Return True if a callback goes by these options, or is not served here."""
        courier = self._couriers.get(subscription.id)
        return courier is None or courier.subscription.options == subscription.options

    def change(self, subscription: Subscription) -> None:
        """Have a callback that is served here go by the options that its record has now."""
        if not self.obeys(subscription):
            self._couriers[subscription.id].change(subscription)

    async def drop(self, id: str) -> None:
        """Serve it no longer, if it is served here."""
        if (courier := self._couriers.pop(id, None)) is not None:
            await courier.stop()

    async def catch_up(self) -> None:
        """Take back what was refused while the store was away."""
        for id in list(self._refused):
            await self._store.remove(id)
            self._refused.discard(id)

    async def adopted(self, record: Record) -> None:
        """Serve what a dead gateway held."""
        # We may have served it before we were thought dead; what is known from then is out of date.
        await self.drop(record.subscription.id)
        self._serve(record)

    async def compare(self, held: dict[str, Record]) -> None:
        """With what the store says this run holds."""
        for id, record in held.items():
            courier = self._couriers.get(id)
            if record.subscription.kind is Kind.CALLBACK and (courier is None or not courier.running):
                await self.drop(id)
                self._serve(record)
        for id in [id for id in self._couriers if id not in held]:
            found = await self._store.record(id)  # it may be newer than the answer above
            if found is None or found.holder != self._run:
                await self.drop(id)

    def _serve(self, record: Record) -> None:
        if record.subscription.id in self._couriers:
            return
        receiver = self._receiver(record.subscription)
        courier = Courier(
            record, self._store, self._fan_out, receiver, consent=self._consent, deliveries=self.deliveries
        )
        self._couriers[record.subscription.id] = courier
        if self.entitled(record.subscription) or record.delivery.state is DeliveryState.SUSPENDED:
            courier.start()
        else:
            courier.start_suspended(UNENTITLED)

    def _receiver(self, subscription: Subscription) -> Receiver:
        return Receiver(self._network, subscription.callback, ssl_context=_tls(), handshakes=self._handshakes)


@cache
def _tls() -> ssl.SSLContext:
    """One for all; the authorities that it knows take more than a megabyte."""
    return ssl.create_default_context()
