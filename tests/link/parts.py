"""Networks with a gateway's session and agents' sessions: Zenoh on loopback, or in memory on virtual time."""

import asyncio
from collections.abc import Awaitable, Callable
from contextlib import AsyncExitStack
from functools import wraps
from typing import Any, Protocol

import linked_fleet_agent.transport
import linked_fleet_agent.zenoh_session
import linked_fleet_link.transport
import linked_fleet_link.zenoh_session
from forwarder import Proxy, proxy
from running import free_port
from virtual.loop import on_virtual_time
from virtual.zenoh_agent import AgentSession
from virtual.zenoh_network import ZenohNetwork

LEASE_S = 0.5
"""The lease of agents; the protocol fixes that of gateways."""
_PATIENCE_S = 30.0


class Network(Protocol):
    """One gateway and the agents that can reach it, each by name."""

    async def gateway(self) -> linked_fleet_link.transport.Session: ...

    async def agent(self, name: str) -> linked_fleet_agent.transport.Session: ...

    def cut(self, name: str) -> None:
        """Let nothing pass between the gateway and an agent, without telling them."""

    def heal(self, name: str) -> None: ...

    def kill(self, name: str) -> None:
        """Close the connection of an agent, as the kernel does for a killed process."""

    async def leave(self, name: str) -> None:
        """Close the session of an agent regularly."""

    def keep(self, declaration: object) -> None:
        """Keep a declaration until the end of the test: Zenoh undeclares what is garbage-collected."""


class _Kept:
    def __init__(self) -> None:
        self._kept: list[object] = []

    def keep(self, declaration: object) -> None:
        self._kept.append(declaration)


class Memory(_Kept):
    """``linked_fleet_link.transport`` and ``linked_fleet_agent.transport`` in memory."""

    def __init__(self, seed: int = 0) -> None:
        super().__init__()
        self.network = ZenohNetwork(seed)
        self._agents: dict[str, AgentSession] = {}

    @staticmethod
    def run(test: Callable[[Network], Awaitable[None]]) -> None:
        async def main() -> None:
            await test(Memory())

        on_virtual_time(main)

    async def gateway(self) -> linked_fleet_link.transport.Session:
        return await self.network.gateway("the gateway")((), (), {})

    async def agent(self, name: str) -> linked_fleet_agent.transport.Session:
        self._agents[name] = session = self.network.agent(name, LEASE_S)
        await session.met.wait()
        return session

    def cut(self, name: str) -> None:
        self.network.partition("the gateway", name)

    def heal(self, name: str) -> None:
        self.network.heal("the gateway", name)

    def kill(self, name: str) -> None:
        self.network.kill(name)

    async def leave(self, name: str) -> None:
        await self._agents[name].close()


class Zenoh(_Kept):
    """Zenoh on loopback. Each agent reaches the gateway through its own proxy."""

    def __init__(self, stack: AsyncExitStack) -> None:
        super().__init__()
        self._stack, self._port = stack, free_port()
        self._ways: dict[str, Proxy] = {}
        self._sessions: dict[str, AsyncExitStack] = {}

    @staticmethod
    def run(test: Callable[[Network], Awaitable[None]]) -> None:
        async def main() -> None:
            async with asyncio.timeout(_PATIENCE_S), AsyncExitStack() as stack:
                await test(Zenoh(stack))

        asyncio.run(main())

    async def gateway(self) -> linked_fleet_link.transport.Session:
        session = await linked_fleet_link.zenoh_session.open_session((f"tcp/127.0.0.1:{self._port}",), (), {})
        self._stack.push_async_callback(session.close)
        return session

    async def agent(self, name: str) -> linked_fleet_agent.transport.Session:
        self._ways[name] = self._stack.enter_context(proxy(self._port))
        self._sessions[name] = await self._stack.enter_async_context(AsyncExitStack())
        opening = linked_fleet_agent.zenoh_session.open_session(
            (self._ways[name].endpoint,), lease_ms=round(LEASE_S * 1000)
        )
        return await self._sessions[name].enter_async_context(opening)

    def cut(self, name: str) -> None:
        self._ways[name].cut()

    def heal(self, name: str) -> None:
        self._ways[name].heal()

    def kill(self, name: str) -> None:
        self._ways[name].sever()

    async def leave(self, name: str) -> None:
        await self._sessions[name].aclose()


def contract(test: Callable[..., Awaitable[None]]) -> Callable[..., None]:
    """Make a test of both implementations from a coroutine function whose argument ``part`` is the network."""

    @wraps(test)
    def run(part: Any, **arguments: object) -> None:
        part.run(lambda network: test(network, **arguments))

    return run
