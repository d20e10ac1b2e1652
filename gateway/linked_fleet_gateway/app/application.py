"""The composition root: compilation of all shapes, routes, middleware and lifespan of the gateway.

A gateway does not start with a shape that cannot be compiled.
"""

from collections.abc import AsyncIterator
from contextlib import AsyncExitStack, asynccontextmanager, closing
from functools import cache
from pathlib import Path

from starlette.applications import Starlette

from linked_fleet_base.contributions import set_present
from linked_fleet_gateway.actions.service import Actions
from linked_fleet_gateway.actions.store import ActionStore
from linked_fleet_gateway.app.extensions import (
    ExtensionSettings,
    checked_contributions,
    create_representations,
    enabled_extensions,
    mount_extensions,
)
from linked_fleet_gateway.app.metrics import MetricsCollector, Sampler, create_registry
from linked_fleet_gateway.app.settings import GatewaySettings
from linked_fleet_gateway.http.endpoint import Endpoint
from linked_fleet_gateway.http.entrance import Entrance, cors_middleware
from linked_fleet_gateway.http.extension import Core
from linked_fleet_gateway.http.forwarding import Authorities
from linked_fleet_gateway.http.request import Gateway, Services
from linked_fleet_gateway.http.request_events import RequestEvents
from linked_fleet_gateway.http.scheduling import StopPriority, TokenBuckets
from linked_fleet_gateway.resources.action_offer import CONDITIONS, action_definitions
from linked_fleet_gateway.resources.paths import robot_of
from linked_fleet_gateway.resources.shape_parameters import COMPLETIONS
from linked_fleet_gateway.subscriptions.callbacks import EntitlementCheck
from linked_fleet_gateway.subscriptions.live import Live
from linked_fleet_gateway.subscriptions.service import Subscriptions, new_run_name
from linked_fleet_gateway.subscriptions.store import SubscriptionStore
from linked_fleet_identity.rights import View
from linked_fleet_identity.service import Identities
from linked_fleet_link.transport import Opener
from linked_fleet_link.zenoh_session import open_session as open_zenoh
from linked_fleet_rdf.graph import Node
from linked_fleet_rdf.shapes import ACTIONS, BLUEPRINTS, SUBSCRIPTIONS, VOCABULARY, added_files, load_turtle
from linked_fleet_rdf.vocabulary import LF, RDF, SH
from linked_fleet_runtime.metrics import RequestMetrics
from linked_fleet_runtime.store_marker import LOST_DATA, StoreMarker
from linked_fleet_runtime.tracing import Tracing
from linked_fleet_server.connection_limits import Sockets, limit_to_file_descriptors
from linked_fleet_shacl import Compiler, Unsupported
from linked_fleet_valkey.server import EmbeddedRedis
from linked_fleet_webhooks.network import Network


def check_shapes() -> None:
    """Compile all shapes of the core and of the present extensions. Raises Unsupported with shape and reason.

    Shapes of actions are checked as written. The parts that COMPLETIONS adds for a robot come from code.
    """
    _check_all(*(added_files(name) for name in (ACTIONS, VOCABULARY, BLUEPRINTS)))


@cache
def _check_all(*added: tuple[Path, ...]) -> None:
    """Once for each set of files that extensions add."""
    for name in (VOCABULARY, BLUEPRINTS, SUBSCRIPTIONS):
        compiler = _compiler(name)
        for node, about in load_turtle(name).items():
            if any(t.predicate == RDF.type and t.object == SH.NodeShape for t in about):
                _check(name, compiler, node)
    shapes = load_turtle(ACTIONS)
    compiler = _compiler(ACTIONS)
    for kind in action_definitions():
        if kind.consumes is not None:
            _check(f"{ACTIONS}/{kind.segment}", compiler, kind.consumes)
    completions = {t.object for about in shapes.values() for t in about if t.predicate == LF.completedBy}
    for unknown in completions.difference(COMPLETIONS):
        raise Unsupported(f"linked_fleet_shapes/{ACTIONS}: lf:completedBy {unknown} is not known")
    for kind in action_definitions():
        for unknown in set(kind.offered_if).difference(CONDITIONS):
            raise Unsupported(f"linked_fleet_shapes/{ACTIONS}: lf:offeredIf {unknown} is not known")


def _compiler(name: str) -> Compiler:
    try:
        return Compiler(load_turtle(name))
    except Unsupported as error:
        raise Unsupported(f"linked_fleet_shapes/{name} cannot be compiled: {error}") from error


def _check(name: str, compiler: Compiler, shape: Node) -> None:
    try:
        compiler.compile(shape)
    except Unsupported as error:
        raise Unsupported(f"linked_fleet_shapes/{name}: {shape} cannot be compiled: {error}") from error


