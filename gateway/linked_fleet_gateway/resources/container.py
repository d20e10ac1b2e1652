"""Containers of records that clients create, replace and delete, and that all gateways share (LDP 1.0, 5.2). Pure."""

from collections.abc import Awaitable, Callable, Iterator, Mapping, Sequence, Set
from dataclasses import dataclass, field
from functools import cached_property, partial
from hashlib import blake2b
from operator import itemgetter
from typing import TYPE_CHECKING, Any, ClassVar, Generic, TypeVar

from pyoxigraph import Literal, NamedNode, Triple

from linked_fleet_base.records import Records, update_record
from linked_fleet_gateway.resources.action_offer import Offer, offers_of
from linked_fleet_gateway.resources.action_tree import resolve_action
from linked_fleet_gateway.resources.affordance import FORM_TYPES, NOTHING, Demand, Honours
from linked_fleet_gateway.resources.body_values import Body
from linked_fleet_gateway.resources.branches import FleetBranch, Found, RequestView
from linked_fleet_gateway.resources.description import InSteps
from linked_fleet_gateway.resources.form import Form
from linked_fleet_gateway.resources.json_form import form_of
from linked_fleet_gateway.resources.plain_json import add_plain_json
from linked_fleet_gateway.resources.resource import CONTAINER, Resource, blueprint_of
from linked_fleet_gateway.resources.versioning import Source
from linked_fleet_identity.rights import Identity, Right, View
from linked_fleet_rdf.graph import Graph, Node
from linked_fleet_rdf.serialise import JSON
from linked_fleet_rdf.vocabulary import DCTERMS, HYBRIT, LDP, LF, RDFS
from linked_fleet_state.invocations import FLEET, Invocation

if TYPE_CHECKING:
    from linked_fleet_gateway.resources.tree import Tree

T = TypeVar("T")
_BLUEPRINT = "blueprint"
_MAX_AT_ONCE = 50
"""Members that are described without letting others have a turn."""


async def _accept(record: object, tree: "Tree", caller: Identity) -> None:
    """Let clients write what its shape allows."""


