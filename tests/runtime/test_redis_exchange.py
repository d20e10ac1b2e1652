"""Connections to one Redis server, with a connection in memory."""

import asyncio
from typing import Any

from linked_fleet_runtime.redis_exchange import Exchange


class HangingConnection:
    """A connection that is closed by the server after each answer; waiting for its end takes forever."""

    def __init__(self) -> None:
        self.is_connected = self._ended = False
        self.connects = 0

    async def connect(self) -> None:
        self.is_connected, self._ended = True, False
        self.connects += 1

    async def disconnect(self, nowait: bool = False) -> None:
        self.is_connected = False
        if not nowait:
            await asyncio.Event().wait()

    async def can_read(self) -> bool:
        return self._ended

    async def send_packed_command(self, command: bytes) -> None:
        assert self.is_connected and not self._ended

    async def read_response(self) -> Any:
        self._ended = True
        return b"PONG"


async def test_nobody_waits_for_the_end_of_a_connection() -> None:
    connection = HangingConnection()
    exchange = Exchange(lambda: connection, {}, ValueError)
    async with asyncio.timeout(5.0):
        assert await exchange.send([("PING",)]) == [b"PONG"]
        assert await exchange.send([("PING",)]) == [b"PONG"]
        await exchange.close()
    assert connection.connects == 2 and not connection.is_connected
