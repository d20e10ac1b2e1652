"""Creating, opening and ending subscriptions over HTTP (paper 5.3, R0.12 to R0.17; flow "fan-out")."""

import re
import time
import uuid
from collections import Counter
from collections.abc import Awaitable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from urllib.parse import unquote

from starlette.responses import Response

from linked_fleet_base.errors import (
    BadRequest,
    Conflict,
    NotAcceptable,
    NotFound,
    TooManySubscriptions,
    UnprocessableContent,
    UpgradeRequired,
)
from linked_fleet_gateway.http.body import body_type, convert_body, parse_body
from linked_fleet_gateway.http.callers import require_subtree
from linked_fleet_gateway.http.fields import Link, field, link_header
from linked_fleet_gateway.http.negotiation import choose
from linked_fleet_gateway.http.request import Connection, Request
from linked_fleet_gateway.http.writes import check_acceptable, created_response
from linked_fleet_gateway.resources.affordance import ChangeSubscription, ResumeSubscription, Subscribe
from linked_fleet_gateway.resources.binary_frames import FRAME_TYPES, layout_path
from linked_fleet_gateway.resources.message_body import message_types
from linked_fleet_gateway.resources.resource import Resource
from linked_fleet_gateway.resources.subscription import Delivery, DeliveryState, Depth, Kind, Record, Subscription
from linked_fleet_gateway.resources.subscription_resource import SubscriptionRequest as Wanted
from linked_fleet_gateway.resources.subscription_resource import container_path, read_request, subscription_path
from linked_fleet_gateway.subscriptions.service import Subscriptions
from linked_fleet_gateway.subscriptions.store import SubscriptionLimitReached, SubscriptionNotHeld
from linked_fleet_rdf.serialise import RDF_TYPES
from linked_fleet_webhooks.network import ForbiddenHost, check_callback_url

OPTIONS = ("depth", "interval", "deadband", "last-event-id")
MAX_INTERVAL_S = 86_400.0
MAX_DEADBAND = 1e9
_ENDED = "The subscription has ended meanwhile."
_DECIMAL = re.compile(r"[0-9]{1,10}(?:\.[0-9]{0,9})?|\.[0-9]{1,9}", re.ASCII)


@dataclass(frozen=True)
class SubscriptionOptions:
    """Options of a subscription besides its resource and media type."""

    depth: Depth = Depth.PROPERTIES
    interval_s: float = 0.0
    deadband: float = 0.0


def parse_options(connection: Connection) -> SubscriptionOptions:
    """Return the options in the query: ``depth``, ``interval`` (s), ``deadband`` (SI unit). Raises BadRequest."""
    query = connection.query_params
    for name, count in Counter(name for name, _ in query.multi_items()).items():
        if name not in (*OPTIONS, "as") or count > 1:
            raise BadRequest(
                f"{name[:50]!r} is no option, or said twice; of a subscription there are {', '.join(OPTIONS)}."
            )
    try:
        depth = Depth(query.get("depth", Depth.PROPERTIES))
    except ValueError:
        raise BadRequest(f"depth is one of {', '.join(Depth)}.") from None
    interval_s = _number(query.get("interval"), "interval", MAX_INTERVAL_S)
    return SubscriptionOptions(depth, interval_s, _number(query.get("deadband"), "deadband", MAX_DEADBAND))


def _number(text: str | None, name: str, most: float) -> float:
    value = 0.0 if text is None else float(text) if _DECIMAL.fullmatch(text) else most + 1
    if value > most:
        raise BadRequest(f"{name} is a decimal number from 0 to {most:g}, such as 0.5.")
    return value


def wants_callback(request: Request) -> bool:
    """Return True for a GET with ``Upgrade: callback`` (paper R0.16)."""
    return _asks_upgrade_to("callback", request)


def check_upgrade(request: Request, resource: Resource) -> None:
    """Raise UpgradeRequired for a GET with a Callback whose Upgrade is missing, as behind many proxies and in HTTP/2.

    BadRequest in a version of HTTP that has no Upgrade.
    """
    if request.method != "GET" or b"callback" not in request.arrival.fields or wants_callback(request):
        return
    container = request.base + container_path(resource.owner_path)
    detail = (
        "The request has a Callback, but no Connection: Upgrade with Upgrade: callback; proxies and HTTP/2 remove them."
        f" Nothing has been subscribed to. POST a description of the subscription to {container} instead."
    )
    if request.scope["http_version"] != "1.1":
        raise BadRequest(detail)
    raise UpgradeRequired(detail, protocol="callback")


