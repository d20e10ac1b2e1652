"""Commands ``do`` and ``stop``: parse ``name=value`` arguments, execute actions and follow them to their end."""

import json
import math
import re
import sys
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from copy import copy
from typing import Any, TypeVar

import click

from linked_fleet_client.action import Action
from linked_fleet_client.cli import output
from linked_fleet_client.cli.description import find_at, invocation
from linked_fleet_client.cli.options import Session, action_names, add_common_options, inputs, longest, things, wait
from linked_fleet_client.errors import ClientError, NoSuchThing, StillRunning
from linked_fleet_client.fleet import Fleet, Thing
from linked_fleet_client.invocation import Invocation, progress_in
from linked_fleet_client.live import Change
from linked_fleet_client.quantity import Quantity
from linked_fleet_client.reading import Value
from linked_fleet_client.vocabulary import LF, local_name

T = TypeVar("T", bound=Invocation)
_STEP = re.compile(r"([^.\[\]]+)(?:\[(\d{1,3})\])?")


class BadArgument(ClientError):  # noqa: N818
    """An argument that is not ``name=value``."""


def nested_values(arguments: Sequence[str]) -> dict[str, Any]:
    """Return the nested mapping of the arguments; a repeated name collects its values in a list.

    ``a=1 b[0].c=2 b[1].c=3`` is the same as ``a=1 b='[{"c": 2}, {"c": 3}]'``.
    """
    found: dict[str, Any] = {}
    for argument in arguments:
        name, equals, text = argument.partition("=")
        parts = [_STEP.fullmatch(part) for part in name.split(".")]
        if not equals or not all(parts):
            raise BadArgument(f"{argument!r} is not of the form name=value")
        _put(found, [(part[1], part[2]) for part in parts if part], _value(argument, text))
    return {name: _lists(value) for name, value in found.items()}


def _value(argument: str, text: str) -> Any:
    if not text.startswith(("{", "[")):
        return text
    try:
        return json.loads(text)
    except (ValueError, RecursionError) as error:
        raise BadArgument(f"{argument!r} begins like JSON but is invalid: {error}") from error


class _Indexed(dict[int, Any]):
    """A list under construction, by index."""


def _put(into: dict[Any, Any], steps: Sequence[tuple[str, str | None]], value: Any) -> None:
    (name, index), *rest = steps
    if index is not None:
        into = _below(into, name, _Indexed)
        name = int(index)  # type: ignore[assignment]
    if rest:
        _put(_below(into, name, dict), rest, value)
    elif name in into:
        before = into[name]
        into[name] = [*(before if isinstance(before, list) else [before]), value]
    else:
        into[name] = value


def _below(into: dict[Any, Any], name: Any, kind: type[dict[Any, Any]]) -> dict[Any, Any]:
    below: Any = into.setdefault(name, kind())
    if not isinstance(below, kind):
        raise BadArgument(f"{name!r} is given both as a value and in parts")
    return below


def _lists(value: Any) -> Any:
    if isinstance(value, _Indexed):
        return [_lists(value[index]) for index in sorted(value)]
    return {name: _lists(each) for name, each in value.items()} if isinstance(value, dict) else value


_BAR = 30
_CANCEL_S = 10.0
_LOOK_S = 0.1


@click.command(short_help="Execute an action and wait for its end.")
@click.argument("path", shell_complete=things)
@click.argument("action", shell_complete=action_names)
@click.argument("arguments", nargs=-1, metavar="[NAME=VALUE]...", shell_complete=inputs)
@click.option("--dry-run", is_flag=True, help="Check the action without executing it.")
@click.option("--idempotency-key", metavar="KEY", help="The same command with the same key is done once.")
@wait
@longest
@add_common_options
@click.pass_obj
def do(
    session: Session,
    path: str,
    action: str,
    arguments: tuple[str, ...],
    dry_run: bool,
    idempotency_key: str | None,
    wait: bool,
    seconds: float | None,
) -> int:
    """Execute an action and wait for its end; Ctrl-C cancels it. `get` lists its input."""
    with session.fleet() as fleet:
        wanted, given = _action(fleet, path, action), nested_values(arguments)
        if dry_run:
            return _rehearse(wanted, given, session.json)
        try:
            run = wanted(given, idempotency_key=idempotency_key)
        except KeyboardInterrupt:
            print("interrupted before the server answered: the action may have begun", file=sys.stderr)
            raise
        return follow(run, seconds, session.json) if wait else print_outcome(run, session.json)


def _action(fleet: Fleet, path: str, name: str) -> Action:
    here = find_at(fleet, path)
    if not isinstance(here, Thing):
        raise NoSuchThing(f"{path} is not a thing, so it has no action {name!r}")
    return here.actions[name]