@dataclass(frozen=True)
class Container(Generic[T]):
    """A container at ``/{segment}`` whose members are records.

    ``type`` and ``member_type`` are the classes of the container and of its members. Kinds of actions with
    ``lf:offeredBy`` the class of members are actions of each member, those with the class of the container are its own.
    """

    segment: str
    title: str
    type: NamedNode
    member_type: NamedNode
    records: Records[T]
    shape: NamedNode
    """Shape of the body of POST and PUT, in a file of ``Extension.shapes``."""
    read: Callable[[Body], T]
    """Returns the record of a body that conforms to the shape. Raises UnprocessableContent for what a shape cannot
    say."""
    describe: Callable[[Graph, "Member[T]"], None]
    """Adds the statements about a member besides its types and title, and all that a client must send back."""
    title_of: Callable[[T], str]
    predicate: NamedNode | None = None
    """Links the container from the fleet's description."""
    blueprint: NamedNode = LF.ContainerShape
    """Shape of the container itself."""
    member_blueprint: NamedNode = LF.MemberShape
    """Shape of a member."""
    writing: tuple[Right, ...] = (Right.ADMIN,)
    """Rights, one of which is needed to create, replace and delete members."""
    reading: tuple[Right, ...] = (Right.READ,)
    """Rights, one of which is needed to read the container and its members."""
    deep: Set[NamedNode] = frozenset()
    """Predicates of a member whose values ``read`` judges itself, with all that these lead to: no shape does."""
    form: "Callable[[str], Form] | None" = None
    """Returns the JSON form of bodies for an IRI, if that is not the form of ``shape``."""
    json: "Callable[[Member[T]], bytes] | None" = None
    """Returns the JSON document of a member, likewise."""
    formats: "Mapping[str, tuple[Callable[[bytes, str], list[Triple]], Callable[[Member[T]], bytes]]]" = field(
        default_factory=dict
    )
    """Further representations of members by media type: functions that return the statements of a body sent to an IRI
    (raises BadRequest, UnprocessableContent), and the document of a member."""
    check: "Callable[[T, Tree, Identity], Awaitable[None]]" = _accept
    """Checks what a client writes against the fleet as it sees it. Raises UnprocessableContent, InsufficientScope."""
    rehearse: "Callable[[T, RequestView, Any], Awaitable[tuple[float, Callable[[Graph, Node], None]]]] | None" = None
    """Rehearses a record that a client would write, with ``serving.Caller``, for ``Prefer: dry-run,
    return=representation``. Returns its duration (s), and a function that adds statements about the node of the
    rehearsal. Raises FleetError."""
    owned: Callable[[T, Identity, str], bool] = lambda record, caller, client: True
    """Returns True if a client, by its name, may replace or delete a member."""
    kept: Callable[[T, T], T] = lambda present, record: record
    """Returns a record that replaces the present one, with what clients do not write of that, such as what actions have
    noted."""
    signed: Callable[[T, Identity, str], T] = lambda record, caller, client: record
    """Returns a record with who has written it, if that is kept; ``client`` is the name by which it is counted."""
    facts: "Callable[[Member[T]], object]" = lambda member: None
    """Returns what the description of a member depends on besides its record."""
    actions: "Callable[[Member[T]], Sequence[Offer]]" = lambda member: ()
    """Returns further actions of a member, which are no kinds of their own."""
    visible: "Callable[[T, View], bool] | None" = None
    """Returns whether a caller who sees these robots sees a member; everybody does by default. With it the members are
    not in queries."""
    by_clients: bool = True
    """False if actions create and change the members, and clients only read and delete them."""

    @property
    def path(self) -> str:
        return "/" + self.segment

    def form_at(self, iri: str) -> Form:
        """Return the JSON form of a body for an IRI."""
        return form_of(self.shape) if self.form is None else self.form(iri)

    def member_path(self, id: str) -> str:
        return f"{self.path}/{id}"

    def offers(self, member: str, label: str, segment: str | None = None) -> list[Offer]:
        """Return the actions of a member at a path, or only the one with the segment; ``label`` names the member."""
        return offers_of(self.member_type, member, label, segment)

    async def update(self, id: str, update: Callable[[T], T]) -> T | None:
        """Replace the record of a member by what ``update`` makes of it, whoever changes it meanwhile.

        Return the record, None if it is not there any more. Raises RedisUnavailable, ContainerFull, and the errors of
        ``update``.
        """
        return await update_record(self.records, id, update)

    def own_offers(self, segment: str | None = None) -> list[Offer]:
        """Return the actions of the container itself, or only the one with the segment."""
        return offers_of(self.type, self.path, self.title, segment)

    @property
    def branch(self) -> FleetBranch:
        """The branch of the tree, for ``Mount.branches``."""
        return FleetBranch(self.segment, self.predicate, self._resolve, graphs=self._graphs(), container=self)

    def _graphs(self) -> "Callable[[RequestView], Iterator[tuple[str, Sequence[Triple]]]] | None":
        """Return the statements for copies of the fleet; None if not everybody who reads the fleet may read them."""
        return self._all if self.reading == (Right.READ,) and self.visible is None else None

    def _all(self, view: RequestView) -> Iterator[tuple[str, Sequence[Triple]]]:
        yield self.path, self._whole(view).full_graph(view.base).triples

    def members(self, view: RequestView) -> "Iterator[Member[T]]":
        """Yield the members, of which there may be thousands, in an order that is the same at all gateways."""
        return (Member(self, view, id, record) for id, record in self._seen(view))

    def _seen(self, view: RequestView) -> Iterator[tuple[str, T]]:
        known = sorted(self.records.known.items(), key=itemgetter(0))
        return (each for each in known if self._is_visible(each[1], view))

    def _is_visible(self, record: T, view: RequestView) -> bool:
        return self.visible is None or self.visible(record, view.visible_robots)

    def own_actions(self, view: RequestView) -> "Iterator[tuple[Member[T], Sequence[Offer]]]":
        """Yield each member that has actions of its own, with these."""
        for each in self.members(view):
            if offers := self.actions(each):
                yield each, offers

    def member(self, view: RequestView, id: str) -> "Member[T] | None":
        """Return the member with this id; None if there is none."""
        record = self.records.known.get(id)
        return None if record is None or not self._is_visible(record, view) else Member(self, view, id, record)

    def _resolve(self, view: RequestView, rest: list[str]) -> Found:
        if not rest:
            return self._whole(view)
        if rest == [_BLUEPRINT]:
            return blueprint_of(self._whole(view), view.base, (self.blueprint, self.shape))
        if rest[0] == "actions" and len(rest) > 1 and (own := self.own_offers(rest[1])):
            return resolve_action(own, rest[1:], view.invocations, Source(lambda: self.path), view.base)
        member = self.member(view, rest[0])
        return None if member is None else member.resolve(rest[1:])

    def _whole(self, view: RequestView) -> Resource:
        path, steps = self.path, InSteps(lambda graph: self._describe(graph, view))
        return Resource(
            path,
            self.title,
            steps if len(self.records.known) > _MAX_AT_ONCE else steps.__call__,
            CONTAINER,
            Source(lambda: self._facts(view)),
            own_paths=(f"{path}/{_BLUEPRINT}", *(each.path for each in self.own_offers())),
            part_paths=tuple([f"{path}/{id}" for id, _ in self._seen(view)]),
            affords=AddMember(self) if self.by_clients else None,
        )

    def _facts(self, view: RequestView) -> list[object]:
        """Return the facts of all members, which may be thousands."""
        running = dict[str, list[str]]()
        for each in view.invocations.open_of_robot(FLEET):
            thing, actions, _ = each.action.partition("/actions/")
            if actions and thing.startswith(self.path + "/"):
                running.setdefault(thing, []).append(each.action + each.id)
        return [
            (each.id, self._digest(each.id, each.record), running.get(each.path), self.facts(each))
            for each in self.members(view)
        ]

    @cached_property
    def _digests(self) -> dict[str, tuple[T, str]]:
        return {}

    def _digest(self, id: str, record: T) -> str:
        """Return what differs between records, kept until a record is replaced."""
        held = self._digests.get(id)
        if held is None or held[0] is not record:
            held = self._digests[id] = record, blake2b(repr(record).encode(), digest_size=8).hexdigest()
            if len(self._digests) > len(self.records.known) + _MAX_AT_ONCE:
                for gone in self._digests.keys() - self.records.known.keys():
                    del self._digests[gone]
        return held[1]

    def _describe(self, graph: Graph, view: RequestView) -> Iterator[None]:
        iri = view.iri(self.path)
        graph.a(iri, self.type, LDP.BasicContainer, LDP.Container)
        graph.add(iri, DCTERMS.title, Literal(self.title))
        graph.add(iri, RDFS.seeAlso, view.iri("/"))
        graph.add(iri, HYBRIT.blueprint, NamedNode(f"{iri.value}/{_BLUEPRINT}"))
        if self.by_clients:
            graph.add(iri, HYBRIT.consumes, self.shape)
        graph.add(iri, HYBRIT.action, *(view.iri(each.path) for each in self.own_offers()))
        for each in self.members(view):
            graph.add(iri, LDP.contains, each.iri)
            each.describe(graph)
            yield


