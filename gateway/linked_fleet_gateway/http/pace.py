"""Rate limiting of requests by client; stops are neither refused nor counted."""

import math
from collections.abc import Collection

from starlette.types import Scope

from linked_fleet_gateway.base.errors import TooManyRequests
from linked_fleet_gateway.http.rates import Rates, by_caller
from linked_fleet_gateway.http.request import Request
from linked_fleet_gateway.http.stop_priority import is_urgent


class Pace:
    """Refuses, before anything is read or found, what a caller asks too often.

    ``carriers``: paths whose requests carry others in their bodies, which ``in_turn`` counts when those have been read.
    """

    def __init__(self, rates: Rates, carriers: Collection[str] = ()) -> None:
        self._rates, self._carriers = rates, frozenset(carriers)

    def wait_s(self, scope: Scope) -> float:
        """Seconds until the request may be made; 0 if it may now, which is counted."""
        if not self._rates.limited or is_urgent(scope) or scope["path"] in self._carriers:
            return 0.0
        return self._rates.take(by_caller(scope))

    def check(self, scope: Scope) -> None:
        """Count the request. Raises TooManyRequests."""
        wait_s = self.wait_s(scope)
        if wait_s:
            raise TooManyRequests(math.ceil(wait_s))


async def in_turn(request: Request) -> None:
    """Count a request to a carrier, and wait for its turn. Raises TooManyRequests.

    The extension that serves the carrier calls it, after reading the request, unless it is a stop.
    """
    wait_s = request.services.rates.take(by_caller(request.scope))
    if wait_s:
        raise TooManyRequests(math.ceil(wait_s))
    await request.services.turns.take()
