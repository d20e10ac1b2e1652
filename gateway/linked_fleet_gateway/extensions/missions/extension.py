"""The extension ``missions``: containers of missions and of their runs, and the actions of both."""

import time
from collections import Counter
from collections.abc import AsyncIterator, Callable, Iterator, Mapping, Sequence
from contextlib import asynccontextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import ClassVar

import msgspec
from prometheus_client.metrics_core import Metric
from pyoxigraph import Triple

from linked_fleet_base.errors import InsufficientScope
from linked_fleet_base.settings import Section, setting, whole_number
from linked_fleet_gateway.api import (
    ActionRequest,
    Body,
    Call,
    Conflict,
    Container,
    Core,
    Extension,
    Graph,
    Member,
    Mount,
    NamedNode,
    NavigationEntry,
    Operation,
    RequestView,
    Right,
    Table,
    UnprocessableContent,
    gauges,
)
from linked_fleet_gateway.extensions.missions.builder import with_builder
from linked_fleet_gateway.extensions.missions.conditions import Conditions
from linked_fleet_gateway.extensions.missions.describing import describe_mission, describe_run, run_json
from linked_fleet_gateway.extensions.missions.engine import Engine
from linked_fleet_gateway.extensions.missions.mission import Confirm, Mission, step_at
from linked_fleet_gateway.extensions.missions.parameters import RunDefinitions, RunOffer, read_values
from linked_fleet_gateway.extensions.missions.progress import confirmed, retried, skipped
from linked_fleet_gateway.extensions.missions.reading import check as check_mission
from linked_fleet_gateway.extensions.missions.reading import form, read_mission, triples_of_mission
from linked_fleet_gateway.extensions.missions.record import OVER, Run
from linked_fleet_gateway.extensions.missions.rehearsing import Rehearsing
from linked_fleet_gateway.extensions.missions.runs import Change, Runs
from linked_fleet_gateway.extensions.missions.steps import Steps
from linked_fleet_gateway.extensions.missions.targets import Targets, creator_of
from linked_fleet_gateway.extensions.missions.terms import LF
from linked_fleet_gateway.extensions.missions.tree_ports import MEDIA_TYPE
from linked_fleet_gateway.extensions.missions.tree_reading import read_tree
from linked_fleet_gateway.extensions.missions.tree_writing import write_tree
from linked_fleet_gateway.extensions.missions.values import Value, is_free, samples
from linked_fleet_gateway.extensions.query.service import Queries
from linked_fleet_gateway.extensions.rules.service import Rules
from linked_fleet_gateway.faces import Identity, Offer, Tree, View
from linked_fleet_gateway.serving import Caller
from linked_fleet_rdf.graph import Node

HERE = Path(__file__).parent


@dataclass(frozen=True)
class MissionSettings(Section):
    prefix: ClassVar[str] = "LINKED_FLEET_MISSIONS_"

    most: int = setting(whole_number(1, 10_000), "500", "missions of the fleet")
    most_runs: int = setting(whole_number(1, 10_000), "1000", "runs of missions that are kept, those that run included")


@dataclass(frozen=True)
class RunsOfMissions:
    """The service for other extensions that ask about runs."""

    known: Mapping[str, Run]
    targets: Targets

    def about(self, id: str) -> tuple[str, tuple[str, ...]] | None:
        """Return the title of the mission of a run, and all robots that it names; None if it is not known."""
        run = self.known.get(id)
        if run is None:
            return None
        return run.mission.title, tuple(dict.fromkeys((*run.robots, *self.targets.named_robots(run.mission))))


class MissionsExtension(Extension):
    """Missions at ``/missions``, and their runs at ``/mission-runs``."""

    name = "missions"
    at_root = ("missions", "mission-runs")
    needs = ("query", "rules")
    vocabulary = (HERE / "vocabulary.ttl",)
    shapes = (HERE / "shapes.ttl",)
    kinds = (HERE / "kinds.ttl",)
    settings = MissionSettings
    navigation = (NavigationEntry("Missions", "/missions", 15),)

    def views(self) -> Sequence[object]:
        from linked_fleet_gateway.extensions.missions import page

        return page.VIEWS

    @asynccontextmanager
    async def start(self, core: Core) -> AsyncIterator[Mount]:
        section = core.section(MissionSettings)
        targets, engines = Targets(core), list[Engine]()

        def changed(id: str, before: Run | None, after: Run | None) -> None:
            for each in engines:
                each.changed(id, before, after)

        runs: Table[Run] = core.table("mission-runs", Run, changed, section.most_runs)
        async with runs:
            conditions = Conditions(core.service(Queries))
            known = Runs(runs)
            core.service(Rules).count_steps(known.steps_of)
            engine = Engine(core, known, Steps(core, known, targets, conditions))
            engines.append(engine)
            make = partial(_missions, targets, conditions, engine, core)
            async with engine, core.open_container("missions", Mission, make, section.most) as missions:
                with core.listening_to_stops(engine.stop), core.listening_to_invocations(engine.hear):
                    yield Mount(
                        branches=(with_builder(missions.branch), _runs(Records(runs), targets).branch),
                        handlers=_handlers(known),
                        formats={"behaviortree": ("Behavior tree", MEDIA_TYPE)},
                        metrics=lambda: _metrics(runs),
                        services=(targets, known, RunsOfMissions(runs.known, targets)),
                    )


