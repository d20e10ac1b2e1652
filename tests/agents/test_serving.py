"""The runs of robots that an agent process serves."""

import asyncio
from contextlib import asynccontextmanager
from typing import Any

import pytest

from linked_fleet_agent import serving
from linked_fleet_agent.robot import NewDescriptionError
from linked_fleet_agent.robots.catalogue import UnavailableError
from linked_fleet_agent.settings import AgentSettings


class FakeAgent:
    """An agent whose run ends with ``ends`` if that is set, and else lasts."""

    name = "r"

    def __init__(self, ends: Exception | None) -> None:
        self._ends, self.began = ends, asyncio.Event()

    async def run(self, link: object) -> None:
        self.began.set()
        if self._ends is not None:
            raise self._ends
        await asyncio.Event().wait()


async def test_a_robot_with_a_new_description_gets_another_run(monkeypatch: pytest.MonkeyPatch) -> None:
    """With a link of its own, after the former one is closed, and after attempts at which it was not there yet."""
    said: list[str] = []
    later: list[Any] = [UnavailableError("r: away"), FakeAgent(None)]
    agents: list[Any] = [FakeAgent(NewDescriptionError("new"))]

    @asynccontextmanager
    async def link(agent: Any) -> Any:
        said.append(f"open {agents.index(agent) if agent in agents else '?'}")
        yield None
        said.append("close")

    def make(settings: AgentSettings, index: int) -> Any:
        found = later.pop(0)
        if isinstance(found, Exception):
            raise found
        return found

    monkeypatch.setattr(serving, "make_agent", make)
    monkeypatch.setattr(serving, "_AGAIN_S", 0.0)
    first, second = agents[0], later[1]
    task = asyncio.create_task(serving._serve_robot(AgentSettings(robots=()), agents, 0, link))
    await asyncio.wait_for(second.began.wait(), 10)
    assert first.began.is_set() and agents == [second] and said[0] == said[-1] == "open 0"
    task.cancel()
    with pytest.raises(asyncio.CancelledError):
        await task
