"""The contract of extensions: a package that adds a capability to the gateway, without a line outside its folder."""

from collections.abc import Awaitable, Callable, Iterable, Mapping, Sequence
from contextlib import AbstractAsyncContextManager, nullcontext
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar, TypeVar

from prometheus_client.metrics_core import Metric
from pyoxigraph import NamedNode
from starlette.types import ASGIApp

from linked_fleet_gateway.actions.handler_table import Handler
from linked_fleet_gateway.actions.service import Actions, MotionGuard
from linked_fleet_gateway.base.settings import Section, SectionT, section
from linked_fleet_gateway.http.authentication import Scheme
from linked_fleet_gateway.http.conversation import Speaker
from linked_fleet_gateway.http.html import HtmlWriter, NavigationEntry
from linked_fleet_gateway.http.request import Request
from linked_fleet_gateway.identity.service import Identities
from linked_fleet_gateway.resources.branches import Branch, RequestView
from linked_fleet_gateway.resources.resource import Resource
from linked_fleet_gateway.runtime.audit_log import Audit
from linked_fleet_gateway.subscriptions.live import Live

Reader = Callable[[Request, Resource, Any], Awaitable[ASGIApp]]
"""Answers GET of a resource; the last argument is its ``remote``."""
Writer = Callable[[Request, Any], Awaitable[ASGIApp]]
"""Answers any other method of a resource; the last argument is its ``affords``."""
Operations = Callable[[RequestView], Mapping[str, Mapping[str, Any]]]
"""Path items (OpenAPI 3.1, 4.8.9) by their templates, of what exists to who asks. Answers that any resource gives
(304, 400, 401, 403, 404, 405, 406, 412, 421, 429, 500, 503) and security schemes are added to each operation."""
T = TypeVar("T")


@dataclass(frozen=True)
class Core:
    """The parts of the gateway that an extension may use. It has not joined the fleet yet."""

    live: Live
    actions: Actions
    audit: Audit
    identities: Identities | None
    redis_url: str
    namespace: str
    """Prefix of every Zenoh and Redis key."""
    run: str
    """Name of this run of the gateway among the gateways."""
    public_urls: Sequence[str]
    state_path: Path
    """Folder for files that outlive the process."""
    views: Sequence[str] = ()
    """The page views of all extensions, as ``module:attribute``."""
    operations: Sequence[str] = ()
    """The operations of all extensions, as ``module:attribute``."""
    navigation: Sequence[NavigationEntry] = ()
    """The links of all extensions that all pages have."""
    sections: Sequence[Section] = ()
    """Settings of the extensions."""
    services: Sequence[object] = ()
    """Services of the extensions that were started before."""

    def section(self, kind: type[SectionT]) -> SectionT:
        """The settings of the extension that says in ``settings`` that they are its own. Raises LookupError."""
        return section(self.sections, kind)

    def service(self, kind: type[T]) -> T:
        """The service of this type that an extension named in ``needs`` has. Raises LookupError."""
        found = self.optional_service(kind)
        if found is None:
            raise LookupError(f"no extension that was started before has a {kind.__name__}")
        return found

    def optional_service(self, kind: type[T]) -> T | None:
        """The service of this type that an extension named in ``uses`` has; None where that is off."""
        return next((each for each in self.services if isinstance(each, kind)), None)


@dataclass(frozen=True)
class Mount:
    """All that an extension adds. Every field is optional."""

    branches: Sequence[Branch] = ()
    """Resources of the tree."""
    readers: Mapping[type, Reader] = field(default_factory=dict)
    """Readers by the type of a resource's ``remote``: each answers its GET."""
    writers: Mapping[type, Writer] = field(default_factory=dict)
    """Writers by the type of a resource's ``affords``: each answers its other methods."""
    speakers: Mapping[type, Speaker] = field(default_factory=dict)
    """Speakers by the type of a resource's ``remote`` or ``affords``: each serves WebSockets at it, in subprotocols of
    its own."""
    formats: Mapping[str, tuple[str, str]] = field(default_factory=dict)
    """Label and media type of further representations, by the word that picks one in ``?as=``."""
    html: HtmlWriter | None = None
    """Writer of pages; one extension has it."""
    scheme: Scheme | None = None
    """A way to say who asks, beside bearer tokens."""
    handlers: Mapping[NamedNode, Handler] = field(default_factory=dict)
    """Handlers of the kinds of actions that the extension brings."""
    guard: MotionGuard | None = None
    """Judge of motions before they are accepted. It fails closed."""
    not_ready: Callable[[], str] = str
    """The reason why a gateway that starts is not ready yet; empty if it is."""
    metrics: Callable[[], Iterable[Metric]] = tuple
    """Numbers for ``/metrics``, collected in a thread beside the event loop."""
    services: Sequence[object] = ()
    """Objects for the extensions that need this one, found by their type."""


class Extension:
    """Base class of extensions. Everything is optional but the name."""

    name: ClassVar[str]
    needs: ClassVar[tuple[str, ...]] = ()
    """Names of extensions that are started before."""
    uses: ClassVar[tuple[str, ...]] = ()
    """Names of extensions that are started before where they are on, and that may be off."""
    modules: ClassVar[tuple[str, ...]] = ()
    """Top-level modules of optional packages. The extension is off where one is not installed, and the log says so."""
    at_root: ClassVar[tuple[str, ...]] = ()
    """Segments below ``/`` that are the extension's, on or off: a robot of such a name is escaped."""
    public: ClassVar[tuple[str, ...]] = ()
    """Those of them that say nothing about any fleet, so that anybody may read what is below."""
    carriers: ClassVar[tuple[str, ...]] = ()
    """Those of them whose requests carry others in their bodies, which may be to stop a robot. They are counted for no
    rate and wait for no turn before the extension, which has read the body, calls ``http.pace.in_turn``."""
    request_fields: ClassVar[tuple[str, ...]] = ()
    """Header fields, in lower case, that pages of other sites may send to it (CORS), if the operator permits them."""
    response_fields: ClassVar[tuple[str, ...]] = ()
    """Header fields that such pages may read of its answers."""
    in_robot: ClassVar[tuple[str, ...]] = ()
    """Segments below a robot that are the extension's, likewise."""
    kinds: ClassVar[tuple[Path, ...]] = ()
    """Turtle files of kinds of actions, written as those in shapes/linked_fleet_shapes/actions."""
    robot_properties: ClassVar[tuple[str, ...]] = ()
    """Further properties of robots, as ``module:attribute`` of functions from a robot to its property."""
    link_statements: ClassVar[tuple[str, ...]] = ()
    """Further statements about links, as ``module:attribute`` of functions of robot and link."""
    functions: ClassVar[tuple[str, ...]] = ()
    """Functions over the live fleet for languages of other extensions, as ``module:attribute`` of FleetFunctions."""
    settings: ClassVar[type[Section] | None] = None
    """Section of its own, with a prefix of its own."""
    views: ClassVar[tuple[str, ...]] = ()
    """Page views, as ``module:attribute`` of a ``PageView``: loaded where there are pages."""
    operations: ClassVar[tuple[str, ...]] = ()
    """Operations on its resources, as ``module:attribute`` of an ``Operations``: loaded where they are described."""
    navigation: ClassVar[tuple[NavigationEntry, ...]] = ()
    """Links that all pages have, while the extension is on."""

    def start(self, core: Core) -> AbstractAsyncContextManager[Mount]:
        """Give what the extension adds, and end all that it has begun when the context is left."""
        return nullcontext(Mount())
