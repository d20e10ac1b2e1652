"""Fair scheduling of queries: round-robin over clients, with bounds on concurrency and on waiting queries."""

import asyncio
from collections import OrderedDict, deque
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

from linked_fleet_gateway.base.errors import Busy
from linked_fleet_gateway.extensions.query.errors import TooManyQueries

AT_ONCE = 2
MAX_OF_CLIENT, MAX_WAITING = 8, 128


class FairTurns:
    """``AT_ONCE`` concurrent turns, assigned round-robin to waiting clients."""

    def __init__(self) -> None:
        self._taken = 0
        self._waiting: OrderedDict[str, deque[asyncio.Future[None]]] = OrderedDict()

    @asynccontextmanager
    async def turn(self, client: str) -> AsyncIterator[None]:
        """Hold a turn. Raises TooManyQueries or Busy if too many queries of the client, or of all, are waiting."""
        if self._taken >= AT_ONCE:
            await self._wait(client)
        else:
            self._taken += 1
        try:
            yield
        finally:
            self._taken -= 1
            self._next()

    async def _wait(self, client: str) -> None:
        own = self._waiting.get(client, ())
        if len(own) >= MAX_OF_CLIENT:
            raise TooManyQueries(f"{MAX_OF_CLIENT} queries of yours are waiting already.")
        if sum(map(len, self._waiting.values())) >= MAX_WAITING:
            raise Busy("Too many queries are waiting; ask again.")
        turn: asyncio.Future[None] = asyncio.get_running_loop().create_future()
        self._waiting.setdefault(client, deque()).append(turn)
        try:
            await turn
        except asyncio.CancelledError:
            if turn.done() and not turn.cancelled():  # it got a turn while being cancelled
                self._taken -= 1
                self._next()
            raise

    def _next(self) -> None:
        while self._waiting and self._taken < AT_ONCE:
            client, own = self._waiting.popitem(last=False)
            turn = own.popleft()
            if own:
                self._waiting[client] = own
            if not turn.done():  # the waiting request was cancelled
                self._taken += 1
                turn.set_result(None)
