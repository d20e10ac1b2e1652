"""Options of all commands, the connection that they describe, and tab completion.

Options are accepted before and after the command name. Completion is by click, with names from the server; the command
``completion`` prints the script for a shell.
"""

import os
import re
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from typing import Any, TypeVar
from urllib.parse import urlsplit

import click
from click.shell_completion import BashComplete, CompletionItem, ZshComplete, add_completion_class, get_completion_class

from linked_fleet_client.errors import ClientError
from linked_fleet_client.fleet import Fleet, Thing
from linked_fleet_client.form import choices_text
from linked_fleet_client.resource import step

DEFAULT_URL = "http://127.0.0.1:8000/"
F = TypeVar("F", bound=Callable[..., Any])


@dataclass
class Session:
    """The server and the form of the output."""

    url: str = field(default_factory=lambda: os.environ.get("LINKED_FLEET_URL") or DEFAULT_URL)
    json: bool = False
    timeout: float = 10.0
    opened: list[Fleet] = field(default_factory=list)

    def fleet(self, at_most_s: float = float("inf")) -> Fleet:
        token = os.environ.get("LINKED_FLEET_TOKEN", "")
        fleet = Fleet(self.url, min(self.timeout, at_most_s), token=token)
        self.opened.append(fleet)
        return fleet

    @property
    def authority(self) -> str:
        return urlsplit(self.url).netloc

    @property
    def has_read(self) -> bool:
        """True if a server has answered with a description."""
        return any(fleet.web.has_read for fleet in self.opened)


def seconds(text: str) -> float:
    """Parse a positive number; the type of an option."""
    try:
        value = float(text)
    except ValueError:
        value = 0.0
    if not 0 < value < 1e9:
        raise click.BadParameter(f"{text} is not a number of seconds")
    return value


def _keep(context: click.Context, parameter: click.Parameter, value: Any) -> None:
    session = context.ensure_object(Session)
    if value and parameter.name:
        setattr(session, parameter.name, value)


def add_common_options(function: F) -> F:
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


VARIABLE = "_LINKED_FLEET_COMPLETE"
_QUICK_S = 2.0
_BREAKS = "=:"
"""Characters at which bash splits words (COMP_WORDBREAKS), but which are part of names, values and addresses."""

# In quotes, because the class cannot be subscripted in the lowest version of click.
Completer = Callable[[click.Context, click.Parameter, str], "list[CompletionItem[str]]"]


def _completer(offered: Callable[[Fleet, click.Context, str], Iterable[str]]) -> Completer:
    """Return a completer of words with the typed prefix.

    If the server fails it returns no words, because a shell cannot show errors.
    """

    def complete(context: click.Context, _: click.Parameter, typed: str) -> "list[CompletionItem[str]]":
        try:
            with context.ensure_object(Session).fleet(_QUICK_S) as fleet:
                found = [
                    each for each in offered(fleet, context, typed) if each.casefold().startswith(typed.casefold())
                ]
        except ClientError:
            return []
        return [CompletionItem(each) for each in found]

    return complete


def _paths(fleet: Fleet, typed: str, properties: bool, actions: bool) -> Iterator[str]:
    above, slash, _ = typed.rpartition("/")
    here = fleet.at(above)
    if not isinstance(here, Thing):
        return
    names = [part.name for part in here.parts.with_loaded_names()]
    names += [prop.name for prop in here.properties.with_loaded_names()] if properties else []
    names += [action.name for action in here.actions.with_loaded_names()] if actions else []
    yield from (f"{above}{slash}{step(name)}" for name in names)


def _action_names(fleet: Fleet, context: click.Context, _: str) -> Iterator[str]:
    thing = fleet.at(context.params["path"])
    if isinstance(thing, Thing):
        yield from (step(action.name) for action in thing.actions.with_loaded_names())


def _inputs(fleet: Fleet, context: click.Context, typed: str) -> Iterator[str]:
    thing = fleet.at(context.params["path"])
    name, equals, _ = typed.partition("=")
    for each in thing.actions[context.params["action"]].fields if isinstance(thing, Thing) else ():
        if not equals:
            yield f"{each.name}="
        elif each.name == name and each.choices is not None:
            yield from (f"{name}={choice}" for choice in re.split(", ", choices_text(each.choices)))


all_paths = _completer(lambda fleet, _, typed: _paths(fleet, typed, properties=True, actions=True))
watched_paths = _completer(lambda fleet, _, typed: _paths(fleet, typed, properties=True, actions=False))
things = _completer(lambda fleet, _, typed: _paths(fleet, typed, properties=False, actions=False))
action_names = _completer(_action_names)
inputs = _completer(_inputs)


class _Bash(BashComplete):
    """Rejoins words with ``=`` and ``:``, and adds no space after a final ``=`` or ``/``."""

    source_template = BashComplete.source_template.replace(
        "    return 0\n",
        "    [[ ${#COMPREPLY[@]} -eq 1 && ${COMPREPLY[0]} == *[=/] ]] && compopt -o nospace\n    return 0\n",
        1,
    )

    def get_completion_args(self) -> tuple[list[str], str]:
        before, typed = super().get_completion_args()
        words: list[str] = []
        for word in (*before, typed):
            broken = words and ((word and word[0] in _BREAKS) or (words[-1][-1:] and words[-1][-1] in _BREAKS))
            words[-1:] = [words[-1] + word] if broken else [*words[-1:], word]
        *whole, self._typed = words
        return whole, self._typed

    def format_completion(self, item: "CompletionItem[str]") -> str:
        cut = max(self._typed.rfind(each) for each in _BREAKS) + 1
        return f"{item.type},{item.value[cut:]}"


class _Zsh(ZshComplete):
    """Adds no space, because a name may continue with ``=`` or ``/``."""

    source_template = ZshComplete.source_template.replace("compadd -U", "compadd -S '' -U")


for _shell in (_Bash, _Zsh):
    add_completion_class(_shell)


@click.command(short_help="Print a script for tab completion in a shell.")
@click.argument("shell", type=click.Choice(["bash", "fish", "zsh"]))
@click.pass_context
def completion(context: click.Context, shell: str) -> None:
    """Print a script for tab completion: eval it in your shell."""
    found = get_completion_class(shell)
    assert found is not None
    print(found(context.find_root().command, {}, "linked-fleet", VARIABLE).source())
