"""Commands of ``linked-fleet`` that other packages provide: the gateway, the demo, the agent.

Packages declare them as entry points. The client imports none of them; its process executes the program instead.
"""

import os
import sys
from collections.abc import Sequence
from importlib.metadata import EntryPoint, entry_points

import click

GROUP = "linked_fleet.commands"
"""Entry points of programs: each names the function ``main`` of a module that ``python -m`` runs."""

_ABOUT = {
    "agent": "Connect robots to a fleet",
    "demo": "Run six simulated robots and a gateway",
    "doctor": "Check what a gateway needs here, and say what is wrong",
    "gateway": "Serve a fleet",
}


def names() -> list[str]:
    """Return the names of the installed programs."""
    return sorted(entry_points(group=GROUP).names)


def program(name: str) -> click.Command | None:
    """Return a command that runs the program with all further arguments; None if it is not installed."""
    found = next(iter(entry_points(group=GROUP, name=name)), None)
    if found is None:
        return None

    @click.command(
        name,
        help=f"{_ABOUT.get(name, f'Run the {name}')}; 'linked-fleet {name} --help' lists its options.",
        short_help=f"{_ABOUT.get(name, f'Run the {name}')}.",
        add_help_option=False,
        context_settings={"ignore_unknown_options": True},
    )
    @click.argument("arguments", nargs=-1, type=click.UNPROCESSED)
    def run(arguments: Sequence[str]) -> None:
        _become(found, arguments)

    return run


def _become(entry_point: EntryPoint, arguments: Sequence[str]) -> None:
    module = entry_point.module.removesuffix(".__main__")
    # -P: a user's folder with the name of one of our modules must not be imported.
    os.execv(sys.executable, [sys.executable, "-P", "-m", module, *arguments])  # noqa: S606 (no shell is wanted)
