"""Commands ``do`` and ``stop``: execute actions and follow them to their end."""

import math
import sys
import time
from collections.abc import Mapping

import click

from linked_fleet_client.action import Action
from linked_fleet_client.cli import output
from linked_fleet_client.cli.arguments import nested
from linked_fleet_client.cli.completion import action_names, inputs, things
from linked_fleet_client.cli.description import found_at, invocation
from linked_fleet_client.cli.options import Session, common, longest, wait
from linked_fleet_client.errors import ClientError, NoSuchThing, StillRunning
from linked_fleet_client.fleet import Fleet
from linked_fleet_client.invocation import Invocation, progress_in
from linked_fleet_client.live import Change
from linked_fleet_client.quantity import Quantity
from linked_fleet_client.reading import Value
from linked_fleet_client.thing import Thing
from linked_fleet_client.vocabulary import LF, local_name

_BAR = 30
_CANCEL_S = 10.0


@click.command(short_help="Execute an action and wait for its end.")
@click.argument("path", shell_complete=things)
@click.argument("action", shell_complete=action_names)
@click.argument("arguments", nargs=-1, metavar="[NAME=VALUE]...", shell_complete=inputs)
@click.option("--dry-run", is_flag=True, help="Check the action without executing it.")
@click.option("--idempotency-key", metavar="KEY", help="The same command with the same key is done once.")
@wait
@longest
@common
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
        wanted, given = _action(fleet, path, action), nested(arguments)
        if dry_run:
            return _rehearse(wanted, given, session.json)
        try:
            run = wanted(given, idempotency_key=idempotency_key)
        except KeyboardInterrupt:
            print("interrupted before the server had answered: it may have begun", file=sys.stderr)
            raise
        return _follow(run, seconds, session.json) if wait else _print(run, session.json)


def _action(fleet: Fleet, path: str, name: str) -> Action:
    here = found_at(fleet, path)
    if not isinstance(here, Thing):
        raise NoSuchThing(f"{path} is no thing, so it has no action {name!r}")
    return here.actions[name]


@click.command(short_help="Stop a thing, or everything.")
@click.argument("path", default="", shell_complete=things)
@wait
@longest
@common
@click.pass_obj
def stop(session: Session, path: str, wait: bool, seconds: float | None) -> int:
    """Stop a thing by its own action; without PATH, stop everything.

    The action is the one whose name begins with ``stop``.
    """
    with session.fleet() as fleet:
        here = found_at(fleet, path)
        if not isinstance(here, Thing):
            raise NoSuchThing(f"{path} is no thing, so nothing can stop it")
        actions = here.actions.introduced()
        found = [action for action in actions if any(name.casefold().startswith("stop") for name in action.names)]
        if len(found) != 1:
            raise NoSuchThing(f"{here.name} has {len(found)} actions that stop it", [each.name for each in actions])
        run = found[0]()
        return _follow(run, seconds, session.json) if wait else _print(run, session.json)


def _rehearse(action: Action, arguments: dict[str, object], as_json: bool) -> int:
    would = action.rehearse(arguments)
    if as_json:
        print(output.as_json({"dryRun": True, "values": output.reading(would)}))
    else:
        print("it would be done; nothing has moved")
        _print_quantities(would.values)
    return 0


def _follow(run: Invocation, seconds: float | None, as_json: bool) -> int:
    """Wait for the end; Ctrl-C cancels the invocation first."""
    if not run.traced:
        return _print(run, as_json)
    bar = _Bar(sys.stderr.isatty() and not as_json)
    try:
        state = run.wait(seconds or math.inf, bar.show)
    except KeyboardInterrupt:
        bar.end()
        print("stopping it ...", file=sys.stderr)
        state = _cancel(run)
    finally:
        bar.end()
    _print(run, as_json)
    return 0 if state == local_name(str(LF.succeeded)) else 1


def _cancel(run: Invocation) -> str | None:
    try:
        run.cancel()
        return run.wait(_CANCEL_S)
    except StillRunning as error:
        print(output.clean(str(error)), file=sys.stderr)
    except ClientError as error:
        print(output.clean(f"it cannot be stopped from here, and goes on: {error}"), file=sys.stderr)
    return None


def _print(run: Invocation, as_json: bool) -> int:
    said = invocation(run)
    if as_json:
        print(output.as_json(said))
        return 0
    if not run.traced:
        print("done, as the server says; it does not say where to look")
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
