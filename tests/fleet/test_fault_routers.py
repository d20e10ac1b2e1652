"""Two running routers that lose each other: gateways and a robot at one, other robots at the other.

Gateways, agents and routers run in the event loop of the test, on real Zenoh sessions.
"""

import asyncio
import itertools
import json
from collections.abc import Awaitable, Callable
from contextlib import AsyncExitStack
from pathlib import Path

import pytest
import zenoh

from forwarder import Proxy, proxy
from link.scene import Gateway, Robot, gateway, serves, until
from linked_fleet_agent.zenoh_session import open_session as open_agent
from linked_fleet_link.zenoh_session import open_session as open_gateway
from running import free_port

pytestmark = pytest.mark.processes
ROUTER = Path(__file__).resolve().parents[2] / "deploy" / "zenoh" / "router.json5"
PATIENCE_S = 120.0
_ports = itertools.count(8000)  # nothing listens there: they only distinguish gateways of one host


class Site:
    """Routers ``near`` and ``far``, and the ``way`` between them; the robot *near* is at the near router."""

    def __init__(self, stack: AsyncExitStack) -> None:
        self._stack = stack
        self.near, self.far = (f"tcp/127.0.0.1:{free_port()}" for _ in range(2))
        self._open_router(self.near)
        self.way: Proxy = stack.enter_context(proxy(int(self.near.rpartition(":")[2])))
        self._open_router(self.far, self.way.endpoint)
        self.robots: dict[str, Robot] = {}
        self._gateways: dict[Gateway, AsyncExitStack] = {}

    def _open_router(self, endpoint: str, *others: str) -> None:
        config = zenoh.Config.from_file(str(ROUTER))
        config.insert_json5("listen/endpoints", json.dumps([endpoint]))
        config.insert_json5("connect/endpoints", json.dumps(others))
        self._stack.callback(zenoh.open(config).close)

    async def appear(self, name: str, router: str) -> None:
        session = await self._stack.enter_async_context(open_agent((router,)))
        self.robots[name] = await Robot(session, name).appear()
        self._stack.push_async_callback(self.robots[name].leave)

    async def die(self, name: str) -> None:
        await self.robots.pop(name).leave()

    async def open_gateway(self, router: str) -> Gateway:
        kept = await self._stack.enter_async_context(AsyncExitStack())
        flags = ("--zenoh-connect", router, "--port", str(next(_ports)))
        opened = await kept.enter_async_context(gateway(open_gateway, *flags))
        self._gateways[opened] = kept
        return opened

    async def close_gateway(self, gateway: Gateway) -> None:
        await self._gateways[gateway].aclose()

    @property
    def far_robots(self) -> dict[str, Robot]:
        return {name: robot for name, robot in self.robots.items() if name != "near"}

    def hold(self) -> bool:
        return all(robot.holds for robot in self.far_robots.values())


def run(test: Callable[[Site], Awaitable[None]]) -> None:
    async def main() -> None:
        async with asyncio.timeout(PATIENCE_S), AsyncExitStack() as stack:
            site = Site(stack)
            for name in ("dies", "restarts", "lives", "dies late"):
                await site.appear(name, site.far)
            await site.appear("near", site.near)
            await test(site)

    asyncio.run(main())


# -- faults ---------------------------------------------------------------------------------------------------------


async def lost(site: Site, near: Gateway) -> None:
    """Wait until the gateway knows that robots are gone, and they know that the gateway is gone and hold."""
    await until(lambda: list(near.online) == ["near"] and site.hold())
    assert not site.robots["near"].holds


async def silent(site: Site, near: Gateway) -> None:
    site.way.cut()
    await lost(site, near)


async def shorter_than_the_lease(site: Site, near: Gateway) -> None:
    site.way.cut()


async def reset(site: Site, near: Gateway) -> None:
    site.way.cut()
    site.way.reset()
    await lost(site, near)


async def reset_twice(site: Site, near: Gateway) -> None:
    """The second time right after routers have exchanged declarations: Zenoh 1.10 does not exchange them again."""
    for _ in range(2):
        await until(lambda: near.online.keys() == site.robots.keys())
        near.lost.clear()
        site.way.reset()
        await until(lambda: near.lost)


@pytest.mark.parametrize(("fault", "times"), [(silent, 3), (shorter_than_the_lease, 1), (reset, 1), (reset_twice, 1)])
def test_exactly_the_living_robots_are_there_after_routers_have_lost_each_other(
    fault: Callable[[Site, Gateway], Awaitable[None]], times: int
) -> None:
    async def test(site: Site) -> None:
        near = await site.open_gateway(site.near)
        for _ in range(times):
            await serves(near, site.robots)
            near.lost.clear()
            await fault(site, near)
            await site.die("dies")
            await site.die("restarts")
            await site.appear("restarts", site.far)
            await site.appear("born", site.far)
            site.way.heal()
            await site.die("dies late")
            await serves(near, site.robots)
            assert fault is not shorter_than_the_lease or "lives" not in near.lost
            await site.die("born")
            await site.appear("dies", site.far)
            await site.appear("dies late", site.far)

    run(test)


def test_robots_believe_in_no_gateway_that_died_while_routers_had_lost_each_other() -> None:
    async def test(site: Site) -> None:
        dies, stays, far = [await site.open_gateway(router) for router in (site.near, site.near, site.far)]
        for each in (dies, stays, far):
            await serves(each, site.robots)
        site.way.cut()
        await until(lambda: list(stays.online) == ["near"])
        await serves(far, site.far_robots)
        await site.close_gateway(dies)
        site.way.heal()
        await serves(stays, site.robots)
        await serves(far, site.robots)
        await site.close_gateway(far)
        await serves(stays, site.robots)
        await silent(site, stays)
        await site.close_gateway(stays)
        site.way.heal()
        last = await site.open_gateway(site.near)
        await serves(last, site.robots)
        await site.close_gateway(last)
        await until(lambda: site.hold() and site.robots["near"].holds)

    run(test)
