"""Requests take turns, so that one to stop a robot overtakes all that wait.

The event loop runs everything that is ready before it looks for what has come since: a hundred requests at once, each
some milliseconds of work, would keep a stop that comes next waiting for all of them. With turns it looks between any two.
"""

import asyncio
from collections import deque

from starlette.types import Scope

from gateway.actions.definition import definitions
from gateway.graph.vocab import LF

_STOPS = frozenset(each.segment for each in definitions() if each.iri in (LF.Hold, LF.StopRobot, LF.StopAll))
URGENT = _STOPS | {"cancel"}
"""The last segments of what stops robots."""


class Turns:
    """Gives the waiting their turns in the order in which they came, one each time around the event loop."""

    def __init__(self) -> None:
        self._waiting: deque[asyncio.Future[None]] = deque()

    async def turn(self, scope: Scope) -> None:
        """Wait for the turn of a request; one that stops a robot waits for nobody."""
        if scope.get("method") == "POST" and scope["path"].rpartition("/")[2] in URGENT:
            return
        loop = asyncio.get_running_loop()
        turn = loop.create_future()
        self._waiting.append(turn)
        if len(self._waiting) == 1:
            loop.call_soon(self._next)
        await turn

    def _next(self) -> None:
        turn = self._waiting.popleft()
        if not turn.done():  # who was waiting may have gone away
            turn.set_result(None)
        if self._waiting:
            turn.get_loop().call_soon(self._next)
