"""The HTTP server of a gateway: uvicorn with the gateway's protocol classes and limits."""

import socket
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from typing import Any, Protocol

import uvicorn
from starlette.types import Receive, Scope, Send

from linked_fleet_server.connection_limits import Sockets
from linked_fleet_server.exchange import Reply
from linked_fleet_server.protocol import HttpProtocol
from linked_fleet_server.tls import Certificate, tls_protocol_factory
from linked_fleet_server.websocket_protocol import WebSocketProtocol

_DRAIN_S = 5  # for running requests; a robot that does not answer takes up to 2 s
_WEBSOCKET_BYTES = 4096  # clients send only short messages
_PING_S = 20


class Application(Protocol):
    """An ASGI application that has responses without waiting, and takes part in a shutdown."""

    draining: bool
    """True while it ends as soon as running work is done. The server sets it."""

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None: ...

    def reply_nowait(self, scope: Scope) -> Reply | None:
        """Return the response to a request that needs no waiting; None for any other."""

    def end_waits(self) -> None:
        """Answer requests that wait for an event."""


class Server(uvicorn.Server):
    """Serves ``app`` on listening sockets passed to ``serve``.

    The caller enters the lifespan of ``app``, so that its errors stay exceptions, and handles signals, because uvicorn
    raises them again after serving, which would cut the lifespan short.
    """

    def __init__(self, app: Application, sockets: Sockets, certificate: Certificate | None = None) -> None:
        http: Any = partial(HttpProtocol, sockets=sockets, reply_nowait=app.reply_nowait)
        config = uvicorn.Config(
            app, lifespan="off", log_config=None, access_log=False, server_header=False,
            proxy_headers=False,  # uvicorn would trust loopback; http/forwarding.py trusts configured fronts
            timeout_graceful_shutdown=_DRAIN_S,
            http=tls_protocol_factory(http, certificate, sockets) if certificate else http,
            ws=WebSocketProtocol, ws_max_size=_WEBSOCKET_BYTES, ws_ping_interval=_PING_S,
        )  # fmt: skip
        super().__init__(config)
        self._app = app

    def begin_shutdown(self, number: int) -> None:
        """Stop accepting work, become not ready, and end when running work is done."""
        self._app.draining = True
        self.handle_exit(number, None)

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        self._app.end_waits()
        await super().shutdown(sockets)

    @contextmanager
    def capture_signals(self) -> Iterator[None]:
        yield
