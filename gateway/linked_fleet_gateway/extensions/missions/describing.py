"""Missions and their runs as triples. Pure."""

import json
from collections.abc import Mapping

from pyoxigraph import Literal, NamedNode, Triple

from linked_fleet_gateway.api import DCTERMS, RDF, Graph, integer, timestamp
from linked_fleet_gateway.extensions.missions.mission import (
    TAGS,
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
    step_at,
    walk_paths,
)
from linked_fleet_gateway.extensions.missions.record import Run, StepRun
from linked_fleet_gateway.extensions.missions.terms import JSON, LF
from linked_fleet_gateway.extensions.missions.values import term
from linked_fleet_gateway.extensions.rules.template import ROOT, triples_of
from linked_fleet_rdf.graph import Node
from linked_fleet_rdf.vocabulary import PROV, XSD

TYPES = {
    "number": LF.number, "integer": LF.wholeNumber, "boolean": LF.truth, "text": LF.textValue, "iri": LF.thing,
}  # fmt: skip
CLASSES: Mapping[type, NamedNode] = {
    Invoke: LF.InvokeStep, Sequence: LF.SequenceStep, Parallel: LF.ParallelStep, FirstOf: LF.FirstOfStep,
    Repeat: LF.RepeatStep, Wait: LF.WaitStep, Confirm: LF.ConfirmStep, Notify: LF.NotifyStep,
}  # fmt: skip


def describe_mission(graph: Graph, root: Node, mission: Mission) -> None:
    """Add what a client has said about a mission, besides its title."""
    for each in mission.parameters:
        node = graph.blank(LF.Parameter)
        graph.add(root, LF.parameter, node)
        _describe_parameter(graph, node, each)
    graph.add(root, LF.holds, Literal(mission.holds))
    graph.add(root, LF.step, describe_step(graph, mission.step))


def _describe_parameter(graph: Graph, node: Node, parameter: Parameter) -> None:
    graph.add(node, DCTERMS.identifier, Literal(parameter.name))
    graph.add(node, LF.parameterType, TYPES[parameter.type])
    if parameter.title:
        graph.add(node, DCTERMS.title, Literal(parameter.title))
    for predicate, number in ((LF.minimum, parameter.minimum), (LF.maximum, parameter.maximum)):
        if number is not None:
            graph.add(node, predicate, _number(number))
    if parameter.default is not None:
        graph.add(node, LF.default, term(parameter.default, parameter.type))
    graph.add(node, LF.option, *(term(each, parameter.type) for each in parameter.options))


def _number(value: float) -> Literal:
    return Literal(repr(value), datatype=XSD.double)


def describe_step(graph: Graph, step: Step) -> Node:
    """Add a step and all below it. Return its node."""
    node = graph.blank(CLASSES[type(step)])
    if step.name:
        graph.add(node, DCTERMS.identifier, Literal(step.name))
    if step.title:
        graph.add(node, DCTERMS.title, Literal(step.title))
    match step:
        case Sequence() | Parallel() | FirstOf():
            graph.add(node, LF.steps, graph.collection([describe_step(graph, each) for each in step.steps]))
            if isinstance(step, Parallel) and step.anySuffices:
                graph.add(node, LF.anySuffices, Literal(True))
        case Repeat():
            graph.add(node, LF.times, integer(step.times))
            graph.add(node, LF.step, describe_step(graph, step.step))
        case Invoke():
            _describe_invoke(graph, node, step)
        case Wait():
            _describe_wait(graph, node, step)
        case Confirm() | Notify():
            graph.add(node, LF.text, Literal(step.text))
    return node


def _describe_invoke(graph: Graph, node: Node, step: Invoke) -> None:
    if step.action:
        graph.add(node, LF.invokes, NamedNode(step.action))
    else:
        graph.add(node, LF.kind, NamedNode(step.kind))
        graph.add(node, LF.actsOn, _thing(graph, step.of))
    if step.body is not None:
        graph.add(node, LF.body, Literal(json.dumps(step.body, ensure_ascii=False), datatype=NamedNode(JSON)))
    elif step.triples:
        _copy_template(graph, node, triples_of(step.triples))


def _thing(graph: Graph, of: Variable | str) -> Node:
    if isinstance(of, str):
        return NamedNode(of)
    node = graph.blank()
    graph.add(node, LF.variable, Literal(of.variable))
    return node


def _copy_template(graph: Graph, node: Node, triples: list[Triple]) -> None:
    own: dict[object, Node] = {each.subject: graph.blank() for each in triples}
    graph.add(node, LF.body, own[ROOT])
    for each in triples:
        graph.add(own[each.subject], each.predicate, own.get(each.object, each.object))  # type: ignore[arg-type]


