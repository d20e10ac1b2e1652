"""The check of a driver: what the fleet would see of it, and what is wrong (``linked-fleet-agent --check FILE``)."""

import importlib.util
import inspect
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import msgspec

from linked_fleet_agent.agent import Agent
from linked_fleet_agent.components.component import Component
from linked_fleet_agent.components.declaration import declare
from linked_fleet_agent.components.schemas import DeclarationError
from linked_fleet_agent.robot import ComponentRobot
from linked_fleet_agent.urdf import UrdfError
from linked_fleet_agent.wire import components as wire
from linked_fleet_agent.wire.schema import Schema

_METHODS = ("describe", "read", "apply", "stop", "close")


def check(path: Path) -> tuple[list[str], list[str]]:
    """Return lines about the robots and components that a Python file defines, and a sentence for each problem.

    Runs the file, but not what it has under ``if __name__ == "__main__"``. A class that needs arguments is declared
    without an object; robots that need some are made by a function of the file without parameters, if there is one.
    """
    try:
        module = _load(path)
    except Exception as error:  # noqa: BLE001 - whatever the file does
        return [], [f"{path} cannot be run: {type(error).__name__}: {error}"]
    lines, problems, shown = list[str](), list[str](), set[type]()
    for name, robot in _robots(module, problems):
        lines += _of_robot(name, robot, problems, shown)
    for cls in _own(module, Component):
        if cls not in shown:
            lines += _of_component(_bare(cls), problems)
    if not lines and not problems:
        problems.append(f"{path} defines neither a component nor a driver, which has {', '.join(_METHODS)}")
    return lines, problems


def _load(path: Path) -> ModuleType:
    spec = importlib.util.spec_from_file_location(path.stem, path)
    if spec is None or spec.loader is None:
        raise ImportError("it is no file of Python")
    module = importlib.util.module_from_spec(spec)
    sys.modules[path.stem] = module
    spec.loader.exec_module(module)
    return module


def _own(module: ModuleType, base: type) -> Iterator[type]:
    for each in list(vars(module).values()):
        if isinstance(each, type) and each.__module__ == module.__name__ and issubclass(each, base):
            yield each


def _robots(module: ModuleType, problems: list[str]) -> Iterator[tuple[str, Any]]:
    """Yield the robots of the file: of classes and functions that need no arguments."""
    for name, each in list(vars(module).items()):
        if getattr(each, "__module__", "") != module.__name__ or not callable(each):
            continue
        is_driver = isinstance(each, type) and all(hasattr(each, method) for method in _METHODS)
        if not is_driver and not (inspect.isfunction(each) and not name.startswith("_")):
            continue
        required = [p for p in inspect.signature(each).parameters.values() if p.default is p.empty]
        if required or inspect.iscoroutinefunction(each):
            continue
        if not is_driver and not _returns_robot(each):
            continue
        try:
            yield name, each()
        except Exception as error:  # noqa: BLE001 - whatever the constructor raises
            problems.append(f"{name}() cannot be made: {type(error).__name__}: {error}")


def _returns_robot(function: Any) -> bool:
    try:
        returned = inspect.get_annotations(function, eval_str=True).get("return")
    except NameError:
        return False
    return isinstance(returned, type) and all(hasattr(returned, method) for method in _METHODS)


def _of_robot(name: str, robot: Any, problems: list[str], shown: set[type]) -> Iterator[str]:
    components = list(robot.components()) if isinstance(robot, ComponentRobot) else []
    shown.update(map(type, components))
    try:
        facts = robot.describe()
        Agent(name, robot)
    except (DeclarationError, UrdfError, ValueError) as error:
        problems.append(f"{name}: {error}")
        facts = None
    if facts is not None:
        yield f"robot {name}: {facts.title}, {'floating' if facts.floating else 'fixed'} base"
        for joint in facts.joints:
            moved = "moved by components alone" if joint.passive else "takes commands"
            near = joint.arrival_tolerance
            within = "" if near is None else f", arrives within {near:.3g} {joint.unit}"
            yield f"  joint {joint.name} [{joint.unit}], {moved}{within}"
    for component in components:
        yield from (f"  {line}" for line in _of_component(component, [] if facts is None else problems))


def _bare(cls: type[Component]) -> Component:
    try:
        return cls()
    except TypeError:  # it needs arguments, which a declaration does not
        return cls.__new__(cls)


def _of_component(component: Component, problems: list[str]) -> list[str]:
    try:
        said = declare(component).said
    except (DeclarationError, AttributeError) as error:
        problems.append(str(error))
        return []
    kind = f", {said.semantic_type}" if said.semantic_type else ""
    return [
        f"component {said.name}: {said.title}{kind}; {said.rate_hz:g} Hz, unknown after {said.stale_s:g} s",
        *(f"  {line}" for line in _parts(said)),
    ]


def _parts(said: wire.Component) -> Iterator[str]:
    for name, each in said.properties.items():
        yield f"property {name}: {in_words(each.schema)}{', can be set' if each.writable else ''}"
    for name, action in said.actions.items():
        moves = f"moves {', '.join(action.moves)}" if action.moves else "moves nothing"
        yield f"action {name}: {moves}; at most {action.duration_s:g} s, stops within {action.stop_s:g} s"
        if (limits := action.stream) is not None:
            yield (
                f"  takes a stream: no sample older than {limits.age_s:g} s; rests after {limits.silence_s:g} s of "
                f"silence, ends after {limits.end_s:g} s"
            )
        for part in ("input", "feedback", "result"):
            if (schema := getattr(action, part)) is not None:
                yield f"  {part}: {in_words(schema)}"
    for name, event in said.events.items():
        yield f"event {name}{'' if event.data is None else f': {in_words(event.data)}'}"


def in_words(schema: Schema) -> str:
    """Return a schema on one line: its type, unit and bounds, and the members of an object."""
    if schema.type == "object":
        members = [
            f"{name}{'' if name in schema.required else '?'}: {in_words(each)}"
            for name, each in schema.properties.items()
        ]
        return f"{{{', '.join(members)}}}"
    if schema.items is not None:
        return f"array of {in_words(schema.items)}{_range(schema.min_items, schema.max_items, ' items')}"
    if schema.enum:
        return " | ".join(msgspec.json.encode(each).decode() for each in schema.enum)
    least = schema.minimum if schema.exclusive_minimum is None else schema.exclusive_minimum
    most = schema.maximum if schema.exclusive_maximum is None else schema.exclusive_maximum
    unit = f" {schema.unit}" if schema.unit else ""
    return f"{schema.type}{unit}{_range(least, most)}{_range(schema.min_length, schema.max_length, ' characters')}"


def _range(least: float | None, most: float | None, of: str = "") -> str:
    if least is None and most is None:
        return ""
    return f" from {least}{of}" if most is None else f" to {most}{of}" if least is None else f" {least} to {most}{of}"
