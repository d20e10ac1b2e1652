"""The query process as the gateway keeps it."""

import asyncio
from collections.abc import Awaitable, Callable

import pytest

from linked_fleet_gateway.extensions.query.messages import News, QueryRequest
from linked_fleet_gateway.extensions.query.process import Feed, QueryProcess
from linked_fleet_state.fleet import Fleet

pytestmark = pytest.mark.processes
_LONG_S = 3600.0


def _ask(_: Feed) -> QueryRequest:
    return QueryRequest(
        news=News(robots=[], frames={}), query="ASK {}", base="http://fleet", base_iri="http://fleet/query",
        patterns=("*",), caller="", default=None, named=None, branches=[], invocations=[], graphs=[],
        media_type="application/sparql-results+json", most_bytes=1000, limit_s=5.0,
    )  # fmt: skip


def _with_process(idle_s: float, run: Callable[[QueryProcess], Awaitable[None]]) -> None:
    async def main() -> None:
        process = QueryProcess(lambda: Feed(Fleet(), {}, lambda robot, path: []), idle_s)  # type: ignore[arg-type, return-value]
        try:
            await run(process)
        finally:
            await process.close()

    asyncio.run(main())


def test_an_idle_query_process_ends_and_is_restarted_for_the_next_query() -> None:
    async def run(process: QueryProcess) -> None:
        for _ in range(2):
            assert b"true" in await process.ask(_ask)
            async with asyncio.timeout(30):
                await process._worker.process.wait()

    _with_process(0.0, run)


def test_a_query_process_outlives_its_query() -> None:
    async def run(process: QueryProcess) -> None:
        await process.ask(_ask)
        child = process._worker.process
        await process.ask(_ask)
        assert process._worker.process is child

    _with_process(_LONG_S, run)


def test_a_query_process_does_not_end_during_another_query() -> None:
    async def run(process: QueryProcess) -> None:
        with process._worker.in_use():  # a request that has not been served yet
            await process.ask(_ask)
            child = process._worker.process
            await process.ask(_ask)
            assert process._worker.process is child

    _with_process(0.0, run)
