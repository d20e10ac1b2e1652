"""Actions as things offer them (paper 5.4, figure 5a). The shape that describes the input also validates it."""

from collections.abc import Iterable
from dataclasses import dataclass

from pyoxigraph import Literal, NamedNode

from linked_fleet_gateway.fleet.model import Joint
from linked_fleet_gateway.fleet.robot import Robot
from linked_fleet_gateway.rdf.graph import Graph, Node
from linked_fleet_gateway.rdf.shapes import ACTIONS, closure, copy, load
from linked_fleet_gateway.rdf.vocabulary import DCTERMS, HTTP, HYBRIT, LF, METHODS, RDFS, SH
from linked_fleet_gateway.resources.action_conditions import CONDITIONS
from linked_fleet_gateway.resources.action_definition import Definition, definitions
from linked_fleet_gateway.resources.joint_kinds import kind_of
from linked_fleet_gateway.resources.paths import joint_path, robot_path
from linked_fleet_gateway.resources.shape_parameters import Scope, complete


@dataclass(frozen=True)
class Offer:
    """One kind of action at the thing with the path ``thing``."""

    definition: Definition
    thing: str
    robot: Robot | None = None
    joint: Joint | None = None

    @property
    def path(self) -> str:
        return f"{self.thing.rstrip('/')}/actions/{self.definition.segment}"

    @property
    def name(self) -> str:
        part = self.joint.name if self.joint else self.robot.name if self.robot else "the fleet"
        return f"{self.definition.title}: {part}"

    @property
    def methods(self) -> tuple[str, ...]:
        return tuple(sorted(("PUT" if method == METHODS.PUT else "POST") for method in self.definition.methods))

    @property
    def takes_body(self) -> bool:
        return self.definition.consumes is not None

    def describe(self, graph: Graph, base: str) -> None:
        """Describe the action as in figure 5a, corrected: limits on the value, per unit, and suitable methods."""
        iri, definition = NamedNode(base + self.path), self.definition
        graph.a(iri, HYBRIT.Action, HYBRIT.AsynchronousAction, definition.iri)
        graph.add(iri, DCTERMS.title, Literal(self.name))
        graph.add(iri, DCTERMS.identifier, Literal(definition.segment))
        graph.add(iri, RDFS.comment, Literal(definition.comment))
        graph.add(iri, RDFS.seeAlso, NamedNode(base + self.thing))
        if definition.consumes is not None:
            graph.add(iri, HYBRIT.consumes, self.consumes(graph, base))
        graph.add(iri, HYBRIT.produces, NamedNode(iri.value + "/produceshape"))
        body = graph.blank(HTTP.Body) if definition.consumes is not None else None
        for method in definition.methods:
            request = graph.blank(HTTP.Request)
            graph.add(iri, HYBRIT.binding, request)
            graph.add(request, HTTP.mthd, method)
            graph.add(request, HTTP.requestURI, iri)
            if body is not None:
                graph.add(request, HTTP.body, body)
        graph.add(iri, LF.dryRun, Literal(True))
        graph.add(iri, LF.invocations, NamedNode(iri.value + "/invocations"))

    def consumes(self, graph: Graph, base: str) -> Node:
        """Add the shape of the body, with the limits of this thing."""
        assert self.definition.consumes is not None
        scope = Scope(base, self.robot, self.joint)
        return copy(graph, load(ACTIONS), self.definition.consumes, complete(scope))

    def describe_result(self, graph: Graph, base: str) -> None:
        """Describe ``hybrit:produces``: the shape of the invocation resource that is created."""
        iri = NamedNode(f"{base}{self.path}/produceshape")
        graph.a(iri, SH.NodeShape)
        graph.add(iri, DCTERMS.title, Literal(f"What {self.name} produces"))
        graph.add(iri, SH.targetClass, LF.Invocation)
        graph.add(iri, SH.node, self.definition.produces)
        closure(graph, self.definition.produces)


def joint_offers(robot: Robot, joint: Joint, segment: str | None = None) -> list[Offer]:
    """Return the actions of a joint; none if it, or its robot, takes no commands.

    ``segment``: return only the action with this segment, if it is offered.
    """
    offered = _offered(kind_of(joint).type, robot, joint, segment)
    return [Offer(each, joint_path(robot.name, joint.name), robot, joint) for each in offered]


def robot_offers(robot: Robot, segment: str | None = None) -> list[Offer]:
    """Return the actions of a robot, or only the one with the segment, if it is offered."""
    return [Offer(each, robot_path(robot.name), robot) for each in _offered(LF.Robot, robot, None, segment)]


def fleet_offers(segment: str | None = None) -> list[Offer]:
    """Return the actions of the fleet, or only the one with the segment."""
    return [Offer(each, "/") for each in _named(segment) if LF.Fleet in each.offered_by]


def _offered(kind: NamedNode, robot: Robot, joint: Joint | None, segment: str | None) -> list[Definition]:
    able = robot.description.capabilities if robot.description is not None and robot.model is not None else ()
    kinds = [each for each in _named(segment) if kind in each.offered_by and each.capability in able]
    return [each for each in kinds if all(CONDITIONS[one](robot, joint) for one in each.offered_if)]


def _named(segment: str | None) -> Iterable[Definition]:
    return [each for each in definitions() if segment in (None, each.segment)]
