"""A gateway and agents in the event loop of a test, on the test's sessions: the product without HTTP and drivers."""

import asyncio
from collections.abc import AsyncIterator, Callable
from contextlib import AsyncExitStack, asynccontextmanager
from typing import Self

from bench.still_agent import Still
from linked_fleet_agent.agent import Agent
from linked_fleet_agent.serving import link_of
from linked_fleet_agent.transport import Session
from linked_fleet_agent.wire.keys import Keys
from linked_fleet_agent.wire.messages import WIRE_VERSION, Accepted, Command, Move
from linked_fleet_gateway.app.application import create_live
from linked_fleet_gateway.app.settings import GatewaySettings
from linked_fleet_gateway.subscriptions.live import Live
from linked_fleet_link.transport import Opener

_RATE_HZ = 20.0


class Robot:
    """One run of an agent, whose robot stands still, from ``appear`` to ``leave``."""

    def __init__(self, session: Session, name: str) -> None:
        agent = self._agent = Agent(name, Still(1), rate_hz=_RATE_HZ)
        self.name, self.incarnation = name, agent.incarnation
        self.link = link_of(agent, session, Keys())
        self._open = AsyncExitStack()

    async def appear(self) -> Self:
        await self._open.enter_async_context(self.link)
        running = asyncio.create_task(self._agent.run(self.link))
        self._open.push_async_callback(asyncio.wait, [running])
        self._open.callback(running.cancel)
        return self

    async def leave(self) -> None:
        await self._open.aclose()

    @property
    def holds(self) -> bool:
        return not self.link.gateway_present


class Gateway:
    """The robots known to one gateway; ``lost``: those that have vanished, in order."""

    def __init__(self, live: Live) -> None:
        self._live = live
        self.lost: list[str] = []
        live.on_lost = self.lost.append

    @property
    def online(self) -> dict[str, int]:
        """The present run of each online robot."""
        robots = self._live.fleet.robots.values()
        return {robot.name: robot.incarnation or 0 for robot in robots if robot.online and robot.described}

    def frame(self, name: str) -> int:
        """Return the number of the last frame of the robot's present run, -1 before the first."""
        return self._live.fleet.robots[name].last_sequence()

    async def commands(self, name: str) -> bool:
        """Return True if the robot answers that it would execute a motion."""
        frame = self._live.fleet.robots[name].frame
        assert frame is not None
        command = Command(
            version=WIRE_VERSION, id="c1", incarnation=frame.incarnation, seen_ns=frame.monotonic_ns,
            time_to_live_ns=10**10, motion=Move({"joint_0": 0.2}), rehearsal=True,
        )  # fmt: skip
        return isinstance(await self._live.link.command(name, command, 5.0), Accepted)


@asynccontextmanager
async def gateway(open_session: Opener, *flags: str) -> AsyncIterator[Gateway]:
    live = create_live(GatewaySettings.read({}, flags), open_session)
    async with live:
        await live.admit_robots()
        yield Gateway(live)


async def until(condition: Callable[[], object]) -> None:
    """Wait, in real or in virtual time."""
    while not condition():  # noqa: ASYNC110 - set in many ways
        await asyncio.sleep(0.01)


async def serves(gateway: Gateway, robots: dict[str, Robot]) -> None:
    """Wait until exactly these robots are online with these runs, send frames, and accept commands."""

    def seen() -> bool:
        return gateway.online == {name: robot.incarnation for name, robot in robots.items()}

    await until(lambda: seen() and not any(robot.holds for robot in robots.values()))
    before = {name: gateway.frame(name) for name in robots}
    await until(lambda: seen() and all(gateway.frame(name) > before[name] for name in robots))
    for name in robots:
        # A robot may refuse once more what was sent while it was cut off.
        while not await gateway.commands(name):  # noqa: ASYNC110 - each time it is asked
            await asyncio.sleep(0.01)
    assert seen()
