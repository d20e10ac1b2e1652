"""DELETE and PATCH of a subscription, at any gateway (LDP 4.2.7)."""

from dataclasses import replace
from functools import partial

from starlette.responses import Response

from linked_fleet_base.errors import InsufficientScope, NotFound, UnprocessableContent
from linked_fleet_gateway.http.callers import require_subtree
from linked_fleet_gateway.http.preconditions import await_preconditions
from linked_fleet_gateway.http.request import Request
from linked_fleet_gateway.http.scheduling import Offload
from linked_fleet_gateway.http.subscribe import (
    cancel_subscription,
    check_channel,
    resolve_media_type,
    translate_store_errors,
)
from linked_fleet_gateway.http.writes import Patch, apply_patch, read_patch
from linked_fleet_gateway.resources.affordance import ChangeSubscription
from linked_fleet_gateway.resources.resource import Resource
from linked_fleet_gateway.resources.subscription import ChangeableOptions, Depth, Record, Subscription
from linked_fleet_gateway.resources.subscription_change import changed_options, managed_option_statements
from linked_fleet_gateway.resources.subscription_resource import container_path, subscription_path
from linked_fleet_gateway.subscriptions.service import Subscriptions
from linked_fleet_identity.rights import Right

_SHORT_TRIPLES = 50  # a description has twenty


async def change_subscription(request: Request, affordance: ChangeSubscription) -> Response:
    """Delete or change a subscription. The response is 204."""
    if request.method == "DELETE":
        return await cancel_subscription(request, affordance)
    subscriptions: Subscriptions = request.services.subscriptions
    path = subscription_path(affordance.record.subscription)
    patch = await read_patch(request, request.base + path)
    while True:
        # Evaluated in each attempt, because another client may change it while the body is read.
        record = await subscriptions.get_record(affordance.record.subscription.id)
        present = None if record is None else _described(request, record)
        if record is None or present is None:
            raise NotFound("The subscription has ended meanwhile.")
        await await_preconditions(request, present)
        options = await _options(request, patch, record.subscription, present)
        if options == record.subscription.options:
            return Response(status_code=204)
        with translate_store_errors():
            if await subscriptions.change_options(record.subscription, options):
                return Response(status_code=204)


def _described(request: Request, record: Record) -> Resource | None:
    subscription = record.subscription
    found = request.tree({subscription.owner: [record]}).resolve(subscription_path(subscription))
    return found if isinstance(found, Resource) else None


async def _options(request: Request, patch: Patch, subscription: Subscription, present: Resource) -> ChangeableOptions:
    """Return the options after the patch, checked for this resource."""
    iri, before = request.base + present.path, present.full_graph(request.base).triples
    after = apply_patch(patch, present, request.base, lambda described: managed_option_statements(described, iri))
    offload: Offload = request.services.offload
    read = partial(changed_options, before, after, subscription, request.base)
    options = await offload.run(read, len(after), _SHORT_TRIPLES)
    if options.depth is not subscription.depth:
        _demand_depth(request, subscription, options.depth)
    if options.media_type == subscription.media_type:
        return options
    return _in_type(request, subscription, options)


def _demand_depth(request: Request, subscription: Subscription, depth: Depth) -> None:
    """Raise InsufficientScope if somebody other than its creator extends a subscription to the whole fleet."""
    require_subtree(request, subscription.resource, depth)
    if subscription.resource == "/" and depth is Depth.SUBTREE and request.caller.name != subscription.creator:
        raise InsufficientScope("Only its creator may have it cover the whole fleet.", scope=Right.SUBSCRIBE)


def _in_type(request: Request, subscription: Subscription, options: ChangeableOptions) -> ChangeableOptions:
    """Return the options with a media type in which messages about the resource are available."""
    container = request.base + container_path(subscription.owner)
    resource = request.tree().resolve(subscription.resource)
    if not isinstance(resource, Resource):
        detail = (
            f"There is no resource at {request.base}{subscription.resource} at present: its media types are not known."
        )
        raise UnprocessableContent(detail, constraint=container)
    media_type = resolve_media_type(resource, options.media_type, container)
    check_channel(resource, subscription.kind, media_type)
    return replace(options, media_type=media_type)
