"""Scheduling of requests in turns, so that a stop overtakes all waiting requests.

The event loop runs all ready callbacks before it polls again: a hundred simultaneous requests of some milliseconds each
would delay a stop that arrives next. With turns it polls between any two requests.
"""

import asyncio
from collections import deque
from collections.abc import Collection

from starlette.types import Scope

from linked_fleet_gateway.rdf.vocabulary import LF
from linked_fleet_gateway.resources.action_definition import definitions

_STOPS = frozenset(each.segment for each in definitions() if each.iri in (LF.Hold, LF.StopRobot, LF.StopAll))
URGENT = _STOPS | {"cancel"}
"""Last path segments of actions that stop robots."""


def is_urgent(scope: Scope) -> bool:
    """Return True for a request that stops robots."""
    return scope.get("method") == "POST" and scope["path"].rpartition("/")[2] in URGENT


class StopPriority:
    """Grants one turn per iteration of the event loop; others wait in order of arrival.

    ``carriers`` are paths whose requests carry other requests in their bodies; they take their turn after reading.
    """

    def __init__(self, carriers: Collection[str] = ()) -> None:
        self._carriers = frozenset(carriers)
        self._waiting: deque[asyncio.Future[None]] = deque()
        self._taken = False

    async def turn(self, scope: Scope) -> None:
        """Wait for the turn of a request; a stop does not wait."""
        if not is_urgent(scope) and scope["path"] not in self._carriers:
            await self.take()

    async def take(self) -> None:
        """Wait for the next turn."""
        loop = asyncio.get_running_loop()
        if not self._taken:
            self._taken = True
            loop.call_soon(self._next)
            return
        turn = loop.create_future()
        self._waiting.append(turn)
        await turn

    def _next(self) -> None:
        while self._waiting and self._waiting[0].done():  # the waiting request was cancelled
            self._waiting.popleft()
        self._taken = bool(self._waiting)
        if self._taken:
            turn = self._waiting.popleft()
            turn.set_result(None)
            turn.get_loop().call_soon(self._next)
