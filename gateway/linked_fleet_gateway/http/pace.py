"""Requests are refused that a client makes too often; what stops robots is neither refused nor counted."""

import math
from collections.abc import Callable, Collection

from starlette.types import ASGIApp, Receive, Scope, Send

from linked_fleet_gateway.base.errors import TooManyRequests
from linked_fleet_gateway.http.host import refuse
from linked_fleet_gateway.http.rates import Rates, by_caller
from linked_fleet_gateway.http.request import Request
from linked_fleet_gateway.http.stop_priority import is_urgent


class Pace:
    """ASGI middleware, inside of ``Callers``: refuses, before anything is read or found, what a client asks too often.

    ``carriers``: paths whose requests carry others in their bodies, which ``in_turn`` counts when those have been read.
    ``who`` names the client of a request.
    """

    def __init__(
        self,
        app: ASGIApp,
        rates: Rates,
        carriers: Collection[str] = (),
        who: Callable[[Scope], str] = by_caller,
    ) -> None:
        self.app, self._rates, self._who = app, rates, who
        self._carriers = frozenset(carriers)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        free = scope["type"] == "lifespan" or not self._rates.limited or self._is_counted_later(scope)
        wait_s = 0.0 if free else self._rates.take(self._who(scope))
        if not wait_s:
            await self.app(scope, receive, send)
            return
        await refuse(TooManyRequests(math.ceil(wait_s)), scope, send)

    def _is_counted_later(self, scope: Scope) -> bool:
        return is_urgent(scope) or scope["path"] in self._carriers


async def in_turn(request: Request) -> None:
    """Count a request to a carrier, and wait for its turn, as for any other request; TooManyRequests.

    The extension that serves the carrier calls it for all that stops no robot, once it has read what is asked for.
    """
    wait_s = request.services.rates.take(by_caller(request.scope))
    if wait_s:
        raise TooManyRequests(math.ceil(wait_s))
    await request.services.turns.take()
