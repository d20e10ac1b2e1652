"""Parts of robots that extensions add beside joints and links, such as components (paper 5.1)."""

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, Protocol

from pyoxigraph import NamedNode

from linked_fleet_agent.planar import DriveLimits
from linked_fleet_gateway.resources.action_offer import Offer
from linked_fleet_gateway.resources.form import Json
from linked_fleet_gateway.resources.paths import robot_path
from linked_fleet_rdf.graph import Graph
from linked_fleet_state.driving import FollowedPath
from linked_fleet_state.gripper import Gripper
from linked_fleet_state.invocation import Invocation
from linked_fleet_state.robot import Robot

if TYPE_CHECKING:
    from linked_fleet_gateway.resources.property import Property


class PartCopier(Protocol):
    """Copies the parts of robots to processes that hear no robot, such as that of queries."""

    @staticmethod
    def version(robot: Robot) -> object:
        """Return what differs after each change of the values of its parts."""

    @staticmethod
    def write(robot: Robot) -> bytes:
        """Return the values of its parts."""

    @staticmethod
    def make(robot: Robot) -> "Mapping[str, RobotPart]":
        """Return the parts of the copy of a robot, from its description."""

    @staticmethod
    def read(robot: Robot, values: bytes) -> None:
        """Give the parts of the copy of a robot the values that ``write`` has returned."""


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

    @property
    def copier(self) -> type[PartCopier]:
        """The class that copies all parts of its robot. Its module is imported by other processes too."""

    @property
    def battery_percent(self) -> float | None:
        """The charge of the battery, if it is one whose charge is known."""

    @property
    def path_ahead(self) -> FollowedPath | None:
        """The path that a base follows, from where it is now, as it says; None if it follows none."""

    @property
    def drive_limits(self) -> DriveLimits | None:
        """The limits of a base; None if it does not say how it brakes."""

    @property
    def gripper(self) -> Gripper | None:
        """The state of a gripper; None if it is no gripper."""

    def properties(self, base: str) -> "Sequence[Property]":
        """Return its properties under a base URL."""

    def facts(self) -> object:
        """Return all that its description depends on, except its properties."""

    def describe(self, graph: Graph, iri: NamedNode, base: str) -> None:
        """Add further statements about it."""

    def json(self) -> bytes:
        """Return its present values in JSON."""

    @property
    def json_schema(self) -> Json:
        """The JSON Schema of ``json``."""

    def streams(self) -> Mapping[str, tuple[Json, Callable[[], bytes]]]:
        """Return what it says from time to time by path: its values together, and each of its events.

        Each is a JSON Schema, and a function that returns the latest in JSON. Unknown values are left out.
        """

    def describe_outcome(self, graph: Graph, iri: NamedNode, base: str, invocation: Invocation) -> None:
        """Add the feedback and the result of an invocation of one of its actions."""

    def outcome_json(self, invocation: Invocation) -> Mapping[str, Any]:
        """Return the feedback and the result of an invocation in JSON, by name."""


def parts_of(robot: Robot) -> Mapping[str, RobotPart]:
    """Return the parts that extensions have added to a robot, by segment."""
    return robot.parts


def path_ahead(robot: Robot) -> FollowedPath | None:
    """Return the path that the base of a robot follows, from where it is now; None if it says none."""
    return next((path for each in parts_of(robot).values() if (path := each.path_ahead) is not None), None)


def drive_limits(robot: Robot) -> DriveLimits | None:
    """Return the limits of the base of a robot; None if it does not say how it brakes."""
    return next((most for each in parts_of(robot).values() if (most := each.drive_limits) is not None), None)


def part_of(robot: Robot, invocation: Invocation) -> RobotPart | None:
    """Return the part of a robot whose action it is, if that is neither joint nor link."""
    segment = invocation.action.removeprefix(robot_path(robot.name)).partition("/actions/")[0]
    return parts_of(robot).get(segment)
