"""``do`` and ``stop``: have an action done, and follow it to its end."""

import math
import sys
import time
from argparse import Namespace
from collections.abc import Mapping

from client.action import Action
from client.cli import show
from client.cli.given import given
from client.cli.look import found_at, invocation
from client.errors import ClientError, NoSuchThing, StillRunning
from client.fleet import Fleet
from client.invocation import Invocation, progress_in
from client.live import Change
from client.quantity import Quantity
from client.reading import Value
from client.thing import Thing
from client.vocabulary import LF, local_name

_BAR = 30
_CANCEL_S = 10.0


def do(fleet: Fleet, options: Namespace) -> int:
    action = _action(fleet, options.path, options.action)
    arguments = given(options.arguments)
    if options.dry_run:
        return _rehearse(action, arguments, options)
    try:
        run = action(arguments, idempotency_key=options.idempotency_key)
    except KeyboardInterrupt:
        print("interrupted before the server had answered: it may have begun", file=sys.stderr)
        raise
    if not options.wait or not run.traced:
        _print(run, options)
        return 0
    return _follow(run, options)


def _action(fleet: Fleet, path: str, name: str) -> Action:
    here = found_at(fleet, path)
    if not isinstance(here, Thing):
        raise NoSuchThing(f"{path} is no thing, so it has no action {name!r}")
    return here.actions[name]


def stop(fleet: Fleet, options: Namespace) -> int:
    """The action whose name is or begins with ``stop``, of whatever is named: a robot, or all of them."""
    here = found_at(fleet, options.path)
    if not isinstance(here, Thing):
        raise NoSuchThing(f"{options.path} is no thing, so nothing can stop it")
    actions = here.actions.introduced()
    found = [action for action in actions if any(name.casefold().startswith("stop") for name in action.names)]
    if len(found) != 1:
        raise NoSuchThing(f"{here.name} has {len(found)} actions that stop it", [action.name for action in actions])
    run = found[0]()
    if not options.wait or not run.traced:
        _print(run, options)
        return 0
    return _follow(run, options)


def _rehearse(action: Action, arguments: dict[str, object], options: Namespace) -> int:
    would = action.rehearse(arguments)
    if options.json:
        print(show.as_json({"dryRun": True, "values": show.reading(would)}))
    else:
        print("it would be done; nothing has moved")
        _print_quantities(would.values)
    return 0


def _follow(run: Invocation, options: Namespace) -> int:
    """Until its end; Ctrl-C has it cancelled first."""
    bar = _Bar(sys.stderr.isatty() and not options.json)
    try:
        state = run.wait(options.seconds or math.inf, bar.show)
    except KeyboardInterrupt:
        bar.end()
        print("stopping it ...", file=sys.stderr)
        state = _cancel(run)
    finally:
        bar.end()
    _print(run, options)
    return 0 if state == local_name(str(LF.succeeded)) else 1


def _cancel(run: Invocation) -> str | None:
    try:
        run.cancel()
        return run.wait(_CANCEL_S)
    except StillRunning as error:
        print(show.clean(str(error)), file=sys.stderr)
    except ClientError as error:
        print(show.clean(f"it cannot be stopped from here, and goes on: {error}"), file=sys.stderr)
    return None


def _print(run: Invocation, options: Namespace) -> None:
    said = invocation(run)
    if options.json:
        print(show.as_json(said))
        return
    if not run.traced:
        print("done, as the server says; it does not say where to look")
        return
    reason = f": {said['reason']}" if said["reason"] else ""
    print(show.clean(f"{said['state'] or 'sent'}{reason}  {run.iri}"))
    _print_quantities(said["result"])


def _print_quantities(values: Mapping[str, Value]) -> None:
    known = {key: value for key, value in values.items() if isinstance(value, Quantity)}
    rows = [[f"  {key.removesuffix('.value')}", str(value)] for key, value in known.items()]
    if rows:
        print(show.table(rows))


class _Bar:
    """How far a motion is, on one line of a terminal; without one, nothing."""

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
        text = show.clean(f"{share}  {state}  {time.monotonic() - self.started:.1f} s")
        sys.stderr.write(f"\r\x1b[K{text}")
        sys.stderr.flush()

    def end(self) -> None:
        if self.on:
            sys.stderr.write("\r\x1b[K")
            sys.stderr.flush()
            self.on = False
