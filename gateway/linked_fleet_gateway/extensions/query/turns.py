"""Fair scheduling of queries: round-robin over clients, with bounds on concurrency and on waiting queries.

Errors of queries: ``ResultTooLarge`` (413, result-too-large), ``TooManyQueries`` (429, too-many-queries),
``QueryTooCostly`` (503, query-too-costly).
"""

# ruff: noqa: N818  (named like the errors of linked_fleet_base.errors)

import asyncio
from collections import OrderedDict, deque
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

from linked_fleet_base.errors import Busy, FleetError, PayloadTooLarge


class ResultTooLarge(PayloadTooLarge):
    """The result exceeds the limit. Results are never truncated."""

    code, title = "result-too-large", "The result of the query is too large"


class TooManyQueries(FleetError):
    """Too many queries of the client are waiting (RFC 6585, 4)."""

    status, code, title = 429, "too-many-queries", "The client has too many queries waiting"
    retry_after_s = 1


class QueryTooCostly(FleetError):
    """A query was ended at its limit of time or memory. Other requests are not affected; repeating it does not help."""

    status, code, title = 503, "query-too-costly", "The query takes too much time or memory"


AT_ONCE = 2
MAX_OF_CLIENT, MAX_WAITING = 8, 128


class FairTurns:
    """Limits concurrent queries to ``at_once``, and serves waiting clients round-robin.

    At most ``of_client`` queries of a client wait, and ``waiting`` of all.
    """

    def __init__(self, at_once: int = AT_ONCE, of_client: int = MAX_OF_CLIENT, waiting: int = MAX_WAITING) -> None:
        self._at_once, self._most_of_client, self._most_waiting = at_once, of_client, waiting
        self._taken = 0
        self._waiting: OrderedDict[str, deque[asyncio.Future[None]]] = OrderedDict()

    @asynccontextmanager
    async def turn(self, client: str) -> AsyncIterator[None]:
        """Hold a turn. Raises TooManyQueries or Busy if too many queries of the client, or of all, are waiting."""
        if self._taken >= self._at_once:
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
        if len(own) >= self._most_of_client:
            raise TooManyQueries(f"{self._most_of_client} of your queries are waiting already.")
        if sum(map(len, self._waiting.values())) >= self._most_waiting:
            raise Busy("Too many queries are waiting; try again.")
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
        while self._waiting and self._taken < self._at_once:
            client, own = self._waiting.popitem(last=False)
            turn = own.popleft()
            if own:
                self._waiting[client] = own
            if not turn.done():  # the waiting request was cancelled
                self._taken += 1
                turn.set_result(None)
