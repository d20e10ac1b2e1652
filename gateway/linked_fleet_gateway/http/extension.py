"""The interface of extensions: packages that add a capability to the gateway without changes outside their folder."""

from collections.abc import AsyncIterator, Awaitable, Callable, Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractAsyncContextManager, asynccontextmanager, contextmanager, nullcontext
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from types import MappingProxyType
from typing import Any, ClassVar, TypeVar

import msgspec
from prometheus_client.metrics_core import Metric
from pyoxigraph import Literal, NamedNode, Triple
from starlette.types import ASGIApp

from linked_fleet_base.faults import Faults
from linked_fleet_base.settings import Section, SectionT, section
from linked_fleet_gateway.actions.action_handlers import Handler
from linked_fleet_gateway.actions.admission import validate_action_body
from linked_fleet_gateway.actions.execution import invoke, rehearse
from linked_fleet_gateway.actions.guards import MotionGuard, MotionPlanner
from linked_fleet_gateway.actions.operations import Operation
from linked_fleet_gateway.actions.plan import Caller, RobotTime
from linked_fleet_gateway.actions.rehearsals import Rehearsal
from linked_fleet_gateway.actions.service import Actions
from linked_fleet_gateway.actions.store import kept_token, own_token
from linked_fleet_gateway.http.arrival import Scheme
from linked_fleet_gateway.http.body import parse_form
from linked_fleet_gateway.http.request import Request
from linked_fleet_gateway.http.request_events import RequestEvent, RequestEvents
from linked_fleet_gateway.http.websocket import WebSocketHandler
from linked_fleet_gateway.http.writes import PatchReader
from linked_fleet_gateway.resources.action_offer import Offer
from linked_fleet_gateway.resources.body_values import Body
from linked_fleet_gateway.resources.branches import Branch, RequestView
from linked_fleet_gateway.resources.container import Container
from linked_fleet_gateway.resources.form import Json
from linked_fleet_gateway.resources.html import HtmlWriter, NavigationEntry
from linked_fleet_gateway.resources.part import RobotPart
from linked_fleet_gateway.resources.property import Property
from linked_fleet_gateway.resources.resource import Resource
from linked_fleet_gateway.subscriptions.live import Live, name_of
from linked_fleet_identity.service import Identities
from linked_fleet_link.incoming import Hear, OfComponents
from linked_fleet_rdf.serialise import JSON
from linked_fleet_runtime.replica import Copy
from linked_fleet_runtime.table import MAX_RECORDS, StoredRecords, Table
from linked_fleet_state.functions import FleetFunctions
from linked_fleet_state.invocation import Invocation
from linked_fleet_state.invocations import FLEET
from linked_fleet_state.model import Link, Pose
from linked_fleet_state.robot import KeptPose, Robot

Reader = Callable[[Request, Resource, Any], Awaitable[ASGIApp]]
"""Answers GET of a resource; the last argument is its ``remote``."""
Writer = Callable[[Request, Any], Awaitable[ASGIApp]]
"""Answers other methods of a resource; the last argument is its ``affords``."""
T = TypeVar("T")


