"""The declaration of a component, made from its class. Pure."""

import inspect
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from types import NoneType
from typing import Any, get_args, get_origin, get_type_hints

import msgspec

from linked_fleet_agent.components.call import Call
from linked_fleet_agent.components.component import OPTIONS, ActionOptions, Component, event, value
from linked_fleet_agent.components.schemas import DeclarationError, schema_of
from linked_fleet_agent.wire import components as wire
from linked_fleet_agent.wire.kinds import kind_problem, with_terms
from linked_fleet_agent.wire.schema import Schema


@dataclass(frozen=True)
class Task:
    """A method that an ``Operate`` runs: an action, or the setter of a value.

    ``run`` takes the decoded ``input`` by keyword, and the ``Call`` as ``call`` if it ``takes_call``.
    """

    run: Callable[..., Any]
    declared: wire.Action
    input: type[msgspec.Struct] | None
    takes_call: bool = False
    rehearse: Callable[..., float] | None = None
    takes_over: bool = False
    resume: Callable[..., Any] | None = None

    @property
    def is_async(self) -> bool:
        return inspect.iscoroutinefunction(self.run)


@dataclass(frozen=True)
class Declared:
    """A component and its declaration. ``reads`` gives its values by name, ``tasks`` its actions, ``setters`` too."""

    component: Component
    said: wire.Component
    reads: Mapping[str, Callable[[], Any]] = field(default_factory=dict)
    tasks: Mapping[str, Task] = field(default_factory=dict)
    setters: Mapping[str, Task] = field(default_factory=dict)


class DeclaredComponent(Component):
    """A component that is made at run time, and makes its own declaration instead of having it in annotations."""

    def declaration(self) -> Declared:
        """Return the declaration. Raises DeclarationError."""
        raise NotImplementedError


def declare(component: Component) -> Declared:
    """Return the declaration of a component. Raises DeclarationError, which names the place."""
    if isinstance(component, DeclaredComponent):
        made = component.declaration()
        return replace(made, said=_checked(made.said))
    cls = type(component)
    name = component.name or cls.__name__.lower()
    properties, actions, events = dict[str, wire.Property](), dict[str, wire.Action](), dict[str, wire.Event]()
    reads, tasks, setters = dict[str, Callable[[], Any]](), dict[str, Task](), dict[str, Task]()
    for attribute, found in _members(cls):
        member = cls.name_of(attribute)
        try:
            if isinstance(found, value):
                properties[member] = _property(found)
                reads[member] = found.read.__get__(component)
                if found.set is not None:
                    setters[member] = _setter(component, found, properties[member].schema)
            elif isinstance(found, event):
                data = None if found.data is NoneType else schema_of(found.data)
                events[member] = wire.Event(
                    title=found.title or _words(member), description=found.description, semantic_type=found.kind,
                    data=data,
                )  # fmt: skip
            else:
                tasks[member] = _task(component, member, found)
                actions[member] = tasks[member].declared
        except DeclarationError as error:
            raise DeclarationError(f"{name}.{member}: {error}") from error
    said = _checked(
        wire.Component(
            name=name, title=component.title or _words(name), description=_prose(cls), semantic_type=component.kind,
            link=component.link, rate_hz=component.rate_hz, stale_s=component.stale_s, properties=properties,
            actions=actions, events=events,
        )
    )  # fmt: skip
    return Declared(component, said, reads, tasks, setters)


def _checked(said: wire.Component) -> wire.Component:
    """Return what a gateway will decode, with all bounds of its fields and the terms of its kind."""
    try:
        checked = msgspec.json.decode(msgspec.json.encode(with_terms(said)), type=wire.Component)
    except msgspec.ValidationError as error:
        raise DeclarationError(f"{said.name}: {error}") from error
    if problem := kind_problem(checked):
        raise DeclarationError(f"{said.name}: {problem}")
    return checked


def _members(cls: type[Component]) -> Iterator[tuple[str, Any]]:
    """Yield values, events and actions in the order of their definition; those of base classes come first."""
    found = {name: each for base in reversed(cls.__mro__) for name, each in vars(base).items()}
    seen = set[int]()
    for name, each in found.items():
        if (isinstance(each, value | event) or hasattr(each, OPTIONS)) and id(each) not in seen:
            seen.add(id(each))  # a setter of another name is the same value
            yield name, each


