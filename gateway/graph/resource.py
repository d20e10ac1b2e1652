"""What a path of the tree resolves to."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from pyoxigraph import NamedNode

from gateway.graph.actions import JointMotion
from gateway.graph.build import Graph
from gateway.graph.paths import owner_path
from gateway.graph.reading import Source
from gateway.graph.vocab import LDP
from gateway.subscriptions.subscription import Record

CONTAINER = (LDP.Resource, LDP.BasicContainer)


@dataclass(frozen=True)
class Resource:
    """One resource; ``describe`` adds its triples, ``documents`` are its other representations by media type.

    At most one of ``action``, ``subscriptions_of`` (the thing whose subscriptions it lists), ``subscription`` and
    ``resumes`` says what can be done to it.
    """

    path: str
    title: str
    describe: Callable[[Graph], None] | None
    interaction: tuple[NamedNode, ...] = (LDP.Resource, LDP.RDFSource)
    source: Source = field(default_factory=Source)
    own: tuple[str, ...] = ()
    parts: tuple[str, ...] = ()
    action: JointMotion | None = None
    subscriptions_of: str | None = None
    subscription: Record | None = None
    resumes: Record | None = None
    documents: Mapping[str, Callable[[], bytes]] = field(default_factory=dict)
    linkset_of: "Resource | None" = None
    has_linkset: bool = False

    @property
    def linkset(self) -> str:
        return self.path.rstrip("/") + "/linkset"

    @property
    def observable(self) -> bool:
        """Whether it can be subscribed to. Subscriptions cannot: they change with every message about them."""
        return self.describe is not None and not (self.subscriptions_of or self.subscription or self.resumes)

    @property
    def owner(self) -> str:
        """Path of the fleet, robot, joint or link that owns it, or that it is."""
        return owner_path(self.path)


@dataclass(frozen=True)
class Redirect:
    """The one spelling of a path that has another (with or without the slash at its end)."""

    path: str
