"""The HTTP server of a gateway: uvicorn with the gateway's protocol classes and limits."""

import socket
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from typing import Any

import uvicorn

from linked_fleet_gateway.http.connection_limits import HEAD_S, Sockets
from linked_fleet_gateway.http.protocol import HttpProtocol
from linked_fleet_gateway.http.request import Gateway
from linked_fleet_gateway.http.tls import Certificate, tls_protocol_factory
from linked_fleet_gateway.http.websocket_protocol import WebSocketProtocol

_DRAIN_S = 5  # for running requests; a robot that does not answer takes up to 2 s
_WEBSOCKET_BYTES = 4096
_PING_S = 20


class Server(uvicorn.Server):
    """Serves ``app`` on listening sockets passed to ``serve``.

    The caller enters the lifespan of ``app``, so that its errors stay exceptions, and handles signals, because uvicorn
    raises them again after serving, which would cut the lifespan short.
    """

    def __init__(self, app: Gateway, sockets: Sockets, certificate: Certificate | None = None) -> None:
        http: Any = partial(HttpProtocol, sockets=sockets, reply_nowait=app.reply_nowait)
        config = uvicorn.Config(
            app, lifespan="off", log_config=None, access_log=False, server_header=False,
            proxy_headers=False,  # uvicorn would trust loopback; http/forwarding.py trusts configured fronts
            timeout_graceful_shutdown=_DRAIN_S, timeout_keep_alive=int(HEAD_S),
            http=tls_protocol_factory(http, certificate, sockets) if certificate else http,
            # No compression, because one framed buffer serves all subscribers. Clients send only short messages.
            ws=WebSocketProtocol, ws_per_message_deflate=False, ws_max_size=_WEBSOCKET_BYTES,
            ws_ping_interval=_PING_S, ws_ping_timeout=_PING_S,
        )  # fmt: skip
        super().__init__(config)
        self._app = app

    def begin_shutdown(self, number: int) -> None:
        """Stop accepting work, become not ready, and end when running work is done."""
        self._app.draining = True
        self.handle_exit(number, None)

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        self._app.services.actions.lifecycle.waiters.shut_down()
        await super().shutdown(sockets)

    @contextmanager
    def capture_signals(self) -> Iterator[None]:
        yield
