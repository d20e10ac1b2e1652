"""Commands ``mission``: check, write, run and export missions."""

import math
import sys
from pathlib import Path

import click

from linked_fleet_client.cli import output
from linked_fleet_client.cli.invoke import follow, nested_values, print_outcome, wait_or_cancel
from linked_fleet_client.cli.mission_tree import Lines, Tree, state_json
from linked_fleet_client.cli.options import Session, add_common_options, longest, wait
from linked_fleet_client.mission import Mission, MissionRun
from linked_fleet_client.thing import MEDIA_TYPES
from linked_fleet_client.vocabulary import document_of

_FILE = click.Path(exists=True, dir_okay=False, path_type=Path)
_FORMATS = {ending.removeprefix("."): media_type for ending, media_type in MEDIA_TYPES.items()}


@click.group(short_help="Check, write, run and export missions.")
def mission() -> None:
    """Check, write, run and export missions: actions made of actions.

    A FILE has plain JSON (.json), Turtle about <> (.ttl) or a tree of BehaviorTree.CPP 4 (.xml).
    """


@mission.command(short_help="Write a mission and run it.")
@click.argument("file", type=_FILE)
@click.argument("arguments", nargs=-1, metavar="[NAME=VALUE]...")
@click.option("--watch", is_flag=True, help="Show the states of its steps as they change.")
@click.option("--dry-run", is_flag=True, help="Check it with these values; it is written, but not run.")
@wait
@longest
@add_common_options
@click.pass_obj
def run(
    session: Session,
    file: Path,
    arguments: tuple[str, ...],
    watch: bool,
    dry_run: bool,
    wait: bool,
    seconds: float | None,
) -> int:
    """Run the mission in FILE, with the values of its parameters; Ctrl-C cancels the run.

    It is written to the fleet if none has its title, and replaces that one if they differ. With --no-wait the run goes
    on by itself.
    """
    with session.fleet() as fleet:
        values, written = nested_values(arguments), fleet.missions.write(file)
        if dry_run:
            written.rehearse(values)
            print("the mission is possible; nothing has moved")
            return 0
        begun = written.run(values)
        if not wait:
            return print_outcome(begun, session.json)
        return _watch(written, begun, seconds, session.json) if watch else follow(begun, seconds, session.json)


def _watch(written: Mission, begun: MissionRun, seconds: float | None, as_json: bool) -> int:
    """Show a run until it is over. Return the exit code."""
    on_terminal = sys.stdout.isatty() and not as_json
    shown = Tree(written.definition()) if on_terminal else Lines(as_json)

    def show() -> str | None:
        for state in begun.watch(seconds or math.inf):
            shown.show(state)
        return None

    ended, _ = wait_or_cancel(begun, show, lambda: None)
    state = ended.now
    if as_json:
        print(output.as_json(state_json(state)))
    else:
        print(output.clean(f"{state.state}{f': {state.reason}' if state.reason else ''}  {ended.record.iri}"))
    return 0 if state.state == "succeeded" else 1


@mission.command(short_help="Check a mission without writing it.")
@click.argument("file", type=_FILE)
@add_common_options
@click.pass_obj
def check(session: Session, file: Path) -> int:
    """Check the mission in FILE: its steps, the bodies of its actions, and your rights. Nothing is written."""
    with session.fleet() as fleet:
        fleet.missions.check(file)
    print("the mission would be accepted; nothing has changed")
    return 0


@mission.command("import", short_help="Write a mission.")
@click.argument("file", type=_FILE)
@add_common_options
@click.pass_obj
def import_(session: Session, file: Path) -> int:
    """Write the mission in FILE to the fleet: a new one, or in place of the one with its title. Print its address."""
    with session.fleet() as fleet:
        print(fleet.missions.write(file).iri)
    return 0


@mission.command(short_help="Print a mission.")
@click.argument("name")
@click.option("--format", "kind", type=click.Choice(list(_FORMATS)), default="json", help="json, ttl or xml.")
@add_common_options
@click.pass_obj
def export(session: Session, name: str, kind: str) -> int:
    """Print the mission NAME as JSON, Turtle, or a tree of BehaviorTree.CPP 4, for a FILE."""
    with session.fleet() as fleet:
        found = fleet.missions.parts[name]
        answer = fleet.web.send("GET", document_of(found.iri), None, {"accept": _FORMATS[kind]})
    print(answer.body.decode())
    return 0
