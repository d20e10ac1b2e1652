"""The pace of requests to receivers of callbacks: back-off of failed deliveries, and a limit of consent requests.

Clock and random numbers of the back-off are arguments; it is pure. The limit of consent requests to one destination
counts all callback subscriptions of this gateway. A subscription costs its creator one request, and costs a host that
never asked for deliveries a handshake. Without a limit per destination, a thousand subscriptions would turn the gateway
into an amplifier.
"""

import asyncio
import time
from collections import OrderedDict
from collections.abc import AsyncIterator, Awaitable, Callable, Iterable
from contextlib import AsyncExitStack, asynccontextmanager
from datetime import UTC
from email.utils import parsedate_to_datetime

from linked_fleet_server.addresses import network_of

FIRST_DELAY_S = 0.5
MAX_DELAY_S = 300.0
SUSPEND_AFTER = 12
"""Failed attempts in a row, within about a quarter of an hour, after which the subscription is suspended."""
MAX_RETRY_AFTER_S = 3600.0
"""Limit of a receiver's Retry-After."""
_LONGEST_FIELD = 64


def backoff_s(failures: int, draw: float) -> float:
    """Return the seconds until the next attempt after ``failures`` (≥ 1) in a row; ``draw`` is random in [0, 1).

    Half of the delay is fixed (equal jitter): an attempt never follows at once, yet the attempts of many subscriptions
    to one failed receiver are spread.
    """
    doublings = min(max(failures, 1) - 1, 16)  # a large exponent would overflow a float; the cap is reached long before
    ceiling = min(MAX_DELAY_S, FIRST_DELAY_S * 2.0**doublings)
    return ceiling / 2 * (1 + draw)


def retry_after_s(field: str | None, now_s: float) -> float | None:
    """Return the seconds after ``now_s`` (Unix) in a Retry-After field (RFC 9110, 10.2.3); None if it is unusable."""
    if field is None or not field.isascii() or len(field) > _LONGEST_FIELD:
        return None
    text = field.strip()
    if text.isdigit():
        return min(float(text), MAX_RETRY_AFTER_S)
    moment_s = _http_date_s(text)
    return None if moment_s is None else min(max(moment_s - now_s, 0.0), MAX_RETRY_AFTER_S)


def _http_date_s(text: str) -> float | None:
    """Return the Unix time of an HTTP-date in any of its three forms (RFC 9110, 5.6.7); None for anything else."""
    if not text[:3].isalpha():  # all three begin with a weekday, which the parser of e-mail dates does not require
        return None
    try:
        moment = parsedate_to_datetime(text)
        return (moment if moment.tzinfo else moment.replace(tzinfo=UTC)).timestamp()
    except (ValueError, OverflowError):
        return None


FIRST_PAUSE_S = 1.0
MAX_PAUSE_S = 60.0
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


class ConsentThrottle:
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
        destination.free_s = self._clock_s() + min(pause_s, MAX_PAUSE_S)

    def _forget(self) -> None:
        while len(self._destinations) > MAX_DESTINATIONS:
            name, longest_unused = next(iter(self._destinations.items()))
            if longest_unused.waiting:
                return
            del self._destinations[name]
