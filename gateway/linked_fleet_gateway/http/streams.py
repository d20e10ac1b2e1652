"""Subscriptions that live on a connection: negotiation, media types, and registration."""

from collections.abc import Awaitable, Callable
from contextlib import AbstractContextManager, nullcontext
from dataclasses import replace

from starlette.types import Receive, Scope, Send

from linked_fleet_base.errors import Conflict, NotAcceptable
from linked_fleet_gateway.http.callers import require_subtree
from linked_fleet_gateway.http.event_stream import CACHE_CONTROL, CANCELLED_ID, serve_event_stream
from linked_fleet_gateway.http.fields import field
from linked_fleet_gateway.http.negotiation import choose, parse_accept, weight
from linked_fleet_gateway.http.request import Connection, Request, WebSocket
from linked_fleet_gateway.http.subscribe import (
    last_event_id,
    new_subscription,
    observable_types,
    parse_options,
    subscription_link,
    translate_store_errors,
)
from linked_fleet_gateway.http.websocket import is_binary, serve_websocket
from linked_fleet_gateway.resources.binary_frames import FRAME_TYPES
from linked_fleet_gateway.resources.paths import robot_of
from linked_fleet_gateway.resources.properties import FRAME_MEDIA_TYPE
from linked_fleet_gateway.resources.resource import Resource
from linked_fleet_gateway.resources.subscription import Kind, Subscription
from linked_fleet_gateway.resources.subscription_resource import subscription_path
from linked_fleet_gateway.subscriptions.broadcast import Feed, Outlet
from linked_fleet_gateway.subscriptions.service import Subscriptions
from linked_fleet_gateway.subscriptions.watcher import Watcher
from linked_fleet_identity.service import Identities
from linked_fleet_rdf.serialise import JELLY, JSON

EVENT_STREAM = "text/event-stream"
SUBPROTOCOLS = {
    "lf.turtle": "text/turtle",
    "lf.jsonld": "application/ld+json",
    "lf.ntriples": "application/n-triples",
    "lf.rdfxml": "application/rdf+xml",
    "lf.jelly": JELLY,
    "lf.frame": FRAME_MEDIA_TYPE,
    "lf.json": JSON,
}
"""Browsers cannot set Accept on a WebSocket, but they can name subprotocols."""
_Start = Callable[[Outlet], Awaitable[Feed]]


def wants_events(request: Request) -> bool:
    """Return True if Accept names event streams and prefers no other type of ours."""
    if not request.arrival.names_event_stream:
        return False
    ranges = parse_accept(field(request, "accept"))
    named = max((each.q for each in ranges if (each.type, each.subtype) == ("text", "event-stream")), default=0.0)
    if named == 0 or request.method not in ("GET", "HEAD"):
        return False
    ours = (*request.services.representations.media_types, *FRAME_TYPES, JSON)
    return named >= max(weight(ranges, media_type) for media_type in ours)


def is_cancelled_stream(request: Request) -> bool:
    """Return True if an EventSource returns to a cancelled stream; 204 makes it stop (WHATWG HTML, 9.2.2)."""
    return field(request, "last-event-id") == CANCELLED_ID and wants_events(request)


class EventStream:
    """The response to a GET that requests events."""

    def __init__(self, request: Request, resource: Resource) -> None:
        self._subscriptions: Subscriptions = request.services.subscriptions
        self._request, self._seen = request, last_event_id(request)
        self._posted = resource.subscription
        if self._posted is not None:
            self._subscription = _opened(request, resource, Kind.EVENT_STREAM)
        else:
            media_type = _type_in_events(request, resource)
            self._subscription = new_subscription(
                request, resource, Kind.EVENT_STREAM, media_type, parse_options(request)
            )
        self._head = request.method == "HEAD"

    async def register(self) -> None:
        """Register the subscription; await this before sending anything. Raises TooManySubscriptions, NotFound."""
        if not self._head:
            with translate_store_errors():
                await self._subscriptions.streams.register(self._subscription, posted=self._posted is not None)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        headers = [(b"link", subscription_link(self._subscription).encode("latin-1")), (b"vary", b"Accept")]
        if self._head:  # HEAD creates nothing, so there is no link either
            headers = [(b"content-type", EVENT_STREAM.encode()), (b"cache-control", CACHE_CONTROL), headers[1]]
            await send({"type": "http.response.start", "status": 200, "headers": headers})
            await send({"type": "http.response.body", "body": b""})
            return

        async def serve(start: _Start) -> None:
            await serve_event_stream(scope, receive, send, headers, start)

        await _live(self._request, self._subscription, self._seen, self._posted is not None, serve)


