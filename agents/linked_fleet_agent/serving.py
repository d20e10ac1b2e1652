"""The composition root of agents: settings → robots → session → links → agents."""

import asyncio
import logging
import os
import signal
import socket
import sys
from collections.abc import MutableSequence, Sequence
from contextlib import AbstractAsyncContextManager, suppress
from itertools import count
from typing import Any, NamedTuple, Protocol

from linked_fleet_agent.agent import Agent, new_incarnation
from linked_fleet_agent.components import DeclarationError
from linked_fleet_agent.link import AbsentRobot, DuplicateNameError, RobotLink
from linked_fleet_agent.robot import NewDescriptionError, Robot
from linked_fleet_agent.robots.catalogue import AwayError, UnavailableError, awaited, load
from linked_fleet_agent.settings import AgentSettings, SettingsError, read_settings
from linked_fleet_agent.tracing import Tracing
from linked_fleet_agent.transport import Session
from linked_fleet_agent.urdf import UrdfError
from linked_fleet_agent.wire.keys import Keys
from linked_fleet_agent.wire.trust import Credentials
from linked_fleet_agent.zenoh_session import open_session

_log = logging.getLogger("linked_fleet_agent")

# Delays before a robot that cannot be used is tried again; each is twice the one before. One that is away has the first
# delay alone: it may come at any time, and to look for it costs little.
FIRST_DELAY_S, LONGEST_DELAY_S = 2.0, 60.0


class Absent(NamedTuple):
    """A robot of the settings that cannot be used, and the reason."""

    place: int
    reason: str


class Opener(Protocol):
    """Opens a session, as ``linked_fleet_agent.zenoh_session.open_session`` does."""

    def __call__(
        self,
        connect: tuple[str, ...],
        listen: tuple[str, ...] = (),
        lease_ms: int = 2_000,
        credentials: Credentials | None = None,
        keys: Keys | None = None,
    ) -> AbstractAsyncContextManager[Session]: ...


def make_agent(settings: AgentSettings, index: int) -> Agent:
    """Load robot ``index`` of the settings. Raises SettingsError, UnavailableError."""
    choice = settings.robots[index]
    robot = load(choice.name, choice.source, choice.floating, settings.mesh_roots)
    facts = robot.describe()
    _log.info(
        "%s: %s, %d joints, %s base",
        choice.name,
        facts.title,
        len(facts.joints),
        "floating" if facts.floating else "fixed",
    )
    sways = [sway for name, sway in settings.sways if name == choice.name]
    try:
        return Agent(choice.name, robot, rate_hz=settings.rate_hz, sways=sways)
    except (UrdfError, DeclarationError) as error:
        raise UnavailableError(f"{choice.name}: its description is refused: {error}") from error
    except ValueError as error:
        raise SettingsError(f"--sway: {error}") from error


def load_robots(settings: AgentSettings) -> tuple[list[Agent], list[Absent]]:
    """Return the agents of robots that can be used, and the other robots. Robots that may be away are left for later.

    Raises SettingsError, and UnavailableError if no robot can be used.
    """
    agents, absent, unusable = list[Agent](), list[Absent](), list[str]()
    for place, choice in enumerate(settings.robots):
        try:
            if awaited(choice.name, choice.source, choice.floating):
                absent.append(Absent(place, f"{choice.name}: the agent waits for the robot"))
            else:
                agents.append(make_agent(settings, place))
        except UnavailableError as error:
            unusable.append(str(error))
            absent.append(Absent(place, str(error)))
    if len(unusable) == len(settings.robots):
        raise UnavailableError("; ".join(unusable))
    return agents, absent


def run(name: str, robot: Robot) -> None:
    """Serve a robot under ``name`` with the settings of the command line, until SIGTERM or SIGINT.

    This is the whole program of a driver. Exits with 2 for settings or a description that cannot be used, with 3 if the
    name is in use.
    """
    try:
        settings = read_settings(["--robot", name, *sys.argv[1:]], os.environ, socket.gethostname())
        agent = Agent(name, robot, rate_hz=settings.rate_hz)
    except (SettingsError, UrdfError, DeclarationError) as error:
        print(f"{name}: {error}", file=sys.stderr)
        sys.exit(2)
    logging.basicConfig(level=settings.log_level, format="%(asctime)s %(levelname)s %(name)s: %(message)s")
    try:
        asyncio.run(serve_until_signal(settings, [agent]))
    except DuplicateNameError as error:
        print(f"{name}: {error}", file=sys.stderr)
        sys.exit(3)


async def serve_until_signal(
    settings: AgentSettings,
    agents: MutableSequence[Agent],
    tracing: Tracing | None = None,
    absent: Sequence[Absent] = (),
) -> None:
    """Serve all robots until a signal arrives or one of them fails. SIGUSR1 restarts ended demonstrations.

    Raises DuplicateNameError if the name of the only robot is in use.
    """
    stop = asyncio.Event()
    loop = asyncio.get_running_loop()
    for number in (signal.SIGINT, signal.SIGTERM):
        loop.add_signal_handler(number, stop.set)
    loop.add_signal_handler(signal.SIGUSR1, _restart_demonstrations, agents)
    serving = asyncio.create_task(serve(settings, agents, tracing, absent=absent))
    stopping = asyncio.create_task(stop.wait())
    await asyncio.wait({serving, stopping}, return_when=asyncio.FIRST_COMPLETED)
    stopping.cancel()
    serving.cancel()
    try:
        await serving
    except asyncio.CancelledError:
        _log.info("stopped")
    except BaseExceptionGroup as group:
        taken, others = group.split(DuplicateNameError)
        if others is not None or taken is None:
            raise
        raise next(error for error in taken.exceptions) from None


