"""The extension ``foxglove``: the live fleet in the protocol of Foxglove, and recordings of what went wrong."""

from collections.abc import AsyncIterator
from contextlib import AsyncExitStack, asynccontextmanager
from dataclasses import dataclass

from starlette.responses import Response

from linked_fleet_gateway.extensions.cameras.pictures import Pictures
from linked_fleet_gateway.extensions.foxglove.protocol import SUBPROTOCOLS
from linked_fleet_gateway.extensions.history.files import MCAP
from linked_fleet_gateway.extensions.history.recorder import History
from linked_fleet_gateway.http.conversation import Speaker
from linked_fleet_gateway.http.extension import Core, Extension, Mount
from linked_fleet_gateway.http.request import Request
from linked_fleet_gateway.resources.branches import Branch, FleetBranch, Found, RequestView
from linked_fleet_gateway.resources.resource import Resource

_PATH = "/foxglove"


@dataclass(frozen=True)
class FoxgloveEndpoint:
    """The address of the WebSocket."""


class FoxgloveExtension(Extension):
    name = "foxglove"
    uses = ("cameras", "history", "world")
    modules = ("foxglove",)
    at_root = (_PATH[1:],)
    in_robot = ("recordings",)

    @asynccontextmanager
    async def start(self, core: Core) -> AsyncIterator[Mount]:
        from linked_fleet_gateway.extensions.foxglove.hub import Hub
        from linked_fleet_gateway.extensions.foxglove.recordings import Recordings

        hub, history = Hub(core.live, core.optional_service(Pictures)), core.optional_service(History)
        async with AsyncExitStack() as stack:
            branches: list[Branch] = [FleetBranch(_PATH[1:], None, _resolve)]
            if history is not None and history.span_s:
                recordings = Recordings(core.live, history, core.state_path / "recordings")
                branches.append(await stack.enter_async_context(recordings.running()))
            yield Mount(
                branches=branches,
                readers={FoxgloveEndpoint: _read},
                speakers={FoxgloveEndpoint: Speaker(SUBPROTOCOLS, hub.speak)},
                formats={"mcap": ("MCAP", MCAP)},
            )


def _resolve(view: RequestView, rest: list[str]) -> Found:
    return None if rest else Resource(_PATH, "Foxglove", None, remote=FoxgloveEndpoint())


async def _read(request: Request, resource: Resource, endpoint: FoxgloveEndpoint) -> Response:
    """Say that this address is that of a WebSocket (RFC 9110, 15.5.22)."""
    said = f"This is a WebSocket; connect Foxglove to {request.base.replace('http', 'ws', 1)}{_PATH}\n"
    return Response(said, 426, {"upgrade": "websocket", "connection": "upgrade"}, "text/plain")
