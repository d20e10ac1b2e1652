"""A wing of the tree: what a package of its own (the world, rules, queries …) adds to fleet, robots or properties.

The tree knows wings by their segment alone. Each gets what who asks may see, and finds its own resources in it.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from pyoxigraph import NamedNode

from gateway.fleet.robot import Robot
from gateway.identity.rights import View
from gateway.resources.access_filter import InvocationsInView
from gateway.resources.property import Property
from gateway.resources.resource import Redirect, Resource

Found = Resource | Redirect | None


@dataclass(frozen=True)
class Sight:
    """The fleet as it is to who asks: the robots and invocations that they may see, under one base URL."""

    base: str
    robots: Mapping[str, Robot]
    invocations: InvocationsInView
    sees: View
    secured: bool = False
    """Whether who asks has to say who they are."""

    def iri(self, path: str) -> NamedNode:
        return NamedNode(self.base + path)


@dataclass(frozen=True)
class FleetWing:
    """Resources at ``/{segment}`` and below it.

    ``resolve`` gets the segments behind its own: none for ``/{segment}``, one empty one for ``/{segment}/``.
    ``predicate``: by which the fleet's description names ``/{segment}``, or None where nothing leads there.
    """

    segment: str
    predicate: NamedNode | None
    resolve: Callable[[Sight, list[str]], Found]

    @property
    def path(self) -> str:
        return "/" + self.segment


@dataclass(frozen=True)
class RobotWing:
    """Resources at ``/{robot}/{segment}`` and below it; ``has``: whether a robot has any."""

    segment: str
    predicate: NamedNode | None
    resolve: Callable[[Sight, Robot, list[str]], Found]
    has: Callable[[Robot], bool] = lambda robot: True


@dataclass(frozen=True)
class PropertyWing:
    """Resources at ``{property}/{segment}`` and below it; ``has``: which properties have any.

    ``resolve`` gets the path of the thing that has the property, the property, and the segments behind its own.
    """

    segment: str
    resolve: Callable[[Sight, Robot, str, Property, list[str]], Found]
    has: Callable[[Property], bool]


@dataclass(frozen=True)
class Wings:
    """All that there are. Their segments are reserved in ``gateway/resources/paths.py``."""

    of_fleet: tuple[FleetWing, ...] = ()
    of_robots: tuple[RobotWing, ...] = ()
    of_properties: tuple[PropertyWing, ...] = ()

    def at_root(self, segment: str) -> FleetWing | None:
        return next((each for each in self.of_fleet if each.segment == segment), None)

    def in_robot(self, robot: Robot, segment: str) -> RobotWing | None:
        return next((each for each in self.of_robots if each.segment == segment and each.has(robot)), None)

    def below_property(self, item: Property, segment: str) -> PropertyWing | None:
        return next((each for each in self.of_properties if each.segment == segment and each.has(item)), None)

    def related_to(self, path: str, item: Property) -> tuple[str, ...]:
        """Paths of those that the property at ``path`` has."""
        return tuple(f"{path}/{each.segment}" for each in self.of_properties if each.has(item))

    def linked(self) -> list[tuple[NamedNode, str]]:
        """Predicate and path of those that the fleet names."""
        return [(each.predicate, each.path) for each in self.of_fleet if each.predicate is not None]

    def linked_from(self, robot: Robot, path: str) -> list[tuple[NamedNode, str]]:
        """Predicate and path of those that a robot at ``path`` names."""
        named = [(each.predicate, each) for each in self.of_robots if each.predicate is not None]
        return [(predicate, path + each.segment) for predicate, each in named if each.has(robot)]


NONE = Wings()
