"""Missions from triples and from JSON, and what no shape can say of them. Pure."""

import json
from collections.abc import Collection
from datetime import datetime
from typing import Any, TypeVar

import msgspec
from pyoxigraph import BlankNode, Literal, NamedNode, Triple

from linked_fleet_gateway.api import DCTERMS, RDF, BadRequest, Body, Graph, UnprocessableContent
from linked_fleet_gateway.extensions.missions.describing import CLASSES, TYPES, describe_mission
from linked_fleet_gateway.extensions.missions.findings import Findings, finding_of_decoding
from linked_fleet_gateway.extensions.missions.mission import (
    MOST_DEEP,
    MOST_STEPS,
    TAGS,
    Invoke,
    Mission,
    Parameter,
    Wait,
    walk,
    walk_paths,
)
from linked_fleet_gateway.extensions.missions.parameters import check_iri, check_value
from linked_fleet_gateway.extensions.missions.schema import SCHEMA
from linked_fleet_gateway.extensions.missions.terms import JSON, LF
from linked_fleet_gateway.extensions.missions.values import value_of, variables_of
from linked_fleet_gateway.extensions.rules.template import template
from linked_fleet_gateway.faces import DeclaredForm
from linked_fleet_rdf.graph import Node

_Record = TypeVar("_Record")
_KINDS = {iri: name for name, iri in TYPES.items()}
_STEPS = {iri: step for step, iri in CLASSES.items()}
_YEARS = 1970, 2200
_LISTED = {LF.SequenceStep, LF.ParallelStep, LF.FirstOfStep}
_ALLOWED: dict[NamedNode, frozenset[NamedNode]] = {
    LF.InvokeStep: frozenset({LF.invokes, LF.kind, LF.actsOn, LF.body}),
    LF.SequenceStep: frozenset({LF.steps}),
    LF.ParallelStep: frozenset({LF.steps, LF.anySuffices}),
    LF.FirstOfStep: frozenset({LF.steps}),
    LF.RepeatStep: frozenset({LF.step, LF.times}),
    LF.WaitStep: frozenset({LF.seconds, LF.until, LF.condition, LF.within}),
    LF.ConfirmStep: frozenset({LF.text}),
    LF.NotifyStep: frozenset({LF.text}),
}
_OF_ALL = frozenset({RDF.type, DCTERMS.identifier, DCTERMS.title})


def read_mission(body: Body) -> Mission:
    """Return the mission that a body describes. Raises UnprocessableContent with the step at fault."""
    steps = _Steps(body)
    holds = body.text(body.root, LF.holds) in ("true", "1")
    (node,) = body.nodes(body.root, LF.step)
    said: dict[str, Any] = {
        "title": body.text(body.root, DCTERMS.title),
        "holds": holds,
        "parameters": [_parameter(body, each) for each in body.nodes(body.root, LF.parameter)],
        "step": steps.read(node, "0", 0),
    }
    try:
        mission = msgspec.convert(said, Mission)
    except msgspec.ValidationError as error:
        raise UnprocessableContent(f"The mission is not usable: {error}") from error
    check(mission)
    return mission


def _parameter(body: Body, node: Node) -> dict[str, Any]:
    kind = _KINDS[body.node(node, LF.parameterType)]  # type: ignore[index]
    said: dict[str, Any] = {"name": body.text(node, DCTERMS.identifier), "type": kind}
    if title := body.text(node, DCTERMS.title):
        said["title"] = title
    for name, predicate in (("minimum", LF.minimum), ("maximum", LF.maximum)):
        if (number := body.number(node, predicate)) is not None:
            said[name] = number
    values = {predicate: _terms(body, node, predicate) for predicate in (LF.default, LF.option)}
    try:
        options = [value_of(each, kind) for each in values[LF.option]]
        default = [value_of(each, kind) for each in values[LF.default]]
    except ValueError as error:
        raise UnprocessableContent(f"A value of the parameter {said['name']} is not of its type: {error}") from error
    return said | ({"default": default[0]} if default else {}) | ({"options": sorted(options)} if options else {})


def _terms(body: Body, node: Node, predicate: NamedNode) -> list[NamedNode | Literal]:
    return [
        each.object
        for each in body.triples
        if each.subject == node and each.predicate == predicate and isinstance(each.object, NamedNode | Literal)
    ]


