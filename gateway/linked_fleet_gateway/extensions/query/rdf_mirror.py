"""An RDF store of the fleet under one base URL, updated incrementally.

It contains the statements that ``resources`` serves, each value once, in the graph of its robot. Statements that depend
only on a description are written when that changes; measured values are written when they move.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from typing import NamedTuple

from pyoxigraph import BlankNode, Literal, NamedNode, Quad, Store, Triple

from linked_fleet_base.faults import Faults
from linked_fleet_gateway.extensions.query.fleet_mirror import Mirror, MirroredRobot
from linked_fleet_gateway.faces import (
    VOCABULARY,
    Describer,
    Measurement,
    Property,
    RobotPart,
    describe_invocation,
    describe_lease,
    describe_terms,
    invocation_path,
    joint_path,
    last_frame,
    link_path,
    parts_of,
    robot_of,
    robot_path,
    run_steps,
)
from linked_fleet_rdf.graph import Graph, Node, Term
from linked_fleet_rdf.shapes import BLUEPRINTS, load_turtle
from linked_fleet_rdf.vocabulary import LF
from linked_fleet_state.invocation import Invocation
from linked_fleet_state.model import Joint, Link
from linked_fleet_state.robot import Robot

SHAPES = "/blueprint"


class LabelledGraph(Graph):
    """A description whose blank node labels are unique by ``prefix``."""

    def __init__(self, prefix: str) -> None:
        super().__init__()
        self._prefix = prefix

    def add(self, subject: Node, predicate: NamedNode, *objects: Term) -> None:
        own = self._own(subject) if isinstance(subject, BlankNode) else subject
        terms = (self._own(each) if isinstance(each, BlankNode) else each for each in objects)
        super().add(own, predicate, *terms)

    def _own(self, node: BlankNode) -> BlankNode:
        return BlankNode(self._prefix + node.value)


class StaticDescriber(Describer):
    """Describes things without their measured values, and records which those are."""

    def __init__(self, base: str) -> None:
        super().__init__(base)
        self.measured: list[tuple[str, Property]] = []

    def _properties(
        self, graph: Graph, owner: str, items: Sequence[Property], measurements: Sequence[Measurement] | None = None
    ) -> None:
        self.measured += [(owner, item) for item in items if self._is_apart(item)]
        super()._properties(graph, owner, items)

    def _property(self, graph: Graph, iri: NamedNode, owner: NamedNode, item: Property, seen: Measurement) -> None:
        if not self._is_apart(item):
            super()._property(graph, iri, owner, item, seen)

    def _is_apart(self, item: Property) -> bool:
        return item.is_measured

    def _last_frame(self, graph: Graph, iri: NamedNode, seen: Measurement) -> None:
        pass

    def value(self, graph: Graph, owner: str, item: Property, seen: Measurement) -> None:
        """Add a measured value that was left out."""
        iri = self.iri(f"{owner.rstrip('/')}/{item.segment}")
        super()._property(graph, iri, self.iri(owner), item, seen)

    def last_frame(self, graph: Graph, iri: NamedNode, robot: Robot) -> None:
        super()._last_frame(graph, iri, Measurement.from_observations(last_frame(robot)))


class PartDescriber(StaticDescriber):
    """Describes parts beside joints and links without their properties, all of which may change at any time."""

    def _is_apart(self, item: Property) -> bool:
        return True


class _Value:
    """The last written statements of a value."""

    def __init__(self, owner: str, item: Property, prefix: str) -> None:
        self.owner, self.item, self.prefix = owner, item, prefix
        self.seen: object = None
        self.triples: list[Triple] = []


class _Document(NamedTuple):
    """The triples of a document, with the prefix of its blank nodes."""

    key: object
    prefix: str
    triples: list[Triple]


class _Robot:
    """The part of the store that belongs to one robot."""

    def __init__(self, graph: NamedNode, held: MirroredRobot) -> None:
        self.graph, self.held = graph, held
        self.basis: object = None
        self.said = self.seen = self.valued = -1
        self.documents: dict[str, _Document] = {}
        self.values: dict[str, list[_Value]] = {}
        self.values_of_parts: dict[str, list[_Value]] = {}
        self.fault = ""


_PART = "queries"  # in faults


class RdfMirror:
    """The store under one base URL (scheme and authority). ``update`` adopts the state of the mirror."""

    def __init__(self, base: str) -> None:
        self.base, self.store, self._faults = base, Store(), Faults()
        self._say = StaticDescriber(base)
        self._robots: dict[str, _Robot] = {}
        self._documents = 0
        graph = LabelledGraph("v")
        run_steps(describe_terms(base, graph))
        self._extend(NamedNode(base + VOCABULARY), graph.triples)
        shapes = [triple for triples in load_turtle(BLUEPRINTS).values() for triple in triples]
        self.add(SHAPES, shapes, "s")

    def graph_of(self, robot: str) -> NamedNode:
        return NamedNode(self.base + robot_path(robot))

    def add(self, path: str, triples: Sequence[Triple], prefix: str) -> None:
        """Add statements to a graph, with blank nodes of their own."""
        graph = LabelledGraph(prefix)
        for triple in triples:
            graph.add(triple.subject, triple.predicate, triple.object)  # type: ignore[arg-type]
        self._extend(NamedNode(self.base + path), graph.triples)

    def update(self, mirror: Mirror) -> None:
        for name in [name for name, known in self._robots.items() if known.held is not mirror.robots.get(name)]:
            self.store.remove_graph(self._robots.pop(name).graph)
        for name, held in mirror.robots.items():
            known = self._robots.setdefault(name, _Robot(self.graph_of(name), held))
            with self._faults.guard(_PART, name):
                self._update_robot(known, held)
            self._note_fault(known, self._faults.find(_PART, name))
            known.said, known.seen, known.valued = held.said, held.seen, held.valued

    def _update_robot(self, known: _Robot, held: MirroredRobot) -> None:
        if known.said != held.said or known.fault:
            self._tell(known, held)
            return
        if known.seen != held.seen:
            self._measure(known, held)
        if known.valued != held.valued:
            self._write_other_parts(known, held.robot)

    def _note_fault(self, known: _Robot, reason: str) -> None:
        """State the reason why a robot is described in part only."""
        if known.fault == reason:
            return
        iri = known.graph
        self._exchange(iri, *([Triple(iri, LF.fault, Literal(each))] if each else [] for each in (known.fault, reason)))
        known.fault = reason

    # -- what is said -------------------------------------------------------------------------------------------------

    def _tell(self, known: _Robot, held: MirroredRobot) -> None:
        robot = held.robot
        # Documents overlap in their statements about parts, so none is removed while the parts are the same.
        basis = (robot.description, robot.model is None, robot.title, robot.parts)
        if basis != known.basis:
            self.store.remove_graph(known.graph)
            known.documents, known.values, known.values_of_parts = {}, {}, {}
            known.basis, known.fault = basis, ""
        self._write_robot(known, held)
        if robot.model is not None:
            self._write_parts(known, robot)
            self._write_other_parts(known, robot)
        self._measure(known, held)

    def _write_robot(self, known: _Robot, held: MirroredRobot) -> None:
        robot, path = held.robot, robot_path(held.robot.name)
        branches = [(NamedNode(term), other) for term, other in held.branches]
        tasks = [invocation_path(each) for each in held.tasks]
        self._write(known, path, None, lambda say, graph: say.robot(robot, tasks, branches, graph))
        self._write(known, "lease", None, lambda say, graph: describe_lease(graph, self.base, robot))
        others = {each.id: each for each in held.invocations}
        for each in held.invocations:
            self._write(known, each.id, None, partial(self._invocation, robot, each, others))
        for gone in [key for key in known.documents if "/" not in key and key not in (*others, "lease")]:
            self._replace(known, gone, _Document(None, "", []))
            del known.documents[gone]

    def invocation(self, one: Invocation, others: dict[str, Invocation], sees: Callable[[str], bool]) -> list[Triple]:
        """Return the triples of an invocation of the whole fleet; ``sees`` has the robots that the caller may see."""
        graph = Graph()
        answers = {name: answer for name, answer in one.robots.items() if sees(name)}
        describe_invocation(graph, self.base, None, one, others, answers)
        return graph.triples

    def _invocation(
        self, robot: Robot, one: Invocation, others: dict[str, Invocation], _: StaticDescriber, graph: Graph
    ) -> None:
        own = [each for each in one.unchecked if robot_of(each[0]) == robot.name]  # the caller may not see other robots
        describe_invocation(graph, self.base, robot, one, others, {}, own)

    def _write_parts(self, known: _Robot, robot: Robot) -> None:
        assert robot.model is not None
        common = _common(robot)
        for joint in robot.model.joints.values():
            path, key = joint_path(robot.name, joint.name), (*common, robot.targets.get(joint.name))
            self._write(known, path, key, partial(_joint, robot, joint))
        for link in robot.model.links.values():
            path = link_path(robot.name, robot.model, link.name)
            self._write(known, path, common, partial(_link, robot, link))

    def _write_other_parts(self, known: _Robot, robot: Robot) -> None:
        """Write what has changed in parts beside joints and links, and their values."""
        if robot.model is None:
            return
        for part in parts_of(robot).values():
            if part.path not in known.values_of_parts:
                items = part.properties(self.base)
                known.values_of_parts[part.path] = [_Value(part.path, item, self._fresh()) for item in items]
            self._write(known, part.path, (*_common(robot), part.facts()), partial(_part, part))
        self._look_at(known, known.values_of_parts)

    def _write(self, known: _Robot, name: str, key: object, describe: Callable[[StaticDescriber, Graph], None]) -> None:
        """Write the document ``name``, unless it was written for the same ``key``; None never matches."""
        held = known.documents.get(name)
        if held is not None and key is not None and held.key == key:
            return
        prefix = self._fresh() if held is None else held.prefix
        say, graph = StaticDescriber(self.base), LabelledGraph(prefix)
        describe(say, graph)
        self._replace(known, name, _Document(key, prefix, graph.triples))
        if say.measured and name not in known.values:
            known.values[name] = [_Value(owner, item, self._fresh()) for owner, item in say.measured]

    # -- what is measured ---------------------------------------------------------------------------------------------

    def _measure(self, known: _Robot, held: MirroredRobot) -> None:
        graph = Graph()
        self._say.last_frame(graph, known.graph, held.robot)
        self._replace(known, "/lastFrame", _Document(None, "", graph.triples))
        self._look_at(known, known.values)

    def _look_at(self, known: _Robot, by_document: Mapping[str, Sequence[_Value]]) -> None:
        old: list[Triple] = []
        new: list[Triple] = []
        for values in by_document.values():
            for value in values:
                self._look(value, old, new)
        self._exchange(known.graph, old, new)

    def _look(self, value: _Value, old: list[Triple], new: list[Triple]) -> None:
        measurement = Measurement.from_observations(value.item.sample())
        seen = measurement if value.item.is_measured else value.item.facts()
        if seen == value.seen:
            return
        graph = LabelledGraph(value.prefix)
        self._say.value(graph, value.owner, value.item, measurement)
        if len(graph.triples) == len(value.triples):
            for before, after in zip(value.triples, graph.triples, strict=True):
                if before != after:
                    old.append(before)
                    new.append(after)
        else:
            old += value.triples
            new += graph.triples
        value.seen, value.triples = seen, graph.triples

    def _fresh(self) -> str:
        self._documents += 1
        return f"d{self._documents}x"

    # -- the store ----------------------------------------------------------------------------------------------------

    def _replace(self, known: _Robot, name: str, document: _Document) -> None:
        before = known.documents.get(name)
        known.documents[name] = document
        if before is None:
            self._extend(known.graph, document.triples)
            return
        was, is_ = set(before.triples), set(document.triples)
        self._exchange(known.graph, was - is_, is_ - was)

    def _exchange(self, graph: NamedNode, old: Iterable[Triple], new: Iterable[Triple]) -> None:
        for triple in old:
            self.store.remove(_quad(triple, graph))
        self._extend(graph, new)

    def _extend(self, graph: NamedNode, triples: Iterable[Triple]) -> None:
        self.store.extend(_quad(triple, graph) for triple in triples)


def _quad(triple: Triple, graph: NamedNode) -> Quad:
    return Quad(triple.subject, triple.predicate, triple.object, graph)


def _joint(robot: Robot, joint: Joint, say: StaticDescriber, graph: Graph) -> None:
    say.joint(robot, joint, graph)


def _link(robot: Robot, link: Link, say: StaticDescriber, graph: Graph) -> None:
    say.link(robot, link, graph)


def _part(part: RobotPart, say: StaticDescriber, graph: Graph) -> None:
    PartDescriber(say.base).part(part, part.properties(say.base), graph)


def _common(robot: Robot) -> tuple[object, ...]:
    """Return the facts about a robot that the descriptions of its parts state."""
    return robot.online, None if robot.online else robot.last_seen_ns, robot.fault, robot.annotations
