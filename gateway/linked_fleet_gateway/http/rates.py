"""How often one client may ask: a bucket of tokens for each, by any string that stands for it."""

import time
from collections import OrderedDict
from collections.abc import Callable

from starlette.types import Scope

from linked_fleet_gateway.base.addresses import network_of
from linked_fleet_gateway.http.arrival import arrival_of

BURST_S = 10.0
"""Seconds for which a client keeps what it has not used."""
MAX_CLIENTS = 10_000


class Rates:
    """``per_s`` requests of each client on average, ``burst`` of them at once; endless if ``per_s`` is 0.

    Of more than ``MAX_CLIENTS`` those are forgotten who have not asked for longest, which gives them their whole burst.
    """

    def __init__(
        self, per_s: float, clock_s: Callable[[], float] = lambda: time.monotonic(), burst: float | None = None
    ) -> None:
        self._per_s, self._clock_s = per_s, clock_s
        self._most = max(1.0, per_s * BURST_S if burst is None else burst)
        self._left: OrderedDict[str, tuple[float, float]] = OrderedDict()  # tokens, and when there were so many

    @property
    def limited(self) -> bool:
        """False if everybody may ask as often as they like."""
        return self._per_s > 0

    def take(self, client: str) -> float:
        """Seconds until the client may ask; 0 if it may now, which is counted."""
        if not self._per_s:
            return 0.0
        now_s = self._clock_s()
        left, at_s = self._left.pop(client, (self._most, now_s))
        left = min(self._most, left + (now_s - at_s) * self._per_s)
        allowed = left >= 1.0
        self._left[client] = (left - 1.0 if allowed else left, now_s)
        if len(self._left) > MAX_CLIENTS:
            self._left.popitem(last=False)
        return 0.0 if allowed else (1.0 - left) / self._per_s


def by_caller(scope: Scope) -> str:
    """The identity of who asks, as it was found; of nobody in particular the address."""
    name, client = arrival_of(scope).authenticated.identity.name, scope.get("client")
    return f"identity {name}" if name else network_of(client[0]) if client else ""