class _Steps:
    """Reads steps, and refuses what a step does not have."""

    def __init__(self, body: Body) -> None:
        self._body = body
        self._by_subject: dict[object, list[Triple]] = {}
        for each in body.triples:
            self._by_subject.setdefault(each.subject, []).append(each)
        self._count = 0

    def read(self, node: Node, path: str, depth: int) -> dict[str, Any]:
        """Return a step in JSON. ``path`` names it in refusals."""
        self._count += 1
        if depth > MOST_DEEP or self._count > MOST_STEPS:
            raise UnprocessableContent(f"There are at most {MOST_STEPS} steps, {MOST_DEEP} deep; none is below itself.")
        kinds = [each for each in self._body.nodes(node, RDF.type) if each in _STEPS]
        if len(kinds) != 1:
            names = ", ".join(f"lf:{each.value.rpartition('#')[2]}" for each in _ALLOWED)
            raise UnprocessableContent(f"The step {path} has one of these types: {names}.")
        kind = kinds[0]
        assert isinstance(kind, NamedNode)
        self._refuse_others(node, path, kind)
        said: dict[str, Any] = {"type": TAGS[_STEPS[kind]]}
        for name, predicate in (("name", DCTERMS.identifier), ("title", DCTERMS.title), ("text", LF.text)):
            if (text := self._body.text(node, predicate)) is not None:
                said[name] = text
        if kind in _LISTED:
            items = self._items(node, path)
            said["steps"] = [self.read(each, f"{path}.{number}", depth + 1) for number, each in enumerate(items)]
        if self._body.text(node, LF.anySuffices) in ("true", "1"):
            said["anySuffices"] = True
        if kind == LF.RepeatStep:
            said |= self._repeat(node, path, depth)
        if kind == LF.InvokeStep:
            said |= self._invoke(node, path)
        if kind == LF.WaitStep:
            said |= self._wait(node)
        return said

    def _refuse_others(self, node: Node, path: str, kind: NamedNode) -> None:
        for each in self._by_subject.get(node, ()):
            if each.predicate not in _ALLOWED[kind] | _OF_ALL:
                known = ", ".join(sorted(f"lf:{term.value.rpartition('#')[2]}" for term in _ALLOWED[kind]))
                raise UnprocessableContent(
                    f"The step {path} has <{each.predicate.value[:200]}>, which it does not know; there are {known}."
                )

    def _items(self, node: Node, path: str) -> list[Node]:
        cell, found = self._body.node(node, LF.steps), list[Node]()
        while cell is not None and cell != RDF.nil and len(found) <= MOST_STEPS:
            item = self._body.node(cell, RDF.first)
            if item is None:
                raise UnprocessableContent(f"lf:steps of the step {path} is a list of steps.")
            found.append(item)
            cell = self._body.node(cell, RDF.rest)
        return found

    def _repeat(self, node: Node, path: str, depth: int) -> dict[str, Any]:
        inner, times = self._body.node(node, LF.step), self._body.number(node, LF.times)
        if inner is None or times is None or times != int(times):
            raise UnprocessableContent(f"The step {path} has lf:step, and lf:times, which is a whole number.")
        return {"step": self.read(inner, f"{path}.0", depth + 1), "times": int(times)}

    def _invoke(self, node: Node, path: str) -> dict[str, Any]:
        said: dict[str, Any] = {}
        for name, predicate in (("action", LF.invokes), ("kind", LF.kind), ("of", LF.actsOn)):
            if (value := self._body.node(node, predicate)) is not None:
                said[name] = self._named(value, path)
        bodies = [each.object for each in self._by_subject.get(node, ()) if each.predicate == LF.body]
        if len(bodies) > 1:
            raise UnprocessableContent(f"The step {path} has at most one lf:body.")
        for each in bodies:
            said |= self._body_of(each, path)
        return said

    def _named(self, value: Node, path: str) -> Any:
        if isinstance(value, NamedNode):
            return value.value
        variable = self._body.text(value, LF.variable)
        if variable is None:
            raise UnprocessableContent(f'The step {path} names a thing by its IRI, or by [ lf:variable "name" ].')
        return {"variable": variable}

    def _body_of(self, value: object, path: str) -> dict[str, Any]:
        if isinstance(value, BlankNode):
            return {"triples": template(self._body.triples, value)}
        if isinstance(value, Literal) and value.datatype.value == JSON:
            try:
                return {"body": json.loads(value.value)}
            except (ValueError, RecursionError) as error:
                raise UnprocessableContent(f"lf:body of the step {path} is no JSON: {error}") from error
        raise UnprocessableContent(f"lf:body of the step {path} is a blank node, or a literal of the type rdf:JSON.")

    def _wait(self, node: Node) -> dict[str, Any]:
        said: dict[str, Any] = {}
        for name, predicate in (("seconds", LF.seconds), ("within", LF.within)):
            if (number := self._body.number(node, predicate)) is not None:
                said[name] = number
        for name, predicate in (("until", LF.until), ("condition", LF.condition)):
            if (text := self._body.text(node, predicate)) is not None:
                said[name] = text
        return said


# -- JSON -------------------------------------------------------------------------------------------------------------


def form(iri: str) -> DeclaredForm:
    """Return the JSON form of a mission."""
    return DeclaredForm(declared=SCHEMA, read=_triples)


