"""Gateways and agents in the event loop of a test, which are started, signalled and ended like child processes."""

import asyncio
import contextlib
import itertools
import logging
import signal
import sys
from collections.abc import AsyncIterator, Awaitable, Callable, Iterator, Sequence
from contextvars import Context
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import linked_fleet_agent.transport
from linked_fleet_agent.agent import Agent
from linked_fleet_agent.robot import Robot
from linked_fleet_agent.robots.catalogue import UnavailableError
from linked_fleet_agent.serving import load_robots, serve
from linked_fleet_agent.settings import SettingsError, read_settings
from linked_fleet_gateway.app.application import create_app, create_sockets
from linked_fleet_gateway.app.settings import GatewaySettings
from linked_fleet_identity.roster import BadRoster
from linked_fleet_link.transport import LinkError, Session
from linked_fleet_runtime.log import create_formatter
from linked_fleet_runtime.redis import InvalidUrl
from linked_fleet_server.server import Server
from state_home import state_home
from virtual.confined import Confined, confined
from virtual.loop import VirtualLoop, current
from virtual.played_session import PlayedSession
from virtual.redis_server import RedisServer
from virtual.tcp import Listener
from virtual.zenoh_agent import AgentSession
from virtual.zenoh_network import ZenohNetwork

_numbers = itertools.count(1)
if find_spec("sniffio") is None:
    # httpcore tries to import it for each lock, which takes a quarter of the time of tests that deliver callbacks.
    sys.modules["sniffio"] = None  # type: ignore[assignment]


class World:
    """Everything that gateways and agents of one loop share: Zenoh networks by endpoint, Redis servers by folder."""

    def __init__(self, loop: VirtualLoop) -> None:
        self._loop = loop
        self._networks: dict[str, ZenohNetwork] = {}
        self._embedded: dict[Path, RedisServer] = {}

    def network(self, endpoints: tuple[str, ...]) -> ZenohNetwork:
        """Return the network of those that listen at or connect to one of these endpoints."""
        if endpoints[0] not in self._networks:
            seed = self._loop.seed
            latency_s = (0.0002, 0.004) if seed else (0.001, 0.001)
            self._networks[endpoints[0]] = ZenohNetwork(seed, latency_s)
        return self._networks[endpoints[0]]

    def embedded(self, folder: Path) -> RedisServer:
        """Return the server with its data in this folder, which replaces the embedded server of a gateway.

        It belongs to no process, and outlives the one that asks for it.
        """
        if folder not in self._embedded:
            self._embedded[folder] = Context().run(RedisServer, self._loop.internet)
        return self._embedded[folder]


def world(loop: VirtualLoop) -> World:
    if loop.world is None:
        loop.world = World(loop)
    found: World = loop.world
    return found


def played_session(loop: VirtualLoop, endpoint: str) -> Any:
    """Open a session at this endpoint for a robot played by the test; Any, as it replaces a ``zenoh.Session``."""
    network = world(loop).network((endpoint,))
    return PlayedSession(loop, loop.inside(network.agent, f"stage {next(_numbers)}"))


@contextlib.contextmanager
def serving_robot(endpoint: str, name: str, robot: Robot) -> "Iterator[VirtualProcess]":
    """Run the agent of a robot with this driver, at the gateway that listens at ``endpoint``."""
    loop = current()
    assert loop is not None
    agent = VirtualProcess(loop, ("-m", "linked_fleet_agent", "--robot", name, "--connect", endpoint), robot)
    try:
        yield agent
    finally:
        agent.stop()


def gateway_session(endpoint: str) -> Awaitable[Session]:
    """Open a session to which agents at this endpoint connect, for a part of a gateway run by the test."""
    loop = current()
    assert loop is not None
    return world(loop).network((endpoint,)).gateway(f"test {next(_numbers)}")((), (), {})


