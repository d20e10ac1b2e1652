"""The rehearsal of a mission: each step from where those before it leave the robots, as far as that is known."""

import asyncio
import math
import time
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

from pyoxigraph import Literal, NamedNode

from linked_fleet_gateway.api import DCTERMS, UNITLESS, Body, Core, FleetError, Graph, joint_path, robot_of
from linked_fleet_gateway.extensions.missions.findings import located
from linked_fleet_gateway.extensions.missions.mission import (
    FirstOf,
    Invoke,
    Mission,
    Parallel,
    Repeat,
    Sequence,
    Step,
    Wait,
    walk,
)
from linked_fleet_gateway.extensions.missions.parameters import RunOffer, read_values
from linked_fleet_gateway.extensions.missions.progress import ROOT
from linked_fleet_gateway.extensions.missions.targets import Targets, Values
from linked_fleet_gateway.extensions.missions.terms import LF
from linked_fleet_gateway.extensions.missions.values import variables_of
from linked_fleet_gateway.faces import Offer, Tree, kind_of
from linked_fleet_gateway.serving import Caller
from linked_fleet_rdf.graph import SECOND, Node
from linked_fleet_state.robot import Robot

MOST_S, MOST_STEPS = 20.0, 1000
"""The time for all steps of a mission, and how many are looked at, those of its missions and of repeats included."""
MOST_PLACES = 100
"""The waypoints of all planned paths that a rehearsal shows. Many paths have fewer of them each, with their ends."""

Places = Mapping[str, Mapping[str, float] | None]
"""By robot the joints that steps have moved, with their positions (rad or m); None if where it is then is unknown."""


class Rehearsed(NamedTuple):
    """The finding of the rehearsal of a step; ``why_not`` says why it was not rehearsed, if it was not."""

    path: str
    step: Invoke
    duration_s: float = 0.0
    free: Mapping[NamedNode, bool] = {}
    why_not: str = ""
    robot: str = ""
    moved: Mapping[str, float] = {}
    """The joints of the robot that this step and those before have moved, with their positions then (rad or m)."""
    describe_path: Callable[[Graph, Node, str, int], None] | None = None
    """Adds the path that was planned: to a node, below a base, with so many waypoints at most."""


class _End(NamedTuple):
    """The duration of steps, and where robots are then."""

    took_s: float
    places: Places


