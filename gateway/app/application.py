"""The composition root: routes, middleware and lifespan of the gateway on one screen."""

from collections.abc import AsyncIterator
from contextlib import AsyncExitStack, asynccontextmanager, closing
from pathlib import Path

from starlette.applications import Starlette
from starlette.middleware import Middleware

from gateway.actions.service import Actions
from gateway.actions.store import ActionStore
from gateway.app.metrics import Numbers, metrics, registry
from gateway.app.sampler import Sampler
from gateway.app.settings import GatewaySettings
from gateway.extensions.cameras.pictures import Pictures
from gateway.extensions.history.recorder import History
from gateway.extensions.history.resources import wings as histories
from gateway.extensions.query.description import wing
from gateway.extensions.query.service import Queries
from gateway.extensions.rules.creators import creator_of
from gateway.extensions.rules.service import Rules
from gateway.extensions.rules.store import RuleStore
from gateway.extensions.sessions.ended_sessions import EndedSessions
from gateway.extensions.things.directory import WINGS as THINGS
from gateway.extensions.world.service import World
from gateway.http.callers import Callers
from gateway.http.cors import pages_elsewhere
from gateway.http.endpoint import resources
from gateway.http.forwarded import Forwarded
from gateway.http.health import Readiness
from gateway.http.host import Authorities
from gateway.http.lazy_imports import Loading
from gateway.http.offload import Offload
from gateway.http.operator_endpoints import Front
from gateway.http.rates import Pace, Rates
from gateway.http.repeats import Repeats
from gateway.http.sockets import Sockets, within_files
from gateway.http.stop_priority import Turns
from gateway.identity.service import Identities
from gateway.identity.store import SessionKey
from gateway.link.transport import Opener
from gateway.link.zenoh_session import open_session as open_zenoh
from gateway.rdf.vocabulary import PREFIXES
from gateway.runtime.audit_log import Audit
from gateway.runtime.counters import Requests
from gateway.runtime.embedded_redis import Embedded
from gateway.runtime.tracing import Tracing
from gateway.subscriptions.live import Live
from gateway.subscriptions.network import Network
from gateway.subscriptions.service import Subscriptions, new_run
from gateway.subscriptions.store import Store


def new_live(settings: GatewaySettings, open_session: Opener) -> Live:
    """The live fleet of a gateway with these settings, not yet joined."""
    return Live(
        settings.namespace,
        settings.gateway_name,
        lambda: open_session(settings.listen_endpoints, settings.connect_endpoints, settings.trust),
        secured=bool(settings.identities),
    )


def sockets_of(settings: GatewaySettings) -> Sockets:
    """The bounds of connections, at most as many as the process may have files."""
    return Sockets(within_files(int(settings.sockets)), int(settings.sockets_per_client))


def create_app(
    settings: GatewaySettings, tracing: Tracing | None = None, open_session: Opener = open_zenoh
) -> Starlette:
    """The ASGI application; entering its lifespan joins the fleet, through the session that ``open_session`` opens."""

    @asynccontextmanager
    async def lifespan(app: Starlette) -> AsyncIterator[None]:
        async with AsyncExitStack() as stack:
            live = await stack.enter_async_context(new_live(settings, open_session))
            live.add(*THINGS)
            span_s, rate_hz = float(settings.history_s), float(settings.history_hz)
            history = await stack.enter_async_context(
                History(live.fleet, span_s, rate_hz, int(settings.history_mb) * 10**6)
            )
            live.add(*(histories(history) if span_s else ()))
            embedded = app.state.embedded = None if settings.redis_url else Embedded(settings.state_path)
            url = settings.redis_url if embedded is None else (await stack.enter_async_context(embedded)).url
            run = new_run()
            app.state.audit = await stack.enter_async_context(Audit(url, settings.namespace))
            app.state.identities = None
            if settings.identities:
                key = SessionKey(url, settings.namespace, settings.session_key_file)
                identities = Identities(Path(settings.identities), key, EndedSessions(url, settings.namespace))
                app.state.identities = await stack.enter_async_context(identities)
            world = app.state.world = World(live, url, settings.namespace, settings.state_path / "meshes")
            await stack.enter_async_context(world)
            remembered = await stack.enter_async_context(ActionStore(url, settings.namespace, run))
            most_motions = int(settings.invocations_per_client)
            app.state.actions = await stack.enter_async_context(Actions(live, remembered, most_motions, world.checks))
            app.state.pictures = await stack.enter_async_context(Pictures(live))
            app.state.queries = await stack.enter_async_context(Queries(live))
            app.state.queries.contribute(world.triples)
            app.state.queries.place(lambda: world.objects.known)
            live.add(wing(app.state.queries))
            await live.join()
            store = await stack.enter_async_context(Store(url, settings.namespace, run))
            network = stack.enter_context(
                closing(Network(settings.callback_networks, ports=settings.callback_port_ranges))
            )
            subscriptions = Subscriptions(
                store, run, live.fan_out, network,
                consent=settings.callback_consent == "on", limit=int(settings.subscriptions_per_client),
                vouches=app.state.identities.vouches if app.state.identities else lambda *_: True,
            )  # fmt: skip
            app.state.live, app.state.subscriptions = live, await stack.enter_async_context(subscriptions)
            rules = Rules(
                live, app.state.actions, RuleStore(url, settings.namespace, run),
                app.state.queries.select,
                lambda rule: creator_of(rule, app.state.identities),
                app.state.audit, int(settings.rules_per_client), settings.public_urls,
            )  # fmt: skip
            app.state.rules = await stack.enter_async_context(rules)
            sampler = await stack.enter_async_context(Sampler(live.fleet))
            app.state.registry = registry(
                Numbers(live, subscriptions, app.state.actions, requests, sampler, history, rules, embedded)
            )
            yield

    requests, rates = Requests(), Rates(float(settings.requests_per_client))
    app = Starlette(
        middleware=[
            Middleware(Forwarded, fronts=settings.front_networks),
            Middleware(Front, metrics=metrics, requests=requests, tracing=tracing),
            *pages_elsewhere(settings.cors_pages),
            Middleware(Authorities, public_urls=settings.public_urls, prefixes=PREFIXES, pages=settings.cors_pages),
            Middleware(Callers),
            Middleware(Pace, rates=rates),
            Middleware(Loading),
        ],
        lifespan=lifespan,
    )
    app.state.readiness = Readiness()
    app.state.turns, app.state.repeats, app.state.offload = Turns(), Repeats(rates, requests), Offload()
    app.router.default = resources  # no route of its own has ever to know the tree, nor `OPTIONS *`
    return app