@click.command(short_help="Stop a thing, or everything.")
@click.argument("path", default="", shell_complete=things)
@wait
@longest
@add_common_options
@click.pass_obj
def stop(session: Session, path: str, wait: bool, seconds: float | None) -> int:
    """Stop a thing by its own action; without PATH, stop everything.

    The action is the one whose name begins with ``stop``.
    """
    with session.fleet() as fleet:
        here = find_at(fleet, path)
        if not isinstance(here, Thing):
            raise NoSuchThing(f"{path} is not a thing, so it has no action that stops it")
        actions = here.actions.with_loaded_names()
        found = [action for action in actions if any(name.casefold().startswith("stop") for name in action.names)]
        if len(found) != 1:
            raise NoSuchThing(f"{here.name} has {len(found)} actions that stop it", [each.name for each in actions])
        run = found[0]()
        return follow(run, seconds, session.json) if wait else print_outcome(run, session.json)


def _rehearse(action: Action, arguments: dict[str, object], as_json: bool) -> int:
    would = action.rehearse(arguments)
    if as_json:
        print(output.as_json({"dryRun": True, "values": output.reading(would)}))
    else:
        print("the action is possible; nothing has moved")
        _print_quantities(would.values)
    return 0


def follow(run: Invocation, seconds: float | None, as_json: bool) -> int:
    """Wait for the end; Ctrl-C cancels the invocation first."""
    if not run.has_location:
        return print_outcome(run, as_json)
    bar = _Bar(sys.stderr.isatty() and not as_json)
    try:
        run, state = wait_or_cancel(run, lambda: run.wait(seconds or math.inf, bar.show), bar.end)
    finally:
        bar.end()
    print_outcome(run, as_json)
    return 0 if state == local_name(str(LF.succeeded)) else 1


def wait_or_cancel(run: T, wait: Callable[[], str | None], end_output: Callable[[], None]) -> tuple[T, str | None]:
    """Wait for the end of an invocation; Ctrl-C cancels it first. Return it, to be read further, and its last state."""
    try:
        return run, _in_thread(wait, f"wait for {run.iri}")
    except KeyboardInterrupt:
        end_output()
        print("stopping it ...", file=sys.stderr)
        run = copy(run)  # the thread still reads into the other one
        return run, _cancel(run)


def _in_thread(wait: Callable[[], str | None], name: str) -> str | None:
    """Wait in a thread.

    A KeyboardInterrupt within a request could leave the client's connections locked, and nothing could be cancelled.
    """
    outcomes: list[str | BaseException | None] = []

    def work() -> None:
        try:
            outcomes.append(wait())
        except BaseException as error:  # noqa: BLE001 - raised below
            outcomes.append(error)

    thread = threading.Thread(target=work, name=name, daemon=True)
    thread.start()
    while thread.is_alive():
        thread.join(_LOOK_S)  # the signal may reach the other thread, and does not end this wait then
    (outcome,) = outcomes
    if isinstance(outcome, BaseException):
        raise outcome
    return outcome


def _cancel(run: Invocation) -> str | None:
    try:
        run.cancel()
        return run.wait(_CANCEL_S)
    except StillRunning as error:
        print(output.clean(str(error)), file=sys.stderr)
    except ClientError as error:
        print(output.clean(f"it cannot be stopped from here, and goes on: {error}"), file=sys.stderr)
    return None


def print_outcome(run: Invocation, as_json: bool) -> int:
    said = invocation(run)
    if as_json:
        print(output.as_json(said))
        return 0
    if not run.has_location:
        print("the server reports success, but gives no invocation to look at")
        return 0
    reason = f": {said['reason']}" if said["reason"] else ""
    print(output.clean(f"{said['state'] or 'sent'}{reason}  {run.iri}"))
    _print_quantities(said["result"])
    return 0


def _print_quantities(values: Mapping[str, Value]) -> None:
    known = {key: value for key, value in values.items() if isinstance(value, Quantity)}
    rows = [[f"  {key.removesuffix('.value')}", str(value)] for key, value in known.items()]
    if rows:
        print(output.table(rows))


class _Bar:
    """A progress bar on one line of a terminal; without a terminal it prints nothing."""

    def __init__(self, on: bool) -> None:
        self.on, self.started = on, time.monotonic()

    def show(self, change: Change) -> None:
        if not self.on:
            return
        graph, node = change.document.graph, change.resource
        progress = progress_in(graph, node)
        state = local_name(str(graph.value(node, LF.state) or ""))
        done = round((progress or 0.0) * _BAR)
        share = f"[{'#' * done}{'-' * (_BAR - done)}] {progress:4.0%}" if progress is not None else "..."
        text = output.clean(f"{share}  {state}  {time.monotonic() - self.started:.1f} s")
        sys.stderr.write(f"\r\x1b[K{text}")
        sys.stderr.flush()

    def end(self) -> None:
        if self.on:
            sys.stderr.write("\r\x1b[K")
            sys.stderr.flush()
            self.on = False
