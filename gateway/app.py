"""The composition root: routes, middleware and lifespan of the gateway on one screen."""

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

from starlette.applications import Starlette
from starlette.middleware import Middleware

from gateway.graph.vocab import PREFIXES
from gateway.http.endpoint import resources
from gateway.http.host import Authorities
from gateway.live import Live
from gateway.settings import GatewaySettings


def create_app(settings: GatewaySettings) -> Starlette:
    """The ASGI application; entering its lifespan joins the fleet."""

    @asynccontextmanager
    async def lifespan(app: Starlette) -> AsyncIterator[None]:
        async with Live(settings) as live:
            app.state.live = live
            yield

    app = Starlette(
        middleware=[Middleware(Authorities, public_urls=settings.public_urls, prefixes=PREFIXES)],
        lifespan=lifespan,
    )
    app.router.default = resources  # no route of its own has ever to know the tree, nor `OPTIONS *`
    return app