@dataclass(frozen=True)
class Core:
    """The parts of the gateway that an extension may use, before the gateway joins the fleet."""

    live: Live
    actions: Actions
    request_events: RequestEvents
    identities: Identities | None
    redis_url: str
    namespace: str
    """Prefix of every Zenoh and Redis key."""
    run: str
    """Unique name of this run of the gateway."""
    public_urls: Sequence[str]
    state_path: Path
    """Folder for persistent files."""
    extensions: "Sequence[Extension]" = ()
    """All extensions that are on."""
    extension: str = ""
    """Name of the extension that is given this object."""
    sections: Sequence[Section] = ()
    """Settings of the extensions."""
    services: Sequence[object] = ()
    """Services of the extensions started before."""

    @property
    def navigation(self) -> Sequence[NavigationEntry]:
        """The navigation links of all extensions."""
        return [entry for each in self.extensions for entry in each.navigation]

    @property
    def robots(self) -> Mapping[str, Robot]:
        """All robots by name, whoever may see them."""
        return self.live.fleet.robots

    @property
    def faults(self) -> Faults:
        """The faults of the gateway: an error ``with core.faults.guard(…)`` is one of what the arguments name."""
        return self.live.faults

    def mark_changed(self, *paths: str) -> None:
        """Tell the subscribers of resources that these have changed."""
        self.live.fan_out.mark_changed(*paths)

    @contextmanager
    def listening(self, listener: Callable[[str | None], None]) -> Iterator[None]:
        """Call ``listener`` at every change of any robot while the context lasts: with its name for a frame, even if no
        value changed, and with None for anything else.
        """
        self.live.add_listener(listener)
        try:
            yield
        finally:
            self.live.remove_listener(listener)

    @contextmanager
    def listening_to_invocations(self, listener: Callable[[Invocation], None]) -> Iterator[None]:
        """Call ``listener`` with an invocation whenever a field of it changes, and once more when it is forgotten.

        Those of other gateways are included, and at the start those that Redis has kept. It is the same object each
        time.
        """
        self.live.add_invocation_listener(listener)
        try:
            yield
        finally:
            self.live.remove_invocation_listener(listener)

    @contextmanager
    def listening_to_stops(self, listener: Callable[[Collection[str] | None], None]) -> Iterator[None]:
        """Call ``listener`` with the robots (None: all) that a client stops, before the stop is sent.

        Stops of rules, and of single joints, are not included. An error of it is a fault of the extension, and does not
        keep the stop from its robots.
        """

        def hear(robots: Collection[str] | None) -> None:
            with self.faults.guard("listeners", thing=name_of(listener)):
                listener(robots)

        self.actions.stop_listeners.append(hear)
        try:
            yield
        finally:
            self.actions.stop_listeners.remove(hear)

    async def invoke(
        self,
        offer: Offer,
        base: str,
        caller: Caller,
        statements: Sequence[Triple] = (),
        moment: RobotTime | None = None,
    ) -> Invocation:
        """Invoke an action for a client, and return the accepted invocation. The extension has checked its rights.

        ``statements`` are those of the body, whose IRIs begin with ``base``. ``moment`` is the time of its robot at
        which the client knew the fleet: a stop since then takes precedence. Raises FleetError.
        """
        return await invoke(self.actions, offer, base, caller, statements, moment)

    def resume(self, id: str, operation: Operation, caller: Caller) -> bool:
        """Go on here with an operation that ``resumes``, whose gateway has gone.

        Return False if the invocation has ended, is not known, or goes on here already.
        """
        return self.actions.operations.resume(id, operation, caller)

    def statements(self, offer: Offer, base: str, given: Json) -> Sequence[Triple]:
        """Return the JSON form of an action's input as statements. Raises UnprocessableContent."""
        from linked_fleet_gateway.resources.json_form import form_of_input

        form, iri = partial(form_of_input, offer, base), base + offer.path
        return parse_form(msgspec.json.encode(given), JSON, iri, base, form)

    async def rehearse(
        self,
        offer: Offer,
        base: str,
        caller: Caller,
        statements: Sequence[Triple] = (),
        assumed: Mapping[str, Robot] = MappingProxyType({}),
    ) -> Rehearsal:
        """Return what ``invoke`` would do. ``assumed`` are robots that stand elsewhere by then, by name
        (``Robot.standing_at``). Raises FleetError.
        """
        return await rehearse(self.actions, offer, base, caller, statements, assumed)

    def silence_s(self, invocation: Invocation) -> float:
        """Return how long the gateway of an operation has not reported on it, in seconds."""
        return self.actions.lifecycle.silence_s(invocation)

    def check_input(self, offer: Offer, base: str, statements: Sequence[Triple]) -> Body:
        """Check the input of an action as ``invoke`` does, and return it. Raises UnprocessableContent."""
        return validate_action_body(offer, statements, base)

    @contextmanager
    def listening_to_requests(self, listener: Callable[[RequestEvent], None]) -> Iterator[None]:
        """Call ``listener`` when a request other than a read has been executed, or refused although its resource was
        found, and when a stream begins or ends, while the context lasts. An error of it is a fault of the extension.
        """
        self.request_events.listeners[listener] = self.extension
        try:
            yield
        finally:
            del self.request_events.listeners[listener]

    def tell_of_request(self, event: RequestEvent) -> None:
        """Tell those who listen to requests of something that the extension has done in the name of a client."""
        self.request_events.tell(event)

    async def set_setting(self, robot: Robot, name: str, value: str | None) -> bool:
        """Replace the known value of a setting of a robot for all gateways, or remove it for None.

        It is for actions, whose invocation has been checked against the control lease. Returns False, without a change,
        if another gateway has changed the setting; its value is then known. Raises RedisUnavailable.
        """
        return await self.actions.lifecycle.replicated_state.change_setting(robot, name, value)

    def control_token(self, token: str) -> str:
        """Return the token with which an extension takes control of robots for a caller: the caller's, if it has one.

        No client can use another one.
        """
        return token or own_token()

    async def take_control(self, robot: Robot, holder: str, duration_s: float, token: str) -> None:
        """Take the control lease of a robot, or renew it; ``holder`` is shown. Raises Controlled, RedisUnavailable."""
        shared = self.actions.lifecycle.replicated_state
        await shared.take_lease(robot, holder, duration_s, token, None, own=token)

    async def has_control(self, robot: Robot, token: str) -> bool:
        """Return True if the control lease of a robot is held by this token. Raises RedisUnavailable."""
        return await self.actions.lifecycle.replicated_state.has_lease(robot, token)

    def kept_token(self, token: str) -> str:
        """Return what may be kept of the token of a control lease: a client cannot use it, but an extension can."""
        return kept_token(token)

    async def hand_over_control(
        self, robot: Robot, token: str, new_token: str, holder: str, duration_s: float, *, may_be_person: bool
    ) -> bool:
        """Give the control lease of a robot to another holder with a token of its own; nobody can take it in between.

        ``may_be_person``: whether the new holder may have the priority of a person, if the lease has it. Return False
        if nobody has control. Raises Controlled, RedisUnavailable.
        """
        shared = self.actions.lifecycle.replicated_state
        return await shared.hand_over_lease(robot, token, new_token, holder, duration_s, may_be_person=may_be_person)

    async def release_control(self, robot: Robot, token: str) -> None:
        """Release the control lease of a robot, if somebody has it. Raises Controlled, RedisUnavailable."""
        await self.actions.lifecycle.replicated_state.release_lease(robot, token)

    def running(self, action: str) -> list[Invocation]:
        """Return the invocations of the action at a path that have not ended, at whichever gateway, newest first."""
        return self.live.invocations.open_of_action(action)

    def hear_components(self, kind: OfComponents, listener: Hear) -> None:
        """Call ``listener`` with the name of a robot and each message of its components of a kind, which it decodes.

        Called before the gateway joins the fleet. A WireError that it raises is counted.
        """
        self.live.link.listeners[kind] = listener

    def set_parts(self, robot: str, parts: Mapping[str, RobotPart], findings: Sequence[str] = ()) -> None:
        """Replace the parts of a robot that are neither joints nor links, by path segment.

        ``findings`` are sentences about parts that could not be taken, which the robot then shows.
        """
        self.live.set_parts(robot, parts, findings)

    def set_poses(self, robot: str, poses: Mapping[str, KeptPose]) -> None:
        """Replace the poses that the extension keeps for a robot, by title: the robot names them, and its actions take
        them.
        """
        self.live.set_poses(robot, poses)

    def mark_values_changed(self, robot: str, *paths: str) -> None:
        """Tell the subscribers of resources of a robot that values in them have changed, which no frame has."""
        self.live.fan_out.mark_values_changed(robot, *paths)

    def reject(self, robot: str, reason: str) -> None:
        """Count something that a robot said and that is refused."""
        self.live.link.reject(robot, reason)

    @contextmanager
    def listening_to_descriptions(
        self, described: Callable[[str], None], removed: Callable[[str], None]
    ) -> Iterator[None]:
        """Call ``described`` with the name of each robot that has described itself, also anew after it was away, and
        ``removed`` with that of one that was removed, while the context lasts.
        """
        self.live.on_described[described] = self.live.on_removed[removed] = None
        try:
            yield
        finally:
            del self.live.on_described[described], self.live.on_removed[removed]

    async def cancel(self, invocation: str, reason: str) -> bool:
        """Cancel the invocation with this id, at whichever gateway. Return False if it has ended, or is not known.

        Raises AgentTimeout if whoever carries it out does not answer in time.
        """
        found = self.live.invocations.get(invocation)
        if found is None or found.state.terminal:
            return False
        await self.actions.lifecycle.cancel(found, reason)
        return True

    async def wait_until(
        self, invocation: Invocation, condition: Callable[[Invocation], bool], timeout_s: float
    ) -> bool:
        """Wait until the invocation meets a condition; return False after the timeout, or when the gateway ends."""
        return await self.actions.lifecycle.waiters.wait_until_or_shutdown(invocation, condition, timeout_s)

    async def has_ended(self, invocation: str, robot: str = FLEET) -> bool:
        """Return True if the invocation with this id has ended, at whichever gateway, or there is none any more.

        ``robot`` is that of its action, if it is the action of one. One that this gateway does not know is looked for
        in Redis. Raises RedisUnavailable.
        """
        found = self.live.invocations.get(invocation)
        if found is None:
            found = await self.actions.lifecycle.replicated_state.fetch(robot, invocation)
        return found is None or found.state.terminal

    def table(
        self,
        name: str,
        record: type[T],
        on_change: Callable[[str, T | None, T | None], None] = lambda id, before, after: None,
        most: int = MAX_RECORDS,
    ) -> Table[T]:
        """Return a table of at most ``most`` records of the extension, which all gateways share. Enter it by ``async
        with``. ``record`` is a type that msgspec converts to and from JSON, such as a frozen ``msgspec.Struct``.
        ``on_change`` is called with id, record before and record after (None if there is none), also for changes of
        other gateways, and for each record while the table opens. An extension that guards motions must open each:
        until then motions are refused.
        """
        stored = StoredRecords(self.redis_url, self.namespace, self.extension, name, most)
        decode = msgspec.json.Decoder(record).decode
        noun = name if name == self.extension else f"{self.extension} {name}"
        table = Table(stored, noun, msgspec.json.encode, decode, on_change, self.live.faults)
        self.add_copy(table.noun, table)
        return table

    @asynccontextmanager
    async def open_container(
        self, name: str, record: type[T], make: Callable[[Table[T]], Container[T]], most: int = MAX_RECORDS
    ) -> AsyncIterator[Container[T]]:
        """Yield the container of at most ``most`` members that ``make`` returns for a table of the extension. Its
        subscribers hear of changes.
        """

        def tell(id: str, before: T | None, after: T | None) -> None:
            if before is None:
                self.live.fan_out.add_resource(container.member_path(id))
            self.live.fan_out.mark_changed(container.member_path(id), container.path)

        table = self.table(name, record, tell, most)
        container = make(table)
        async with table:
            yield container

    def add_copy(self, noun: str, copy: Copy) -> None:
        """Let the gateway get ready once a copy of what gateways share is read, as ``table`` does for its records.

        If the extension guards motions, they are refused before. ``noun`` is a plural.
        """
        guards = any(each.guards_motions for each in self.extensions if each.name == self.extension)
        self.live.copies.add(noun, copy, needed_by_motions=guards)

    def section(self, kind: type[SectionT]) -> SectionT:
        """Return the settings of this type, which the extension names in ``settings``. Raises LookupError."""
        return section(self.sections, kind)

    def service(self, kind: type[T]) -> T:
        """Return the service of this type from an extension in ``needs``. Raises LookupError."""
        found = self.optional_service(kind)
        if found is None:
            raise LookupError(f"no extension that was started before has a {kind.__name__}")
        return found

    def optional_service(self, kind: type[T]) -> T | None:
        """Return the service of this type from an extension in ``uses``; None if that is off."""
        return next((each for each in self.services if isinstance(each, kind)), None)