def _property(found: value[Any, Any]) -> wire.Property:
    hints = get_type_hints(found.read, include_extras=True)
    if "return" not in hints:
        raise DeclarationError("it has no annotation of what it returns")
    schema = schema_of(hints["return"])
    if not schema.description:
        schema = msgspec.structs.replace(schema, description=_prose(found.read))
    return wire.Property(schema=schema, writable=found.set is not None)


def _setter(component: Component, found: value[Any, Any], schema: Schema) -> Task:
    hints = get_type_hints(found.read, include_extras=True)
    given = msgspec.defstruct("Setting", [("value", hints["return"])], forbid_unknown_fields=True)
    assert found.set is not None
    method = found.set.__get__(component)
    return Task(lambda value: method(value), wire.Action(duration_s=10.0), given)


def _task(component: Component, name: str, method: Callable[..., Any]) -> Task:
    options: ActionOptions = getattr(method, OPTIONS)
    hints = get_type_hints(method, include_extras=True)
    parameters = list(inspect.signature(method).parameters.values())[1:]
    feedback = NoneType
    takes_call = any(each.name == "call" for each in parameters)
    if takes_call:
        feedback = _feedback_of(hints.get("call"))
    given = _input_of(name, [each for each in parameters if each.name != "call"], hints)
    returned = hints.get("return", NoneType)
    if "return" not in hints:
        raise DeclarationError("it has no annotation of what it returns; '-> None' if it has no result")
    declared = wire.Action(
        title=options.title or _words(name),
        description=_prose(method),
        semantic_type=options.kind,
        input=None if given is None else schema_of(given),
        feedback=None if feedback is NoneType else schema_of(feedback),
        result=None if returned is NoneType else schema_of(returned),
        moves=tuple(options.moves(component) if callable(options.moves) else options.moves),
        duration_s=options.duration_s,
        stop_s=options.stop_s,
        rehearses=options.rehearse is not None,
        stream=options.stream,
        resumes=options.resume is not None,
    )
    if options.stream is not None and not (takes_call and inspect.iscoroutinefunction(method)):
        raise DeclarationError("it takes a stream, so it must be async and have a parameter 'call'")
    if options.resume is not None and declared.moves:
        raise DeclarationError("it moves something, and so ends with its agent: it cannot resume")
    rehearse = None if options.rehearse is None else options.rehearse.__get__(component)
    resume = None if options.resume is None else options.resume.__get__(component)
    return Task(method.__get__(component), declared, given, takes_call, rehearse, options.takes_over, resume)


def _feedback_of(hint: Any) -> Any:
    if hint is Call:
        return NoneType
    if get_origin(hint) is not Call:
        raise DeclarationError("the parameter 'call' must be annotated as Call, or Call[type of the feedback]")
    return get_args(hint)[0]


def _input_of(name: str, parameters: list[inspect.Parameter], hints: Mapping[str, Any]) -> type[msgspec.Struct] | None:
    fields: list[Any] = []
    for each in parameters:
        if each.kind in (each.VAR_POSITIONAL, each.VAR_KEYWORD, each.POSITIONAL_ONLY):
            raise DeclarationError(f"the parameter {each.name!r} must be a plain one")
        if each.name not in hints:
            raise DeclarationError(f"the parameter {each.name!r} has no annotation")
        given = () if each.default is each.empty else (each.default,)
        fields.append((each.name, hints[each.name], *given))
    if not fields:
        return None
    return msgspec.defstruct(f"{name}Input", fields, kw_only=True, forbid_unknown_fields=True)


def _words(name: str) -> str:
    """Return a name in words: ``toolOutput`` and ``tool_output`` are "Tool output"."""
    spaced = "".join(f" {each.lower()}" if each.isupper() else each for each in name.replace("_", " "))
    return spaced.strip()[:1].upper() + spaced.strip()[1:256]


def _prose(documented: Any) -> str:
    """Return the first paragraph of its own docstring on one line."""
    text = inspect.cleandoc(documented.__doc__ or "")
    return " ".join(text.partition("\n\n")[0].split())[:4096]
