"""Runs of actions that go on when their agent ends, and that the next agent takes up."""

import asyncio
from collections.abc import Iterable

import pytest

from component_agent import Bench
from linked_fleet_agent.components import BASE, Call, Component, DeclarationError, action
from linked_fleet_agent.components.declaration import declare


class Oven:
    """What bakes, whatever becomes of the agent."""

    def __init__(self) -> None:
        self.baking: dict[str, asyncio.Future[int]] = {}

    def bake(self, id: str) -> "asyncio.Future[int]":
        return self.baking.setdefault(id, asyncio.get_running_loop().create_future())


class Baker(Component, blocking=False):
    def __init__(self, oven: Oven) -> None:
        self.oven, self._told = oven, set[str]()
        self.cancelled: list[str] = []

    def unfinished(self) -> Iterable[tuple[str, str]]:
        new = self.oven.baking.keys() - self._told
        self._told |= new
        return [("bake", each) for each in new]

    async def _await(self, call: Call[int]) -> int:
        try:
            return await asyncio.shield(self.oven.bake(call.id))
        except asyncio.CancelledError:
            if not call.goes_on:
                self.cancelled.append(call.id)
            raise

    @action(resume=_await)
    async def bake(self, call: Call[int]) -> int:
        self._told.add(call.id)
        return await self._await(call)


async def _end(bench: Bench) -> None:
    """End the agent, as its ``run`` does."""
    run = asyncio.ensure_future(bench.agent.run(bench.link))
    await asyncio.sleep(0)
    run.cancel()
    await asyncio.wait({run})
    await asyncio.sleep(0)


async def test_the_next_agent_tells_how_a_run_ends() -> None:
    oven = Oven()
    first = Bench(Baker(oven))
    first.operate("b", "bake", component="baker")
    await first.tick(0.1)
    await _end(first)
    assert first.states("b") == ["running"], "no end is told"

    second = Bench(baker := Baker(oven))
    await second.tick(0.1)
    assert second.states("b") == ["running"]
    oven.baking["b"].set_result(220)
    await second.tick(0.1)
    assert (second.states("b"), bytes(second.end("b").result or b"")) == (["running", "succeeded"], b"220")
    assert baker.cancelled == []
    await second.tick(1.0)
    assert second.states("b") == ["running", "succeeded"], "it is taken up once"


async def test_a_run_that_was_taken_up_is_cancelled_as_any_other() -> None:
    oven = Oven()
    oven.bake("b")
    bench = Bench(baker := Baker(oven))
    await bench.tick(0.1)
    bench.stop("s", command="b")
    await bench.tick(0.1)
    assert (bench.end("b").state, baker.cancelled) == ("cancelled", ["b"])


def test_an_action_that_moves_something_does_not_resume() -> None:
    class Roller(Component):
        async def _await(self, call: Call[None]) -> None: ...

        @action(moves=[BASE], resume=_await)
        async def roll(self, call: Call[None]) -> None: ...

    with pytest.raises(DeclarationError, match="it moves something, and so ends with its agent"):
        declare(Roller())
