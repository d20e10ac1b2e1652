"""Gateways as real processes with robots at a Zenoh router of the test, and their clients over HTTP."""

import asyncio
import contextlib
import random
from contextlib import AsyncExitStack
from types import TracebackType
from typing import Any, Self

from browser import LF, Browser, Page
from commanding import of_joint
from fake_robots import FakeRobot
from gateway_group import Gateway as Seen
from gateway_group import Hub, hub
from histories.environment import Environment
from histories.history import History
from histories.robots import JOINT, Witnessed
from histories.web import HttpGateway, last_segment
from histories.web_callbacks import HttpReceiver, Subscribers
from histories.web_clients import ConditionalWriters, Controllers, Movers, SceneObject, Title
from histories.workload import Clients, another
from linked_fleet_agent.serving import link_of
from linked_fleet_agent.wire.keys import Keys as ZenohKeys
from linked_fleet_agent.zenoh_session import open_session
from linked_fleet_runtime.background import cancel_tasks
from running import eventually, free_port

GATEWAYS = 2
_TITLED, _LEASED, _OBJECTS = 60, 60, 60
_USES = 120  # of each key
_MOVER = "mover"
_FROZEN = 0.3  # share of gateways that are frozen instead of killed
_FLAGS = (
    *("--callback-allow", "127.0.0.0/8", "--requests-per-client", "0", "--history-s", "0"),
    *("--invocations-per-client", "100000", "--subscriptions-per-client", "100000"),
)


class Processes:
    """An async context manager."""

    between_kills = (1_000, 2_000)

    def __init__(self, environment: Environment, history: History, draws: random.Random) -> None:
        self._environment, self._history, self._draws = environment, history, draws
        self.gateways: list[HttpGateway] = []
        self.kinds: list[Clients[Any]] = []
        self._stack = AsyncExitStack()

    async def __aenter__(self) -> Self:
        async with AsyncExitStack() as stack:
            self._hub = stack.enter_context(hub())
            receiver = HttpReceiver(self._history, another(self._draws))
            server = await asyncio.start_server(receiver.serve, "127.0.0.1", 0)
            stack.callback(server.close)
            receiver.port = server.sockets[0].getsockname()[1]
            arms = [f"arm-{number}" for number in range(_TITLED + _LEASED)]
            self._arms = [FakeRobot(self._hub.session, name).appear() for name in arms]
            stack.push_async_callback(self._stop_gateways)
            for number in range(GATEWAYS):
                self.gateways.append(await self._started(number))
            await self._join_mover(stack)
            await self._meet(receiver, arms)
            subscribers = self.kinds[-1]
            assert isinstance(subscribers, Subscribers)
            self._run(subscribers.move(), stack)
            self._stack = stack.pop_all()
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        await self._stack.aclose()

    async def _stop_gateways(self) -> None:
        for gateway in self.gateways:
            await gateway.stop()

    def _run(self, doing: Any, stack: AsyncExitStack) -> None:
        task = asyncio.create_task(doing)
        stack.push_async_callback(cancel_tasks, [task])

    async def _started(self, number: int, port: int | None = None) -> HttpGateway:
        shared = ("--zenoh-connect", self._hub.endpoint, "--redis-url", self._environment.url(number))
        gateway = HttpGateway(port or free_port(), ("-m", "linked_fleet_gateway", *shared, *_FLAGS))
        await gateway.serving()
        return gateway

    async def _join_mover(self, stack: AsyncExitStack) -> None:
        """Add a robot that accepts commands, whose agent runs in this process."""
        self._mover = Witnessed(_MOVER, self._history, lambda *ran: self._movers.ran(*ran))
        agent, session = self._mover.agent, await stack.enter_async_context(open_session((self._hub.endpoint,)))
        link = link_of(
            agent, session, ZenohKeys(), on_command=self._mover.handle, on_operate=self._mover.handle_operate
        )
        self._run(agent.run(await stack.enter_async_context(link)), stack)

    async def _meet(self, receiver: HttpReceiver, arms: list[str]) -> None:
        found = await asyncio.to_thread(_Places, self._hub, self.gateways[0].port, arms)
        titles, leased = iter(found.titles[:_TITLED]), iter(found.robots[_TITLED:])
        objects = [await self._object(found.objects) for _ in range(_OBJECTS)]
        for path in found.titles[:_TITLED]:
            since_ns, value = self._history.now_ns(), self._history.label("v")
            await self.gateways[0].ask("PUT", path, Title().body(value))
            self._history.happened("register", path, "swap", since_ns, is_="done", value=value)
        self._movers = Movers(self._history, found.rotate, uses=8)
        history = self._history
        self.kinds = [
            ConditionalWriters(history, Title(), titles.__next__, _USES, self.gateways),
            ConditionalWriters(history, SceneObject(), iter(objects).__next__, _USES, self.gateways),
            Controllers(history, leased.__next__, _USES),
            self._movers,
            Subscribers(history, self._hub, found.container, found.rotation, receiver, self.gateways),
        ]

    async def _object(self, container: str) -> str:
        since_ns, value = self._history.now_ns(), self._history.label("v")
        made = await self.gateways[0].ask("POST", container, SceneObject().body(value))
        assert made.status == 201, made.text
        path = f"{container}/{last_segment(made.headers['location'])}"
        self._history.happened("register", path, "swap", since_ns, is_="done", value=value)
        return path

    async def replace(self, number: int) -> None:
        gateway = self.gateways[number]
        if self._draws.random() < _FROZEN:
            await gateway.freeze()
            return
        del self.gateways[number]
        await gateway.kill()
        self._environment.bury(number)
        await self._environment.revive(number)
        self.gateways.insert(number, await self._started(number, gateway.port))


class _Places:
    """Paths of resources that clients use, found by links from the root."""

    def __init__(self, stage: Hub, port: int, arms: list[str]) -> None:
        with contextlib.closing(Browser(f"http://127.0.0.1:{port}/")) as browser:
            self._browser = browser
            pages = [eventually(lambda name=name: self._described(name), f"the robot {name}") for name in arms]
            self.robots = [self._path(page.url).rstrip("/") for page in pages]
            self.titles = [self._path(str(page.property(LF.TextProperty))) for page in pages]
            world = browser.page(str(browser.page(browser.root).one(LF.world)))
            self.objects = self._path(str(world.one(LF.objects)))
            eventually(lambda: self._described(_MOVER), "the robot that moves")
            self.rotate = self._path(of_joint(browser, JOINT, robot=_MOVER))
            seen = Seen(None, browser)  # type: ignore[arg-type]
            seen.meet(stage)
            self.container, self.rotation = self._path(seen.container), self._path(seen.rotation)

    def _path(self, iri: str) -> str:
        return "/" + iri.removeprefix(self._browser.root)

    def _described(self, name: str) -> Page | None:
        try:
            page = self._browser.robot(name)
        except AssertionError:
            return None
        return page if (page.iri, LF.rootLink, None) in page.graph else None
