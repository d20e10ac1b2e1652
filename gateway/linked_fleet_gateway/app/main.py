"""The process of a gateway: settings, refusals, listener, event loop and garbage collection."""

import asyncio
import gc
import logging
import os
import signal
import socket
import sys
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

import uvloop

from linked_fleet_agent.spans import TracingUnavailable
from linked_fleet_agent.wire.trust import is_loopback, unauthenticated_endpoints
from linked_fleet_gateway.app.application import create_app, create_sockets
from linked_fleet_gateway.app.settings import GatewaySettings, exposure_problems
from linked_fleet_identity.roster import BadRoster
from linked_fleet_link.transport import LinkError
from linked_fleet_runtime.background import supervised
from linked_fleet_runtime.log import configure_logging
from linked_fleet_runtime.redis import InvalidUrl
from linked_fleet_runtime.tracing import Tracing, open_tracing
from linked_fleet_server.server import Server
from linked_fleet_server.tls import CHECK_S, Certificate
from linked_fleet_shacl import Unsupported

_log = logging.getLogger(__name__)
_UNSENT_BYTES = 16 * 1024
_BACKLOG = 2048  # uvicorn's default


_SWITCH_S = 0.0005
_YOUNG = 10_000  # net allocations after which the youngest generation is collected, which takes a millisecond


def main() -> int:
    """Run the gateway of the command line until a signal ends it. Return its exit code."""
    try:
        settings = GatewaySettings.read(os.environ, sys.argv[1:])
        configure_logging(settings.log_format)
        _refuse_exposure(settings)
        certificate = _certificate(settings)
        tracing = open_tracing(os.environ, settings.gateway_name)
        listener = _listen(settings.host, settings.port)
    except (ValueError, OSError) as error:
        print(f"gateway: {error}", file=sys.stderr)
        return 1
    except TracingUnavailable as error:
        print(f"gateway: {error}", file=sys.stderr)
        return 2
    # Plans are computed in threads. A shorter switch interval keeps the event loop from waiting 5 ms for them.
    sys.setswitchinterval(_SWITCH_S)
    try:
        return uvloop.run(_serve(settings, listener, certificate, tracing))
    except (LinkError, InvalidUrl, BadRoster, Unsupported) as error:
        print(f"gateway: {error}", file=sys.stderr)
        return 1
    finally:
        listener.close()
        if tracing is not None:
            tracing.close()


def _refuse_exposure(settings: GatewaySettings) -> None:
    """Raise ValueError, in one line, for an exposure without protection or for credentials that cannot be used."""
    settings.trust  # noqa: B018 -- raises ValueError
    # The name in a certificate has no effect unless the access list says what each name may do.
    proof = settings.credentials if settings.zenoh_access else None
    found = exposure_problems(
        exposed=not is_loopback(settings.host),
        tls=bool(settings.tls_cert),
        identities=bool(settings.identities),
        open_endpoints=unauthenticated_endpoints(settings.listen_endpoints, proof),
        allowed=settings.allow,
    )
    if found:
        raise ValueError(f"refused: {'; '.join(found)}")


def _certificate(settings: GatewaySettings) -> Certificate | None:
    return Certificate(str(settings.tls_cert), str(settings.tls_key)) if settings.tls_cert else None


async def _serve(
    settings: GatewaySettings, listener: socket.socket, certificate: Certificate | None, tracing: Tracing | None
) -> int:
    app = create_app(settings, tracing)
    server = Server(app, create_sockets(settings), certificate)
    for number in (signal.SIGINT, signal.SIGTERM):
        asyncio.get_running_loop().add_signal_handler(number, server.begin_shutdown, number)
    async with app.router.lifespan_context(app), _followed(certificate):
        settle()
        print(f"serving {settings.public_urls[0]}/", flush=True)
        await server.serve(sockets=[listener])
    return 0


def settle() -> None:
    """Exempt present objects from garbage collection, and collect less often.

    A full collection held the event loop for 140 ms, and with Python's default threshold hundreds of messages at once
    caused several collections a second.
    """
    gc.freeze()
    gc.set_threshold(_YOUNG)


@asynccontextmanager
async def _followed(certificate: Certificate | None) -> AsyncIterator[None]:
    """Reload the certificate when its files change, and at once on SIGHUP."""
    if certificate is None:
        yield
        return
    asyncio.get_running_loop().add_signal_handler(signal.SIGHUP, certificate.reload)
    following = supervised(
        certificate.reload_if_changed, "follow the certificate", _log, "the certificate in use stays", CHECK_S
    )
    try:
        yield
    finally:
        following.cancel()


def _listen(host: str, port: int) -> socket.socket:
    """Return a listening socket.

    Raises OSError with one clear sentence if the address is in use or not of this machine.
    """
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    # With an explicit protocol asyncio sets TCP_NODELAY. With Nagle's algorithm an answer would take 40 ms.
    listener = socket.socket(family, socket.SOCK_STREAM, socket.IPPROTO_TCP)
    listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    if hasattr(socket, "TCP_NOTSENT_LOWAT"):
        # Accepted connections inherit this limit. Unsent messages then wait in this process, where newer values replace
        # them, and not as megabytes of old values in the kernel.
        listener.setsockopt(socket.IPPROTO_TCP, socket.TCP_NOTSENT_LOWAT, _UNSENT_BYTES)
    try:
        listener.bind((host, port))
        # Listen now: a bound port can still be taken by others, and clients connect as soon as "serving" is logged.
        listener.listen(_BACKLOG)
    except OSError as error:
        listener.close()
        raise OSError(f"cannot listen on {host}:{port}: {error.strerror}; choose another with --port") from None
    return listener
