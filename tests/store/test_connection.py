"""Commands while connections are lost: each is answered, or told that the store is away."""

import asyncio
from collections.abc import Callable
from contextlib import AbstractContextManager
from pathlib import Path

import pytest
from redis_servers import Servers, cluster, single

from gateway.store.connection import Connection, StoreUnavailable

_ROUNDS, _AT_ONCE = 100, 12


@pytest.mark.parametrize("servers", [single, cluster])
def test_who_writes_while_all_connections_are_cut_hears_of_it(
    tmp_path: Path, servers: Callable[[Path], AbstractContextManager[Servers]]
) -> None:
    """The client of a cluster closes all connections when one fails, also those that others are about to write to."""

    async def scenario(url: str) -> None:
        connection = Connection(url, "news")

        async def ask(*command: str | int) -> bool:
            try:
                await connection.one(*command)
            except StoreUnavailable:
                return False
            return True

        cut = 0
        for number in range(_ROUNDS):
            tasks = []
            for each in range(_AT_ONCE):
                tasks.append(asyncio.create_task(ask("SET", f"key {each}", number)))
                if each % 4 == 0:
                    tasks.append(asyncio.create_task(ask("CLIENT", "KILL", "TYPE", "normal", "SKIPME", "no")))
                if number % 3:  # else all begin at once
                    await asyncio.sleep(0)
            cut += (await asyncio.gather(*tasks)).count(False)
        assert cut
        while not await ask("PING"):
            pass
        await connection.close()

    with servers(tmp_path) as found:
        asyncio.run(scenario(found.url))
