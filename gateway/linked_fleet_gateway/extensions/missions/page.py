"""The pages of missions: the list, one mission as an outline, the list of runs, and one run with its steps."""

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from operator import itemgetter
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
from linked_fleet_rdf.vocabulary import HYBRIT, PROV

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
    """A step of a run; ``deep`` is the number of steps above it, ``took`` how long it lasted.

    One that ``is_pending`` has not begun. Steps with others below them have no state of their own.
    """

    path: str
    deep: int
    word: str
    title: str
    round: str = ""
    state: Value | None = None
    reason: str = ""
    attempt: str = "1"
    began: Value | None = None
    took: str = ""
    invocation: Link | None = None
    decisions: Sequence[Decision] = ()
    is_pending: bool = False


@dataclass(frozen=True)
class Question:
    """A question of a step to people."""

    text: str
    decisions: Sequence[Decision]


def missions(facts: Facts, iri: NamedNode) -> Part:
    members = facts.nodes(iri, LDP.contains)
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
    return [facts.link(each) for each in facts.nodes(iri, HYBRIT.action)]


def runs(facts: Facts, iri: NamedNode) -> Part:
    members = facts.nodes(iri, LDP.contains)
    rows = sorted((_run(facts, each) for each in members), key=lambda row: str(row.when), reverse=True)
    return Part({"runs": rows}, {LDP.contains}, {*members})


def _run(facts: Facts, iri: NamedNode) -> RunRow:
    state, when = facts.first_value(iri, LF.state), facts.first_value(iri, DCTERMS.created)
    return RunRow(facts.link(iri), state, when, facts.text(iri, LF.reason))


def run(facts: Facts, iri: NamedNode) -> Part:
    nodes = [each for each in facts.all(iri, LF.stepRun) if isinstance(each, BlankNode)]
    state = facts.one(iri, LF.state)
    is_open = state not in (LF.succeeded, LF.failed, LF.cancelled, LF.ending)
    begun = [_step(facts, iri, each, is_open) for each in nodes]
    steps = [row for _, row in sorted([*_in_order(begun), *_not_begun(facts, iri, begun)], key=itemgetter(0))]
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
    return Part(more, {LF.stepRun, LF.plannedStep, LF.note, LF.state, LF.reason, HYBRIT.action})


_OPENED = {LF.failed, LF.unknown, LF.cancelled}


_Place = list[tuple[int, float]]
"""A path as the numbers of children, each with its round; by it steps are in the order of their mission."""


def _in_order(begun: Sequence[StepRunRow]) -> Iterator[tuple[_Place, StepRunRow]]:
    for row in begun:
        parts = [each.partition("#") for each in row.path.split(".")]
        yield [(int(number), float(after or -1)) for number, _, after in parts], row


def _not_begun(facts: Facts, iri: NamedNode, begun: Sequence[StepRunRow]) -> Iterator[tuple[_Place, StepRunRow]]:
    """Yield the steps with steps below them, which are headings, and those that have not begun in any round."""
    nodes = [each for each in facts.all(iri, LF.plannedStep) if isinstance(each, BlankNode)]
    planned = {facts.text(each, LF.stepPath): each for each in nodes}
    known = {re.sub(r"#\d+", "", row.path) for row in begun}
    above = {path.rpartition(".")[0] for path in planned}
    for path, node in planned.items():
        if path in above or path not in known:
            title, is_heading = facts.text(node, DCTERMS.title), path in above
            row = StepRunRow(path, path.count("."), _word(facts, node), title, is_pending=not is_heading)
            yield _planned_place(facts, path, planned, is_heading), row


def _planned_place(facts: Facts, path: str, planned: Mapping[str, BlankNode], is_heading: bool) -> _Place:
    """Return where a step stands: a heading before the rounds of what is below it, another one after them."""
    parts = path.split(".")
    repeats = [
        facts.is_a(node, LF.RepeatStep) if (node := planned.get(".".join(parts[:deep]))) is not None else False
        for deep in range(len(parts))
    ]
    return [
        (int(part), math.inf if repeated and not is_heading else -1.0)
        for part, repeated in zip(parts, repeats, strict=True)
    ]


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
        _word(facts, node),
        facts.text(node, DCTERMS.title),
        say("round {numbers}", numbers=", ".join(map(str, rounds))) if rounds else "",
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
