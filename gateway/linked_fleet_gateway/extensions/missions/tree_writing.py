"""Missions as trees of BehaviorTree.CPP 4: all that a mission says, in the words of ``tree_reading``. Pure."""

import json
import re
from collections.abc import Iterator, Mapping
from xml.sax.saxutils import quoteattr

from linked_fleet_gateway.extensions.missions.mission import (
    Confirm,
    FirstOf,
    Invoke,
    Mission,
    Notify,
    Parallel,
    Parameter,
    Repeat,
    Sequence,
    Step,
    Variable,
    Wait,
    children,
)
from linked_fleet_gateway.extensions.missions.tree_ports import FORMAT, JSON, TYPES, are_ports, port_of, text_of

_NO_NAME = re.compile(r"[^A-Za-z0-9_]+")
_WITHIN_S = 3600.0


def write_tree(mission: Mission) -> bytes:
    """Return the XML document of a mission."""
    id = _NO_NAME.sub("_", mission.title).strip("_") or "Mission"
    root = {"BTCPP_format": FORMAT, "main_tree_to_execute": id}
    tree = {"ID": id, "_description": text_of(mission.title), **({"holds": "true"} if mission.holds else {})}
    lines = [
        '<?xml version="1.0" encoding="UTF-8"?>',
        f"<root{_attributes(root)}>",
        f"  <BehaviorTree{_attributes(tree)}>",
    ]
    lines += [*_step(mission.step, 2), "  </BehaviorTree>"]
    if mission.parameters:
        lines += ["  <TreeNodesModel>", f"    <SubTree{_attributes({'ID': id})}>"]
        lines += [f"      <input_port{_attributes(_port(each))}/>" for each in mission.parameters]
        lines += ["    </SubTree>", "  </TreeNodesModel>"]
    return "\n".join([*lines, "</root>", ""]).encode()


def _port(parameter: Parameter) -> Mapping[str, str]:
    said = {"name": parameter.name, "type": TYPES[parameter.type]}
    said |= {} if parameter.default is None else {"default": port_of(parameter.default)}
    said |= {"_description": text_of(parameter.title)} if parameter.title else {}
    for name, bound in (("minimum", parameter.minimum), ("maximum", parameter.maximum)):
        said |= {} if bound is None else {name: repr(bound)}
    return said | ({"options": JSON + json.dumps(parameter.options)} if parameter.options else {})


def _step(step: Step, depth: int) -> Iterator[str]:
    tag, said = _element(step)
    said |= {"name": step.name} if step.name else {}
    said |= {"_description": text_of(step.title)} if step.title else {}
    below, indent = children(step), "  " * depth
    yield f"{indent}<{tag}{_attributes(said)}{'' if below else '/'}>"
    for each in below:
        yield from _step(each, depth + 1)
    if below:
        yield f"{indent}</{tag}>"


def _element(step: Step) -> tuple[str, dict[str, str]]:
    """Return the tag of a step, and its attributes but name and description."""
    match step:
        case Sequence():
            return "Sequence", {}
        case FirstOf():
            return "Fallback", {}
        case Parallel():
            enough = ("1", "-1") if step.anySuffices else ("-1", "1")
            return "Parallel", dict(zip(("success_count", "failure_count"), enough, strict=True))
        case Repeat():
            return "Repeat", {"num_cycles": str(step.times)}
        case Wait():
            return _wait(step)
        case Confirm() | Notify():
            return "Action", {"ID": type(step).__name__, "text": text_of(step.text)}
        case Invoke():
            return "Action", _invoke(step)


def _wait(step: Wait) -> tuple[str, dict[str, str]]:
    if step.seconds is not None:
        milliseconds = round(step.seconds * 1000)
        if milliseconds / 1000 == step.seconds:
            return "Sleep", {"msec": str(milliseconds)}
    said = {"ID": "Wait"}
    said |= {} if step.seconds is None else {"seconds": repr(step.seconds)}
    said |= {"until": text_of(step.until)} if step.until else {}
    said |= {"condition": text_of(step.condition)} if step.condition else {}
    return "Action", said | ({} if step.within == _WITHIN_S else {"within": repr(step.within)})


def _invoke(step: Invoke) -> dict[str, str]:
    named = step.action.rpartition("/")[2] or step.kind.rpartition("#")[2]
    said = {"ID": _NO_NAME.sub("_", named).strip("_") or "Invoke"}
    said |= {name: text_of(value) for name, value in (("action", step.action), ("kind", step.kind)) if value}
    if step.of:
        said["of"] = f"{{{step.of.variable}}}" if isinstance(step.of, Variable) else text_of(step.of)
    said |= {"triples": text_of(step.triples)} if step.triples else {}
    if step.body is None:
        return said
    if are_ports(step.body):
        return said | {name: port_of(value) for name, value in step.body.items()}
    return said | {"body": JSON + json.dumps(step.body)}


def _attributes(said: Mapping[str, str]) -> str:
    return "".join(f" {name}={quoteattr(value)}" for name, value in said.items())
