"""Missions of a fleet, and their runs, step by step."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from datetime import datetime
from functools import cached_property
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

from rdflib import Graph
from rdflib.term import Node, URIRef

from linked_fleet_client.action import Action
from linked_fleet_client.errors import InvalidInput, NoSuchThing, Unsupported
from linked_fleet_client.invocation import Invocation
from linked_fleet_client.live import Change
from linked_fleet_client.reading import Reading, date_time
from linked_fleet_client.resource import Members
from linked_fleet_client.thing import Collection, Observable, Thing, body_of
from linked_fleet_client.vocabulary import DCTERMS, LDP, LF, PROV, RDF, document_of, is_web, local_name
from linked_fleet_client.web import parse_rdf

Source = Graph | Mapping[str, Any] | Path
OVER = frozenset({"succeeded", "failed", "cancelled"})
_JSON = "json:"  # precedes JSON in attributes of behavior trees
_NO_RUN = "the server links no record of the run, so its steps cannot be read or changed"


@dataclass(frozen=True)
class StepState:
    """A step of a run, and its state. ``kind`` is its class, such as ``InvokeStep``."""

    path: str
    """The numbers of steps from the first one on, and of rounds after ``#``."""
    kind: str
    title: str
    state: str
    attempt: int
    reason: str
    invocation: str
    """The IRI of its invocation, or empty."""
    started: datetime | None
    ended: datetime | None


@dataclass(frozen=True)
class RunState:
    """A run as it is at one time. ``state`` is ``running``, ``paused``, ``blocked``, ``ending`` or how it has ended."""

    state: str
    reason: str
    notes: tuple[str, ...]
    steps: tuple[StepState, ...]

    @property
    def is_over(self) -> bool:
        return self.state in OVER

    def in_state(self, *states: str) -> list[StepState]:
        return [each for each in self.steps if each.state in states]


class MissionRun(Invocation):
    """A run of a mission: an invocation, with a record of its steps."""

    def __init__(self, invocation: Invocation, runs: Collection | None) -> None:
        """Create it; ``runs`` is the container of the records."""
        super().__init__(invocation.web, invocation.iri, Action)
        self._runs = runs

    @cached_property
    def record(self) -> Thing:
        """The resource that tells what has become of each step. Raises Unsupported if there is none."""
        if self._runs is None:
            raise Unsupported(_NO_RUN)
        document = self._runs.read()
        for found in document.graph.subjects(LF.invocation, self.iri):
            if is_web(found) and (found, RDF.type, LF.MissionRun) in document.graph:
                return Thing(self.web, str(found), self._runs)
        raise Unsupported(_NO_RUN)

    @property
    def now(self) -> RunState:
        """Its present state, and those of its steps."""
        record = self.record
        return _run_state(record.read().graph, record.node)

    @property
    def steps(self) -> tuple[StepState, ...]:
        return self.now.steps

    def watch(self, timeout_s: float = math.inf) -> Iterator[RunState]:
        """Yield its state at each change, beginning with the present one, until it is over or the time has passed."""
        record = Observable(self.web, self.record.iri)
        for change in record.subscribe(timeout_s=None if timeout_s == math.inf else timeout_s):
            state = _changed_state(change)
            yield state
            if state.is_over:
                return

    def pause(self) -> None:
        """Let no further step begin. Raises Problem if it is not running."""
        self._do("pause")

    def resume(self) -> None:
        """Go on after ``pause``. Raises Problem if it is not paused."""
        self._do("resume")

    def retry(self, step: str) -> None:
        """Take a step again, given by its path or title, with those that were cancelled because of it."""
        self._do("retry", step=self._path(step))

    def skip(self, step: str) -> None:
        """Go on as if a step had succeeded, given by its path or title."""
        self._do("skip", step=self._path(step))

    def confirm(self, step: str = "", confirmed: bool = True) -> None:
        """Answer the step that waits for a person, given by its path or title if several do."""
        self._do("confirm", step=self._path(step) if step else self._question(), confirmed=confirmed)

    def _do(self, action: str, **given: Any) -> None:
        self.record.actions[action](given).wait()

    def _question(self) -> str:
        asked = [each for each in self.now.in_state("waiting") if each.kind == local_name(LF.ConfirmStep)]
        if len(asked) != 1:
            named = ", ".join(each.title or each.path for each in asked) or "none"
            raise NoSuchThing(f"one step has to wait for a person, but these do: {named}")
        return asked[0].path

    def _path(self, step: str) -> str:
        found = [each for each in self.now.steps if step in (each.path, each.title)]
        if not found:
            known = [each.path for each in self.now.steps]
            raise NoSuchThing(f"no step of {self.iri} that has begun is called {step!r}", known)
        return found[-1].path


