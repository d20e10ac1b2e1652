"""Branches of the tree: resources that an extension adds to the fleet, to robots or to properties.

The tree knows only the segment of a branch. The branch resolves the rest of the path for what the caller may see.
"""

from collections.abc import Awaitable, Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any

from msgspec import Struct, field
from pyoxigraph import NamedNode, Triple

from linked_fleet_base.faults import Faults
from linked_fleet_gateway.resources.access_filter import InvocationsInView
from linked_fleet_gateway.resources.part import RobotPart
from linked_fleet_gateway.resources.property import Property
from linked_fleet_gateway.resources.resource import Redirect, Rendition, Resource, TypedLink
from linked_fleet_identity.rights import Identity, Right, View
from linked_fleet_state.carried import CarriedPose
from linked_fleet_state.model import Joint, Link, Pose
from linked_fleet_state.robot import Robot

Found = Resource | Redirect | None


class RequestView(Struct, frozen=True):
    """The fleet as seen by a caller: visible robots and invocations, under one base URL."""

    base: str
    robots: Mapping[str, Robot]
    invocations: InvocationsInView
    visible_robots: View
    requires_authentication: bool = False
    """True if callers must authenticate."""
    faults: Faults = field(default_factory=Faults)
    """The faults of the gateway, in which faces note what they cannot describe."""

    def iri(self, path: str) -> NamedNode:
        return NamedNode(self.base + path)


@dataclass(frozen=True)
class FleetBranch:
    """Resources at ``/{segment}`` and below.

    ``resolve`` gets the segments after its own: none for ``/{segment}``, one empty one for ``/{segment}/``.
    ``predicate`` links ``/{segment}`` from the fleet's description; None for no link.
    """

    segment: str
    predicate: NamedNode | None
    resolve: Callable[[RequestView, list[str]], Found] = lambda view, rest: None
    allows_encoded_slashes: bool = False
    """True if later segments may contain encoded slashes."""
    graphs: Callable[[RequestView], Iterable[tuple[str, Sequence[Triple]]]] | None = None
    """All statements of its resources by path, for copies of the whole fleet.

    Blank node labels must be unique among all branches that describe the same path.
    """
    poses: Callable[[], Mapping[str, Pose | CarriedPose]] | None = None
    """Poses of its resources in the common frame of robots, or on links that carry them, by path."""
    container: Any = None
    """The ``Container`` that the resources are of, if the core answers its writes; else None."""
    link: tuple[str, str] | None = None
    """Relation and media type of a link from ``/`` to ``/{segment}`` in its Link field and link set."""
    reading: tuple[Right, ...] = ()
    """Rights, one of which its readers need for some robot, instead of the right to read; ``ADMIN`` for all robots.

    The Link field and link set of ``/`` have a link for them alone. Its description has none, so ``predicate`` is None.
    """
    load: Callable[[RequestView, list[str]], Awaitable[Resource]] | None = None
    """Reads a resource from a store for each request, instead of ``resolve``. Raises NotFound and other errors."""

    @property
    def path(self) -> str:
        return "/" + self.segment


@dataclass(frozen=True)
class RobotBranch:
    """Resources at ``/{robot}/{segment}`` and below; ``applies_to`` selects the robots."""

    segment: str
    predicate: NamedNode | None
    resolve: Callable[[RequestView, Robot, list[str]], Found]
    applies_to: Callable[[Robot], bool] = lambda robot: True


@dataclass(frozen=True)
class PropertyBranch:
    """Resources at ``{property}/{segment}`` and below; ``applies_to`` selects the properties.

    ``resolve`` gets the path of the property's owner, the property, and the segments after its own.
    """

    segment: str
    resolve: Callable[[RequestView, Robot, str, Property, list[str]], Found]
    applies_to: Callable[[Property], bool]


@dataclass(frozen=True)
class ThingDocument:
    """A further representation of the fleet, robots and their parts that contains no measured values.

    ``write`` gets the robot (None for the fleet), and its part (None for the robot itself).
    """

    media_type: str
    write: Callable[[RequestView, Robot | None, Joint | Link | RobotPart | None], bytes]


Branch = FleetBranch | RobotBranch | PropertyBranch | ThingDocument