@dataclass
class Rehearsing:
    """One rehearsal, for a client. ``found`` is what it says of each step that invokes an action."""

    core: Core
    targets: Targets
    base: str
    tree: Tree
    caller: Caller
    found: list[Rehearsed] = field(default_factory=list)
    _ends_s: float = field(default_factory=lambda: time.monotonic() + MOST_S)
    _seen: int = 0

    @property
    def _is_over(self) -> bool:
        return self._seen >= MOST_STEPS or time.monotonic() >= self._ends_s

    async def mission(self, mission: Mission, values: Values) -> float:
        """Rehearse all steps and return how long they take. Raises FleetError of the first step that is refused."""
        end = await self._step(mission.step, ROOT, values, {})
        return end.took_s

    def describe(self, graph: Graph, node: Node) -> None:
        """Add what was found about each step."""
        most = max(2, MOST_PLACES // max(sum(each.describe_path is not None for each in self.found), 1))
        for each in self.found:
            step = graph.blank(LF.StepRehearsal)
            graph.add(node, LF.stepRehearsal, step)
            graph.add(step, LF.stepPath, Literal(each.path))
            if title := each.step.title or each.step.name:
                graph.add(step, DCTERMS.title, Literal(title))
            if each.why_not:
                graph.add(step, LF.reason, Literal(each.why_not))
                continue
            graph.scalar(step, LF.duration, round(each.duration_s, 3), SECOND)
            for predicate, free in each.free.items():
                graph.add(step, predicate, Literal(True) if free else LF.unknown)
            if each.describe_path is not None:
                each.describe_path(graph, step, self.base, most)
            self._add_targets(graph, step, each)

    def _add_targets(self, graph: Graph, step: Node, found: Rehearsed) -> None:
        """Add where the joints of a robot are after a step that moves it."""
        robot = self.core.robots.get(found.robot)
        if robot is None or robot.model is None:
            return
        for name, position in found.moved.items():
            node, joint = graph.blank(), robot.model.joints.get(name)
            dimension = kind_of(joint).dimension if joint is not None else None
            graph.add(step, LF.target, node)
            graph.add(node, LF.ofJoint, NamedNode(self.base + joint_path(robot.name, name)))
            graph.scalar(node, LF.value, round(position, 6), dimension.position if dimension else UNITLESS)

    # -- steps ------------------------------------------------------------------------------------------------------

    async def _step(self, step: Step, path: str, values: Values, places: Places) -> _End:
        self._seen += 1
        if self._seen % 20 == 0:
            await asyncio.sleep(0)  # others come between
        match step:
            case Sequence():
                return await self._sequence(step, path, values, places)
            case Parallel():
                return await self._parallel(step, path, values, places)
            case FirstOf():
                return await self._first_of(step, path, values, places)
            case Repeat():
                return await self._repeat(step, path, values, places)
            case Invoke():
                return await self._named(step, path, values, places)
            case Wait():
                return _End(step.seconds or 0.0, places)
        return _End(0.0, places)

    async def _sequence(self, step: Sequence, path: str, values: Values, places: Places) -> _End:
        took_s = 0.0
        for number, each in enumerate(step.steps):
            end = await self._step(each, f"{path}.{number}", values, places)
            took_s, places = took_s + end.took_s, end.places
        return _End(took_s, places)

    async def _parallel(self, step: Parallel, path: str, values: Values, places: Places) -> _End:
        """Rehearse each branch as if it was alone; where it leads to is known if all of them are needed."""
        ends = [await self._step(each, f"{path}.{i}", values, places) for i, each in enumerate(step.steps)]
        took_s = (min if step.anySuffices else max)(each.took_s for each in ends)
        return _End(took_s, _joined(places, ends, known=not step.anySuffices))

    async def _first_of(self, step: FirstOf, path: str, values: Values, places: Places) -> _End:
        """Rehearse steps until one is not refused, as a run tries them."""
        *others, last = enumerate(step.steps)
        for number, each in others:
            before = len(self.found)
            try:
                return await self._step(each, f"{path}.{number}", values, places)
            except FleetError as error:
                refused = next((one for one, _ in walk(each) if isinstance(one, Invoke)), None)
                del self.found[before:]
                if refused is not None:
                    self.found.append(Rehearsed(f"{path}.{number}", refused, why_not=str(error.detail)))
        return await self._step(last[1], f"{path}.{last[0]}", values, places)

    async def _repeat(self, step: Repeat, path: str, values: Values, places: Places) -> _End:
        """Rehearse the first two rounds: each further one begins where the second one did."""
        first = await self._step(step.step, f"{path}.0#0", values, places)
        if step.times == 1 or self._is_over:
            return first._replace(took_s=step.times * first.took_s)
        second = await self._step(step.step, f"{path}.0#1", values, first.places)
        return _End(first.took_s + (step.times - 1) * second.took_s, second.places)

    async def _named(self, step: Invoke, path: str, values: Values, places: Places) -> _End:
        try:
            return await self._invoke(step, path, values, places)
        except FleetError as error:
            located(error, path, step)
            raise

    async def _invoke(self, step: Invoke, path: str, values: Values, places: Places) -> _End:
        if self._is_over:
            return self._skip(step, path, self._of(step, places), "the rehearsal had taken too long or too many steps")
        if unknown := variables_of(step) - values.keys():
            why = f"it needs {min(unknown)}, which {'an earlier step' if '.' in min(unknown) else 'who runs it'} gives"
            return self._skip(step, path, self._of(step, places), why)
        offer = self.targets.offer(step, values, self.base, self.tree, self.caller.identity)
        if isinstance(offer, RunOffer):
            inner = self._inner_values(step, offer, values)
            return await self._step(offer.mission.step, f"{path}/{ROOT}", inner, places)
        if offer.robot is not None and places.get(offer.robot.name, ()) is None:
            where = f"where {offer.robot.name} is then is unknown"
            return self._skip(step, path, places, where)
        return await self._rehearse(step, path, offer, values, places)

    async def _rehearse(self, step: Invoke, path: str, offer: Offer, values: Values, places: Places) -> _End:
        statements = self.targets.statements(step, offer, values, self.base)
        said = await self.core.rehearse(offer, self.base, self.caller, statements, self._stand_ins(places))
        after = self._moved(places, offer, said.after)
        name = offer.robot.name if offer.robot is not None else ""
        moved = after.get(name) or {}
        self.found.append(
            Rehearsed(
                path,
                step,
                said.duration_s,
                said.findings,
                robot=name,
                moved=moved,
                describe_path=said.describe_path if said.path is not None else None,
            )
        )
        return _End(said.duration_s, after)

    def _skip(self, step: Invoke, path: str, places: Places, why: str) -> _End:
        if len(self.found) < MOST_STEPS:
            self.found.append(Rehearsed(path, step, why_not=why))
        return _End(0.0, places)

    # -- places -----------------------------------------------------------------------------------------------------

    def _stand_ins(self, places: Places) -> dict[str, Robot]:
        robots = self.core.robots
        return {name: robots[name].standing_at(moved) for name, moved in places.items() if moved and name in robots}

    def _moved(self, places: Places, offer: Offer, after: Robot | None) -> Places:
        if offer.robot is None:
            return places
        name = offer.robot.name
        if after is None:
            return {**places, name: None}
        before, moved = self.core.robots[name].positions, dict(places.get(name) or {})
        for joint, at in after.positions.items():
            if math.isfinite(at) and (joint in moved or at != before.get(joint)):
                moved[joint] = at
        return {**places, name: moved}

    def _of(self, step: Invoke, places: Places) -> Places:
        """Return the places after a step whose input is unknown."""
        name = robot_of(self.targets.path(step.action, self.base)) if step.action else None
        if name is None:
            return dict.fromkeys({*places, *self.core.robots})
        return {**places, name: None}

    def _inner_values(self, step: Invoke, offer: RunOffer, values: Values) -> Values:
        """Return the values with which a step runs another mission. Raises UnprocessableContent."""
        statements, body = self.targets.statements(step, offer, values, self.base), Body((), NamedNode(self.base))
        if offer.takes_body:
            body = self.core.check_input(offer, self.base, statements)
        found = read_values(body, offer.mission, self.base + offer.thing)
        return {each.name: (found[each.name], each.type) for each in offer.mission.parameters}


def _joined(before: Places, ends: Iterable[_End], *, known: bool) -> Places:
    """Return where robots are after branches; those that a branch has moved are somewhere unless that is ``known``."""
    found = dict(before)
    for end in ends:
        for name, moved in end.places.items():
            if moved == before.get(name, {}):
                continue
            there = found.get(name, {})
            found[name] = {**there, **moved} if known and moved is not None and there is not None else None
    return found
