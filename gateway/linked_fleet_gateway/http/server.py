"""The HTTP server of a gateway: uvicorn with the gateway's own protocol classes and bounds."""

import socket
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from typing import Any

import uvicorn

from linked_fleet_gateway.http.protocol import HttpProtocol
from linked_fleet_gateway.http.request import Gateway
from linked_fleet_gateway.http.sockets import Sockets
from linked_fleet_gateway.http.timeouts import HEAD_S
from linked_fleet_gateway.http.tls import Certificate, secured
from linked_fleet_gateway.http.websocket_protocol import WebSocketProtocol

_DRAIN_S = 5  # for requests under way; 2 s may go by before a robot that does not answer is given up
_WEBSOCKET_BYTES = 4096
_PING_S = 20


class Server(uvicorn.Server):
    """Serves ``app`` on the listening sockets that are given to ``serve``.

    The caller enters the lifespan of ``app``, so that its errors stay exceptions. It handles signals as well: uvicorn
    raises them again after serving, which would cut the lifespan short.
    """

    def __init__(self, app: Gateway, sockets: Sockets, certificate: Certificate | None = None) -> None:
        http: Any = partial(HttpProtocol, sockets=sockets, at_once=app.at_once)
        config = uvicorn.Config(
            app, lifespan="off", log_config=None, access_log=False, server_header=False,
            proxy_headers=False,  # uvicorn would believe loopback; http/forwarded.py believes named fronts
            timeout_graceful_shutdown=_DRAIN_S, timeout_keep_alive=int(HEAD_S),
            http=secured(http, certificate.context) if certificate else http,
            # One framed buffer serves all subscribers, so there is no compression; and clients have nothing to say.
            ws=WebSocketProtocol, ws_per_message_deflate=False, ws_max_size=_WEBSOCKET_BYTES,
            ws_ping_interval=_PING_S, ws_ping_timeout=_PING_S,
        )  # fmt: skip
        super().__init__(config)
        self._app = app

    def leave(self, number: int) -> None:
        """Take no more work, and end when that under way is done; from now on the gateway is not ready."""
        self._app.draining = True
        self.handle_exit(number, None)

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        self._app.services.actions.waiting.hurry()
        await super().shutdown(sockets)

    @contextmanager
    def capture_signals(self) -> Iterator[None]:
        yield
