"""The composition root of agents: settings → robots → session → links → agents."""

import asyncio
import logging
from collections.abc import Callable
from contextlib import AbstractAsyncContextManager
from functools import partial
from typing import Protocol

from linked_fleet_agent.agent import Agent
from linked_fleet_agent.link import RobotLink
from linked_fleet_agent.robot import NewDescriptionError
from linked_fleet_agent.robots.catalogue import UnavailableError, load
from linked_fleet_agent.settings import AgentSettings, SettingsError
from linked_fleet_agent.tracing import Tracing
from linked_fleet_agent.transport import Session
from linked_fleet_agent.urdf import UrdfError
from linked_fleet_agent.wire.keys import Keys
from linked_fleet_agent.wire.trust import Credentials
from linked_fleet_agent.zenoh_session import open_session

_log = logging.getLogger("linked_fleet_agent")

_AGAIN_S = 5.0


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
    robot = load(choice.name, choice.source, choice.floating)
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
    except UrdfError as error:
        raise UnavailableError(f"{choice.name}: its description is refused: {error}") from error
    except ValueError as error:
        raise SettingsError(f"--sway: {error}") from error


async def serve(
    settings: AgentSettings, agents: list[Agent], tracing: Tracing | None = None, opener: Opener = open_session
) -> None:
    """Serve all robots over one session until cancelled. Raises an ExceptionGroup of the errors of failed robots.

    The agent of a robot that describes itself anew is replaced in ``agents``.
    """
    async with (
        opener(
            settings.zenoh_connect, settings.zenoh_listen, settings.lease_ms, settings.credentials, settings.keys
        ) as session,
        asyncio.TaskGroup() as tasks,
    ):
        for index in range(len(agents)):
            tasks.create_task(_serve_robot(settings, agents, index, partial(_link, settings, session, tracing)))


def _link(settings: AgentSettings, session: Session, tracing: Tracing | None, agent: Agent) -> RobotLink:
    return RobotLink(
        session,
        settings.keys,
        robot=agent.name,
        incarnation=agent.incarnation,
        description=agent.description,
        on_command=agent.handle,
        on_stop=agent.handle_stop,
        on_mesh=agent.mesh,
        on_picture=agent.picture if agent.has_cameras else None,
        lease_ms=settings.lease_ms,
        tracing=tracing,
    )


async def _serve_robot(
    settings: AgentSettings, agents: list[Agent], index: int, link: Callable[[Agent], RobotLink]
) -> None:
    """Serve one robot; when it describes itself anew, with another run of its agent."""
    while True:
        agent = agents[index]
        try:
            async with link(agent) as declared:
                await agent.run(declared)
        except NewDescriptionError:
            _log.warning("%s: it has described itself anew; another run begins", agent.name)
            agents[index] = await _loaded_again(settings, index)


async def _loaded_again(settings: AgentSettings, index: int) -> Agent:
    while True:
        try:
            return await asyncio.to_thread(make_agent, settings, index)
        except UnavailableError as error:
            _log.warning("%s; the next attempt is in %g s", error, _AGAIN_S)
            await asyncio.sleep(_AGAIN_S)
