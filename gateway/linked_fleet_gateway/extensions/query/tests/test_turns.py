"""The order in which queries of several clients are evaluated."""

import asyncio

import pytest

from linked_fleet_base.errors import Busy, FleetError
from linked_fleet_gateway.extensions.query.turns import AT_ONCE, MAX_OF_CLIENT, MAX_WAITING, FairTurns, TooManyQueries


class Asked:
    """Queries of clients, each in progress until the test ends it."""

    def __init__(self) -> None:
        self.turns = FairTurns()
        self.order: list[str] = []
        self.ends: list[asyncio.Event] = []
        self.tasks: list[asyncio.Task[None]] = []

    async def ask(self, client: str) -> asyncio.Task[None]:
        end = asyncio.Event()
        self.ends.append(end)
        task = asyncio.create_task(self._ask(client, end))
        self.tasks.append(task)
        await asyncio.sleep(0)
        return task

    async def _ask(self, client: str, end: asyncio.Event) -> None:
        async with self.turns.turn(client):
            self.order.append(client)
            await end.wait()

    async def end(self) -> None:
        for end in self.ends:
            end.set()
        await asyncio.gather(*self.tasks, return_exceptions=True)


def test_a_client_with_many_queries_alternates_with_others() -> None:
    async def main() -> list[str]:
        asked = Asked()
        for client in [*"a" * (AT_ONCE + 3), "b", "c"]:
            await asked.ask(client)
        await asked.end()
        return asked.order

    assert "".join(asyncio.run(main())) == "a" * AT_ONCE + "abcaa"


async def test_few_wait_of_each_and_of_all() -> None:
    async def refused(asked: Asked, client: str) -> type[FleetError]:
        with pytest.raises(FleetError) as error:
            await (await asked.ask(client))
        return type(error.value)

    asked = Asked()
    for _ in range(AT_ONCE + MAX_OF_CLIENT):
        await asked.ask("a")
    assert await refused(asked, "a") is TooManyQueries
    for client in range(MAX_WAITING - MAX_OF_CLIENT):
        await asked.ask(f"c{client}")
    assert await refused(asked, "b") is Busy
    await asked.end()


def test_a_cancelled_query_takes_no_turn() -> None:
    async def main() -> list[str]:
        asked = Asked()
        for _ in range(AT_ONCE):
            await asked.ask("a")
        gone = await asked.ask("b")
        await asked.ask("c")
        gone.cancel()
        asked.ends[0].set()
        gone_as_it_is_given_one = await asked.ask("d")
        await asyncio.sleep(0)
        asked.ends[1].set()
        await asyncio.sleep(0)
        gone_as_it_is_given_one.cancel()
        await asked.ask("e")
        await asked.end()
        return asked.order

    order = asyncio.run(main())
    assert "b" not in order
    assert order[AT_ONCE] == "c"
    assert order[-1] == "e"
