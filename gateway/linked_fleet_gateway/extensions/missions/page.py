"""The pages of missions: the list, one mission as an outline, the list of runs, and one run with its steps."""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

from pyoxigraph import BlankNode, Literal, NamedNode

from linked_fleet_gateway.api import DCTERMS, LDP, RDF, RDFS
from linked_fleet_gateway.extensions.missions.builder import SEGMENT
from linked_fleet_gateway.extensions.missions.describing import CLASSES
from linked_fleet_gateway.extensions.missions.terms import LF
from linked_fleet_gateway.extensions.pages.api import (
    Facts,
    Link,
    PageView,
    Part,
    Value,
    message,
    say,
    timeline_link,
    translated,
)
from linked_fleet_gateway.rdf.vocabulary import HYBRIT, PROV

_TEMPLATES = Path(__file__).parent / "templates"
_WORDS = {
    LF.InvokeStep: message("Invoke"),
    LF.SequenceStep: message("One after the other"),
    LF.ParallelStep: message("At the same time"),
    LF.FirstOfStep: message("The first that succeeds"),
    LF.RepeatStep: message("Repeat"),
    LF.WaitStep: message("Wait"),
    LF.ConfirmStep: message("Ask"),
    LF.NotifyStep: message("Tell"),
}
_MOST = 1000
_MINUTE_S = 60.0


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
class Decision:
    """A button by which a person decides: the action of the run, with the step and an answer if it takes them."""

    text: str
    action: str
    path: str = ""
    confirmed: str = ""


@dataclass(frozen=True)
class StepRunRow:
    """A step of a run; ``deep`` is the number of steps above it, ``took`` how long it lasted."""

    path: str
    deep: int
    round: str
    word: str
    title: str
    state: Value | None
    reason: str
    attempt: str
    began: Value | None
    took: str
    invocation: Link | None
    decisions: Sequence[Decision]


@dataclass(frozen=True)
class Question:
    """What a step asks people."""

    text: str
    decisions: Sequence[Decision]


def missions(facts: Facts, iri: NamedNode) -> Part:
    members = [each for each in facts.all(iri, LDP.contains) if isinstance(each, NamedNode)]
    more = {"missions": [facts.link(each) for each in members], "builder": _builder(facts)}
    return Part(more, {LDP.contains}, {*members})


def _builder(facts: Facts) -> str:
    return f"{facts.root}missions/{SEGMENT}"


def builder(facts: Facts, iri: NamedNode) -> Part:
    return Part({"missions": f"{facts.root}missions", "query": f"{facts.root}query"}, {RDFS.seeAlso})


def mission(facts: Facts, iri: NamedNode) -> Part:
    first = facts.one(iri, LF.step)
    steps = list(_outline(facts, first, 0)) if isinstance(first, BlankNode) else []
    id = iri.value.rpartition("/")[2]
    more = {"steps": steps, "actions": _actions(facts, iri), "edit": f"{_builder(facts)}?mission={id}"}
    return Part(more, {LF.step, LF.holds, HYBRIT.action})


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
        return say("{count} times", count=times)
    until = facts.text(node, LF.until)
    return say("until {time}", time=until) if until else facts.text(node, LF.text) or facts.text(node, LF.condition)


def _word(facts: Facts, node: NamedNode | BlankNode) -> str:
    kind = next((each for each in CLASSES.values() if facts.is_a(node, each)), None)
    return "" if kind is None else translated(_WORDS[kind])


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
    nodes = [each for each in facts.all(iri, LF.stepRun) if isinstance(each, BlankNode)]
    state = facts.one(iri, LF.state)
    is_open = state not in (LF.succeeded, LF.failed, LF.cancelled, LF.ending)
    steps = sorted((_step(facts, iri, each, is_open) for each in nodes), key=lambda row: _order(row.path))
    asking = [each for each in nodes if is_open and _asks(facts, each)]
    notes = [each.value for each in facts.all(iri, LF.note) if isinstance(each, Literal)]
    more = {
        "run": _run(facts, iri),
        "steps": steps,
        "notes": notes,
        "questions": [Question(facts.text(each, LF.reason), _answers(facts, iri, each)) for each in asking],
        "decisions": _decisions(facts, iri, state),
        "actions": _actions(facts, iri),
        "timeline": timeline_link(facts, facts.text(iri, DCTERMS.created)),
    }
    return Part(more, {LF.stepRun, LF.note, LF.state, LF.reason, HYBRIT.action})