def _missions(
    targets: Targets, conditions: Conditions, engine: Engine, core: Core, table: Table[Mission]
) -> Container[Mission]:
    async def check(mission: Mission, tree: Tree, caller: Identity) -> None:
        await targets.check(mission, tree.view.base, tree, caller)
        await conditions.check(mission, tree.view.base, caller)

    async def rehearse(
        mission: Mission, view: RequestView, caller: Caller
    ) -> tuple[float, Callable[[Graph, Node], None]]:
        targets.check_nesting("", mission)
        rehearsing = Rehearsing(core, targets, view.base, core.live.tree(view.base, caller.visible_robots), caller)
        free = {each.name for each in mission.parameters if is_free(each)}
        values = {name: value for name, value in samples(mission).items() if name not in free}
        return await rehearsing.mission(mission, values), rehearsing.describe

    targets.missions = table.known
    definitions = RunDefinitions()

    def describe(graph: Graph, member: Member[Mission]) -> None:
        describe_mission(graph, member.iri, member.record)

    def visible(mission: Mission, sees: View) -> bool:
        return all(map(sees.includes, targets.named_robots(mission)))

    def actions(member: Member[Mission]) -> list[Offer]:
        handler = partial(_run, targets, engine, core, member.record)
        mission, definition = member.record, definitions.of(member.path, member.record)
        acts_on = targets.possible_robots
        return [
            RunOffer(definition, member.path, label=mission.title, handler=handler, mission=mission, acts_on=acts_on)
        ]

    return Container(
        segment="missions", title="Missions", type=LF.MissionList, member_type=LF.Mission, records=table,
        shape=LF.MissionInput, read=read_mission, describe=describe, title_of=lambda mission: mission.title,
        predicate=LF.missions, visible=visible, member_blueprint=LF.MissionShape, writing=(Right.ACT, Right.ADMIN),
        deep=frozenset({LF.step}), form=form, json=_json, check=check, actions=actions,
        rehearse=rehearse,
        formats={MEDIA_TYPE: (_read_tree, lambda member: write_tree(member.record))},
    )  # fmt: skip


def _read_tree(content: bytes, iri: str) -> list[Triple]:
    mission = read_tree(content, iri.rpartition("/missions")[0])
    check_mission(mission)
    return triples_of_mission(mission)


def _json(member: Member[Mission]) -> bytes:
    return msgspec.json.encode(member.record)


def _run(targets: Targets, engine: Engine, core: Core, mission: Mission, request: ActionRequest) -> Operation:
    """Handle ``run`` of a mission."""
    base, path = request.base, request.thing
    values = read_values(request.body, mission, base + path)
    typed: Mapping[str, tuple[Value, str]] = {each.name: (values[each.name], each.type) for each in mission.parameters}

    async def rehearse(caller: Caller) -> float:
        targets.check_nesting(path, mission)
        tree = core.live.tree(base, caller.visible_robots)
        await targets.check_run(mission, typed, base, tree, caller.identity)
        return 0.0

    async def run(call: Call) -> None:
        caller = call.caller
        tree = core.live.tree(base, caller.visible_robots)
        robots = targets.robots(mission, typed, base, tree, caller.identity)
        record = Run(
            mission,
            path,
            base,
            values,
            creator_of(caller.identity, caller.name, caller.lease_token),
            time.time_ns(),
            robots,
        )
        await engine.begin(call, record)

    async def dry_run(caller: Caller) -> tuple[float, Callable[[Graph, Node], None]]:
        await rehearse(caller)
        tree = core.live.tree(base, caller.visible_robots)
        rehearsing = Rehearsing(core, targets, base, tree, caller)
        return await rehearsing.mission(mission, typed), rehearsing.describe

    about = targets.told_of(mission, values, base)
    return Operation(run, rehearse=rehearse, resumes=True, dry_run=dry_run, about=about)


