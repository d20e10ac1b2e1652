"""Clients of several gateways with faults among their operations, from a seed; the result is a history."""

import asyncio
import contextlib
import random
from collections.abc import AsyncIterator, Coroutine, Sequence
from typing import Any, Protocol, TypeVar

from histories.environment import Environment
from histories.history import History
from linked_fleet_base.errors import RedisUnavailable

CLIENTS = 24
_CANCELLED = 0.02
_IMPATIENCE_S = 0.002
_PAUSE_S = 0.01  # of a client after the store was unavailable
_LOOK_S, _QUIET_S = 0.001, 1.0
_BETWEEN_FAULTS = (20, 60)  # operations


class Unanswered(Exception):  # noqa: N818
    """The outcome of an operation is unknown."""


class Gateway(Protocol):
    def task(self, coroutine: Coroutine[Any, Any, None]) -> asyncio.Task[None]:
        """Run a coroutine at this gateway, with which it ends."""


G = TypeVar("G", bound=Gateway, contravariant=True)


class Clients(Protocol[G]):
    """Clients of one kind."""

    async def act(self, client: int, gateway: G, draws: random.Random) -> None:
        """Execute one operation; RedisUnavailable, RedisUnavailable, Unanswered if its outcome is unknown."""

    async def settle(self, gateway: G) -> None:
        """Record all outcomes after the faults."""


class Fleet(Protocol):
    """The gateways, and their clients. ``between_kills``: operations."""

    gateways: list[Any]
    kinds: Sequence[Clients[Any]]
    between_kills: tuple[int, int]

    async def replace(self, number: int) -> None:
        """Kill a gateway and start another in its place."""


class Workload:
    """Runs until ``operations`` have responses, and everything has settled."""

    def __init__(
        self, fleet: Fleet, environment: Environment, history: History, draws: random.Random, operations: int
    ) -> None:
        self._fleet, self._environment, self._history = fleet, environment, history
        self._draws, self._operations = draws, operations

    @property
    def _over(self) -> bool:
        return self._history.answered >= self._operations

    async def run(self) -> None:
        clients = [self._client(number) for number in range(1, CLIENTS + 1)]
        await asyncio.gather(*clients, self._fail(), self._kill_gateways())
        for kind in self._fleet.kinds:
            while not await _succeeded(kind.settle(self._fleet.gateways[0])):  # noqa: ASYNC110 - until the store is back
                await asyncio.sleep(_PAUSE_S)

    async def _client(self, client: int) -> None:
        draws = another(self._draws)
        while not self._over:
            gateway, kind = draws.choice(self._fleet.gateways), draws.choice(self._fleet.kinds)
            task = gateway.task(kind.act(client, gateway, draws))
            if draws.random() < _CANCELLED:
                await asyncio.sleep(draws.random() * _IMPATIENCE_S)
                task.cancel()
            await asyncio.wait([task])
            if task.cancelled() or not await _succeeded(task):
                await asyncio.sleep(_PAUSE_S)

    async def _fail(self) -> None:
        async for _ in self._each(_BETWEEN_FAULTS):
            await self._environment.fail(self._draws)

    async def _kill_gateways(self) -> None:
        async for _ in self._each(self._fleet.between_kills):
            await self._fleet.replace(self._draws.randrange(len(self._fleet.gateways)))

    async def _each(self, between: tuple[int, int]) -> AsyncIterator[None]:
        """Yield each time that a number of operations got a response, or none for a while."""
        while True:
            at = self._history.answered + self._draws.randint(*between)
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(_QUIET_S):
                    while self._history.answered < at:  # noqa: ASYNC110 - a count
                        await asyncio.sleep(_LOOK_S)
            if self._over:
                return
            yield


async def _succeeded(doing: Coroutine[Any, Any, None] | asyncio.Task[None]) -> bool:
    try:
        await doing
    except (RedisUnavailable, Unanswered):
        return False
    return True


def another(draws: random.Random) -> random.Random:
    """Return a separate random generator, for a client that does not take turns with others."""
    return random.Random(draws.random())