def check_handshake(request: Request) -> None:
    """Raise BadRequest for a WebSocket handshake without its key (RFC 6455, 4.2.2).

    A complete handshake never arrives here as a request. In HTTP/1.0 it is ignored (RFC 9110, 7.8).
    """
    opens = request.scope["http_version"] == "1.1" and _asks_upgrade_to("websocket", request)
    if opens and "sec-websocket-key" not in request.headers:
        raise BadRequest("The opening handshake of a WebSocket needs a Sec-WebSocket-Key field (RFC 6455, 4.1).")


def _asks_upgrade_to(protocol: str, request: Request) -> bool:
    """Return True for a GET whose Upgrade names ``protocol``, with the connection option (RFC 9110, 7.8)."""
    if b"upgrade" not in request.arrival.fields:
        return False
    connection = (field(request, "connection") or "").lower().split(",")
    protocols = (field(request, "upgrade") or "").lower().split(",")
    return (
        request.method == "GET"
        and "upgrade" in [option.strip() for option in connection]
        and protocol in [name.strip() for name in protocols]
    )


async def subscribe_callback(request: Request, resource: Resource) -> Response:
    """Create a callback by GET with ``Upgrade: callback``. The response is 201 with the description (R0.16)."""
    offered = observable_types(resource)
    callbacks = request.headers.getlist("callback")
    if len(callbacks) != 1:
        raise BadRequest("A callback subscription needs one Callback field with the URL of its receiver.")
    try:
        url = check_callback_url(callbacks[0].strip().removeprefix("<").removesuffix(">"))
    except ValueError as error:
        raise BadRequest(str(error)) from error
    media_type = choose(request.effective_accept, offered)
    if media_type is None:
        raise NotAcceptable(f"Messages are to be had in {', '.join(offered)}.", offered=offered)
    subscription = new_subscription(request, resource, Kind.CALLBACK, media_type, parse_options(request))
    subscription = replace(subscription, callback=url)
    # Binary types cannot describe the subscription; the description is then in Turtle.
    return await _create(request, subscription, media_type if media_type in RDF_TYPES else RDF_TYPES[0])


async def post_subscription(request: Request, affordance: Subscribe) -> Response:
    """Create a callback, or a stream to be opened at its Location, by POST to a Subscriptions container."""
    owner, media_type = affordance.owner, body_type(request)
    check_acceptable(request)
    iri = request.base + container_path(owner)
    wanted = await convert_body(
        request, lambda body: read_request(parse_body(body, media_type, iri, request.base), iri, request.base)
    )
    resource = request.tree().resolve(unquote(wanted.resource[len(request.base) :]))
    if not isinstance(resource, Resource):
        raise _unprocessable(f"There is no resource at {wanted.resource}; browse from {request.base}/.", iri)
    if not resource.observable:
        raise _unprocessable(f"{wanted.resource} cannot be subscribed to; its ETag says whether it has changed.", iri)
    if resource.owner_path != owner:
        right = request.base + container_path(resource.owner_path)
        raise _unprocessable(f"Subscriptions to {wanted.resource} are made at {right}.", iri)
    return await _create(request, _from_body(request, wanted, resource, iri), None)


def _from_body(request: Request, wanted: Wanted, resource: Resource, iri: str) -> Subscription:
    media_type = resolve_media_type(resource, wanted.media_type, iri)
    asked = SubscriptionOptions(wanted.depth, wanted.interval_s, wanted.deadband)
    kind = Kind.CALLBACK if wanted.callback else Kind.STREAM
    subscription = new_subscription(request, resource, kind, media_type, asked)
    if not wanted.callback:
        return subscription
    try:
        return replace(subscription, callback=check_callback_url(wanted.callback), secret=wanted.secret)
    except ValueError as error:
        raise _unprocessable(str(error), iri) from error


def resolve_media_type(resource: Resource, requested: str, iri: str) -> str:
    """Return the requested media type, or the default. Raises UnprocessableContent for an unavailable one."""
    offered = message_types(resource)
    media_type = requested or offered[0]
    if media_type not in offered:
        raise _unprocessable(f"Messages are to be had in {', '.join(offered)}, not in {media_type[:100]}.", iri)
    return media_type


