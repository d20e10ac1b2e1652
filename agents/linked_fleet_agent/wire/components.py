"""Components of robots: the messages about them, and the checks of declarations (PROTOCOL.md, "Components"). SI units.

A declaration is part of the description of its robot. What cannot be used in it is refused by itself, so that a bad
component costs a robot neither its joints nor its other components.
"""

from collections.abc import Collection, Iterable, Iterator, Sequence
from typing import Annotated, Any

import msgspec
from msgspec import UNSET, Meta, Raw, Struct, UnsetType, structs

from linked_fleet_agent.wire.declaration import BASE as BASE
from linked_fleet_agent.wire.declaration import MAX_ACTIONS as MAX_ACTIONS
from linked_fleet_agent.wire.declaration import MAX_COMPONENTS as MAX_COMPONENTS
from linked_fleet_agent.wire.declaration import MAX_EVENTS as MAX_EVENTS
from linked_fleet_agent.wire.declaration import MAX_PROPERTIES as MAX_PROPERTIES
from linked_fleet_agent.wire.declaration import Action as Action
from linked_fleet_agent.wire.declaration import Component as Component
from linked_fleet_agent.wire.declaration import Event as Event
from linked_fleet_agent.wire.declaration import Property as Property
from linked_fleet_agent.wire.declaration import StreamLimits as StreamLimits
from linked_fleet_agent.wire.kinds import kind_problem
from linked_fleet_agent.wire.messages import COMPONENTS_VERSION as COMPONENTS_VERSION
from linked_fleet_agent.wire.messages import Description, Identifier, Name, Progress, Unsigned
from linked_fleet_agent.wire.schema import MAX_DEPTH, Schema, schema_problem, value_problem

MAX_DECLARATIONS_BYTES = MAX_RESULT_BYTES = MAX_VALUES_BYTES = 256 * 1024
MAX_VALUE_BYTES = MAX_FEEDBACK_BYTES = MAX_EVENT_BYTES = 16_384
MAX_INPUT_BYTES, MAX_SENTENCE = 65_536, 1024
MAX_SAMPLE_BYTES = 4096
"""The longest message with a sample."""


class Measured(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """Values of a component at ``at_ns`` (monotonic time of the agent), those that have changed; null is unknown.

    ``fault`` is why it cannot be read, and all its values are unknown then.
    """

    at_ns: Unsigned
    values: Annotated[dict[Name, Raw], Meta(max_length=MAX_PROPERTIES)] = {}
    fault: Annotated[str, Meta(max_length=1024)] = ""


class Values(Struct, frozen=True, kw_only=True):
    """Values of components. ``sequence`` grows by one with each message, so that a lost one is noticed.

    The reply to a query has all values, and the ``sequence`` of the message before it.
    """

    version: int
    incarnation: Unsigned
    sequence: Unsigned
    monotonic_ns: Unsigned
    wall_ns: Unsigned
    components: Annotated[dict[Name, Measured], Meta(max_length=MAX_COMPONENTS)] = {}


class Operate(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A request to carry out an action of a component, or to set a property to ``input``.

    Lateness, run, id and rehearsal are those of a command. ``stream`` opens the action as a stream: samples with its
    ``id`` are further inputs.
    """

    version: int
    id: Identifier
    incarnation: Unsigned
    seen_ns: Unsigned
    time_to_live_ns: Annotated[int, Meta(gt=0, le=60_000_000_000)]
    component: Name
    action: Annotated[str, Meta(max_length=128)] = ""
    property: Annotated[str, Meta(max_length=128)] = ""
    input: Raw = Raw(b"null")
    rehearsal: bool = False
    stream: bool | UnsetType = UNSET


class Sample(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A further input of the action that was opened as a stream with ``id``.

    ``number`` grows with each sample of the stream. ``seen_ns`` is the monotonic time of the agent that whoever gives
    the input saw last.
    """

    version: int
    id: Identifier
    incarnation: Unsigned
    number: Unsigned
    seen_ns: Unsigned
    input: Raw


class Occurrence(Struct, frozen=True, kw_only=True):
    """An event of a component. ``sequence`` counts the events of a run, also those that were not sent."""

    version: int
    incarnation: Unsigned
    sequence: Unsigned
    monotonic_ns: Unsigned
    wall_ns: Unsigned
    component: Name
    event: Name
    data: Raw | UnsetType = UNSET


class DescriptionWithComponents(Description, frozen=True, kw_only=True):
    """The description of a robot with its components, which ``read_declarations`` reads apart from the rest."""

    components: Raw = Raw(b"[]")


# Made once, here: declarations are read in threads, and threads that resolve the types of a structure at the same time
# end the process.
_DECLARATIONS, _COMPONENT = msgspec.json.Decoder(list[Raw]), msgspec.json.Decoder(Component)


def read_declarations(
    components: bytes | Raw, links: Collection[str], joints: Collection[str]
) -> tuple[list[Component], list[str]]:
    """Return the components that a description declares, and a sentence for each that is refused.

    Nothing of a declaration that is too long is decoded, and no component beyond the first ``MAX_COMPONENTS``.
    """
    size = len(bytes(components))
    if size > MAX_DECLARATIONS_BYTES:
        return [], [f"the components are refused: {size} bytes; {MAX_DECLARATIONS_BYTES} is the maximum"]
    try:
        declared = _DECLARATIONS.decode(components)
    except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError) as error:
        return [], [f"the components are refused: {error}"]
    accepted, refused = list[Component](), list[str]()
    for index, each in enumerate(declared[:MAX_COMPONENTS]):
        try:
            component = _COMPONENT.decode(each)
        except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError) as error:
            refused.append(f"component {index + 1} is refused: {error}")
            continue
        problem = declaration_problem(component, links, joints) or _excess(component, accepted)
        if problem:
            refused.append(f"component {component.name!r} is refused: {problem}")
        else:
            accepted.append(component)
    if (excess := len(declared) - MAX_COMPONENTS) > 0:
        refused.append(f"the last {excess} components are refused: {MAX_COMPONENTS} components is the maximum")
    return accepted, [each[:MAX_SENTENCE] for each in refused]


