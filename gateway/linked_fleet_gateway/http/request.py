"""The gateway as seen by handlers, and typed requests with caller and tree, resolved once."""

import sys
from collections.abc import Awaitable, Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any, Protocol

from prometheus_client import CollectorRegistry
from starlette.applications import Starlette
from starlette.requests import HTTPConnection
from starlette.requests import Request as StarletteRequest
from starlette.types import Lifespan, Message, Receive, Scope, Send
from starlette.websockets import WebSocket as StarletteWebSocket

from linked_fleet_base.contributions import Contributions, set_present
from linked_fleet_gateway.actions.service import Actions
from linked_fleet_gateway.http.answers import ResponseCache
from linked_fleet_gateway.http.arrival import Scheme, arrival_of
from linked_fleet_gateway.http.awaited_robots import AwaitedRobots
from linked_fleet_gateway.http.fields import field as field_of
from linked_fleet_gateway.http.representation import Representations
from linked_fleet_gateway.http.request_events import RequestEvent, RequestEvents
from linked_fleet_gateway.http.scheduling import Offload, StopPriority, TokenBuckets, bucket_key
from linked_fleet_gateway.resources.html import HtmlWriter, Reader
from linked_fleet_gateway.resources.paths import robot_of
from linked_fleet_gateway.resources.things import NO_SUBSCRIPTIONS, SubscriptionsByOwner
from linked_fleet_gateway.resources.tree import Tree
from linked_fleet_gateway.subscriptions.live import Live
from linked_fleet_gateway.subscriptions.service import Subscriptions
from linked_fleet_identity.rights import Identity, Right
from linked_fleet_identity.service import Identities
from linked_fleet_runtime.log import current_request
from linked_fleet_server.exchange import Reply

_NOTHING_DONE = (401, 404, 405)
_LONGEST = 500  # characters of a reported path, and of a reason
LANGUAGE_COOKIE = "language"
"""The cookie with the language that a person has chosen for pages."""
_BY_PAGES = ("subscribe", "unsubscribe")


