"""``python -m agents --robot NAME``: settings → robots → session → links → agents; nothing else."""

import asyncio
import logging
import os
import signal
import socket
import sys

from agents.agent import Agent
from agents.link import DuplicateNameError, ZenohLink, open_session
from agents.robots.catalogue import UnavailableError, load
from agents.settings import AgentSettings, SettingsError, read_settings
from agents.tracing import Tracing, open_tracing
from telemetry.spans import TracingUnavailable

_log = logging.getLogger("agents")


def main() -> int:
    """Exit code 0 after SIGINT or SIGTERM; 2 for settings or robots that cannot be used, 3 for a name that is taken."""
    try:
        settings = read_settings(sys.argv[1:], os.environ, socket.gethostname())
        logging.basicConfig(level=settings.log_level, format="%(asctime)s %(levelname)s %(name)s: %(message)s")
        tracing = open_tracing(os.environ)
        agents = [_make_agent(settings, index) for index in range(len(settings.robots))]
    except (SettingsError, UnavailableError, TracingUnavailable) as error:
        print(f"agents: {error}", file=sys.stderr)
        return 2
    try:
        asyncio.run(_run(settings, agents, tracing))
    except DuplicateNameError as error:
        print(f"agents: {error}", file=sys.stderr)
        return 3
    finally:
        if tracing is not None:
            tracing.close()
    return 0


def _make_agent(settings: AgentSettings, index: int) -> Agent:
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
    except ValueError as error:
        raise SettingsError(f"--sway: {error}") from error


async def _run(settings: AgentSettings, agents: list[Agent], tracing: Tracing | None) -> None:
    """Serve all robots until a signal comes or one of them fails. SIGUSR1 begins demonstrations anew."""
    stop = asyncio.Event()
    loop = asyncio.get_running_loop()
    for number in (signal.SIGINT, signal.SIGTERM):
        loop.add_signal_handler(number, stop.set)
    loop.add_signal_handler(signal.SIGUSR1, _begin_demonstrations_anew, agents)
    serving = asyncio.create_task(_serve(settings, agents, tracing))
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


def _begin_demonstrations_anew(agents: list[Agent]) -> None:
    for agent in agents:
        agent.demonstration.begin_anew()


async def _serve(settings: AgentSettings, agents: list[Agent], tracing: Tracing | None) -> None:
    async with (
        open_session(
            settings.zenoh_connect, settings.zenoh_listen, settings.lease_ms, settings.credentials, settings.keys
        ) as session,
        asyncio.TaskGroup() as tasks,
    ):
        for agent in agents:
            link = ZenohLink(
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
            tasks.create_task(_attend(agent, link))


async def _attend(agent: Agent, link: ZenohLink) -> None:
    async with link:
        await agent.run(link)


if __name__ == "__main__":
    sys.exit(main())
