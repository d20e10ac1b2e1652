"""The composition root of agents: settings → robots → session → links → agents."""

import asyncio
import logging
from contextlib import AbstractAsyncContextManager
from typing import Protocol

from linked_fleet_agent.agent import Agent
from linked_fleet_agent.link import RobotLink
from linked_fleet_agent.robots.catalogue import load
from linked_fleet_agent.settings import AgentSettings, SettingsError
from linked_fleet_agent.tracing import Tracing
from linked_fleet_agent.transport import Session
from linked_fleet_agent.wire.keys import Keys
from linked_fleet_agent.wire.trust import Credentials
from linked_fleet_agent.zenoh_session import open_session

_log = logging.getLogger("linked_fleet_agent")


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
    except ValueError as error:
        raise SettingsError(f"--sway: {error}") from error


async def serve(
    settings: AgentSettings, agents: list[Agent], tracing: Tracing | None = None, opener: Opener = open_session
) -> None:
    """Serve all robots over one session until cancelled. Raises an ExceptionGroup of the errors of failed robots."""
    async with (
        opener(
            settings.zenoh_connect, settings.zenoh_listen, settings.lease_ms, settings.credentials, settings.keys
        ) as session,
        asyncio.TaskGroup() as tasks,
    ):
        for agent in agents:
            link = RobotLink(
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
            tasks.create_task(_serve_robot(agent, link))


async def _serve_robot(agent: Agent, link: RobotLink) -> None:
    async with link:
        await agent.run(link)
