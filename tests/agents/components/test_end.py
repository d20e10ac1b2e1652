"""The end of an agent while an action of a component is going on."""

import asyncio
import threading

import pytest

from component_agent import Bench
from linked_fleet_agent.components import Call, Component, action
from linked_fleet_agent.robots.of_components import RobotOfComponents


class Braking(Component, blocking=False):
    """Its action waits for a tick when it is cancelled."""

    def __init__(self, number: int) -> None:
        self.name, self.ended = f"part{number}", False

    @action()
    async def roll(self, call: Call[None]) -> None:
        try:
            await asyncio.Future()
        except asyncio.CancelledError:
            try:
                await asyncio.Future()
            finally:
                self.ended = True
            raise


@pytest.mark.parametrize("all_at_once", [False, True])
def test_an_action_that_brakes_does_not_keep_the_agent_from_ending(all_at_once: bool) -> None:
    parts = [Braking(number) for number in range(10)]

    async def program() -> None:
        bench = Bench(other=RobotOfComponents("Parts", *parts))
        bench.agent.tick(bench.link)
        running = asyncio.create_task(bench.agent.run(bench.link))
        for part in parts:
            bench.operate(part.name, "roll", component=part.name)
        for _ in range(5):
            await asyncio.sleep(0)
        if not all_at_once:  # otherwise ``asyncio.run`` cancels all tasks
            running.cancel()
            await asyncio.wait([running])

    thread = threading.Thread(target=asyncio.run, args=(program(),), daemon=True)
    thread.start()
    thread.join(20)
    assert not thread.is_alive()
    assert all(part.ended for part in parts)