@dataclass(frozen=True)
class Mount:
    """The contributions of an extension. Every field is optional."""

    branches: Sequence[Branch] = ()
    """Resources of the tree."""
    readers: Mapping[type, Reader] = field(default_factory=dict)
    """Handlers of GET by the type of a resource's ``remote``."""
    writers: Mapping[type, Writer] = field(default_factory=dict)
    """Handlers of other methods by the type of a resource's ``affords``."""
    websocket_handlers: Mapping[type, WebSocketHandler] = field(default_factory=dict)
    """Handlers of WebSockets in subprotocols, by the type of a resource's ``remote`` or ``affords``."""
    formats: Mapping[str, tuple[str, str]] = field(default_factory=dict)
    """Label and media type of further representations, by their word in ``?as=``."""
    subprotocols: Mapping[str, str] = field(default_factory=dict)
    """Media types of messages about its resources, by the WebSocket subprotocol (``lf.…``) that selects them."""
    html: HtmlWriter | None = None
    """Renderer of HTML pages; at most one extension has it."""
    scheme: Scheme | None = None
    """An authentication scheme besides bearer tokens."""
    handlers: Mapping[NamedNode, Handler] = field(default_factory=dict)
    """Handlers of the kinds of actions of the extension."""
    guard: MotionGuard | None = None
    """Guard of motions before they are accepted. It fails closed."""
    planner: MotionPlanner | None = None
    """Finds other paths for motions than the direct ones; at most one extension has it."""
    not_ready: Callable[[], str] = str
    """Returns the reason why a starting gateway is not ready yet; empty if it is."""
    metrics: Callable[[], Iterable[Metric]] = tuple
    """Returns metrics for ``/metrics``; called in a thread."""
    services: Sequence[object] = ()
    """Objects for dependent extensions, found by their type."""