async def open_websocket(websocket: WebSocket, resource: Resource) -> None:
    """Serve a WebSocket on the resource (R0.15); refusals come before the handshake."""
    subscriptions: Subscriptions = websocket.services.subscriptions
    if resource.subscription is not None:
        subscription = _opened(websocket, resource, Kind.WEBSOCKET)
        _, subprotocol = _type_of_frames(websocket, (subscription.media_type,))
    else:
        media_type, subprotocol = _type_of_frames(websocket, observable_types(resource))
        subscription = new_subscription(websocket, resource, Kind.WEBSOCKET, media_type, parse_options(websocket))
    with translate_store_errors():
        await subscriptions.streams.register(subscription, posted=resource.subscription is not None)
    headers = [(b"link", subscription_link(subscription).encode("latin-1"))]

    async def serve(start: _Start) -> None:
        await serve_websocket(websocket, subprotocol, headers, start)

    await _live(websocket, subscription, last_event_id(websocket), resource.subscription is not None, serve)


async def _live(
    connection: Connection,
    subscription: Subscription,
    last: str | None,
    posted: bool,
    serve: Callable[[_Start], Awaitable[None]],
) -> None:
    """Serve a subscription from its registration to the end of the connection."""
    subscriptions: Subscriptions = connection.services.subscriptions
    watcher: Watcher | None = None

    async def start(outlet: Outlet) -> Feed:
        nonlocal watcher
        watcher = subscriptions.streams.open(subscription, outlet, last)
        return watcher

    connection.report("subscribe", 101 if subscription.kind is Kind.WEBSOCKET else 200, subscription_path(subscription))
    try:
        with _guarded(connection, subscription):
            await serve(start)
    finally:
        connection.report("unsubscribe", None, subscription_path(subscription))
        subscriptions.streams.close(subscription, watcher, reopenable=posted)


def _guarded(connection: Connection, subscription: Subscription) -> AbstractContextManager[None]:
    """End the stream when its client loses the right to it."""
    identities: Identities | None = connection.services.identities
    if identities is None:
        return nullcontext()
    subscriptions: Subscriptions = connection.services.subscriptions
    robot, id = robot_of(subscription.resource), subscription.id
    needed = connection.services.live.branches.reading(subscription.resource)
    return identities.watch_rights(
        connection.caller, robot, lambda: subscriptions.streams.revoke(id), connection.credentials_valid, needed
    )


def _opened(connection: Connection, resource: Resource, kind: Kind) -> Subscription:
    """Return the subscription created by POST that this connection opens."""
    assert resource.subscription is not None
    subscription = resource.subscription.subscription
    if subscription.creator != connection.caller.name:
        raise Conflict("Only who made this subscription can open it.")
    if not subscription.kind.is_stream:
        raise Conflict("This is a callback subscription: its messages go to its receiver alone.")
    require_subtree(connection, subscription.resource, subscription.depth)
    if kind is Kind.EVENT_STREAM and is_binary(subscription.media_type):
        raise NotAcceptable("Binary messages cannot be sent as events; open a WebSocket.", offered=())
    return replace(subscription, kind=kind, sees=connection.caller.visible_robots.patterns)


def _type_in_events(request: Request, resource: Resource) -> str:
    """Return the type that Accept prefers besides event streams, or that ``?as=`` picks; Turtle by default."""
    offered = tuple(each for each in observable_types(resource) if not is_binary(each))
    if (picked := request.query_params.get("as")) is not None:
        media_type = request.services.representations.override_accept(None, picked)
        if media_type not in offered:
            raise NotAcceptable(f"Messages are to be had in {', '.join(offered)}.", offered=offered)
        return media_type
    accept = field(request, "accept")
    ranges = [each for each in parse_accept(accept) if (each.type, each.subtype) != ("text", "event-stream")]
    if not any(weight(ranges, media_type) for media_type in offered):
        return offered[0]
    return choose(accept, offered) or offered[0]


def _type_of_frames(websocket: WebSocket, offered: tuple[str, ...]) -> tuple[str, str | None]:
    """Return the media type of messages, and the subprotocol that selected it, if any."""
    names: list[str] = websocket.scope["subprotocols"]
    subprotocols = {**SUBPROTOCOLS, **websocket.services.subprotocols}
    for name in names:
        if subprotocols.get(name) in offered:
            return subprotocols[name], name
    media_type = choose(websocket.effective_accept, offered)
    if media_type is None or any(name.startswith("lf.") for name in names):
        tokens = ", ".join(name for name, each in subprotocols.items() if each in offered)
        raise NotAcceptable(f"Messages are to be had as {tokens}, or in {', '.join(offered)}.", offered=offered)
    return media_type, None