def _describe_wait(graph: Graph, node: Node, step: Wait) -> None:
    if step.seconds is not None:
        graph.add(node, LF.seconds, _number(step.seconds))
    elif step.until:
        graph.add(node, LF.until, Literal(step.until, datatype=XSD.dateTime))
    else:
        graph.add(node, LF.condition, Literal(step.condition))
        graph.add(node, LF.within, _number(step.within))


# -- runs -------------------------------------------------------------------------------------------------------------


def describe_run(graph: Graph, iri: NamedNode, run: Run) -> None:
    """Add all statements about a run, besides its types and title."""
    base = run.base
    graph.add(iri, LF.mission, NamedNode(base + run.mission_path))
    graph.add(iri, LF.invocation, NamedNode(base + invocation_path_of(run, iri.value.rpartition("/")[2])))
    graph.add(iri, LF.state, LF.terms[run.phase])
    if run.reason:
        graph.add(iri, LF.reason, Literal(run.reason))
    graph.add(iri, DCTERMS.created, timestamp(run.began_ns))
    for name, value in run.values.items():
        node = graph.blank()
        graph.add(iri, LF.binding, node)
        graph.add(node, LF.variable, Literal(name))
        kind = next(each.type for each in run.mission.parameters if each.name == name)
        graph.add(node, LF.value, term(value, kind))
    for text in run.notes:
        graph.add(iri, LF.note, Literal(text))
    for path, said in run.steps.items():
        graph.add(iri, LF.stepRun, _describe_step_run(graph, run, path, said))
    for path, step in walk_paths(run.mission.step):
        node = graph.blank(LF.PlannedStep)
        graph.a(node, CLASSES[type(step)])
        graph.add(iri, LF.plannedStep, node)
        graph.add(node, LF.stepPath, Literal(path))
        if heading := step.title or step.name:
            graph.add(node, DCTERMS.title, Literal(heading))


def run_json(id: str, run: Run) -> bytes:
    """Return a run in plain JSON."""
    steps = [_step_json(run, path, said) for path, said in run.steps.items()]
    told: dict[str, object] = {
        "title": run.mission.title,
        "mission": run.base + run.mission_path,
        "invocation": run.base + invocation_path_of(run, id),
        "state": run.phase,
        "created": timestamp(run.began_ns).value,
        "values": run.values,
        "notes": run.notes,
        "steps": steps,
        "plan": [_planned_json(path, step) for path, step in walk_paths(run.mission.step)],
    }
    return json.dumps(told | ({"reason": run.reason} if run.reason else {}), ensure_ascii=False).encode()


def _planned_json(path: str, step: Step) -> dict[str, str]:
    heading = step.title or step.name
    return {"step": path, "type": TAGS[type(step)]} | ({"title": heading} if heading else {})


def _step_json(run: Run, path: str, said: StepRun) -> dict[str, object]:
    step = step_at(run.mission.step, path)
    told: dict[str, object] = {"step": path, "type": TAGS[type(step)], "state": said.state, "attempt": said.attempt}
    more = {
        "title": step.title or step.name,
        "invocation": said.invocation and run.base + said.invocation,
        "reason": said.reason,
        "started": timestamp(said.began_ns).value,
        "ended": said.ended_ns and timestamp(said.ended_ns).value,
    }
    return told | {name: value for name, value in more.items() if value}


def invocation_path_of(run: Run, id: str) -> str:
    """Return the path of the invocation of a run."""
    return f"{run.mission_path}/actions/run/invocations/{id}"


def _describe_step_run(graph: Graph, run: Run, path: str, said: StepRun) -> Node:
    step, node = step_at(run.mission.step, path), graph.blank(LF.StepRun)
    graph.add(node, LF.stepPath, Literal(path))
    if title := step.title or step.name:
        graph.add(node, DCTERMS.title, Literal(title))
    graph.add(node, RDF.type, CLASSES[type(step)])
    graph.add(node, LF.state, LF.terms[said.state])
    graph.add(node, LF.attempt, integer(said.attempt))
    if said.invocation:
        graph.add(node, LF.invocation, NamedNode(run.base + said.invocation))
    if said.reason:
        graph.add(node, LF.reason, Literal(said.reason))
    graph.add(node, PROV.startedAtTime, timestamp(said.began_ns))
    if said.ended_ns:
        graph.add(node, PROV.endedAtTime, timestamp(said.ended_ns))
    return node
