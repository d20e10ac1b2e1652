"""The environment of a workload and its faults: Valkey servers, and a proxy from each gateway to them."""

import asyncio
import contextlib
import random
from collections.abc import AsyncIterator, Callable, Sequence
from pathlib import Path
from typing import Protocol

from histories.faulty_proxy import FaultyProxy, faulty_proxy
from redis_servers import IN_STEP, Server
from running import eventually

_SPLIT = 0.1
_SHARP = 0.75  # share of faults that are over at once
_BETWEEN_PROMOTIONS = 25  # faults
HELD_S = (0.1,)
"""Duration of a hang: long enough for operations to pile up."""
_LATE_S = (0.0, 0.005, 0.05)


class Environment(Protocol):
    """A store that gateways reach at ``url``, and its faults; everything that a workload knows of it."""

    def url(self, gateway: int) -> str:
        """Return the store's address for one of the gateways."""

    def bury(self, gateway: int) -> None:
        """Let a killed gateway send nothing more; ``url`` then returns its successor's address."""

    async def revive(self, gateway: int) -> None:
        """Prepare ``url`` for the successor."""

    async def fail(self, draws: random.Random) -> None:
        """Cause a fault and, if it lasts, end it."""


class OneServer:
    """One Valkey server that syncs every write, behind proxies that lose, split and delay."""

    def __init__(
        self,
        server: Server,
        gateways: int,
        draws: random.Random,
        ways: contextlib.AsyncExitStack,
        held_s: Sequence[float] = HELD_S,
    ) -> None:
        self._server, self._draws, self._stack, self._held_s = server, draws, ways, held_s
        self._ways: list[FaultyProxy | None] = [None] * gateways
        self._down = asyncio.Lock()

    async def open(self) -> None:
        for gateway in range(len(self._ways)):
            await self.revive(gateway)

    def url(self, gateway: int) -> str:
        way = self._ways[gateway]
        assert way is not None
        return f"redis://127.0.0.1:{way.port}"

    def bury(self, gateway: int) -> None:
        way = self._ways[gateway]
        assert way is not None
        way.sever()

    async def revive(self, gateway: int) -> None:
        way = await self._stack.enter_async_context(
            faulty_proxy(self._server.port, random.Random(self._draws.random()), _SPLIT)
        )
        way.target = self._server.port  # a replica may have been promoted meanwhile
        self._ways[gateway] = way

    async def fail(self, draws: random.Random) -> None:
        way = draws.choice([way for way in self._ways if way is not None])
        faults: list[Callable[[], None]] = [way.reset, way.lose_answers, lambda: way.make_late(draws.choice(_LATE_S))]
        if draws.random() < _SHARP:
            draws.choice(faults)()
            return
        await draws.choice([lambda: self._cut(way), self._kill, self._pause])()

    async def _cut(self, way: FaultyProxy) -> None:
        way.cut()
        await asyncio.sleep(self._draws.choice(self._held_s))
        way.heal()

    async def _kill(self) -> None:
        async with self._down:
            await asyncio.to_thread(self._server.kill)
            await asyncio.to_thread(self._server.start)

    async def _pause(self) -> None:
        async with self._down:
            self._server.pause()
            await asyncio.sleep(self._draws.choice(self._held_s))
            self._server.resume()


class Replicated(OneServer):
    """A server with a replica, which repeatedly replaces it.

    It does so only when it has everything that was written: if a master dies with more than its replica has, data is
    lost (``gateway/linked_fleet_gateway/subscriptions/PROTOCOL.md``).
    """

    def __init__(
        self,
        servers: tuple[Server, Server],
        gateways: int,
        draws: random.Random,
        ways: contextlib.AsyncExitStack,
        held_s: Sequence[float] = HELD_S,
    ) -> None:
        super().__init__(servers[0], gateways, draws, ways, held_s)
        self._replica = servers[1]
        self.promotions = self._faults = 0
        _follow(self._replica, self._server)

    async def fail(self, draws: random.Random) -> None:
        self._faults += 1
        await (super().fail(draws) if self._faults % _BETWEEN_PROMOTIONS else self._promote())

    async def _promote(self) -> None:
        async with self._down:
            await asyncio.to_thread(self._change_places)
            self._server, self._replica = self._replica, self._server
            self.promotions += 1
            for way in self._ways:
                if way is not None:
                    way.target = self._server.port
                    way.reset()

    def _change_places(self) -> None:
        master, replica = self._server, self._replica
        eventually(lambda: IN_STEP.search(master.ask("INFO replication")), "a replica in step")
        assert master.ask("CLIENT PAUSE 60000 WRITE") == "+OK"
        eventually(lambda: _offset(replica) == _offset(master), "a replica that has everything")
        assert replica.ask("REPLICAOF NO ONE") == "+OK"
        _follow(master, replica)
        assert master.ask("CLIENT UNPAUSE") == "+OK"


def _follow(replica: Server, master: Server) -> None:
    """By a command: an option at the start would apply at each start."""
    assert replica.ask("REPLICAOF 127.0.0.1", master.port) == "+OK"


def _offset(server: Server) -> str:
    """Return the offset of the last write that the server has."""
    said = server.ask("INFO replication")
    return said.partition("slave_repl_offset:" if "role:slave" in said else "master_repl_offset:")[2].split()[0]


@contextlib.asynccontextmanager
async def _started(folder: Path) -> AsyncIterator[Server]:
    server = Server(folder)
    try:
        await asyncio.to_thread(server.start)
        yield server
    finally:
        server.discard()


@contextlib.asynccontextmanager
async def one_server(folder: Path, gateways: int, draws: random.Random) -> AsyncIterator[OneServer]:
    async with _started(folder) as server, contextlib.AsyncExitStack() as ways:
        found = OneServer(server, gateways, draws, ways)
        await found.open()
        yield found


@contextlib.asynccontextmanager
async def replicated(
    folder: Path, gateways: int, draws: random.Random, held_s: Sequence[float] = HELD_S
) -> AsyncIterator[Replicated]:
    async with (
        _started(folder / "one") as one,
        _started(folder / "other") as other,
        contextlib.AsyncExitStack() as ways,
    ):
        found = Replicated((one, other), gateways, draws, ways, held_s)
        await found.open()
        yield found
        assert found.promotions, "no replica was promoted"