def _excess(component: Component, accepted: Sequence[Component]) -> str:
    if any(component.name == other.name for other in accepted):
        return "another component has this name"
    for part, most in (("properties", MAX_PROPERTIES), ("actions", MAX_ACTIONS), ("events", MAX_EVENTS)):
        if sum(len(getattr(each, part)) for each in (*accepted, component)) > most:
            return f"{most} {part} is the maximum of a robot"
    return ""


def declaration_problem(component: Component, links: Collection[str], joints: Collection[str]) -> str:
    """Return a sentence about what cannot be used in a declaration, or an empty string."""
    if component.link and component.link not in links:
        return f"its link {component.link!r} is none of the robot's"
    both = component.properties.keys() & component.actions.keys()
    if both:
        return f"{sorted(both)[0]!r} is a property and an action"
    for where, schema in _schemas(component):
        if said := schema_problem(schema):
            return f"{where}: {said}"
    for name, action in component.actions.items():
        unknown = [moved for moved in action.moves if moved != BASE and moved not in joints]
        if unknown:
            return f"action {name!r} moves {unknown[0]!r}, which is neither a joint of the robot nor {BASE!r}"
        if action.input is not None and action.input.type != "object":
            return f"the input of action {name!r} has the type {action.input.type!r}; it must be an object"
        if action.stream is not None and (action.input is None or action.input.required):
            return f"action {name!r} takes a stream, so it needs an input without required members"
    return kind_problem(component)


def _schemas(component: Component) -> Iterator[tuple[str, Schema]]:
    for name, each in component.properties.items():
        yield f"property {name!r}", each.schema
    for name, action in component.actions.items():
        parts = (("input", action.input), ("feedback", action.feedback), ("result", action.result))
        yield from _present(((f"{part} of action {name!r}", schema) for part, schema in parts))
    yield from _present((f"event {name!r}", event.data) for name, event in component.events.items())


def _present(parts: Iterable[tuple[str, Schema | None]]) -> Iterator[tuple[str, Schema]]:
    return ((where, schema) for where, schema in parts if schema is not None)


def without_unusable_parts(progress: Progress) -> tuple[Progress, str]:
    """Return progress without a feedback or a result that is no JSON or too long, and a sentence about it."""
    problems = dict[str, str]()
    for name, part, most in (
        ("feedback", progress.feedback, MAX_FEEDBACK_BYTES),
        ("result", progress.result, MAX_RESULT_BYTES),
    ):
        if part is UNSET:
            continue
        if len(bytes(part)) > most:
            problems[name] = f"the {name} has {len(bytes(part))} bytes; {most} is the maximum"
            continue
        try:
            said = msgspec.json.decode(part)
        except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError) as error:
            problems[name] = f"the {name} is no JSON: {error}"
        else:
            if _is_deeper(said, MAX_DEPTH):
                problems[name] = f"the {name} is nested more than {MAX_DEPTH} deep, as no schema is"
    return (structs.replace(progress, **dict.fromkeys(problems, UNSET)), "; ".join(problems.values()))


def _is_deeper(value: Any, most: int) -> bool:
    """Return True for objects and arrays within each other at more levels than ``most``."""
    level = [value]
    for _ in range(most):
        level = [inner for each in level for inner in _within(each)]
    return any(isinstance(each, dict | list) for each in level)


def _within(value: Any) -> Iterable[Any]:
    if isinstance(value, dict):
        return value.values()
    return value if isinstance(value, list) else ()


def read_value(schema: Schema, payload: bytes | Raw, most_bytes: int = MAX_VALUE_BYTES) -> tuple[Any, str]:
    """Return a JSON value and an empty string; or None and a sentence about how it violates ``schema``.

    None without a sentence is unknown: JSON null.
    """
    if len(bytes(payload)) > most_bytes:
        return None, f"{len(bytes(payload))} bytes; {most_bytes} is the maximum"
    try:
        value = msgspec.json.decode(payload)
    except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError) as error:
        return None, f"not JSON: {error}"
    problem = "" if value is None else value_problem(schema, value)
    return (None, problem) if problem else (value, "")
