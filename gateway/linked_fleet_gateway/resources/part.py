"""Parts of robots that extensions add beside joints and links, such as components (paper 5.1)."""

from collections.abc import Mapping, Sequence
from typing import Any, Protocol

from pyoxigraph import NamedNode

from linked_fleet_gateway.fleet.invocation import Invocation
from linked_fleet_gateway.fleet.robot import Robot
from linked_fleet_gateway.rdf.graph import Graph
from linked_fleet_gateway.resources.action_offer import Offer
from linked_fleet_gateway.resources.property import Property


class RobotPart(Protocol):
    """A part of a robot. Its path is that of the robot and its ``segment`` (``paths.part_segment``)."""

    @property
    def robot(self) -> Robot: ...

    @property
    def name(self) -> str: ...

    @property
    def title(self) -> str: ...

    @property
    def path(self) -> str: ...

    @property
    def types(self) -> Sequence[NamedNode]:
        """Its classes."""

    @property
    def shapes(self) -> Sequence[NamedNode]:
        """The shapes that it conforms to, of which blueprints are made."""

    @property
    def offers(self) -> Mapping[str, Offer]:
        """Its actions by segment."""

    def properties(self, base: str) -> Sequence[Property]:
        """Return its properties under a base URL."""

    def facts(self) -> object:
        """Return all that its description depends on, except its properties."""

    def describe(self, graph: Graph, iri: NamedNode, base: str) -> None:
        """Add further statements about it."""

    def json(self) -> bytes:
        """Return its present values in JSON."""

    def describe_outcome(self, graph: Graph, iri: NamedNode, base: str, invocation: Invocation) -> None:
        """Add the feedback and the result of an invocation of one of its actions."""

    def outcome_json(self, invocation: Invocation) -> Mapping[str, Any]:
        """Return the feedback and the result of an invocation in JSON, by name."""


def parts_of(robot: Robot) -> Mapping[str, RobotPart]:
    """Return the parts that extensions have added to a robot, by segment."""
    return robot.parts
