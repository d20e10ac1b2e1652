"""The pages of missions: the list, one mission as an outline, the list of runs, and one run with its steps."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from pyoxigraph import BlankNode, Literal, NamedNode

from linked_fleet_gateway.api import DCTERMS, LDP, RDF
from linked_fleet_gateway.extensions.missions.describing import CLASSES
from linked_fleet_gateway.extensions.missions.terms import LF
from linked_fleet_gateway.extensions.pages.api import Facts, Link, PageView, Part, Value, timeline_link
from linked_fleet_gateway.rdf.vocabulary import HYBRIT, PROV

_TEMPLATES = Path(__file__).parent / "templates"
_WORDS = {
    LF.InvokeStep: "Invoke", LF.SequenceStep: "One after the other", LF.ParallelStep: "At the same time",
    LF.FirstOfStep: "The first that succeeds", LF.RepeatStep: "Repeat", LF.WaitStep: "Wait", LF.ConfirmStep: "Ask",
    LF.NotifyStep: "Tell",
}  # fmt: skip
_MOST = 1000


@dataclass(frozen=True)
class StepRow:
    """A step in an outline; ``deep`` is the number of steps above it."""

    deep: int
    word: str
    title: str
    about: str
    action: Link | None


@dataclass(frozen=True)
class RunRow:
    """A run in a list."""

    link: Link
    state: Value | None
    when: Value | None
    reason: str


@dataclass(frozen=True)
class StepRunRow:
    """A step of a run, in the order in which steps have begun."""

    path: str
    word: str
    title: str
    state: Value | None
    reason: str
    attempt: str
    began: Value | None
    ended: Value | None
    invocation: Link | None


def missions(facts: Facts, iri: NamedNode) -> Part:
    members = [each for each in facts.all(iri, LDP.contains) if isinstance(each, NamedNode)]
    return Part({"missions": [facts.link(each) for each in members]}, {LDP.contains}, {*members})


def mission(facts: Facts, iri: NamedNode) -> Part:
    first = facts.one(iri, LF.step)
    steps = list(_outline(facts, first, 0)) if isinstance(first, BlankNode) else []
    return Part({"steps": steps, "actions": _actions(facts, iri)}, {LF.step, LF.holds, HYBRIT.action})


def _outline(facts: Facts, node: BlankNode, deep: int) -> Iterator[StepRow]:
    action = facts.one(node, LF.invokes) or facts.one(node, LF.actsOn)
    yield StepRow(
        deep,
        _word(facts, node),
        facts.text(node, DCTERMS.title) or facts.text(node, DCTERMS.identifier),
        _about(facts, node),
        facts.placed_link(action) if isinstance(action, NamedNode) else None,
    )
    below = [*facts.all(node, LF.step), *_items(facts, node)]
    for each in below:
        if isinstance(each, BlankNode):
            yield from _outline(facts, each, deep + 1)


def _items(facts: Facts, node: BlankNode) -> Iterator[object]:
    cell = facts.one(node, LF.steps)
    for _ in range(_MOST):
        if not isinstance(cell, BlankNode):
            return
        yield facts.one(cell, RDF.first)
        cell = facts.one(cell, RDF.rest)


def _about(facts: Facts, node: BlankNode) -> str:
    if seconds := facts.text(node, LF.seconds):
        return f"{float(seconds):g} s"
    if times := facts.text(node, LF.times):
        return f"{times} times"
    until = facts.text(node, LF.until)
    return f"until {until}" if until else facts.text(node, LF.text) or facts.text(node, LF.condition)


def _word(facts: Facts, node: NamedNode | BlankNode) -> str:
    kind = next((each for each in CLASSES.values() if facts.is_a(node, each)), None)
    return "" if kind is None else _WORDS[kind]


def _actions(facts: Facts, iri: NamedNode) -> list[Link]:
    return [facts.link(each) for each in facts.all(iri, HYBRIT.action) if isinstance(each, NamedNode)]


def runs(facts: Facts, iri: NamedNode) -> Part:
    members = [each for each in facts.all(iri, LDP.contains) if isinstance(each, NamedNode)]
    rows = sorted((_run(facts, each) for each in members), key=lambda row: str(row.when), reverse=True)
    return Part({"runs": rows}, {LDP.contains}, {*members})


def _run(facts: Facts, iri: NamedNode) -> RunRow:
    state, when = facts.first_value(iri, LF.state), facts.first_value(iri, DCTERMS.created)
    return RunRow(facts.link(iri), state, when, facts.text(iri, LF.reason))


def run(facts: Facts, iri: NamedNode) -> Part:
    steps = [_step(facts, each) for each in facts.all(iri, LF.stepRun) if isinstance(each, BlankNode)]
    notes = [each.value for each in facts.all(iri, LF.note) if isinstance(each, Literal)]
    more = {
        "run": _run(facts, iri),
        "steps": steps,
        "notes": notes,
        "actions": _actions(facts, iri),
        "timeline": timeline_link(facts, facts.text(iri, DCTERMS.created)),
    }
    return Part(more, {LF.stepRun, LF.note, LF.state, LF.reason, HYBRIT.action})


def _step(facts: Facts, node: BlankNode) -> StepRunRow:
    invocation = facts.one(node, LF.invocation)
    return StepRunRow(
        facts.text(node, LF.stepPath),
        _word(facts, node),
        facts.text(node, DCTERMS.title),
        facts.first_value(node, LF.state),
        facts.text(node, LF.reason),
        facts.text(node, LF.attempt),
        facts.first_value(node, PROV.startedAtTime),
        facts.first_value(node, PROV.endedAtTime),
        facts.placed_link(invocation) if isinstance(invocation, NamedNode) else None,
    )


VIEWS = (
    PageView(LF.MissionList, _TEMPLATES / "missions.html", missions),
    PageView(LF.Mission, _TEMPLATES / "mission.html", mission),
    PageView(LF.MissionRunList, _TEMPLATES / "mission_runs.html", runs),
    PageView(LF.MissionRun, _TEMPLATES / "mission_run.html", run),
)
