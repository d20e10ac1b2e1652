"""Requests take turns, so that one to stop a robot overtakes all that wait.

The event loop runs all that is ready before it looks for what has come since: a hundred requests at once, each some
milliseconds of work, would keep a stop that comes next waiting for all of them. With turns it looks between any two.
"""

import asyncio
from collections import deque
from collections.abc import Collection

from starlette.types import Scope

from linked_fleet_gateway.rdf.vocabulary import LF
from linked_fleet_gateway.resources.action_definition import definitions

_STOPS = frozenset(each.segment for each in definitions() if each.iri in (LF.Hold, LF.StopRobot, LF.StopAll))
URGENT = _STOPS | {"cancel"}
"""The last segments of what stops robots."""


def is_urgent(scope: Scope) -> bool:
    """Return True for a request that stops robots."""
    return scope.get("method") == "POST" and scope["path"].rpartition("/")[2] in URGENT


class Turns:
    """One turn each time around the event loop; who comes when it is taken waits, in the order of coming.

    ``carriers``: paths whose requests carry others in their bodies, and take their turn when those have been read.
    """

    def __init__(self, carriers: Collection[str] = ()) -> None:
        self._carriers = frozenset(carriers)
        self._waiting: deque[asyncio.Future[None]] = deque()
        self._taken = False

    async def turn(self, scope: Scope) -> None:
        """Wait for the turn of a request; one that stops a robot waits for nobody."""
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
        while self._waiting and self._waiting[0].done():  # who was waiting has gone away
            self._waiting.popleft()
        self._taken = bool(self._waiting)
        if self._taken:
            turn = self._waiting.popleft()
            turn.set_result(None)
            turn.get_loop().call_soon(self._next)