class VirtualProcess:
    """``-m linked_fleet_gateway`` or ``-m linked_fleet_agent`` in the loop. Interface: ``running.Process``."""

    def __init__(self, loop: VirtualLoop, arguments: Sequence[str], robot: Robot | None = None) -> None:
        """``robot`` is the driver of the agent's robot, in place of one that it would load."""
        self.lines: list[str] = []
        self._robot = robot
        self._loop, self._world = loop, world(loop)
        _, module, *words = arguments
        self.name = f"{module} {next(_numbers)}"
        start: dict[str, Callable[[list[str]], Awaitable[int]]] = {
            "linked_fleet_gateway": self._gateway,
            "linked_fleet_agent": self._agents,
        }
        self._process = loop.confine(self.name)
        self._code: int | None = None
        self._logging = _Logging(self._process, self.lines)
        logging.getLogger().addHandler(self._logging)
        self._ending: Callable[[], object] = lambda: None
        self._task = self._process.run(loop.create_task, self._run(start[module], words))
        loop.run_for(0)

    @property
    def output(self) -> str:
        return "".join(self.lines)

    def said(self, text: str) -> None:
        def probe() -> bool:
            assert not self._task.done() or text in self.output, f"ended early:\n{self.output}"
            return text in self.output

        self._loop.run_until(probe, f"{text!r} in the output:\n{self.output}")

    def ended(self) -> int:
        """Wait for the end, and return the exit code."""
        if self._process.dead:
            return -signal.SIGKILL
        self._loop.run_until(self._task.done, f"the end of:\n{self.output}")
        self._task.result()
        assert self._code is not None
        return self._code

    def send(self, number: signal.Signals) -> None:
        """Send a signal: SIGTERM and SIGINT end it regularly; SIGKILL, SIGSTOP and SIGCONT act as usual."""
        act: dict[signal.Signals, Callable[[], object]] = {
            signal.SIGKILL: self._kill,
            signal.SIGSTOP: self._process.stop,
            signal.SIGCONT: self._process.go_on,
        }
        act.get(number, lambda: self._process.run(self._ending))()
        if not self._loop.is_running():
            self._loop.run_for(0)

    def _kill(self) -> None:
        self._process.kill()
        # What it raises when it is cancelled at the end of the test, in which it can reach nobody, is of no interest.
        self._task.add_done_callback(lambda task: task.cancelled() or task.exception())

    def kill_child(self, module: str) -> None:
        """Kill a real child process, identified by its module."""
        self._loop.kill_child(module)

    def step_wall(self, by_s: float) -> None:
        """Step its wall clock forward or back; those of others stay."""
        self._process.step_wall(by_s)

    def stop(self) -> int:
        if not self._task.done() and not self._process.dead:
            self._process.go_on()
            self.send(signal.SIGTERM)
        try:
            return self.ended()
        finally:
            logging.getLogger().removeHandler(self._logging)

    async def _run(self, start: Callable[[list[str]], Awaitable[int]], words: list[str]) -> None:
        self._code = await start(words)

    async def _gateway(self, words: list[str]) -> int:
        try:
            environment = {"XDG_STATE_HOME": state_home()}
            settings = GatewaySettings.read(environment, words)
            self._logging.setFormatter(create_formatter(settings.log_format))
            if not settings.redis_url:
                words = [*words, "--redis-url", self._world.embedded(settings.state_path).url]
                settings = GatewaySettings.read(environment, words)
            listener: Any = Listener(self._loop.internet, settings.host, settings.port)
        except (ValueError, OSError) as error:
            self.lines.append(f"gateway: {error}\n")
            return 1
        network = self._world.network(settings.zenoh_connect or settings.listen_endpoints)
        try:
            app = create_app(settings, None, network.gateway(self.name))
            server = Server(app, create_sockets(settings))
            self._ending = lambda: server.begin_shutdown(signal.SIGTERM)
            async with app.router.lifespan_context(app):
                self.lines.append(f"serving {settings.public_urls[0]}/\n")
                await server.serve(sockets=[listener])
        except (LinkError, InvalidUrl, BadRoster) as error:
            self.lines.append(f"gateway: {error}\n")
            return 1
        return 0

    async def _agents(self, words: list[str]) -> int:
        try:
            settings = read_settings(words, {}, "virtual")
            if self._robot is None:
                agents, absent = load_robots(settings)
            else:
                agents, absent = [Agent(settings.robots[0].name, self._robot)], []
        except (SettingsError, UnavailableError) as error:
            self.lines.append(f"linked-fleet-agent: {error}\n")
            return 2
        serving = asyncio.create_task(serve(settings, agents, None, self._open_session, absent))
        self._ending = serving.cancel
        with contextlib.suppress(asyncio.CancelledError):
            await serving
        return 0

    @contextlib.asynccontextmanager
    async def _open_session(
        self, connect: tuple[str, ...], listen: tuple[str, ...] = (), lease_ms: int = 2_000, *_: object
    ) -> AsyncIterator[linked_fleet_agent.transport.Session]:
        session: AgentSession = self._world.network(connect or listen).agent(self.name, lease_ms / 1000)
        try:
            if not listen:  # a client session is open when a peer responds
                await session.met.wait()
            yield session
        finally:
            session.end()


class _Logging(logging.Handler):
    """Stores the log of one process as lines of output."""

    def __init__(self, process: Confined, lines: list[str]) -> None:
        super().__init__()
        self._process, self._lines = process, lines
        self.setFormatter(logging.Formatter("%(asctime)s %(levelname)s %(name)s: %(message)s"))

    def emit(self, record: logging.LogRecord) -> None:
        if confined() is self._process:
            self._lines.append(f"{self.format(record)}\n")
