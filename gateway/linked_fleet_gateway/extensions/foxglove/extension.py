"""The extension ``foxglove``: the live fleet in the protocol of Foxglove."""

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import dataclass

from starlette.responses import Response

from linked_fleet_gateway.api import (
    Core,
    Extension,
    FleetBranch,
    Found,
    Mount,
    Request,
    RequestView,
    Resource,
    WebSocketHandler,
)
from linked_fleet_gateway.extensions.cameras.pictures import Pictures
from linked_fleet_gateway.extensions.foxglove.protocol import SUBPROTOCOLS
from linked_fleet_gateway.extensions.world.service import World

_PATH = "/foxglove"


@dataclass(frozen=True)
class FoxgloveEndpoint:
    """The resource of the WebSocket."""


class FoxgloveExtension(Extension):
    name = "foxglove"
    uses = ("cameras", "world")
    modules = ("foxglove",)
    at_root = (_PATH[1:],)

    @asynccontextmanager
    async def start(self, core: Core) -> AsyncIterator[Mount]:
        from linked_fleet_gateway.extensions.foxglove.hub import Hub

        hub = Hub(core, core.optional_service(Pictures), core.optional_service(World))
        with core.listening_to_invocations(hub.hear):
            yield Mount(
                branches=(FleetBranch(_PATH[1:], None, _resolve),),
                readers={FoxgloveEndpoint: _read},
                websocket_handlers={FoxgloveEndpoint: WebSocketHandler(SUBPROTOCOLS, hub.serve)},
            )


def _resolve(view: RequestView, rest: list[str]) -> Found:
    return None if rest else Resource(_PATH, "Foxglove", None, remote=FoxgloveEndpoint())


async def _read(request: Request, resource: Resource, endpoint: FoxgloveEndpoint) -> Response:
    """Tell the client to connect by WebSocket (426, RFC 9110, 15.5.22)."""
    said = f"This is a WebSocket; connect Foxglove to {request.base.replace('http', 'ws', 1)}{_PATH}\n"
    return Response(said, 426, {"upgrade": "websocket", "connection": "upgrade"}, "text/plain")