# -- runs -------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Records:
    """The runs as the members of their container, which clients delete once they are over."""

    table: Table[Run]

    @property
    def known(self) -> Mapping[str, Run]:
        return self.table.known

    async def add(self, record: Run) -> str:
        raise Conflict("Runs begin by the action run of their mission.")

    async def change(self, id: str, record: Run | None) -> bool:
        """Delete a run. Raises Conflict while it is not over."""
        if id in self.table.known and self.table.known[id].phase not in OVER:
            raise Conflict("The run is not over: cancel its invocation first.")
        return await self.table.change(id, record)


def _runs(records: Records, targets: Targets) -> Container[Run]:
    def visible(run: Run, sees: View) -> bool:
        return all(map(sees.includes, {*run.robots, *targets.named_robots(run.mission)}))

    def describe(graph: Graph, member: Member[Run]) -> None:
        describe_run(graph, member.iri, member.record)

    def read(body: Body) -> Run:
        raise UnprocessableContent("Runs are not written.")

    return Container(
        segment="mission-runs", title="Runs of missions", type=LF.MissionRunList, member_type=LF.MissionRun,
        records=records, shape=LF.MissionRunShape, read=read, describe=describe,
        title_of=lambda run: run.mission.title, json=lambda member: run_json(member.id, member.record),
        predicate=LF.missionRuns, visible=visible,
        blueprint=LF.MissionRunListShape, member_blueprint=LF.MissionRunShape,
        writing=(Right.ACT, Right.ADMIN), by_clients=False,
    )  # fmt: skip


def _handlers(runs: Runs) -> Mapping[NamedNode, Callable[[ActionRequest], Operation]]:
    def changing(change: Callable[[ActionRequest, Call], Change]) -> Callable[[ActionRequest], Operation]:
        def handle(request: ActionRequest) -> Operation:
            async def run(call: Call) -> None:
                def checked(run: Run) -> Run:
                    _check_rights(run, call.caller.identity)
                    return change(request, call)(run)

                await runs.change(request.member_id, checked)
                call.accept()

            return Operation(run)

        return handle

    return {
        LF.PauseRun: changing(lambda request, call: lambda run: _phase(run, "running", "paused", call.client)),
        LF.ResumeRun: changing(lambda request, call: lambda run: _phase(run, "paused", "running", "")),
        LF.RetryStep: changing(_retry),
        LF.SkipStep: changing(_skip),
        LF.AnswerStep: changing(_answer),
    }


def _check_rights(run: Run, caller: Identity) -> None:
    """Raise InsufficientScope if a caller may not act on all robots that a run uses."""
    if missing := [each for each in run.robots if not caller.has_right(Right.ACT, each)]:
        wanted = f"The run uses {', '.join(missing)[:200]}; changing it takes the right to act on them."
        raise InsufficientScope(wanted, scope=Right.ACT)


def _phase(run: Run, before: str, after: str, by: str) -> Run:
    if run.phase != before:
        raise Conflict(f"The run is {run.phase}, not {before}.")
    return msgspec.structs.replace(run, phase=after, reason=f"paused by {by}" if by else "")


def _path(request: ActionRequest, run: Run, *states: str) -> str:
    """Return the path of the step that a body names, which is in one of these states. Raises Conflict, NotFound."""
    path = request.body.text(request.body.root, LF.stepPath) or ""
    held = run.steps.get(path)
    if held is None:
        raise UnprocessableContent(f"The run has no step {path[:100]} that has begun.")
    if held.state not in states:
        raise Conflict(f"The step {path} is {held.state}; it can be changed while it is {' or '.join(states)}.")
    if run.phase in OVER or run.phase == "ending":
        raise Conflict(f"The run is {run.phase}.")
    return path


def _retry(request: ActionRequest, call: Call) -> Change:
    return lambda run: retried(run, _path(request, run, "failed", "unknown", "cancelled"), time.time_ns())


def _skip(request: ActionRequest, call: Call) -> Change:
    return lambda run: skipped(run, _path(request, run, "failed", "unknown", "cancelled", "waiting"), time.time_ns())


def _answer(request: ActionRequest, call: Call) -> Change:
    good = request.body.text(request.body.root, LF.confirmed) in ("true", "1")

    def change(run: Run) -> Run:
        path = _path(request, run, "waiting")
        if not isinstance(step_at(run.mission.step, path), Confirm):
            raise Conflict(f"The step {path} does not wait for a person.")
        return confirmed(run, path, good, call.client, time.time_ns())

    return change


def _metrics(runs: Table[Run]) -> Iterator[Metric]:
    phases = Counter(run.phase for run in list(runs.known.values()))
    yield gauges("mission_runs", "Runs of missions by state.", "state", phases.items())