def create_live(settings: GatewaySettings, open_session: Opener) -> Live:
    """Return the live fleet of a gateway with these settings, not yet joined."""
    return Live(
        settings.namespace,
        settings.gateway_name,
        lambda: open_session(settings.listen_endpoints, settings.zenoh_connect, settings.trust),
        secured=bool(settings.identities),
    )


def _entitlement(identities: Identities, live: Live) -> EntitlementCheck:
    """Return what checks the right to a callback of a resource, again and again."""

    def check(creator: str, resource: str, sees: View) -> bool:
        return identities.may_continue(creator, robot_of(resource), sees, live.branches.reading(resource))

    return check


def create_sockets(settings: GatewaySettings) -> Sockets:
    """Return the limits of connections, bounded by the number of files that the process may open."""
    return Sockets(limit_to_file_descriptors(settings.sockets), settings.sockets_per_client)


def create_app(settings: GatewaySettings, tracing: Tracing | None = None, open_session: Opener = open_zenoh) -> Gateway:
    """Return the ASGI application; its lifespan joins the fleet through a session from ``open_session``.

    Raises Unsupported for shapes that cannot be compiled.
    """
    extensions = enabled_extensions(settings.section(ExtensionSettings))
    contributions, left_out = checked_contributions(extensions, check_shapes)

    @asynccontextmanager
    async def lifespan(_: Starlette) -> AsyncIterator[None]:
        set_present(contributions)
        async with AsyncExitStack() as stack:
            live = await stack.enter_async_context(create_live(settings, open_session))
            embedded = None if settings.redis_url else EmbeddedRedis(settings.state_path, LOST_DATA)
            url = settings.redis_url if embedded is None else (await stack.enter_async_context(embedded)).url
            run = new_run_name()
            request_events = RequestEvents(live.faults)
            identities = None
            if settings.identities:
                identities = await stack.enter_async_context(Identities(settings.identities))
            action_store = await stack.enter_async_context(ActionStore(url, settings.namespace, run))
            actions = await stack.enter_async_context(Actions(live, action_store, settings.invocations_per_client))
            core = Core(
                live, actions, request_events, identities, url, settings.namespace, run,
                settings.public_urls, settings.state_path,
                sections=[settings.section(each.settings) for each in extensions if each.settings],
            )  # fmt: skip
            mounted = await mount_extensions(extensions, core, stack, left_out)
            mounts = mounted.values()
            stack.push_async_callback(actions.operations.close)
            await live.admit_robots()
            store = await stack.enter_async_context(SubscriptionStore(url, settings.namespace, run))
            kept: EmbeddedRedis | StoreMarker = embedded or StoreMarker(url, settings.namespace)
            if isinstance(kept, StoreMarker):
                await stack.enter_async_context(kept)
            network = stack.enter_context(closing(Network(settings.callback_allow, ports=settings.callback_ports)))
            subscriptions = Subscriptions(
                store, run, live.fan_out, network,
                consent_required=settings.callback_consent, limit=settings.subscriptions_per_client,
                check_entitlement=_entitlement(identities, live) if identities else lambda *_: True,
            )  # fmt: skip
            await stack.enter_async_context(subscriptions)
            sampler = await stack.enter_async_context(Sampler(live.fleet))
            numbers = MetricsCollector(
                live,
                subscriptions,
                actions,
                requests,
                sampler,
                embedded,
                {name: each.metrics for name, each in mounted.items()},
            )
            app.services = Services(
                live, actions, subscriptions, request_events, identities,
                data_warning=lambda: kept.warning,
                stop_priority=StopPriority(carriers), rates=rates,
                representations=create_representations(mounts), registry=create_registry(numbers),
                schemes=[each.scheme for each in mounts if each.scheme is not None],
                subprotocols={name: value for each in mounts for name, value in each.subprotocols.items()},
                not_ready=[live.copies.awaited, *(each.not_ready for each in mounts)],
            )  # fmt: skip
            for forget in (app.services.response_cache.forget_robot, app.services.representations.forget_robot):
                live.on_removed[forget] = None
            app.endpoint = Endpoint(mounts)
            yield

    requests, rates = RequestMetrics(), TokenBuckets(settings.requests_per_client)
    carriers = [f"/{segment}" for each in extensions for segment in each.carriers]
    app = Gateway(
        Entrance(
            Authorities(settings.public_urls, settings.cors_origins),
            requests,
            rates,
            fronts=settings.fronts,
            tracing=tracing,
            cors=cors_middleware(
                settings.cors_origins,
                [name for each in extensions for name in each.request_fields],
                [name for each in extensions for name in each.response_fields],
            ),
            carriers=carriers,
        ),
        lifespan,
        contributions,
    )
    return app