@dataclass(frozen=True)
class Member(Generic[T]):
    """A member of a container, as a caller sees it."""

    container: Container[T]
    view: RequestView
    id: str
    record: T

    @property
    def path(self) -> str:
        return self.container.member_path(self.id)

    @property
    def iri(self) -> NamedNode:
        return self.view.iri(self.path)

    def running(self, segment: str) -> list[Invocation]:
        """Return the invocations of one of its actions that have not ended, newest first."""
        return self.view.invocations.open_of_action(f"{self.path}/actions/{segment}")

    @property
    def facts(self) -> tuple[Any, ...]:
        """The facts that determine its description, equal on all gateways."""
        kinds = [each.definition.segment for each in self.offers()]
        running = [[each.id for each in self.running(kind)] for kind in kinds]
        return self.id, self.record, running, self.container.facts(self)

    def offers(self, segment: str | None = None) -> list[Offer]:
        """Return its actions, or only the one with the segment."""
        own = [each for each in self.container.actions(self) if segment in (None, each.definition.segment)]
        return [*self.container.offers(self.path, self.title, segment), *own]

    @property
    def title(self) -> str:
        """Its title; its id if the extension fails to name it, which is a fault of the gateway."""
        with self.view.faults.guard(self.container.path, thing=f"title of {self.id}"):
            return self.container.title_of(self.record)
        return self.id

    def describe(self, graph: Graph) -> None:
        """Add all statements about it."""
        iri = self.iri
        graph.a(iri, self.container.member_type)
        graph.add(iri, DCTERMS.title, Literal(self.title))
        graph.add(iri, HYBRIT.action, *(self.view.iri(each.path) for each in self.offers()))
        # An error about one member must not hide the others, here and in queries.
        with self.view.faults.guard(self.container.path, thing=f"description of {self.id}"):
            self.container.describe(graph, self)

    def resource(self) -> Resource:
        container, view, id = self.container, self.view, self.id

        def facts() -> object:
            present = container.member(view, id)
            return None if present is None else present.facts

        resource = Resource(
            self.path,
            self.title,
            self._describe_alone,
            source=Source(facts),
            own_paths=(f"{self.path}/{_BLUEPRINT}", *(each.path for each in self.offers())),
            affords=ChangeMember(container, id) if container.by_clients else RemoveMember(container, id),
        )
        further = {media_type: partial(write, self) for media_type, (_, write) in container.formats.items()}
        if (write := container.json) is not None:
            further[JSON] = partial(write, self)
        else:
            resource = add_plain_json(resource, container.shape, view.base)
        return resource.replace(documents={**resource.documents, **further})

    def _describe_alone(self, graph: Graph) -> None:
        self.describe(graph)
        graph.add(self.iri, HYBRIT.blueprint, NamedNode(f"{self.iri.value}/{_BLUEPRINT}"))
        if self.container.by_clients:
            graph.add(self.iri, HYBRIT.consumes, self.container.shape)

    def resolve(self, rest: list[str]) -> Found:
        """Return the resource at the segments below its path."""
        if not rest:
            return self.resource()
        if rest == [_BLUEPRINT]:
            shapes = self.container.member_blueprint, self.container.shape
            return blueprint_of(self.resource(), self.view.base, shapes)
        if rest[0] == "actions" and len(rest) > 1:
            source = Source(lambda: (self.id, self.record))
            return resolve_action(self.offers(rest[1]), rest[1:], self.view.invocations, source, self.view.base)
        return None


@dataclass(frozen=True)
class _OfContainer:
    """Writes of a container, by those with the rights that it asks for."""

    container: Container[Any]
    reads: ClassVar[bool] = False

    @property
    def body_types(self) -> tuple[str, ...]:
        return (*FORM_TYPES, *self.container.formats)

    @property
    def needs(self) -> tuple[Right, ...]:
        return self.container.writing

    @property
    def reading(self) -> tuple[Right, ...]:
        return self.container.reading


@dataclass(frozen=True)
class AddMember(_OfContainer):
    """Add a member to a container."""

    methods: ClassVar[tuple[str, ...]] = ("POST",)
    honours: ClassVar[Honours] = frozenset({Demand.DRY_RUN})


@dataclass(frozen=True)
class ChangeMember(_OfContainer):
    """Replace a member of a container, or delete it."""

    id: str
    methods: ClassVar[tuple[str, ...]] = ("PUT", "PATCH", "DELETE")
    honours: ClassVar[Honours] = frozenset({Demand.DRY_RUN})


@dataclass(frozen=True)
class RemoveMember(ChangeMember):
    """Delete a member of a container that clients do not write."""

    methods: ClassVar[tuple[str, ...]] = ("DELETE",)
    honours: ClassVar[Honours] = NOTHING
