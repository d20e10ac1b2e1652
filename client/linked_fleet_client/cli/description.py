"""Commands ``ls`` and ``get``: the resources of a fleet and their descriptions."""

from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import click
from rdflib.term import URIRef

from linked_fleet_client.action import Action
from linked_fleet_client.cli import output
from linked_fleet_client.cli.options import Session, add_common_options, all_paths, units
from linked_fleet_client.cli.output import clean
from linked_fleet_client.fleet import Fleet, Property, Thing, kind_of
from linked_fleet_client.invocation import Invocation
from linked_fleet_client.quantity import Quantity
from linked_fleet_client.reading import Reading
from linked_fleet_client.resource import step
from linked_fleet_client.vocabulary import is_web

Found = Thing | Property | Action | Invocation
_AT_ONCE = 8


def find_at(fleet: Fleet, path: str) -> Found:
    """Return the object at a path of names from the root, or at an IRI."""
    return fleet.get(path) if is_web(URIRef(path)) else fleet.at(path)


@click.command()
@click.argument("path", default="", shell_complete=all_paths)
@click.option("--values", is_flag=True, help="Read each part for its measured values.")
@units
@add_common_options
@click.pass_obj
def ls(session: Session, path: str, values: bool, units: tuple[str, ...]) -> None:
    """List parts, properties and actions. PATH is titles with slashes between, such as baxter/right_s1."""
    with session.fleet() as fleet:
        here = find_at(fleet, path)
        rows = list(_rows(here, values, units)) if isinstance(here, Thing) else [_row(here, units)]
    if session.json:
        print(output.as_json(rows))
    elif rows:
        print(output.table([[step(row["name"]), row["kind"], row["state"]] for row in rows], ("NAME", "KIND", "VALUE")))


def _rows(thing: Thing, live: bool, units: Sequence[str]) -> Iterator[dict[str, Any]]:
    document = thing.read()
    parts = list(thing.parts.with_loaded_names())
    if live:
        with ThreadPoolExecutor(_AT_ONCE) as pool:
            list(pool.map(Thing.document, parts))
    for part in parts:
        state = _presence(part, thing) or (_live(part, units) if live else "")
        yield {"name": part.name, "kind": part.kind, "state": state, "iri": part.iri}
    for prop in thing.properties_in(document).with_loaded_names():
        value = prop.reading_in(document)
        value = value if value.values else prop.reading
        row = {"name": prop.name, "kind": kind_of(prop) or "property", "state": output.one_line(value, units)}
        yield row | {"iri": prop.iri, "values": output.reading(value, units)}
    for action in thing.actions.with_loaded_names():
        yield _row(action, units)


def _row(here: Found, units: Sequence[str]) -> dict[str, Any]:
    if isinstance(here, Property):
        value = here.reading
        row = {"name": here.name, "kind": kind_of(here), "state": output.one_line(value, units), "iri": here.iri}
        return row | {"values": output.reading(value, units)}
    here.document()
    kind = "action" if isinstance(here, Action) else kind_of(here)
    return {"name": here.name, "kind": kind, "state": here.title, "iri": here.iri}


def _presence(part: Thing, above: Thing) -> str:
    return (
        part.presence_in(above.document())
        or part.presence_in(part.document() if part.known else above.document())
        or ""
    )


def _live(part: Thing, units: Sequence[str]) -> str:
    """Return the values of a thing that have a time of measurement."""
    document = part.document()
    found = [(prop.name, prop.reading_in(document).main) for prop in part.properties_in(document)]
    return ", ".join(f"{name}={output.value_text(value, units)}" for name, value in found if value and value.time)


@click.command()
@click.argument("path", default="", shell_complete=all_paths)
@units
@add_common_options
@click.pass_obj
def get(session: Session, path: str, units: tuple[str, ...]) -> None:
    """Show values with their units, and the input of actions."""
    with session.fleet() as fleet:
        here = find_at(fleet, path)
        said = _described(here, units)
        print(output.as_json(said) if session.json else "\n".join(_text(here, said, units)))


def _described(here: Found, units: Sequence[str]) -> dict[str, Any]:
    document = here.read()
    said: dict[str, Any] = {"iri": here.iri, "title": here.title, "types": sorted(map(str, here.types))}
    if isinstance(here, Thing):
        said["presence"] = here.presence_in(document)
        said["parts"] = [part.name for part in here.parts.with_loaded_names()]
        properties = here.properties_in(document).with_loaded_names()
        said["properties"] = {prop.name: output.reading(_value(prop, here), units) for prop in properties}
        said["actions"] = {action.name: _action(action) for action in here.actions.with_loaded_names()}
    elif isinstance(here, Action):
        said |= _action(here)
    elif isinstance(here, Invocation):
        said |= invocation(here)
    else:
        said["values"] = output.reading(here.reading, units)
        if not said["values"]:
            said["statements"] = output.statements(here.triples)
    return said


def _value(prop: Property, thing: Thing) -> Reading:
    """Return the value from the thing's description or, if that only links the property, from the property's own."""
    shown = prop.reading_in(thing.document())
    return shown if shown.values else prop.reading


def _action(action: Action) -> dict[str, Any]:
    action.document()
    return {"title": action.title, "dryRun": action.can_rehearse, "input": output.fields_json(action.fields)}


def invocation(run: Invocation) -> dict[str, Any]:
    """Return state and result of an invocation, for JSON output."""
    if not run.has_location:
        return {"iri": None, "state": None}
    state = run.state
    return {
        "iri": run.iri,
        "state": state,
        "progress": run.progress,
        "reason": run.reason,
        "result": run.result,
    }


def _text(here: Found, said: dict[str, Any], units: Sequence[str]) -> Iterator[str]:
    yield clean(f"{said['title']}  ({kind_of(here)})")
    yield clean(str(here.iri))
    if said.get("presence"):
        yield clean(said["presence"])
    if isinstance(here, Thing):
        yield from _thing_text(here, units)
    elif isinstance(here, Action):
        yield from _action_text(here)
    elif isinstance(here, Property):
        yield from _property_text(here, units)
    else:
        yield output.table([[key, str(value)] for key, value in invocation(here).items() if value is not None])


def _thing_text(thing: Thing, units: Sequence[str]) -> Iterator[str]:
    rows = [
        [step(prop.name), output.one_line(_value(prop, thing), units)] for prop in thing.properties.with_loaded_names()
    ]
    if rows:
        yield "\nProperties\n" + output.table([["  " + name, value] for name, value in rows])
    actions = list(thing.actions.with_loaded_names())
    if actions:
        yield "\nActions"
    for action in actions:
        action.document()
        yield from ("  " + line for line in [clean(f"{step(action.name)}: {action.title}"), *_input(action)])
    if parts := [step(part.name) for part in thing.parts.with_loaded_names()]:
        yield "\nParts\n  " + clean(" ".join(parts))


def _action_text(action: Action) -> Iterator[str]:
    if action.comment:
        yield clean(action.comment)
    yield from _input(action)


def _input(action: Action) -> list[str]:
    action.document()
    return output.input_text(action.fields, "    ") or ["    takes nothing"]


def _property_text(prop: Property, units: Sequence[str]) -> Iterator[str]:
    reading = prop.reading
    rows = [[key, output.value_text(value, units)] for key, value in reading.values.items()]
    if rows:
        yield output.table(rows)
    else:
        yield output.table(
            [[name, value] for name, values in output.statements(prop.triples).items() for value in values]
        )
    times = {value.time for value in reading.values.values() if isinstance(value, Quantity) and value.time}
    for time in sorted(times):
        yield f"at {time.isoformat()}"
