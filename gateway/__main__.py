"""``python -m gateway``: settings → socket → application; nothing else."""

import asyncio
import gc
import logging
import os
import signal
import socket
import sys
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager, contextmanager
from functools import partial
from typing import Any

import uvicorn
import uvloop
from starlette.applications import Starlette

from agents.wire.trust import is_loopback, open_to_all
from gateway.app import create_app
from gateway.exposure import complaints
from gateway.http.patience import HEAD_S
from gateway.http.protocol import HttpProtocol
from gateway.http.sockets import Sockets, within_files
from gateway.http.tls import Certificate, secured
from gateway.http.websocket_protocol import WebSocketProtocol
from gateway.identity.roster import BadRoster
from gateway.link import LinkError
from gateway.observe.log import configure
from gateway.observe.tracing import Tracing, open_tracing
from gateway.session import trust
from gateway.settings import GatewaySettings
from gateway.store.connection import BadUrl
from telemetry.spans import TracingUnavailable

_DRAIN_S = 5  # for requests under way; 2 s may go by before a robot that does not answer is given up
# An Upgrade that is ignored, and each WebSocket that comes and goes.
_ORDINARY = ("Unsupported upgrade request.", '%s - "WebSocket %s"', "connection open", "connection closed",
             "connection rejected", "HTTP response sent")  # fmt: skip
_WEBSOCKET_BYTES = 4096
_PING_S = 20
_UNSENT_BYTES = 16 * 1024
_BACKLOG = 2048  # uvicorn's


class _Server(uvicorn.Server):
    """Leaves signals to us: uvicorn raises them again after serving, which would cut the lifespan short."""

    def __init__(self, config: uvicorn.Config, app: Starlette) -> None:
        super().__init__(config)
        self._app = app

    def leave(self, number: int) -> None:
        """Take no more work, and end when that under way is done; from now on the gateway is not ready."""
        self._app.state.draining = True
        self.handle_exit(number, None)

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        self._app.state.actions.waiting.hurry()
        await super().shutdown(sockets)

    @contextmanager
    def capture_signals(self) -> Iterator[None]:
        yield


_SWITCH_S = 0.0005
_YOUNG = 10_000  # objects made and not unmade, after which those are looked through: a millisecond


def main() -> int:
    logging.getLogger("uvicorn.error").addFilter(_is_news)
    try:
        settings = GatewaySettings.read(os.environ, sys.argv[1:])
        configure(settings.log_format)
        _refuse_exposure(settings)
        certificate = Certificate(settings.tls_cert, settings.tls_key) if settings.tls_cert else None
        tracing = open_tracing(os.environ, settings.gateway_name)
        listener = _listen(settings.host, settings.port_number)
    except (ValueError, OSError) as error:
        print(f"gateway: {error}", file=sys.stderr)
        return 1
    except TracingUnavailable as error:
        print(f"gateway: {error}", file=sys.stderr)
        return 2
    # Plans are computed in threads; the event loop is not to wait 5 ms for each piece of their work.
    sys.setswitchinterval(_SWITCH_S)
    try:
        return uvloop.run(_serve(settings, listener, certificate, tracing))
    except (LinkError, BadUrl, BadRoster) as error:
        print(f"gateway: {error}", file=sys.stderr)
        return 1
    finally:
        listener.close()
        if tracing is not None:
            tracing.close()


def _refuse_exposure(settings: GatewaySettings) -> None:
    """ValueError, in one line, for what may not be reached from other machines as it is, or proves nothing."""
    trust(settings.credentials, settings.zenoh_access)
    # Whom a certificate names does not matter where nobody has said what each of them may do.
    proof = settings.credentials if settings.zenoh_access else None
    found = complaints(
        exposed=not is_loopback(settings.host),
        tls=bool(settings.tls_cert),
        identities=bool(settings.identities),
        open_endpoints=open_to_all(settings.listen_endpoints, proof),
        allowed=settings.allowed,
    )
    if found:
        raise ValueError(f"refused: {'; '.join(found)}")


def _is_news(record: logging.LogRecord) -> bool:
    """Whether a message of uvicorn is worth a line."""
    return not str(record.msg).startswith(_ORDINARY)


async def _serve(
    settings: GatewaySettings, listener: socket.socket, certificate: Certificate | None, tracing: Tracing | None
) -> int:
    app = create_app(settings, tracing)
    sockets = Sockets(within_files(int(settings.sockets)), int(settings.sockets_per_client))
    http: Any = partial(HttpProtocol, sockets=sockets, repeats=app.state.repeats)
    # The lifespan is entered here, not by the server: its errors stay exceptions, and the address is printed when true.
    config = uvicorn.Config(
        app, lifespan="off", log_config=None, access_log=False, server_header=False,
        proxy_headers=False,  # uvicorn would believe loopback; gateway.http.forwarded believes named fronts
        timeout_graceful_shutdown=_DRAIN_S, timeout_keep_alive=int(HEAD_S),
        # On h11. httptools loses the body of a request whose Upgrade is ignored (uvicorn issue 2722), and the authority
        # of an absolute request target, and makes a 400 of every method that it does not know.
        http=secured(http, certificate.context) if certificate else http,
        # One framed buffer serves all subscribers, so there is no compression; and clients have nothing to say.
        ws=WebSocketProtocol, ws_per_message_deflate=False, ws_max_size=_WEBSOCKET_BYTES,
        ws_ping_interval=_PING_S, ws_ping_timeout=_PING_S,
    )  # fmt: skip
    app.state.draining = False
    server = _Server(config, app)
    for number in (signal.SIGINT, signal.SIGTERM):
        asyncio.get_running_loop().add_signal_handler(number, server.leave, number)
    async with app.router.lifespan_context(app), _followed(certificate):
        _settle()
        print(f"serving {settings.public_urls[0]}/", flush=True)
        await server.serve(sockets=[listener])
    return 0


def _settle() -> None:
    """What is there by now stays: to look through it for garbage again and again held the event loop for 140 ms, and
    with Python's own threshold hundreds of messages at once made it look several times a second."""
    gc.freeze()
    gc.set_threshold(_YOUNG)


@asynccontextmanager
async def _followed(certificate: Certificate | None) -> AsyncIterator[None]:
    """Meanwhile a new certificate is taken when its files change, and at once on SIGHUP."""
    if certificate is None:
        yield
        return
    asyncio.get_running_loop().add_signal_handler(signal.SIGHUP, certificate.reload)
    following = asyncio.create_task(certificate.follow())
    try:
        yield
    finally:
        following.cancel()


def _listen(host: str, port: int) -> socket.socket:
    """A listening socket; OSError with one clear sentence when the address is taken or not ours."""
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    # Spelt out, or asyncio does not know it for TCP and leaves Nagle's algorithm on: 40 ms an answer.
    listener = socket.socket(family, socket.SOCK_STREAM, socket.IPPROTO_TCP)
    listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    if hasattr(socket, "TCP_NOTSENT_LOWAT"):
        # Inherited by each connection: what is not on its way yet shall wait here, where a newer value replaces it,
        # and not as megabytes of old values in the kernel.
        listener.setsockopt(socket.IPPROTO_TCP, socket.TCP_NOTSENT_LOWAT, _UNSENT_BYTES)
    try:
        listener.bind((host, port))
        # At once: a bound port is not taken yet, and whoever reads "serving" may connect.
        listener.listen(_BACKLOG)
    except OSError as error:
        listener.close()
        raise OSError(f"cannot listen on {host}:{port}: {error.strerror}; choose another with --port") from None
    return listener


if __name__ == "__main__":
    sys.exit(main())
