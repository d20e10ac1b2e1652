"""The rate limit of consent requests to one destination, over all callback subscriptions of this gateway.

A subscription costs its creator one request, and costs a host that never asked for deliveries a handshake. Without a
limit per destination, a thousand subscriptions would turn the gateway into an amplifier.
"""

import asyncio
import time
from collections import OrderedDict
from collections.abc import AsyncIterator, Awaitable, Callable, Iterable
from contextlib import AsyncExitStack, asynccontextmanager

from linked_fleet_gateway.base.addresses import network_of

FIRST_PAUSE_S = 1.0
LONGEST_PAUSE_S = 60.0
"""Longest pause between two requests to a destination that does not consent; reached after seven refusals in a row."""
MAX_DESTINATIONS = 10_000
"""Above this number, the destinations unused for longest are forgotten."""


class ConsentRequest:
    """One request for consent. The caller sets ``granted``."""

    granted = False


class _Destination:
    def __init__(self) -> None:
        self.lock = asyncio.Lock()
        self.waiting = 0
        self.refusals = 0
        self.free_s = 0.0


class Handshakes:
    """Requests to each destination, one at a time and in the order of arrival.

    After a request that was not granted the next one waits: 1 s at first, twice as long after each further one, 60 s at
    most. A consent ends the pauses, so subscriptions to a receiver that consents do not wait.
    """

    def __init__(
        self,
        clock_s: Callable[[], float] = lambda: time.monotonic(),
        sleep: Callable[[float], Awaitable[None]] = asyncio.sleep,
    ) -> None:
        self._clock_s, self._sleep = clock_s, sleep
        self._destinations: OrderedDict[str, _Destination] = OrderedDict()

    @asynccontextmanager
    async def turn(self, addresses: Iterable[str]) -> AsyncIterator[ConsentRequest]:
        """Wait until all of these IP addresses may be asked, and record the result when the context ends."""
        turn = ConsentRequest()
        async with AsyncExitStack() as stack:
            # Sorted, so that two names with some addresses in common never wait for each other.
            for name in sorted({network_of(address) for address in addresses}):
                await stack.enter_async_context(self._held(name, turn))
            yield turn

    @asynccontextmanager
    async def _held(self, name: str, turn: ConsentRequest) -> AsyncIterator[None]:
        destination = self._destinations.setdefault(name, _Destination())
        self._destinations.move_to_end(name)
        destination.waiting += 1
        try:
            async with destination.lock:
                await self._sleep(max(0.0, destination.free_s - self._clock_s()))
                try:
                    yield
                finally:
                    self._record(destination, turn.granted)
        finally:
            destination.waiting -= 1
            self._forget()

    def _record(self, destination: _Destination, granted: bool) -> None:
        destination.refusals = 0 if granted else destination.refusals + 1
        pause_s = FIRST_PAUSE_S * 2.0 ** min(destination.refusals - 1, 16) if destination.refusals else 0.0
        destination.free_s = self._clock_s() + min(pause_s, LONGEST_PAUSE_S)

    def _forget(self) -> None:
        while len(self._destinations) > MAX_DESTINATIONS:
            name, longest_unused = next(iter(self._destinations.items()))
            if longest_unused.waiting:
                return
            del self._destinations[name]
