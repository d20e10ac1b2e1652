"""Missions from trees of BehaviorTree.CPP 4: the part of its XML that a mission can say. The rest is refused. Pure."""

import json
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Final, NoReturn
from xml.etree.ElementTree import Element

import msgspec

from linked_fleet_agent.urdf import XmlError, XmlReader
from linked_fleet_gateway.api import BadRequest, UnprocessableContent
from linked_fleet_gateway.extensions.missions.mission import MOST_DEEP, MOST_STEPS, Mission
from linked_fleet_gateway.extensions.missions.terms import LF
from linked_fleet_gateway.extensions.missions.tree_ports import (
    FORMAT,
    JSON,
    OTHER_TYPES,
    OWN_PORTS,
    PortError,
    default_of,
    entry_of,
    value_of,
)

_MOST_ELEMENTS: Final = 2_000
_NAME: Final = re.compile(r"[A-Za-z_][A-Za-z0-9_]{0,63}")
_OF_ALL: Final = frozenset({"name", "_description"})
_OWN: Final = frozenset({"Confirm", "Notify", "Wait"})
_BRANCHES: Final = {"Sequence": "sequence", "Fallback": "firstOf"}
_INSTEAD: Final = {
    "ReactiveSequence": "conditions are not evaluated again; write Sequence",
    "ReactiveFallback": "conditions are not evaluated again; write Fallback",
    "AsyncSequence": "write Sequence", "AsyncFallback": "write Fallback", "SequenceWithMemory": "write Sequence",
    "SequenceStar": "write Sequence", "SubTreePlus": "write SubTree",
    "ParallelAll": "the first failure cancels the others; write Parallel",
    "RetryUntilSuccessful": "write a Fallback with the attempts",
    "Condition": "write an Action with ID Wait and the port condition, a SPARQL SELECT",
    "Script": "a mission changes no blackboard; give its parameters defaults",
    "SetBlackboard": "a mission changes no blackboard; give its parameters defaults",
    "ForceSuccess": "write a Fallback with an Action with ID Notify at its end",
}  # fmt: skip
"""The right elements in place of well-known ones."""


def read_tree(content: bytes, base: str) -> Mission:
    """Return the mission of a document. Paths of actions are below ``base``. Raises BadRequest, UnprocessableContent,
    with the element and its line.
    """
    reader = XmlReader("tree", _MOST_ELEMENTS)
    try:
        root = reader.read_or_refuse(content.decode("utf-8-sig"))
    except (XmlError, UnicodeDecodeError) as error:
        raise BadRequest(f"The body is no XML in UTF-8: {error}.") from error
    lines = dict(zip(map(id, root.iter()), reader.lines, strict=True))
    said = _Document(root, lines, base).mission()
    try:
        return msgspec.convert(said, Mission)
    except msgspec.ValidationError as error:
        raise UnprocessableContent(f"The mission of the tree is not usable: {error}") from error


@dataclass(frozen=True)
class _Scope:
    """The meanings of entries of the blackboard in a tree: entries of the mission, or texts of ports."""

    known: frozenset[str]
    """The parameters of the mission."""
    ports: Mapping[str, str] | None = None
    """The ports of a subtree as texts of the mission; None in the main tree."""
    passes_all: bool = True
    above: tuple[str, ...] = ()

    def resolve(self, text: str, port: str) -> str:
        """Return the text of a port with the parameter, or the text, that its entry stands for. Raises PortError."""
        name = entry_of(text, port)
        if name is None:
            return JSON + json.dumps(self._resolve_json(value_of(text))) if text.startswith(JSON) else text
        return self._resolve_name(name)

    def _resolve_json(self, value: Any) -> Any:
        """Return a JSON value with the variables of the mission in place of those of the tree."""
        if isinstance(value, dict) and value.keys() == {"variable"} and isinstance(value["variable"], str):
            return json_of(self._resolve_name(value["variable"]))
        if isinstance(value, dict):
            return {name: self._resolve_json(each) for name, each in value.items()}
        return [self._resolve_json(each) for each in value] if isinstance(value, list) else value

    def _resolve_name(self, name: str) -> str:
        if self.ports is not None and name in self.ports:
            return self.ports[name]
        if "." in name or (name in self.known and self.passes_all):
            return f"{{{name}}}"
        declared = "the ports of the SubTree" if self.ports is not None else "the input_port elements of the main tree"
        raise PortError(f"{{{name}}} has no value; {declared} name the entries that have one")


