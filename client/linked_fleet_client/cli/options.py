"""Options of all commands, accepted before and after the command name, and the connection that they describe."""

import os
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, TypeVar

import click

from linked_fleet_client.fleet import Fleet

DEFAULT_URL = "http://127.0.0.1:8000/"
F = TypeVar("F", bound=Callable[..., Any])


@dataclass
class Session:
    """The server and the form of the output."""

    url: str = field(default_factory=lambda: os.environ.get("LINKED_FLEET_URL") or DEFAULT_URL)
    json: bool = False
    timeout: float = 10.0

    def fleet(self, at_most_s: float = float("inf")) -> Fleet:
        token = os.environ.get("LINKED_FLEET_TOKEN", "")
        return Fleet(self.url, min(self.timeout, at_most_s), token=token)


def seconds(text: str) -> float:
    """Parse a positive number; the type of an option."""
    try:
        value = float(text)
    except ValueError:
        value = 0.0
    if not 0 < value < 1e9:
        raise click.BadParameter(f"{text} is no number of seconds")
    return value


def _keep(context: click.Context, parameter: click.Parameter, value: Any) -> None:
    session = context.ensure_object(Session)
    if value and parameter.name:
        setattr(session, parameter.name, value)


def common(function: F) -> F:
    """Add the options ``--url``, ``--json`` and ``--timeout`` to a command."""
    for option in (
        click.option("--timeout", type=seconds, metavar="S", help="Seconds to wait for the server.",
                     expose_value=False, callback=_keep),
        click.option("--json", is_flag=True, help="JSON, for scripts.", expose_value=False, callback=_keep),
        click.option("--url", expose_value=False, callback=_keep,
                     help="Where the fleet is (or LINKED_FLEET_URL); the token is in LINKED_FLEET_TOKEN."),
    ):  # fmt: skip
        function = option(function)
    return function


units = click.option("--unit", "units", multiple=True, help="Show values in this unit, such as deg or mm.")
wait = click.option("--wait/--no-wait", default=True, help="Follow it to its end.")
longest = click.option("--seconds", type=seconds, help="Wait no longer than this; it goes on.")