@dataclass(frozen=True)
class Branches:
    """All branches. Their segments are reserved in ``gateway/linked_fleet_gateway/resources/paths.py``."""

    fleet_branches: tuple[FleetBranch, ...] = ()
    robot_branches: tuple[RobotBranch, ...] = ()
    property_branches: tuple[PropertyBranch, ...] = ()
    documents: tuple[ThingDocument, ...] = ()

    def with_branches(self, *added: Branch) -> "Branches":
        """Return these branches and the added ones."""
        return Branches(
            (*self.fleet_branches, *(each for each in added if isinstance(each, FleetBranch))),
            (*self.robot_branches, *(each for each in added if isinstance(each, RobotBranch))),
            (*self.property_branches, *(each for each in added if isinstance(each, PropertyBranch))),
            (*self.documents, *(each for each in added if isinstance(each, ThingDocument))),
        )

    def thing_documents(
        self, view: RequestView, robot: Robot | None = None, part: Joint | Link | RobotPart | None = None
    ) -> dict[str, Callable[[], bytes]]:
        """Return the further representations of a thing by media type."""
        return {
            each.media_type: Rendition(partial(each.write, view, robot, part), is_constant=True)
            for each in self.documents
        }

    def allows_encoded_slashes(self, path: str) -> bool:
        """Return True if the path is below a branch whose segments may contain encoded slashes."""
        branch = self.fleet_branch(path[1:].partition("/")[0])
        return branch is not None and branch.allows_encoded_slashes

    def graphs(self, view: RequestView) -> Iterator[tuple[str, Sequence[Triple]]]:
        """Yield path and statements of the graphs of all branches."""
        for branch in self.fleet_branches:
            if branch.graphs is not None:
                yield from branch.graphs(view)

    @property
    def containers(self) -> list[Any]:
        """The containers whose writes the core answers."""
        return [each.container for each in self.fleet_branches if each.container is not None]

    def poses(self) -> dict[str, Pose | CarriedPose]:
        """Poses of resources of branches in the frame that robots have in common, or on links, by path."""
        return {path: pose for each in self.fleet_branches if each.poses for path, pose in each.poses().items()}

    @cached_property
    def _restricted(self) -> tuple[FleetBranch, ...]:
        return tuple(each for each in self.fleet_branches if each.reading)

    def restricted_paths(self, caller: Identity) -> tuple[str, ...]:
        """Return the paths of the branches with ``reading`` that the caller may read."""
        return tuple(each.path for each in self._restricted if caller.has_any_right(each.reading, None))

    @cached_property
    def _stored(self) -> Mapping[str, FleetBranch]:
        return {each.segment: each for each in self.fleet_branches if each.load is not None}

    def stored_branch(self, path: str) -> FleetBranch | None:
        """Return the branch at or above the path, if its resources are read from a store."""
        return self._stored.get(path[1:].partition("/")[0])

    def reading(self, path: str) -> tuple[Right, ...]:
        """Return the rights, one of which readers of the path need; empty if its branch does not say so."""
        segment = path[1:].partition("/")[0]
        return next((each.reading for each in self._restricted if each.segment == segment), ())

    def fleet_branch(self, segment: str) -> FleetBranch | None:
        return next((each for each in self.fleet_branches if each.segment == segment), None)

    def robot_branch(self, robot: Robot, segment: str) -> RobotBranch | None:
        return next((each for each in self.robot_branches if each.segment == segment and each.applies_to(robot)), None)

    def property_branch(self, item: Property, segment: str) -> PropertyBranch | None:
        return next(
            (each for each in self.property_branches if each.segment == segment and each.applies_to(item)), None
        )

    def property_paths(self, path: str, item: Property) -> tuple[str, ...]:
        """Return the paths of the branches of the property at ``path``."""
        return tuple(f"{path}/{each.segment}" for each in self.property_branches if each.applies_to(item))

    def fleet_links(self) -> list[tuple[NamedNode, str]]:
        """Return predicate and path of the branches that the fleet's description links."""
        return [(each.predicate, each.path) for each in self.fleet_branches if each.predicate is not None]

    def typed_links(self) -> tuple[TypedLink, ...]:
        """Return the links of the fleet to branches with a link relation."""
        return tuple(TypedLink(each.link[0], each.path, each.link[1]) for each in self.fleet_branches if each.link)

    def robot_links(self, robot: Robot, path: str) -> list[tuple[NamedNode, str]]:
        """Return predicate and path of the branches that the description of a robot at ``path`` links."""
        named = [(each.predicate, each) for each in self.robot_branches if each.predicate is not None]
        return [(predicate, path + each.segment) for predicate, each in named if each.applies_to(robot)]


NO_BRANCHES = Branches()