class Application(Protocol):
    """The layer in front of all resources (``http/entrance.py``), and the resources (``http/endpoint.py``)."""

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer a request as an ASGI application."""

    def reply_nowait(self, scope: Scope) -> Reply | None:
        """Return the response to a request that needs no waiting; None for any other."""


@dataclass(frozen=True)
class Services:
    """The parts that exist while the gateway has joined its fleet."""

    live: Live
    actions: Actions
    subscriptions: Subscriptions
    request_events: RequestEvents
    identities: Identities | None
    data_warning: Callable[[], str] = str
    """Returns a sentence about data in Redis that are lost; empty without any."""
    offload: Offload = field(default_factory=Offload)
    writing_offload: Offload = field(default_factory=partial(Offload, sys.maxsize))
    """Writes long representations; the number of connections is their only limit."""
    stop_priority: StopPriority = field(default_factory=StopPriority)
    rates: TokenBuckets = field(default_factory=lambda: TokenBuckets(0.0))
    """Rate limits by client."""
    awaited_robots: AwaitedRobots = field(default_factory=AwaitedRobots)
    """Robots that may still come, and the streams that wait for them."""
    response_cache: ResponseCache = field(default_factory=ResponseCache)
    representations: Representations = field(default_factory=Representations)
    registry: CollectorRegistry = field(default_factory=CollectorRegistry)
    """The metrics for ``/metrics``."""
    schemes: Sequence[Scheme] = ()
    """Authentication schemes besides bearer tokens."""
    subprotocols: Mapping[str, str] = field(default_factory=dict)
    """Media types of messages besides those of the core, by the WebSocket subprotocol that selects them."""
    not_ready: Sequence[Callable[[], str]] = ()
    """Functions of extensions that return why a starting gateway is not ready yet."""

    def not_ready_reasons(self) -> list[str]:
        return [reason for tell in self.not_ready if (reason := tell())]


class Gateway(Starlette):
    """The ASGI application. Its lifespan sets ``services`` before the first request."""

    services: Services
    endpoint: Application
    """Answers every path. The lifespan sets it."""
    draining = False
    """True while it ends as soon as running work is done."""
    has_been_ready = False

    def __init__(
        self,
        entrance: Application,
        lifespan: Lifespan[Starlette] | None = None,
        contributions: Contributions | None = None,
    ) -> None:
        super().__init__(lifespan=lifespan)
        self._entrance = entrance
        self._contributions = contributions or Contributions()

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        scope["app"] = self
        set_present(self._contributions)
        await (self.router if scope["type"] == "lifespan" else self._entrance)(scope, receive, send)

    def reply_nowait(self, scope: Scope) -> Reply | None:
        """Return the response to a request that needs no waiting; None for any other."""
        scope["app"] = self
        set_present(self._contributions)
        return self._entrance.reply_nowait(scope)

    def end_waits(self) -> None:
        """Answer requests that wait for the end of an action."""
        self.services.actions.lifecycle.waiters.shut_down()


class _Resolved(HTTPConnection):
    """Additional attributes of requests and WebSockets."""

    refusal = ""
    """The reason of a refusal or failure, once there was one."""
    is_renewal = False
    """True once it is known to renew what the client has."""

    def __init__(self, scope: Scope, *channels: Any) -> None:
        super().__init__(scope, *channels)
        self.arrival = arrival_of(scope)

    @property
    def services(self) -> Services:
        gateway: Gateway = self.scope["app"]
        return gateway.services

    @property
    def base(self) -> str:
        """The public base URL used by the client, without a slash at its end."""
        return self.arrival.base

    @property
    def caller(self) -> Identity:
        """The caller. Without configured identities, everybody has all rights."""
        return self.arrival.authenticated.identity

    @property
    def credentials_valid(self) -> Callable[[], bool]:
        """A function that returns whether the caller's credentials are still valid."""
        return self.arrival.authenticated.is_valid

    @property
    def shown_on_pages(self) -> bool:
        """True if the page shows who has logged in."""
        return self.arrival.authenticated.shown_on_pages

    def field(self, name: str) -> str | None:
        """Return all lines of a list-valued field as one value (RFC 9110, 5.3); None if there is none."""
        return field_of(self, name)

    @property
    def client_key(self) -> str:
        """The identity of the caller, or without one its network, by which limits count clients."""
        return bucket_key(self.scope)

    @property
    def effective_accept(self) -> str | None:
        """The Accept field, or the types that ``?as=`` picks instead. Raises NotAcceptable for an unknown word."""
        picked = self.query_params.get("as") if self.scope["query_string"] else None
        return self.services.representations.override_accept(field_of(self, "accept"), picked)

    def reader(self, path: str) -> Reader:
        """Return the caller as the reader of the page at ``path``."""
        caller, rights = self.caller, None
        if self.services.identities is not None:
            rights = tuple(each.value for each in Right if caller.has_right(each, robot_of(path)))
        return Reader(caller.name if self.shown_on_pages else "", rights, self.restricted_paths, self.languages)

    @property
    def languages(self) -> str:
        """The languages of pages that the client prefers, as in Accept-Language; that of a cookie is the first."""
        chosen, accepted = self.cookies.get(LANGUAGE_COOKIE, ""), field_of(self, "accept-language") or ""
        return f"{chosen},{accepted}" if chosen else accepted

    @property
    def restricted_paths(self) -> tuple[str, ...]:
        """The paths of the restricted branches that the caller may read."""
        return self.services.live.branches.restricted_paths(self.caller)

    @property
    def caller_name(self) -> str:
        """The displayed and counted name of the caller; without identities the network address."""
        client = self.scope.get("client")
        return self.caller.name or (client[0] if client else "")

    def report(self, event: str, status: int | None, location: str = "") -> None:
        """Tell listeners that this was executed, or refused although its resource was found (``RequestEvent``)."""
        if status in _NOTHING_DONE:
            return
        asked, path = current_request(), self.scope["path"][:_LONGEST]
        self.services.request_events.tell(
            RequestEvent(
                self.caller_name, event, path, robot_of(path) or "", status,
                "" if asked is None else asked.id, location.removeprefix(self.base).partition("?")[0],
                self.refusal[:_LONGEST], self._is_by_page(event),
            )
        )  # fmt: skip

    def _is_by_page(self, event: str) -> bool:
        """Return True for what scripts of the gateway's own pages do without a person who asks for it.

        Browsers send an Origin field with each of these, also the name of the gateway itself.
        """
        ours = b"origin" in self.arrival.fields and not self.arrival.cross_origin
        return ours and (event in _BY_PAGES or self.is_renewal)

    def tree(self, subscriptions: SubscriptionsByOwner = NO_SUBSCRIPTIONS) -> Tree:
        """Return the tree as the caller may see it; ``subscriptions`` are those to show."""
        return self.services.live.tree(self.base, self.caller.visible_robots, subscriptions)


class Request(_Resolved, StarletteRequest):
    """A request for a resource."""

    is_safe = False
    """True once the method is known to be safe at the resource."""
    has_empty_body = False
    """True once a body without a single byte has been read."""

    def check_once_received(self, check: Callable[[], Awaitable[None]]) -> None:
        """Await ``check`` when the whole body has arrived, before its reader gets the last part."""
        receive = self._receive

        async def checked() -> Message:
            message = await receive()
            if message["type"] == "http.request" and not message.get("more_body", False):
                await check()
            return message

        self._receive = checked


class WebSocket(_Resolved, StarletteWebSocket):
    """A WebSocket on a resource."""


Connection = Request | WebSocket


def gateway_of(scope: Scope) -> Gateway:
    """Return the gateway that answers a request."""
    gateway: Gateway = scope["app"]
    return gateway


def html_of(scope: Scope) -> HtmlWriter | None:
    """Return the renderer of pages, for middleware that refuses a request; None without pages."""
    app = scope.get("app")
    return app.services.representations.html if isinstance(app, Gateway) else None
