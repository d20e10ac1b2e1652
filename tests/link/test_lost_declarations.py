"""Gateways and robots that routers have hidden from each other, and tokens that routers keep.

On virtual time. ``tests/fleet/test_fault_routers.py`` shows that Zenoh routers do this, and that the remedy works.
"""

import asyncio
from collections.abc import AsyncIterator, Awaitable, Callable, Container
from contextlib import AsyncExitStack, asynccontextmanager

import pytest

from bench.still_agent import Still
from link.scene import Gateway, Robot, gateway, serves, until
from linked_fleet_agent.agent import Agent
from linked_fleet_agent.gateways import LONGEST_S, RENEW_S
from linked_fleet_agent.transport import Query
from linked_fleet_agent.wire.codec import encode_state
from linked_fleet_agent.wire.keys import Keys
from linked_fleet_agent.wire.messages import State
from linked_fleet_link.fleet_link import DESCRIPTION_TIMEOUT_S
from linked_fleet_state.presence import SILENT_S
from virtual.loop import on_virtual_time
from virtual.zenoh_agent import AgentSession
from virtual.zenoh_network import ZenohNetwork

KEYS = Keys()
HEALED_S = RENEW_S + SILENT_S + 2.0
OFFLINE_S = SILENT_S + 3 * DESCRIPTION_TIMEOUT_S + 3.0


class Site:
    """A gateway ``g``, optionally another ``h``, and connected robots at nodes of their names."""

    def __init__(self, stack: AsyncExitStack) -> None:
        self.network, self._stack, self.robots = ZenohNetwork(), stack, dict[str, Robot]()

    async def open_gateway(self, node: str) -> Gateway:
        port = str(8000 + ord(node))  # nothing listens there: it only distinguishes gateways of one host
        return await self._stack.enter_async_context(gateway(self.network.gateway(node), "--port", port))

    async def session(self, node: str) -> AgentSession:
        session = self.network.agent(node)
        await session.met.wait()
        return session

    async def appear(self, *names: str) -> None:
        for name in names:
            self.robots[name] = await Robot(await self.session(name), name).appear()
            self._stack.push_async_callback(self.robots[name].leave)


def run(test: Callable[[Site], Awaitable[None]]) -> None:
    async def main() -> None:
        async with AsyncExitStack() as stack:
            await test(Site(stack))

    on_virtual_time(main)


@pytest.mark.parametrize("of", [("r",), ("g",), ("r", "g")], ids=["robot's", "gateway's", "both"])
@pytest.mark.parametrize("others", [(), ("h",)], ids=["alone", "with another gateway"])
def test_declarations_that_routers_have_lost_are_made_anew(of: Container[str], others: tuple[str, ...]) -> None:
    async def test(site: Site) -> None:
        seen = [await site.open_gateway(node) for node in ("g", *others)]
        await site.appear("r", "s")
        for each in seen:
            await serves(each, site.robots)
        async with asyncio.timeout(HEALED_S):
            site.network.lose_declarations("r", "g", of)
            await asyncio.sleep(0.1)
            await serves(seen[0], site.robots)
        await asyncio.sleep(2 * LONGEST_S)
        for each in seen:
            await serves(each, site.robots)
        assert [each.lost for each in seen] == [["r"] if "r" in of else [], *([] for _ in others)]

    run(test)


def test_no_robot_holds_while_another_gateway_is_alive() -> None:
    async def test(site: Site) -> None:
        seen, _ = await site.open_gateway("g"), await site.open_gateway("h")
        await site.appear("r")
        await serves(seen, site.robots)
        site.network.lose_declarations("r", "g", ("r", "g"))
        for _ in range(round(2 * HEALED_S / 0.01)):
            await asyncio.sleep(0.01)
            assert not site.robots["r"].holds

    run(test)


# -- tokens that stay -----------------------------------------------------------------------------------------------


class Played:
    """An agent that sends frames and answers while the test permits it; another session keeps its token."""

    def __init__(self, name: str, session: AgentSession, keeper: AgentSession) -> None:
        self._agent = Agent(name, Still(1))
        self.asked = 0
        self.hangs = self.sends = False
        self._session = session
        self._key = KEYS.robot(name, "description")
        self._kept = [session.declare_queryable(self._key, self._answer)]
        self._kept.append(keeper.declare_token(KEYS.presence(name, self._agent.incarnation)))

    @property
    def run(self) -> int:
        return self._agent.incarnation

    def _answer(self, query: Query) -> None:
        self.asked += 1
        if not self.hangs:
            query.reply(self._key, self._agent.description)

    async def send(self) -> None:
        states = self._session.declare_publisher(KEYS.robot(self._agent.name, "state"), reliable=False, express=True)
        for sequence in range(10**6):
            await asyncio.sleep(0.1)
            if self.sends:
                state = State(
                    incarnation=self.run, sequence=sequence, monotonic_ns=1, wall_ns=1, positions=(0.0,),
                    velocities=(0.0,), efforts=(0.0,),
                )  # fmt: skip
                states.put(encode_state(state))


@asynccontextmanager
async def played(site: Site, name: str = "r") -> AsyncIterator[Played]:
    one = Played(name, await site.session(name), await site.session(f"router of {name}"))
    sending = asyncio.create_task(one.send())
    yield one
    sending.cancel()


def test_a_robot_whose_token_outlives_it_is_offline_and_its_next_run_is_there() -> None:
    async def test(site: Site) -> None:
        seen = await site.open_gateway("g")
        async with played(site) as dead:
            dead.sends = True
            await until(lambda: seen.online == {"r": dead.run})
            site.network.kill("r")
            dead.sends = False
            async with asyncio.timeout(OFFLINE_S):
                await until(lambda: not seen.online)
            await asyncio.sleep(2 * LONGEST_S)
            assert (seen.online, seen.lost) == ({}, ["r"])
            async with played(site) as living:
                living.sends = True
                await until(lambda: seen.online == {"r": living.run})
                await asyncio.sleep(2 * LONGEST_S)
                assert seen.online == {"r": living.run}

    run(test)


def test_an_agent_that_hangs_while_zenoh_keeps_its_token_is_offline_until_it_goes_on() -> None:
    async def test(site: Site) -> None:
        seen = await site.open_gateway("g")
        async with played(site) as agent:
            agent.sends = True
            await until(lambda: seen.online)
            agent.hangs, agent.sends = True, False
            async with asyncio.timeout(OFFLINE_S):
                await until(lambda: not seen.online)
            await asyncio.sleep(2 * LONGEST_S)
            assert not seen.online
            agent.hangs, agent.sends = False, True
            async with asyncio.timeout(2 * DESCRIPTION_TIMEOUT_S + 3.0):
                await until(lambda: seen.online)
            await asyncio.sleep(2 * LONGEST_S)
            assert (seen.online, seen.lost) == ({"r": agent.run}, ["r"])

    run(test)


def test_an_agent_that_answers_and_sends_no_frames_stays_and_costs_little() -> None:
    """The same applies to a ROS 2 agent whose robot is silent."""

    async def test(site: Site) -> None:
        seen = await site.open_gateway("g")
        tokens: list[bool] = []
        (await site.session("witness")).subscribe_tokens(KEYS.all_gateways, lambda _, present: tokens.append(present))
        async with played(site) as agent:
            await until(lambda: seen.online)
            await asyncio.sleep(1800.0)
            assert (seen.online, seen.lost) == ({"r": agent.run}, [])
            assert agent.asked <= 1800.0 / LONGEST_S + 10
            assert tokens == [True] + 3 * [False, True]  # the gateway has repeated its declarations, and then stopped

    run(test)
