"""``ls`` and ``get``: what there is, and what it says."""

from argparse import Namespace
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import Any

from rdflib.term import URIRef

from client.action import Action
from client.cli import show
from client.cli.show import clean
from client.fleet import Fleet
from client.invocation import Invocation
from client.naming import step
from client.reading import Reading
from client.thing import Property, Thing, kind_of
from client.vocabulary import is_web

Found = Thing | Property | Action | Invocation
_AT_ONCE = 8


def found_at(fleet: Fleet, path: str) -> Found:
    """By names from the root, or by an IRI that somebody copied."""
    return fleet.get(path) if is_web(URIRef(path)) else fleet.at(path)


def ls(fleet: Fleet, options: Namespace) -> int:
    here = found_at(fleet, options.path)
    rows = list(_rows(here, options)) if isinstance(here, Thing) else [_row(here, options)]
    if options.json:
        print(show.as_json(rows))
    elif rows:
        print(show.table([[step(row["name"]), row["kind"], row["state"]] for row in rows], ("NAME", "KIND", "VALUE")))
    return 0


def _rows(thing: Thing, options: Namespace) -> Iterator[dict[str, Any]]:
    document = thing.read()
    parts = list(thing.parts.introduced())
    if options.values:
        with ThreadPoolExecutor(_AT_ONCE) as pool:
            list(pool.map(Thing.learn, parts))
    for part in parts:
        state = _presence(part, thing) or (_live(part, options.unit) if options.values else "")
        yield {"name": part.name, "kind": part.kind, "state": state, "iri": part.iri}
    for prop in thing.properties_in(document).introduced():
        value = prop.within(document)
        value = value if value.values else prop.reading
        row = {"name": prop.name, "kind": kind_of(prop) or "property", "state": show.brief(value, options.unit)}
        yield row | {"iri": prop.iri, "values": show.reading(value, options.unit)}
    for action in thing.actions.introduced():
        yield _row(action, options)


def _row(here: Found, options: Namespace) -> dict[str, Any]:
    if isinstance(here, Property):
        value = here.reading
        row = {"name": here.name, "kind": kind_of(here), "state": show.brief(value, options.unit), "iri": here.iri}
        return row | {"values": show.reading(value, options.unit)}
    here.learn()
    kind = "action" if isinstance(here, Action) else kind_of(here)
    return {"name": here.name, "kind": kind, "state": here.title, "iri": here.iri}


def _presence(part: Thing, above: Thing) -> str:
    return part.presence_in(above.learn()) or part.presence_in(part.learn() if part.known else above.learn()) or ""


def _live(part: Thing, units: list[str]) -> str:
    """Those values of a thing that have a time: they are measured, not made."""
    document = part.learn()
    found = [(prop.name, prop.within(document).main) for prop in part.properties_in(document)]
    return ", ".join(f"{name}={show.said(value, units)}" for name, value in found if value and value.time)


def get(fleet: Fleet, options: Namespace) -> int:
    here = found_at(fleet, options.path)
    said = _described(here, options)
    if options.json:
        print(show.as_json(said))
    else:
        print("\n".join(_text(here, said, options)))
    return 0


def _described(here: Found, options: Namespace) -> dict[str, Any]:
    document = here.read()
    said: dict[str, Any] = {"iri": here.iri, "title": here.title, "types": sorted(map(str, here.types))}
    if isinstance(here, Thing):
        said["presence"] = here.presence_in(document)
        said["parts"] = [part.name for part in here.parts.introduced()]
        properties = here.properties_in(document).introduced()
        said["properties"] = {prop.name: show.reading(_value(prop, here), options.unit) for prop in properties}
        said["actions"] = {action.name: _action(action) for action in here.actions.introduced()}
    elif isinstance(here, Action):
        said |= _action(here)
    elif isinstance(here, Invocation):
        said |= invocation(here)
    else:
        said["values"] = show.reading(here.reading, options.unit)
        if not said["values"]:
            said["statements"] = show.statements(here.triples)
    return said


def _value(prop: Property, thing: Thing) -> Reading:
    """As the description of the thing shows it or, where that only links it, as it says itself."""
    shown = prop.within(thing.learn())
    return shown if shown.values else prop.reading


def _action(action: Action) -> dict[str, Any]:
    action.learn()
    return {"title": action.title, "dryRun": action.can_rehearse, "input": show.asked_json(action.fields)}


def invocation(run: Invocation) -> dict[str, Any]:
    """State and result of an invocation, for scripts."""
    if not run.traced:
        return {"iri": None, "state": None}
    state = run.state
    return {
        "iri": run.iri,
        "state": state,
        "progress": run.progress,
        "reason": run.reason,
        "result": run.result,
    }


def _text(here: Found, said: dict[str, Any], options: Namespace) -> Iterator[str]:
    yield clean(f"{said['title']}  ({kind_of(here)})")
    yield clean(str(here.iri))
    if said.get("presence"):
        yield clean(said["presence"])
    if isinstance(here, Thing):
        yield from _thing_text(here, options)
    elif isinstance(here, Action):
        yield from _action_text(here)
    elif isinstance(here, Property):
        yield from _property_text(here, options)
    else:
        yield show.table([[key, str(value)] for key, value in invocation(here).items() if value is not None])


def _thing_text(thing: Thing, options: Namespace) -> Iterator[str]:
    rows = [[step(prop.name), show.brief(_value(prop, thing), options.unit)] for prop in thing.properties.introduced()]
    if rows:
        yield "\nProperties\n" + show.table([["  " + name, value] for name, value in rows])
    actions = list(thing.actions.introduced())
    if actions:
        yield "\nActions"
    for action in actions:
        action.learn()
        yield from ("  " + line for line in [clean(f"{step(action.name)}: {action.title}"), *_input(action)])
    if parts := [step(part.name) for part in thing.parts.introduced()]:
        yield "\nParts\n  " + clean(" ".join(parts))


def _action_text(action: Action) -> Iterator[str]:
    if action.comment:
        yield clean(action.comment)
    yield from _input(action)


def _input(action: Action) -> list[str]:
    action.learn()
    return show.input_in_words(action.fields, "    ") or ["    takes nothing"]


def _property_text(prop: Property, options: Namespace) -> Iterator[str]:
    reading = prop.reading
    rows = [[key, show.said(value, options.unit)] for key, value in reading.values.items()]
    if rows:
        yield show.table(rows)
    else:
        yield show.table([[name, value] for name, values in show.statements(prop.triples).items() for value in values])
    times = {value.time for value in reading.values.values() if not isinstance(value, str) and value.time}
    for time in sorted(times):
        yield f"at {time.isoformat()}"
