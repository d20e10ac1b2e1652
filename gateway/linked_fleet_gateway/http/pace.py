"""Rate limiting of requests by client; stops are neither refused nor counted."""

import math
from collections.abc import Collection

from starlette.types import Scope

from linked_fleet_gateway.base.errors import TooManyRequests
from linked_fleet_gateway.http.rates import TokenBuckets, bucket_of
from linked_fleet_gateway.http.request import Request
from linked_fleet_gateway.http.stop_priority import is_urgent


class RateLimiter:
    """Refuses requests above the caller's rate, before anything is read or resolved.

    ``carriers``: paths whose requests contain others in their bodies, which ``await_turn`` counts after reading them.
    """

    def __init__(self, rates: TokenBuckets, carriers: Collection[str] = ()) -> None:
        self._rates, self._carriers = rates, frozenset(carriers)

    def wait_s(self, scope: Scope) -> float:
        """Return the seconds until the request is permitted; 0 if it is now, and then counted."""
        if not self._rates.limited or is_urgent(scope) or scope["path"] in self._carriers:
            return 0.0
        return self._rates.take(bucket_of(scope))

    def check(self, scope: Scope) -> None:
        """Count the request. Raises TooManyRequests."""
        wait_s = self.wait_s(scope)
        if wait_s:
            raise TooManyRequests(math.ceil(wait_s))


async def await_turn(request: Request) -> None:
    """Count a request to a carrier, and wait for its turn. Raises TooManyRequests.

    The extension that serves the carrier calls it, after reading the request, unless it is a stop.
    """
    wait_s = request.services.rates.take(bucket_of(request.scope))
    if wait_s:
        raise TooManyRequests(math.ceil(wait_s))
    await request.services.turns.take()