_OPENED = {LF.failed, LF.unknown, LF.cancelled}


def _order(path: str) -> list[int]:
    """Return the numbers of a path, by which steps are in the order of their mission."""
    return [int(each) for each in re.findall(r"\d+", path)]


def _asks(facts: Facts, node: BlankNode) -> bool:
    return facts.is_a(node, LF.ConfirmStep) and facts.one(node, LF.state) == LF.waiting


def _action_of(iri: NamedNode, segment: str) -> str:
    return f"{iri.value}/actions/{segment}"


def _answers(facts: Facts, iri: NamedNode, node: BlankNode) -> list[Decision]:
    action, path = _action_of(iri, "confirm"), facts.text(node, LF.stepPath)
    return [Decision(say("Yes"), action, path, "true"), Decision(say("No"), action, path, "false")]


def _decisions(facts: Facts, iri: NamedNode, state: object) -> list[Decision]:
    """Return what people may do with the whole run."""
    if state == LF.running:
        return [Decision(say("Pause"), _action_of(iri, "pause"))]
    return [Decision(say("Resume"), _action_of(iri, "resume"))] if state == LF.paused else []


def _step_decisions(facts: Facts, iri: NamedNode, node: BlankNode, path: str) -> list[Decision]:
    state, skip = facts.one(node, LF.state), Decision(say("Skip"), _action_of(iri, "skip"), path)
    if _asks(facts, node):
        return [*_answers(facts, iri, node), skip]
    if state in _OPENED:
        return [Decision(say("Retry"), _action_of(iri, "retry"), path), skip]
    return [skip] if state == LF.waiting else []


def _took(facts: Facts, node: BlankNode) -> str:
    begin, end = facts.text(node, PROV.startedAtTime), facts.text(node, PROV.endedAtTime)
    if not begin or not end:
        return ""
    seconds = (datetime.fromisoformat(end) - datetime.fromisoformat(begin)).total_seconds()
    return f"{max(seconds, 0.0):.1f} s" if seconds < _MINUTE_S else f"{int(seconds // 60)} min {int(seconds % 60)} s"


def _step(facts: Facts, iri: NamedNode, node: BlankNode, is_open: bool) -> StepRunRow:
    invocation, path = facts.one(node, LF.invocation), facts.text(node, LF.stepPath)
    rounds = [int(each) + 1 for each in re.findall(r"#(\d+)", path)]
    return StepRunRow(
        path,
        path.count("."),
        say("round {numbers}", numbers=", ".join(map(str, rounds))) if rounds else "",
        _word(facts, node),
        facts.text(node, DCTERMS.title),
        facts.first_value(node, LF.state),
        facts.text(node, LF.reason),
        facts.text(node, LF.attempt),
        facts.first_value(node, PROV.startedAtTime),
        _took(facts, node),
        facts.placed_link(invocation) if isinstance(invocation, NamedNode) else None,
        _step_decisions(facts, iri, node, path) if is_open else [],
    )


VIEWS = (
    PageView(
        LF.MissionList,
        _TEMPLATES / "missions.html",
        missions,
        help=message(
            "Missions are tasks of several steps for one robot or more. Build one here, and run it or put it"
            " into the queue."
        ),
        guide="docs/MAP.md",
    ),
    PageView(
        LF.Mission,
        _TEMPLATES / "mission.html",
        mission,
        help=message("The steps of a mission. Run it now, edit it, or put it into the queue."),
        guide="docs/MAP.md",
    ),
    PageView(
        LF.MissionBuilder,
        _TEMPLATES / "mission_builder.html",
        builder,
        help=message(
            "Add steps, and set what each does. Check and try the mission before you save it; nothing moves"
            " until it runs."
        ),
        guide="docs/MAP.md",
    ),
    PageView(
        LF.MissionRunList,
        _TEMPLATES / "mission_runs.html",
        runs,
        help=message("Missions that run, and those that have run, with their results."),
        guide="docs/MAP.md",
    ),
    PageView(
        LF.MissionRun,
        _TEMPLATES / "mission_run.html",
        run,
        help=message(
            "One run of a mission: what each step does. Here you answer its questions, pause it, and skip or"
            " repeat steps."
        ),
        guide="docs/MAP.md",
    ),
)