class Mission(Thing):
    """An action that is made of actions."""

    def run(self, values: Mapping[str, Any] | None = None, /, **given: Any) -> MissionRun:
        """Run it with these values of its parameters. Raises InvalidInput, and Problem if it is refused."""
        return MissionRun(self.actions["run"](values, **given), self._runs())

    def rehearse(self, values: Mapping[str, Any] | None = None, /, **given: Any) -> Reading:
        """Check it with these values. Nothing begins. Raises as ``run``."""
        return self.actions["run"].rehearse(values, **given)

    def definition(self) -> dict[str, Any]:
        """Return it in plain JSON, as ``Missions.add`` takes it."""
        answer = self.web.send("GET", document_of(self.iri), None, {"accept": "application/json"})
        found: dict[str, Any] = json.loads(answer.body)
        return found

    def _runs(self) -> Collection | None:
        fleet = self.owner.owner if self.owner is not None else None
        found = [] if fleet is None else fleet.linked_iris(LF.missionRuns)
        return Collection(self.web, found[0], fleet) if found else None


class Missions(Collection):
    """The missions of a fleet; its parts are missions."""

    @property
    def parts(self) -> Members[Mission]:  # type: ignore[override]
        document = self.read()
        return Members(self._members(Mission, self.linked_iris(LDP.contains), document), "mission")

    def add(self, member: Source) -> Mission:
        """Add a mission: plain JSON, a graph about ``<>``, or a file. Raises as ``Collection.add``."""
        made = super().add(member)
        return Mission(self.web, made.iri, self)

    def write(self, source: Source) -> Mission:
        """Return the mission with the title of ``source``: add it, or replace it if it differs. Raises as ``add``."""
        found = self.parts.known(title_of(source))
        if found is None:
            return self.add(source)
        if not (isinstance(source, Mapping) and dict(source) == found.definition()):
            self.replace(found, source)
        return found


def title_of(source: Source) -> str:
    """Return the title of a mission. Raises InvalidInput if it has none."""
    title = _title_in_graph(source) if isinstance(source, Graph) else None
    if not isinstance(source, Graph):
        body, media_type = body_of(source)
        title = _title_in(body, media_type)
    if not title:
        raise InvalidInput(["the mission has no title"])
    return title


def _title_in(body: bytes, media_type: str) -> str | None:
    try:
        if media_type == "application/json":
            said = json.loads(body)
            return str(said["title"]) if isinstance(said, dict) and "title" in said else None
        if media_type == "text/turtle":
            return _title_in_graph(parse_rdf(body.decode(), media_type, "urn:mission"))
        root = ElementTree.fromstring(body)  # noqa: S314 (a file of the user's own)
    except (ValueError, RecursionError, ElementTree.ParseError) as error:
        raise InvalidInput([f"the mission cannot be read: {error}"]) from error
    main = root.get("main_tree_to_execute")
    trees = [each for each in root.iter("BehaviorTree") if main in (None, each.get("ID"))]
    return _title_of_tree(trees[0]) if trees else None


def _title_of_tree(tree: ElementTree.Element) -> str | None:
    said = tree.get("_description") or tree.get("ID")
    return str(json.loads(said[len(_JSON) :])) if said and said.startswith(_JSON) else said


def _title_in_graph(graph: Graph) -> str | None:
    found = [graph.value(each, DCTERMS.title) for each in graph.subjects(LF.step)]
    return next((str(each) for each in found if each is not None), None)


def _changed_state(change: Change) -> RunState:
    return _run_state(change.document.graph, change.resource)


def _run_state(graph: Graph, node: Node) -> RunState:
    steps = [_step_state(graph, each) for each in graph.objects(node, LF.stepRun)]
    return RunState(
        _word(graph, node, LF.state),
        _text(graph, node, LF.reason),
        tuple(sorted(map(str, graph.objects(node, LF.note)))),
        tuple(sorted(steps, key=lambda each: _order(each.path))),
    )


def _step_state(graph: Graph, node: Node) -> StepState:
    kinds = sorted(local_name(str(each)) for each in graph.objects(node, RDF.type) if each != LF.StepRun)
    return StepState(
        path=_text(graph, node, LF.stepPath),
        kind=kinds[0] if kinds else "",
        title=_text(graph, node, DCTERMS.title),
        state=_word(graph, node, LF.state),
        attempt=int(_text(graph, node, LF.attempt) or 1),
        reason=_text(graph, node, LF.reason),
        invocation=_text(graph, node, LF.invocation),
        started=date_time(graph.value(node, PROV.startedAtTime)),
        ended=date_time(graph.value(node, PROV.endedAtTime)),
    )


def _order(path: str) -> list[tuple[int, int]]:
    """Return a key by which steps are sorted as they are taken."""
    parts = (each.partition("#") for each in path.split("."))
    return [(int(number or 0), int(round_ or 0)) for number, _, round_ in parts]


def _text(graph: Graph, node: Node, predicate: URIRef) -> str:
    found = graph.value(node, predicate)
    return "" if found is None else str(found)


def _word(graph: Graph, node: Node, predicate: URIRef) -> str:
    return local_name(_text(graph, node, predicate)) if _text(graph, node, predicate) else ""
