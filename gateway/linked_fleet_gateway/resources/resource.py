"""Resources: the results of resolving a path of the tree."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

from pyoxigraph import NamedNode

from linked_fleet_agent.wire.messages import Mesh
from linked_fleet_gateway.fleet.robot import Robot
from linked_fleet_gateway.rdf.graph import Graph
from linked_fleet_gateway.rdf.shapes import blueprint
from linked_fleet_gateway.rdf.vocabulary import LDP
from linked_fleet_gateway.resources.affordance import Affordance, ChangeSubscription, ResumeSubscription, Subscribe
from linked_fleet_gateway.resources.paths import owner_path
from linked_fleet_gateway.resources.property import Look, Seen
from linked_fleet_gateway.resources.subscription import Record
from linked_fleet_gateway.resources.versioning import Source

_OF_SUBSCRIPTIONS = (Subscribe, ChangeSubscription, ResumeSubscription)
CONTAINER = (LDP.Resource, LDP.BasicContainer)


@dataclass(frozen=True)
class Remote:
    """A mesh that ``robot`` has to be asked for; the rest is known without asking."""

    robot: Robot
    mesh: Mesh


@dataclass(frozen=True)
class Alike:
    """Resources of which one is written and the others are copied: their descriptions differ in the owner's path alone.

    ``key`` is compared. ``describe`` describes the one whose owner is at the path that it is given.
    """

    key: object
    owner: str
    describe: Callable[[Graph, str], None]


@dataclass(frozen=True)
class TypedLink:
    """A link whose relation is registered (RFC 8288), from a resource to ``path``; ``media_type`` is what is there."""

    relation: str
    path: str
    media_type: str


@dataclass(frozen=True)
class Resource:
    """One resource; ``describe`` adds its triples, ``documents`` are its other representations by media type.

    ``remote``: what has to be asked for at each GET, where that is not known here, or depends on the request; by its
    type ``http/endpoint.py`` finds who answers. ``affords`` says what can be done to it besides reading;
    ``immutable``: what is at this path is never anything else.
    """

    path: str
    title: str
    describe: Callable[[Graph], None] | None
    interaction: tuple[NamedNode, ...] = (LDP.Resource, LDP.RDFSource)
    source: Source = field(default_factory=Source)
    own: tuple[str, ...] = ()
    parts: tuple[str, ...] = ()
    links: tuple[TypedLink, ...] = ()
    affords: Affordance | None = None
    documents: Mapping[str, Callable[[], bytes]] = field(default_factory=dict)
    constant: frozenset[str] = frozenset()
    """Media types of ``documents`` that are in no message, because no value stands in them."""
    remote: object | None = None
    linkset_of: "Resource | None" = None
    has_linkset: bool = False
    layout: str | None = None
    """Path of what describes its binary frames."""
    immutable: bool = False
    coded: Mapping[str, bytes] = field(default_factory=dict)
    """Its only document in content codings, the preferred one first."""
    measured: Callable[[Graph, Sequence[Seen]], None] | None = None
    """``describe`` with other values than the present ones, of each of ``looks`` one; None where none is measured."""
    alike: Alike | None = None
    """Resources whose description is the same but for their path."""
    looks: tuple[Look, ...] = ()
    """The measured values that it shows, in the order of its properties."""
    query: str = ""
    """With which it was asked for, where that makes a difference."""
    followed: bool = True
    """True if anything follows it as it changes."""
    news_in_documents: bool = False
    """True if what is measured shows in ``documents`` alone, and is no news of the description."""
    forms: bool = False
    """True if its page sends a form without a script."""
    reader: str = ""
    """The name of the person who has logged in and reads it as a page."""
    rights: tuple[str, ...] | None = None
    """The rights of who reads it over what it is about; None where nobody has to say who they are."""
    audited: bool = False
    """True if who reads it may read the audit."""
    links_subscriptions: bool = True
    """Its page links its Subscriptions container, which not everybody who reads the page may read."""
    warning: str = ""
    """One sentence about the gateway that its page shows."""

    def read_as(self, other: "Resource") -> "Resource":
        """This resource for the reader for whom ``other`` was found."""
        return replace(self, reader=other.reader, rights=other.rights, audited=other.audited, warning=other.warning)

    def whole(self, base: str) -> Graph:
        """All that a representation in RDF says."""
        graph = Graph()
        if self.describe is not None:
            self.describe(graph)
        self.state_model(graph, base)
        return graph

    def state_model(self, graph: Graph, base: str, path: str = "") -> None:
        """Say in its description, too, that it is an RDF source, which nobody has to infer (R1.7).

        Containers say themselves what they are.
        """
        if LDP.RDFSource in self.interaction:
            graph.a(NamedNode(base + (path or self.path)), LDP.RDFSource)

    @property
    def linkset(self) -> str:
        return self.path.rstrip("/") + "/linkset"

    @property
    def observable(self) -> bool:
        """True if it can be subscribed to. Subscriptions cannot: they change with every message about them."""
        return self.describe is not None and self.followed and not isinstance(self.affords, _OF_SUBSCRIPTIONS)

    @property
    def subscription(self) -> Record | None:
        """The subscription that it is."""
        return self.affords.record if isinstance(self.affords, ChangeSubscription) else None

    @property
    def owner(self) -> str:
        """Path of the fleet, robot, joint or link that owns it, or that it is."""
        return owner_path(self.path)


def blueprint_of(
    resource: Resource, base: str, shapes: tuple[NamedNode, ...], source: Source | None = None
) -> Resource:
    """The blueprint of a resource (paper 5.1); ``source``: what it follows from, if it is not always the same."""

    def describe(graph: Graph, owner: str) -> None:
        iri = NamedNode(base + owner.rstrip("/") + "/blueprint")
        blueprint(graph, iri, NamedNode(base + owner), shapes)

    return Resource(
        resource.path.rstrip("/") + "/blueprint",
        f"Blueprint of {resource.path}",
        lambda graph: describe(graph, resource.path),
        source=source or Source(),
        alike=Alike((shapes, resource.path.endswith("/")), resource.path, describe),
    )


@dataclass(frozen=True)
class Redirect:
    """The one spelling of a path that has another (with or without the slash at its end)."""

    path: str