async def _create(request: Request, subscription: Subscription, media_type: str | None) -> Response:
    """Return 201 with Location and description; ``media_type`` overrides Accept for the description."""
    subscriptions: Subscriptions = request.services.subscriptions
    iri = request.base + container_path(subscription.owner)
    with translate_store_errors():
        try:
            if subscription.kind is Kind.CALLBACK:
                record = await subscriptions.callbacks.create(subscription)
            else:
                record = Record(subscription, Delivery(DeliveryState.WAITING), "")
                await subscriptions.streams.add_unopened(subscription)
        except ForbiddenHost as error:
            raise _unprocessable(str(error), iri) from error
    path = subscription_path(subscription)
    shown = request.tree({subscription.owner: [record]}).resolve(path)
    assert isinstance(shown, Resource)
    return created_response(request, shown, media_type)


async def cancel_subscription(request: Request, affordance: ChangeSubscription) -> Response:
    subscriptions: Subscriptions = request.services.subscriptions
    return await _carried_out(subscriptions.cancel(affordance.record.subscription.id))


async def resume_subscription(request: Request, affordance: ResumeSubscription) -> Response:
    subscriptions: Subscriptions = request.services.subscriptions
    if not subscriptions.callbacks.is_entitled(affordance.record.subscription):
        raise Conflict("The rights of its creator ended: it can only be deleted.")
    return await _carried_out(subscriptions.resume(affordance.record.subscription.id))


async def _carried_out(change: Awaitable[bool]) -> Response:
    """Return 204 for a change. Raises NotFound if the subscription has ended meanwhile."""
    with translate_store_errors():
        if not await change:
            raise NotFound(_ENDED)
    return Response(status_code=204)


def new_subscription(
    connection: Connection, resource: Resource, kind: Kind, media_type: str, options: SubscriptionOptions
) -> Subscription:
    require_subtree(connection, resource.path, options.depth)
    check_channel(resource, kind, media_type)
    return Subscription(
        id=str(uuid.uuid4()),
        owner=resource.owner_path,
        resource=resource.path,
        kind=kind,
        media_type=media_type,
        base=connection.base,
        client=connection.caller_name,
        created_ns=time.time_ns(),
        depth=options.depth,
        interval_s=options.interval_s,
        deadband=options.deadband,
        creator=connection.caller.name,
        sees=connection.caller.visible_robots.patterns,
    )


def check_channel(resource: Resource, kind: Kind, media_type: str) -> None:
    """Raise Conflict for messages that are not available by callback."""
    if kind is Kind.CALLBACK and resource.values_only_in_documents and media_type in resource.documents:
        raise Conflict(
            f"Messages in {media_type} go to streams alone: open a WebSocket here, or take {', '.join(RDF_TYPES)}."
        )


def subscription_link(subscription: Subscription) -> str:
    """Return the Link field of a stream: its description, which can be deleted to end it, and the layout of frames."""
    links = [Link(subscription.base + subscription_path(subscription), "related")]
    if subscription.media_type in FRAME_TYPES:
        links.append(Link(subscription.base + layout_path(subscription.resource), "describedby"))
    return link_header(links, [])


def last_event_id(connection: Connection) -> str | None:
    """Return the id of the message last seen: ``Last-Event-ID``, or ``last-event-id`` in the query of WebSockets."""
    return field(connection, "last-event-id") or connection.query_params.get("last-event-id")


@contextmanager
def translate_store_errors() -> Iterator[None]:
    """Translate errors of the store into problems."""
    try:
        yield
    except SubscriptionLimitReached as error:
        raise TooManySubscriptions(f"{error}. Delete some of them, or wait until streams have ended.") from error
    except SubscriptionNotHeld as error:
        raise NotFound(_ENDED) from error


def observable_types(resource: Resource) -> tuple[str, ...]:
    """Return the media types of messages about the resource. Raises Conflict if there are none."""
    offered = message_types(resource)
    if not offered:
        raise Conflict("This resource cannot be subscribed to; it says by its ETag whether it has changed.")
    return offered


def _unprocessable(detail: str, iri: str) -> UnprocessableContent:
    return UnprocessableContent(detail, constraint=iri)
