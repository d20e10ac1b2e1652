"""Tab completion: a script for the shell, and the hidden command that it asks."""

import os
import re
from collections.abc import Iterator, Sequence
from itertools import pairwise

from client.errors import ClientError
from client.fleet import Fleet
from client.form import Asked, said_choices
from client.naming import step
from client.thing import Thing

COMMANDS = ("ls", "get", "watch", "do", "stop", "conform", "completion")
_OPTIONS = {
    "ls": ("--json", "--unit", "--values", "--url"),
    "get": ("--json", "--unit", "--url"),
    "watch": ("--json", "--unit", "--count", "--interval", "--seconds", "--url"),
    "do": ("--dry-run", "--idempotency-key", "--json", "--no-wait", "--seconds", "--url"),
    "stop": ("--json", "--no-wait", "--url"),
}
_TAKING = frozenset({"--url", "--unit", "--count", "--interval", "--seconds", "--idempotency-key", "--timeout"})
QUICK_S = 2.0

_BASH = r"""_linked_fleet() {
    local line="${COMP_LINE:0:COMP_POINT}" words word
    read -ra words <<<"$line"
    [[ $line == *[[:space:]] ]] && words+=("")
    word="${words[-1]}"
    mapfile -t COMPREPLY < <(linked-fleet complete -- "${words[@]:1}" 2>/dev/null)
    [[ $word == *[=:]* ]] && COMPREPLY=("${COMPREPLY[@]#"${word%"${word##*[=:]}"}"}")
    [[ ${#COMPREPLY[@]} -eq 1 && ${COMPREPLY[0]} == */ || ${COMPREPLY[0]} == *= ]] && compopt -o nospace
    return 0
}
complete -F _linked_fleet linked-fleet"""

_ZSH = r"""#compdef linked-fleet
_linked_fleet() {
    local -a found
    found=("${(@f)$(linked-fleet complete -- "${(@)words[2,CURRENT]}" 2>/dev/null)}")
    compadd -Q -S '' -- "${(@)found:#}"
}
compdef _linked_fleet linked-fleet"""

SCRIPTS = {"bash": _BASH, "zsh": _ZSH}


def completions(words: Sequence[str], url: str) -> list[str]:
    """What the last of ``words`` may become; nothing where nobody answers, for a shell has no use for an error."""
    *before, last = words or [""]
    url = _url(before) or url
    plain = _plain(before)
    if before and before[-1] in _TAKING:
        return []
    if not plain:
        return [each for each in COMMANDS if each.startswith(last)]
    if last.startswith("-"):
        return [each for each in _OPTIONS.get(plain[0], ()) if each.startswith(last)]
    if plain[0] == "completion":
        return [each for each in SCRIPTS if each.startswith(last)]
    try:
        with Fleet(url, QUICK_S, token=os.environ.get("LINKED_FLEET_TOKEN", "")) as fleet:
            return [each for each in _offered(fleet, plain, last) if each.casefold().startswith(last.casefold())]
    except ClientError:
        return []


def _offered(fleet: Fleet, plain: list[str], last: str) -> Iterator[str]:
    command, *arguments = plain
    if command == "watch" or (command in ("ls", "get", "do", "stop") and not arguments):
        yield from _paths(fleet, last, command)
    elif command == "do" and (thing := fleet.at(arguments[0])) and isinstance(thing, Thing):
        if len(arguments) == 1:
            yield from (step(action.name) for action in thing.actions.introduced())
        else:
            yield from _inputs(thing.actions[arguments[1]].fields, last)


def _paths(fleet: Fleet, last: str, command: str) -> Iterator[str]:
    above, slash, _ = last.rpartition("/")
    here = fleet.at(above)
    if not isinstance(here, Thing):
        return
    yield from (f"{above}{slash}{step(part.name)}" for part in here.parts.introduced())
    if command in ("ls", "get", "watch"):
        yield from (f"{above}{slash}{step(prop.name)}" for prop in here.properties.introduced())
    if command in ("ls", "get"):
        yield from (f"{above}{slash}{step(action.name)}" for action in here.actions.introduced())


def _inputs(fields: Sequence[Asked], last: str) -> Iterator[str]:
    name, equals, _ = last.partition("=")
    for each in fields:
        if not equals:
            yield f"{each.name}="
        elif each.name == name and each.choices is not None:
            yield from (f"{name}={choice}" for choice in re.split(", ", said_choices(each.choices)))


def _url(before: Sequence[str]) -> str | None:
    named = [value for flag, value in pairwise(before) if flag == "--url"]
    named += [each.partition("=")[2] for each in before if each.startswith("--url=")]
    return named[-1] if named else None


def _plain(before: Sequence[str]) -> list[str]:
    """The words that are neither options nor their values."""
    found, taken = [], False
    for word in before:
        if not taken and not word.startswith("-"):
            found.append(word)
        taken = not taken and word in _TAKING
    return found