class Extension:
    """Base class of extensions. Everything except the name is optional."""

    name: ClassVar[str]
    needs: ClassVar[tuple[str, ...]] = ()
    """Names of extensions that must be started before."""
    uses: ClassVar[tuple[str, ...]] = ()
    """Names of extensions that are started before if they are on."""
    modules: ClassVar[tuple[str, ...]] = ()
    """Top-level modules of optional packages. If one is missing, the extension is off and this is logged."""
    at_root: ClassVar[tuple[str, ...]] = ()
    """Segments below ``/`` reserved for the extension, even if it is off; robots with these names are escaped."""
    public: ClassVar[tuple[str, ...]] = ()
    """Reserved segments whose resources contain nothing about a fleet, so that everybody may read them."""
    carriers: ClassVar[tuple[str, ...]] = ()
    """Reserved segments whose requests carry other requests in their bodies, which may be stops.

    They are not rate-limited and do not wait for a turn until the extension, having read the body, calls
    ``http.entrance.await_turn``.
    """
    request_fields: ClassVar[tuple[str, ...]] = ()
    """Header fields, in lower case, that pages of other sites may send (CORS), if the operator permits them."""
    response_fields: ClassVar[tuple[str, ...]] = ()
    """Header fields that such pages may read in responses."""
    guards_motions: ClassVar[bool] = False
    """True if its ``Mount`` has a ``guard``. If it cannot be started, motions are refused."""
    in_robot: ClassVar[tuple[str, ...]] = ()
    """Segments below a robot reserved for the extension, likewise."""
    vocabulary: ClassVar[tuple[Path, ...]] = ()
    """Turtle files of terms, and of shapes of input of its containers, contained in /vocabulary."""
    shapes: ClassVar[tuple[Path, ...]] = ()
    """Turtle files of blueprints, and of shapes (``…Input``) of input of PUT. Statements about shapes of the core are
    added to these."""
    kinds: ClassVar[tuple[Path, ...]] = ()
    """Turtle files of kinds of actions, in the form of those in shapes/linked_fleet_shapes/actions."""
    robot_properties: ClassVar[tuple[Callable[[Robot], Property], ...]] = ()
    """Further properties of robots: functions from a robot to a property."""
    placements: ClassVar[tuple[Callable[[Robot], Pose | None], ...]] = ()
    """Functions from a robot to the pose of its own frame in a common one, None if unknown. Poses of other things:
    ``FleetBranch.poses``."""
    component_things: ClassVar[Mapping[tuple[str, str], Mapping[str, tuple[str, str]]]] = {}
    """Members that name things, added to the inputs of actions of components that move something: by kind (IRI) and
    action the predicate (IRI) and the description of each member. Guards see them, robots do not.
    """
    link_statements: ClassVar[tuple[Callable[[Robot, Link], Iterable[tuple[NamedNode, str]]], ...]] = ()
    """Further statements about links: functions of robot and link, which return predicates and paths."""
    introductions: ClassVar[tuple[Callable[[Robot], Iterable[tuple[NamedNode, Literal]]], ...]] = ()
    """Further statements about a robot where the fleet lists it: functions of a robot, which return predicates and
    values.
    """
    functions: ClassVar[tuple[type[FleetFunctions], ...]] = ()
    """Functions over the live fleet for query languages. The module of the class is imported by other processes too."""
    patches: ClassVar[Mapping[str, PatchReader]] = {}
    """Readers of bodies of PATCH by their media type: functions of body and base IRI, called in a thread if it is long.

    Each returns a function from the triples of a description to the changed ones. Both raise errors of the contract.
    """
    settings: ClassVar[type[Section] | None] = None
    """Section of settings, with its own prefix."""
    navigation: ClassVar[tuple[NavigationEntry, ...]] = ()
    """Links on all pages while the extension is on."""

    def views(self) -> Sequence[object]:
        """Return the views of its pages, each a ``PageView``. It is called only if the extension ``pages`` is on."""
        return ()

    def operations(self, view: RequestView) -> Mapping[str, Mapping[str, Any]]:
        """Return the path items (OpenAPI 3.1, 4.8.9) of its resources by template, as far as they exist for the caller.

        Those of containers, and of kinds of actions, follow from their shapes. Common responses (304, 400, 401, 403,
        404, 405, 406, 412, 421, 429, 431, 500, 503) and security schemes are added to each operation.
        """
        return {}

    def start(self, core: Core) -> AbstractAsyncContextManager[Mount]:
        """Start the extension, yield its contributions, and stop everything when the context is left."""
        return nullcontext(Mount())
