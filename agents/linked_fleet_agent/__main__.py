"""Command line of the agent, ``python -m linked_fleet_agent --robot NAME``."""

import asyncio
import logging
import os
import socket
import sys
from pathlib import Path

from linked_fleet_agent.check import check
from linked_fleet_agent.link import DuplicateNameError
from linked_fleet_agent.robots.catalogue import UnavailableError
from linked_fleet_agent.serving import load_robots, serve_until_signal
from linked_fleet_agent.settings import SettingsError, read_settings
from linked_fleet_agent.spans import TracingUnavailable
from linked_fleet_agent.tracing import open_tracing


def main() -> int:
    """Run the agents and return the exit code: 0 after SIGINT or SIGTERM, 2 for unusable settings or if no robot can
    be used, 3 if the name of the only robot is in use. ``--check FILE`` checks a driver instead: 0 or 1.
    """
    if sys.argv[1:2] == ["--check"]:
        return _check(sys.argv[2:])
    try:
        settings = read_settings(sys.argv[1:], os.environ, socket.gethostname())
        logging.basicConfig(level=settings.log_level, format="%(asctime)s %(levelname)s %(name)s: %(message)s")
        tracing = open_tracing(os.environ)
        agents, absent = load_robots(settings)
    except (SettingsError, UnavailableError, TracingUnavailable) as error:
        print(f"linked-fleet-agent: {error}", file=sys.stderr)
        return 2
    try:
        asyncio.run(serve_until_signal(settings, agents, tracing, absent))
    except DuplicateNameError as error:
        print(f"linked-fleet-agent: {error}", file=sys.stderr)
        return 3
    finally:
        if tracing is not None:
            tracing.close()
    return 0


def _check(files: list[str]) -> int:
    if len(files) != 1:
        print("linked-fleet-agent: --check takes one file of Python, with a driver or components", file=sys.stderr)
        return 2
    lines, problems = check(Path(files[0]))
    print(*lines, sep="\n")
    for problem in problems:
        print(f"wrong: {problem}", file=sys.stderr)
    return 1 if problems else 0


if __name__ == "__main__":
    sys.exit(main())