def _triples(content: bytes, iri: str, most: int) -> list[Triple]:
    mission = decoded(content, Mission, "mission", iri)
    check(mission)
    return triples_of_mission(mission)


def decoded(content: bytes, kind: type[_Record], noun: str, iri: str) -> _Record:
    """Return the record in a body in JSON. Raises UnprocessableContent, BadRequest."""
    try:
        return msgspec.json.decode(content, type=kind)
    except msgspec.ValidationError as error:
        refused = UnprocessableContent(f"The {noun} is not usable: {error}", constraint=iri)
        if found := finding_of_decoding(str(error)):
            refused.added["findings"] = found
        raise refused from error
    except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError) as error:
        raise BadRequest(f"The body is no JSON: {error}") from error


def triples_of_mission(mission: Mission) -> list[Triple]:
    """Return what a client could have sent in RDF."""
    graph = Graph()
    root = graph.blank()
    graph.add(root, DCTERMS.title, Literal(mission.title))
    describe_mission(graph, root, mission)
    return list(graph.triples)


# -- what no shape says -----------------------------------------------------------------------------------------------


def check(mission: Mission) -> None:
    """Raise UnprocessableContent for a mission that could not run, whatever the fleet is."""
    steps = list(walk(mission.step))
    if len(steps) > MOST_STEPS or any(depth > MOST_DEEP for _, depth in steps):
        raise UnprocessableContent(f"A mission has at most {MOST_STEPS} steps, {MOST_DEEP} deep.")
    named, findings = [each.name for each, _ in steps if each.name], Findings()
    _refuse_repeated([each.name for each in mission.parameters], "Two parameters")
    parameters, seen = {each.name for each in mission.parameters}, set[str]()
    for path, step in walk_paths(mission.step):
        with findings.at(path, step):
            if step.name in seen:
                raise UnprocessableContent(f"Two steps have the name {step.name}; names are told apart.")
            seen |= {step.name} - {""}
            if isinstance(step, Invoke):
                _check_invoke(step, parameters, named)
            elif isinstance(step, Wait):
                _check_wait(step)
    for each in mission.parameters:
        with findings.at_parameter(each.name):
            _check_parameter(each)
    findings.check()


def _refuse_repeated(names: Collection[str], who: str) -> None:
    if repeated := [each for each in names if list(names).count(each) > 1]:
        raise UnprocessableContent(f"{who} have the name {repeated[0]}; names are told apart.")


def _check_invoke(step: Invoke, parameters: Collection[str], named: Collection[str]) -> None:
    if bool(step.action) == bool(step.kind and step.of):
        raise UnprocessableContent("A step invokes either an action, or the action of a kind at a thing: kind and of.")
    for iri in (step.action, step.kind, step.of if isinstance(step.of, str) else ""):
        check_iri(iri, "A step")
    if _depth(step.body) > MOST_DEEP:
        raise UnprocessableContent(f"The body of a step is at most {MOST_DEEP} deep.")
    if step.body is not None and step.triples:
        raise UnprocessableContent("A step has either a body in JSON, or triples.")
    for each in variables_of(step):
        step_name, dot, _ = each.partition(".")
        if each not in parameters and not (dot and step_name in named):
            raise UnprocessableContent(
                f"{each[:130]} is neither a parameter of the mission, nor a named step with a member of its result."
            )


def _depth(given: object) -> int:
    """Return how deep objects and lists are nested, as far as that is more than may be."""
    deepest, pending = 0, [(given, 1)]
    while pending:
        each, depth = pending.pop()
        deepest = max(deepest, depth)
        if depth <= MOST_DEEP and isinstance(each, dict | list):
            pending += [(inner, depth + 1) for inner in (each.values() if isinstance(each, dict) else each)]
    return deepest


def _check_wait(step: Wait) -> None:
    if [step.seconds is not None, bool(step.until), bool(step.condition)].count(True) != 1:
        raise UnprocessableContent("A step that waits has one of seconds, until and condition.")
    if step.until:
        try:
            year = datetime.fromisoformat(step.until).year
        except ValueError as error:
            raise UnprocessableContent(f"until is an xsd:dateTime, such as 2026-11-29T20:00:00Z: {error}") from error
        if not _YEARS[0] <= year <= _YEARS[1]:
            raise UnprocessableContent(f"until is an instant of the years {_YEARS[0]} to {_YEARS[1]}.")


def _check_parameter(parameter: Parameter) -> None:
    given = [parameter.default] if parameter.default is not None else []
    for each in [*given, *parameter.options]:
        check_value(parameter, each)
    if parameter.options and parameter.type not in ("text", "iri"):
        raise UnprocessableContent(f"The parameter {parameter.name} has options, which texts and IRIs alone have.")