@dataclass
class _Document:
    root: Element
    lines: Mapping[int, int]
    base: str
    steps: int = 0
    trees: dict[str, Element] = field(default_factory=dict)

    def mission(self) -> dict[str, Any]:
        if self.root.tag != "root" or self.root.get("BTCPP_format") != FORMAT:
            self.refuse(self.root, f'is not <root BTCPP_format="{FORMAT}">')
        models = self._read_parts()
        main = self._main()
        parameters = [each for model in models for each in self._parameters(model, main)]
        tree = self.trees[main]
        self._check_attributes(tree, frozenset({"ID", "_description", "holds", "_fullpath"}))
        scope = _Scope(frozenset(each["name"] for each in parameters), above=(main,))
        step = self.step(self._only_child(tree), scope, 0)
        _make_names_unique(step)
        try:
            title = _plain_text(tree.get("_description", main))[:200]
        except PortError as error:
            self.refuse(tree, f"is not usable: {error}")
        return {"title": title, "parameters": parameters, "holds": tree.get("holds") == "true", "step": step}

    def _read_parts(self) -> list[Element]:
        """Note the trees by their ids. Return the models."""
        models = []
        for each in self.root:
            if each.tag == "BehaviorTree":
                if (id := each.get("ID", "")) in self.trees:
                    self.refuse(each, f"has the ID {id!r} of another one; ids are told apart")
                self.trees[id] = each
            elif each.tag == "TreeNodesModel":
                models.append(each)
            else:
                self.refuse(each, "is not known here; there are BehaviorTree and TreeNodesModel")
        return models

    def _main(self) -> str:
        main = self.root.get("main_tree_to_execute")
        if main is None and len(self.trees) == 1:
            return next(iter(self.trees))
        if main not in self.trees:
            self.refuse(self.root, "has main_tree_to_execute, the ID of a BehaviorTree, if there are several")
        return str(main)

    # -- parameters -------------------------------------------------------------------------------------------------

    def _parameters(self, model: Element, main: str) -> list[dict[str, Any]]:
        """Return the parameters: the input ports of the main tree. Models of other nodes say nothing of a mission."""
        trees = [each for each in model if each.tag == "SubTree" and each.get("ID") == main]
        return [self._parameter(port) for tree in trees for port in tree]

    def _parameter(self, port: Element) -> dict[str, Any]:
        if port.tag != "input_port":
            self.refuse(port, "of the main tree is no input_port, which alone can be a parameter")
        known = frozenset({"name", "type", "default", "_description", "minimum", "maximum", "options"})
        self._check_attributes(port, known)
        if (type_ := OTHER_TYPES.get(port.get("type", ""))) is None:
            self.refuse(port, f"has a type; there are {', '.join(OTHER_TYPES)}")
        said: dict[str, Any] = {"name": port.get("name", ""), "type": type_}
        try:
            if (default := port.get("default")) is not None:
                said["default"] = default_of(default, type_)
            if (title := port.get("_description")) is not None:
                said["title"] = _plain_text(title)
            said |= {
                name: value_of(port.attrib[name]) for name in ("minimum", "maximum", "options") if name in port.attrib
            }
        except PortError as error:
            self.refuse(port, f"is not usable: {error}")
        return said

    # -- steps ------------------------------------------------------------------------------------------------------

    def step(self, element: Element, scope: _Scope, depth: int) -> dict[str, Any]:
        """Return the step of an element in JSON."""
        self.steps += 1
        if self.steps > MOST_STEPS or depth > MOST_DEEP:
            self.refuse(element, f"is one step too many: there are at most {MOST_STEPS}, {MOST_DEEP} deep")
        try:
            said = self._step(element, scope, depth)
            named = element.get("name", "")
            title = element.get("_description")
            if element.tag != "SubTree":
                said |= {"name": named} if _NAME.fullmatch(named) else {"title": named[:200]} if named else {}
                said |= {} if title is None else {"title": _plain_text(title)}
        except PortError as error:
            self.refuse(element, f"is not usable: {error}")
        return said

    def _step(self, element: Element, scope: _Scope, depth: int) -> dict[str, Any]:
        match element.tag:
            case "Sequence" | "Fallback":
                self._check_attributes(element, _OF_ALL)
                return {"type": _BRANCHES[element.tag], "steps": self._children(element, scope, depth)}
            case "Parallel":
                return self._parallel(element, scope, depth)
            case "Repeat":
                self._check_attributes(element, _OF_ALL | {"num_cycles"})
                inner = self.step(self._only_child(element), scope, depth + 1)
                return {"type": "repeat", "times": self._count(element, "num_cycles", scope), "step": inner}
            case "Sleep":
                self._check_attributes(element, _OF_ALL | {"msec"})
                self._refuse_children(element)
                return {"type": "wait", "seconds": self._count(element, "msec", scope) / 1000}
            case "Delay":
                self._check_attributes(element, _OF_ALL | {"delay_msec"})
                wait = {"type": "wait", "seconds": self._count(element, "delay_msec", scope) / 1000}
                return {"type": "sequence", "steps": [wait, self.step(self._only_child(element), scope, depth + 1)]}
            case "SubTree":
                return self._subtree(element, scope, depth)
        return self._leaf(element, scope)

    def _children(self, element: Element, scope: _Scope, depth: int) -> list[dict[str, Any]]:
        if len(element) == 0:
            self.refuse(element, "has no step below it; it takes at least one")
        return [self.step(each, scope, depth + 1) for each in element]

    def _parallel(self, element: Element, scope: _Scope, depth: int) -> dict[str, Any]:
        self._check_attributes(element, _OF_ALL | {"success_count", "failure_count"})
        steps = self._children(element, scope, depth)
        good = self._count(element, "success_count", scope, -1)
        bad = self._count(element, "failure_count", scope, 1)
        whole = {-1, len(steps)}
        if good == 1 and bad in whole - {1}:
            return {"type": "parallel", "steps": steps, "anySuffices": True}
        if good in whole and (bad == 1 or len(steps) == 1):
            return {"type": "parallel", "steps": steps}
        both = "success_count -1 and failure_count 1 (all succeed), or 1 and -1 (one suffices)"
        self.refuse(element, f"has thresholds that no mission has; there are {both}")

    def _subtree(self, element: Element, scope: _Scope, depth: int) -> dict[str, Any]:
        """Return the steps of another tree in place of its call."""
        self._refuse_children(element)
        id = element.get("ID", "")
        if id not in self.trees:
            self.refuse(element, f"has no BehaviorTree with its ID {id!r} in this document")
        if id in scope.above:
            self.refuse(element, f"calls {id}, which it is a part of; missions have no circles")
        ports = {}
        for name, text in element.attrib.items():
            if name.startswith("_") and name not in ("_autoremap", "_description"):
                self._refuse_attribute(element, name)
            if name not in ("ID", "name", "_autoremap", "_description"):
                ports[name] = scope.resolve(text, name)
        remaps = element.get("_autoremap") in ("true", "1")
        ports = {**(scope.ports or {}), **ports} if remaps else ports
        inner = _Scope(scope.known, ports, remaps and scope.passes_all, (*scope.above, id))
        return self.step(self._only_child(self.trees[id]), inner, depth)

    # -- leaves -----------------------------------------------------------------------------------------------------

    def _leaf(self, element: Element, scope: _Scope) -> dict[str, Any]:
        kind = element.get("ID", "") if element.tag == "Action" else element.tag
        if element.tag in _INSTEAD:
            self.refuse(element, f"is no element that a mission can say: {_INSTEAD[element.tag]}")
        names_action = "action" in element.attrib or "kind" in element.attrib
        if not names_action and kind not in _OWN:
            known = "Sequence, Fallback, Parallel, Repeat, Sleep, Delay, SubTree and Action"
            self.refuse(
                element,
                f"is no element that a mission can say; there are {known}. A leaf has the port action, the IRI or path"
                " of an action of this fleet, or the ports kind and of",
            )
        self._refuse_children(element)
        return self._invoke(element, scope) if names_action else self._own(element, kind, scope)

    def _invoke(self, element: Element, scope: _Scope) -> dict[str, Any]:
        said: dict[str, Any] = {"type": "invoke"}
        for name in ("action", "kind", "triples"):
            if name in element.attrib:
                said[name] = self._text(element, name, scope)
        if scope.ports is not None and LF.variable.value in said.get("triples", ""):
            self.refuse(element, "has variables in the port triples of a SubTree; write ports, or the port body")
        if (path := said.get("action", "")).startswith("/"):
            said["action"] = self.base + path
        if "of" in element.attrib:
            said["of"] = json_of(scope.resolve(element.attrib["of"], "of"))
        ports = {name: text for name, text in element.attrib.items() if name not in OWN_PORTS}
        for name in ports:
            if name.startswith("_"):
                self._refuse_attribute(element, name)
        if "body" in element.attrib:
            said["body"] = json_of(scope.resolve(element.attrib["body"], "body"))
            if ports:
                self.refuse(
                    element, f"has either the port body, or ports for its members, not both: {', '.join(ports)}"
                )
        elif ports:
            said["body"] = {name: json_of(scope.resolve(text, name)) for name, text in ports.items()}
        return said

    def _own(self, element: Element, kind: str, scope: _Scope) -> dict[str, Any]:
        """Return the step of a leaf that invokes no action."""
        own = frozenset({"seconds", "until", "condition", "within"} if kind == "Wait" else {"text"})
        self._check_attributes(element, _OF_ALL | {"ID"} | own)
        said: dict[str, Any] = {"type": kind.casefold()}
        for name in own & element.attrib.keys():
            text = self._text(element, name, scope)
            said[name] = value_of(text) if name in ("seconds", "within") else text
        return said

    # -- attributes -------------------------------------------------------------------------------------------------

    def _text(self, element: Element, name: str, scope: _Scope) -> str:
        """Return an attribute that no parameter can stand for."""
        text = scope.resolve(element.get(name, ""), name)
        if entry_of(text) is not None:
            raise PortError(f"{name} takes no parameter: a mission has one {name}")
        return _plain_text(text)

    def _count(self, element: Element, name: str, scope: _Scope, default: int | None = None) -> int:
        if default is not None and name not in element.attrib:
            return default
        text = self._text(element, name, scope)
        if not re.fullmatch(r"-?[0-9]{1,12}", text):
            raise PortError(f"{name} is a whole number, not {text[:60]!r}")
        return int(text)

    def _check_attributes(self, element: Element, known: frozenset[str]) -> None:
        for name in sorted(element.attrib.keys() - known):
            self._refuse_attribute(element, name, known)

    def _refuse_attribute(self, element: Element, name: str, known: frozenset[str] = frozenset()) -> NoReturn:
        there = f"; there are {', '.join(sorted(known))}" if known else ": missions have no scripts and conditions here"
        self.refuse(element, f"has the attribute {name[:60]}, which no mission can say{there}")

    def _only_child(self, element: Element) -> Element:
        if len(element) != 1:
            self.refuse(element, f"has {len(element)} elements below it; it takes one")
        return element[0]

    def _refuse_children(self, element: Element) -> None:
        if len(element) != 0:
            self.refuse(element, "is a leaf, and takes no element below it")

    def refuse(self, element: Element, why: str) -> NoReturn:
        """Raise UnprocessableContent with an element, its line, and what would be right."""
        named = f' ID="{element.get("ID", "")[:60]}"' if "ID" in element.attrib else ""
        raise UnprocessableContent(f"<{element.tag[:60]}{named}> in line {self.lines[id(element)]} {why}.")


def json_of(text: str) -> Any:
    """Return the JSON of a port: the variable of an entry, or a value."""
    name = entry_of(text)
    return value_of(text) if name is None else {"variable": name}


def _plain_text(text: str) -> str:
    """Return a text that may be JSON. Raises PortError for other JSON."""
    value = value_of(text) if text.startswith(JSON) else text
    if not isinstance(value, str):
        raise PortError(f"{text[:60]!r} is no text")
    return value


def _make_names_unique(step: dict[str, Any]) -> None:
    """Make titles of names that occur again, as in a tree that is called twice, unless a variable refers to them."""
    steps = [step]
    for each in steps:
        steps += each.get("steps", []) + ([each["step"]] if "step" in each else [])
    used = {each.partition(".")[0] for each in re.findall(r'"variable": "([^"]*)"', json.dumps(steps[0]))}
    seen: set[str] = set()
    for each in steps:
        name = each.get("name", "")
        if name and name in seen and name not in used:
            del each["name"]
            each.setdefault("title", name)
        seen.add(name)
