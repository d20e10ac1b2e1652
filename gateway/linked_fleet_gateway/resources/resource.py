"""Resources: the results of resolving a path in the tree."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

from msgspec import Struct, field
from msgspec.structs import replace
from pyoxigraph import Literal, NamedNode

from linked_fleet_gateway.resources.affordance import Affordance, ChangeSubscription, ResumeSubscription, Subscribe
from linked_fleet_gateway.resources.description import (
    DescriptionTemplate,
    InSteps,
    MeasuredDescription,
    run_steps,
)
from linked_fleet_gateway.resources.paths import owner_path
from linked_fleet_gateway.resources.subscription import Record
from linked_fleet_gateway.resources.versioning import Source
from linked_fleet_rdf.graph import Graph
from linked_fleet_rdf.shapes import describe_blueprint
from linked_fleet_rdf.vocabulary import LDP

_OF_SUBSCRIPTIONS = (Subscribe, ChangeSubscription, ResumeSubscription)
CONTAINER = (LDP.Resource, LDP.BasicContainer)


class Rendition(Struct, frozen=True):
    """A document of a resource, and what is known of it before it is written."""

    write: Callable[[], bytes]
    file_name: str = ""
    """Name under which it is saved (RFC 6266); of characters that need no quoting."""
    codings: Mapping[str, bytes] = field(default_factory=dict)
    """The same bytes in content codings, the preferred one first."""
    is_constant: bool = False
    """True if it has no measured values, so that it is in no message."""
    is_long: bool = False
    """True if it takes more than a few milliseconds, so that a thread writes it. It reads nothing that changes."""

    def __call__(self) -> bytes:
        return self.write()


class TypedLink(Struct, frozen=True):
    """A link with a registered relation (RFC 8288) to ``path``, which has the given media type."""

    relation: str
    path: str
    media_type: str


class Resource(Struct, frozen=True):
    """One resource; ``describe`` adds its triples, ``documents`` are its other representations by media type.

    Documents are functions, or ``Rendition`` to say more of them.

    ``describe`` is a function, ``InSteps`` if that takes long, or a template (``resources/description.py``).

    ``remote`` is an object that must be fetched at each GET or depends on the request; ``http/endpoint.py`` selects the
    reader by its type. ``affords`` has its methods other than reading. ``immutable`` says that the content at this path
    never changes.
    """

    path: str
    title: str
    describe: Callable[[Graph], None] | None
    interaction_model: tuple[NamedNode, ...] = (LDP.Resource, LDP.RDFSource)
    source: Source = field(default_factory=Source)
    own_paths: tuple[str, ...] = ()
    part_paths: tuple[str, ...] = ()
    typed_links: tuple[TypedLink, ...] = ()
    affords: Affordance | None = None
    documents: Mapping[str, Callable[[], bytes]] = field(default_factory=dict)
    remote: object | None = None
    linkset_of: "Resource | None" = None
    has_linkset: bool = False
    layout_path: str | None = None
    """Path of the layout of its binary frames."""
    immutable: bool = False
    publishes_changes: bool = True
    """True if its changes can be followed."""
    values_only_in_documents: bool = False
    """True if measured values appear only in ``documents`` and do not change the description."""
    has_form: bool = False
    """True if its page submits a form without a script."""

    def replace(self, **fields: Any) -> "Resource":
        """Return a copy with these fields."""
        return replace(self, **fields)

    def full_graph(self, base: str) -> Graph:
        """Return all triples of an RDF representation."""
        graph = Graph()
        run_steps(self.describe_in_steps(graph, base))
        return graph

    def describe_in_steps(self, graph: Graph, base: str) -> Iterator[None]:
        """Add all triples of an RDF representation, one step of the description after the other."""
        yield from self.own_steps(graph)
        self.add_interaction_model(graph, base)

    def own_steps(self, graph: Graph) -> Iterator[None]:
        """Add the triples of its description, in steps."""
        if isinstance(self.describe, InSteps):
            yield from self.describe.steps(graph)
        elif self.describe is not None:
            self.describe(graph)

    def add_interaction_model(self, graph: Graph, base: str, path: str = "") -> None:
        """Add the type ldp:RDFSource, which clients need not infer (R1.7). Containers state their own types."""
        if LDP.RDFSource in self.interaction_model:
            graph.a(NamedNode(base + (path or self.path)), LDP.RDFSource)

    def rendition(self, media_type: str) -> Rendition | None:
        """Return its document in a media type; None if it has none."""
        found = self.documents.get(media_type)
        return found if found is None or isinstance(found, Rendition) else Rendition(found)

    @property
    def template(self) -> DescriptionTemplate | None:
        """The template of its kind; None if it has none."""
        return self.describe if isinstance(self.describe, DescriptionTemplate) else None

    @property
    def is_long(self) -> bool:
        """True if its description takes more than a few milliseconds."""
        return isinstance(self.describe, InSteps)

    @property
    def shows_values(self) -> bool:
        """True if its description has measured values."""
        return isinstance(self.describe, MeasuredDescription)

    @property
    def linkset_path(self) -> str:
        return self.path.rstrip("/") + "/linkset"

    @property
    def observable(self) -> bool:
        """True if it can be subscribed to. Subscriptions cannot, because they change with every message about them."""
        return self.describe is not None and self.publishes_changes and not isinstance(self.affords, _OF_SUBSCRIPTIONS)

    @property
    def subscription(self) -> Record | None:
        """The subscription that it represents, or None."""
        return self.affords.record if isinstance(self.affords, ChangeSubscription) else None

    @property
    def owner_path(self) -> str:
        """Path of the fleet, robot, joint or link that owns it, or that it is."""
        return owner_path(self.path)


def blueprint_of(
    resource: Resource, base: str, shapes: tuple[NamedNode, ...], source: Source | None = None
) -> Resource:
    """Return the blueprint of a resource (paper 5.1); ``source`` is given if it can change."""
    return blueprint_at(resource.path, base, shapes, source or Source())


def blueprint_at(owned_by: str, base: str, shapes: tuple[NamedNode, ...], source: Source) -> Resource:
    """Return the blueprint of the resource at the path ``owned_by``."""

    def describe(graph: Graph, owner: str, _: Sequence[Literal] = ()) -> None:
        iri = NamedNode(base + owner.rstrip("/") + "/blueprint")
        describe_blueprint(graph, iri, NamedNode(base + owner), shapes)

    return Resource(
        owned_by.rstrip("/") + "/blueprint",
        f"Blueprint of {owned_by}",
        DescriptionTemplate(shapes, owned_by, describe),
        source=source,
    )


class Redirect(Struct, frozen=True):
    """The canonical spelling of a path with a wrong trailing slash."""

    path: str
