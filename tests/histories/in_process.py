"""Gateways in the process of the test, with clients of all kinds."""

import asyncio
import random
from types import TracebackType
from typing import Any, Self

from histories.callbacks import CallbackClients
from histories.environment import Environment
from histories.gateways import Deliveries, Gateway, Watched, note_owners
from histories.history import History
from histories.leases import LeaseClients
from histories.registers import Objects, RegisterClients, Rules, Settings
from histories.requests import MotionClients
from histories.robots import Toy
from histories.workload import Clients, another
from linked_fleet_runtime.background import cancel_tasks

GATEWAYS = 3
_USES = 60  # of each key
_TOYS = ("toy-a", "toy-b")


class InProcess:
    """An async context manager."""

    between_kills = (300, 600)

    def __init__(self, environment: Environment, history: History, draws: random.Random) -> None:
        self._environment, self._draws = environment, draws
        self._watched = Watched(4)
        self.deliveries = Deliveries(history, self._watched, another(draws))
        motions = MotionClients(history, list(_TOYS), uses=8)
        self._robots = {name: Toy(name, history, motions.ran) for name in _TOYS}
        registers = [RegisterClients(history, each, _USES) for each in (Settings(), Objects(), Rules())]
        callbacks = CallbackClients(history, self._watched, self.deliveries)
        self.kinds: list[Clients[Any]] = [*registers, LeaseClients(history, _USES), motions, callbacks]
        self.gateways: list[Gateway] = []

    async def __aenter__(self) -> Self:
        note_owners()
        for number in range(GATEWAYS):
            self.gateways.append(await self._started(number))
        self._running = [asyncio.create_task(robot.run()) for robot in self._robots.values()]
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        await cancel_tasks(self._running)
        for gateway in self.gateways:
            await gateway.kill()

    async def _started(self, number: int) -> Gateway:
        gateway = Gateway(self._environment.url(number), self._watched, self._robots, another(self._draws))
        await gateway.start()
        return gateway

    async def replace(self, number: int) -> None:
        self._environment.bury(number)
        await self.gateways[number].kill()
        await self._environment.revive(number)
        self.gateways[number] = await self._started(number)