def _restart_demonstrations(agents: MutableSequence[Agent]) -> None:
    for agent in agents:
        agent.demonstration.restart()


async def serve(
    settings: AgentSettings,
    agents: MutableSequence[Agent],
    tracing: Tracing | None = None,
    opener: Opener = open_session,
    absent: Sequence[Absent] = (),
) -> None:
    """Serve all robots over one session until cancelled.

    Robots that are ``absent`` are shown with the reason and tried again; their agents join ``agents``. So is one of
    several robots whose name is taken. Raises an ExceptionGroup of the errors of failed agents.
    """
    alone = len(agents) + len(absent) == 1
    async with (
        opener(
            settings.zenoh_connect, settings.zenoh_listen, settings.lease_ms, settings.credentials, settings.keys
        ) as session,
        asyncio.TaskGroup() as tasks,
    ):
        served = _Served(settings, session, tracing, agents)
        for agent in list(agents):
            tasks.create_task(served.keep_running(agent, alone))
        for each in absent:
            tasks.create_task(served.wait_for(each, alone))


class _Served:
    """The robots on one session."""

    def __init__(
        self, settings: AgentSettings, session: Session, tracing: Tracing | None, agents: MutableSequence[Agent]
    ) -> None:
        self._settings, self._session, self._tracing, self._agents = settings, session, tracing, agents

    async def wait_for(self, absent: Absent, alone: bool) -> None:
        """Serve a robot of the settings once it can be used."""
        _log.info(absent.reason)
        await self.keep_running(await self._loaded(absent), alone)

    async def keep_running(self, agent: Agent, alone: bool) -> None:
        """Serve a robot until cancelled. One that describes itself anew gets another agent.

        One of several robots whose name is taken is tried again. Raises DuplicateNameError for one ``alone``.
        """
        delay_s = FIRST_DELAY_S
        while True:
            try:
                await self._run(agent)
            except DuplicateNameError as error:
                if alone:
                    raise
                _log.warning("%s; the robot is tried again in %g s, and the others go on", error, delay_s)
                await asyncio.sleep(delay_s)
                delay_s = min(2.0 * delay_s, LONGEST_DELAY_S)
            except NewDescriptionError:
                _log.warning("%s: it has described itself anew; another run begins", agent.name)
                self._agents.remove(agent)
                place = [choice.name for choice in self._settings.robots].index(agent.name)
                agent = await self._loaded(Absent(place, f"{agent.name}: it has described itself anew"))

    async def _run(self, agent: Agent) -> None:
        settings = self._settings
        link = link_of(agent, self._session, settings.keys, lease_ms=settings.lease_ms, tracing=self._tracing)
        async with link:
            await agent.run(link)

    async def _loaded(self, absent: Absent) -> Agent:
        """Try to load a robot until that succeeds. Gateways see the reason meanwhile."""
        keys, name, delay_s = self._settings.keys, self._settings.robots[absent.place].name, FIRST_DELAY_S
        with AbsentRobot(self._session, keys, name, new_incarnation(), absent.reason) as shown:
            for attempt in count(1):
                try:
                    agent = await self._made(absent.place)
                    break
                except (SettingsError, UnavailableError) as error:
                    away = isinstance(error, AwayError)
                    delay_s = FIRST_DELAY_S if away else delay_s
                    if not away or str(error) != shown.reason or attempt.bit_count() == 1:
                        _log.warning("%s; the robot is tried again in %g s", error, delay_s)
                    shown.reason = str(error)
                await asyncio.sleep(delay_s)
                delay_s = min(2.0 * delay_s, LONGEST_DELAY_S)
        self._agents.append(agent)
        return agent

    async def _made(self, place: int) -> Agent:
        """Load a robot in a thread. One that is found after the agent was told to end is closed."""
        loading = asyncio.ensure_future(asyncio.to_thread(make_agent, self._settings, place))
        try:
            return await asyncio.shield(loading)
        except asyncio.CancelledError:
            with suppress(SettingsError, UnavailableError):
                (await loading).close()
            raise


def link_of(agent: Agent, session: Session, keys: Keys, **more: Any) -> RobotLink:
    """Return the link of an agent on a session; ``more`` are further arguments of ``RobotLink``, or others instead."""
    components: dict[str, Any] = {}
    if agent.has_components:
        components = {"on_operate": agent.handle_operate, "on_values": agent.values, "on_sample": agent.handle_sample}
    told: dict[str, Any] = {
        "on_command": agent.handle,
        "on_stop": agent.handle_stop,
        "on_mesh": agent.mesh,
        "on_picture": agent.picture if agent.has_cameras else None,
        **components,
        **more,
    }
    about: dict[str, Any] = {"robot": agent.name, "incarnation": agent.incarnation, "description": agent.description}
    return RobotLink(session, keys, **about, **told)
