"""Rate limits by client: a token bucket for each string that identifies a client."""

import time
from collections import OrderedDict
from collections.abc import Callable

from starlette.types import Scope

from linked_fleet_gateway.base.addresses import network_of
from linked_fleet_gateway.http.arrival import arrival_of

BURST_S = 10.0
"""Seconds for which unused requests are kept."""
MAX_CLIENTS = 10_000


class TokenBuckets:
    """Allows each client ``per_s`` requests on average, ``burst`` of them at once; unlimited if ``per_s`` is 0.

    Beyond ``MAX_CLIENTS`` the least recent clients are forgotten, which restores their whole burst.
    """

    def __init__(
        self, per_s: float, clock_s: Callable[[], float] = lambda: time.monotonic(), burst: float | None = None
    ) -> None:
        self._per_s, self._clock_s = per_s, clock_s
        self._most = max(1.0, per_s * BURST_S if burst is None else burst)
        self._left: OrderedDict[str, tuple[float, float]] = OrderedDict()  # tokens, and the time of that count

    @property
    def limited(self) -> bool:
        """False if requests are unlimited."""
        return self._per_s > 0

    def take(self, client: str) -> float:
        """Return the seconds until the client may send; 0 if it may now, which is then counted."""
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


def bucket_of(scope: Scope) -> str:
    """Return the identity of the caller, or without one its address."""
    name, client = arrival_of(scope).authenticated.identity.name, scope.get("client")
    return f"identity {name}" if name else network_of(client[0]) if client else ""
