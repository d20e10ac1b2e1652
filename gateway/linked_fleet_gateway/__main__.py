"""``python -m linked_fleet_gateway``: settings → socket → application; nothing else."""

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
from linked_fleet_agent.wire.trust import is_loopback, open_to_all
from linked_fleet_gateway.app.application import create_app, sockets_of
from linked_fleet_gateway.app.exposure import complaints
from linked_fleet_gateway.app.settings import GatewaySettings
from linked_fleet_gateway.http.server import Server
from linked_fleet_gateway.http.tls import Certificate
from linked_fleet_gateway.identity.roster import BadRoster
from linked_fleet_gateway.link.transport import LinkError
from linked_fleet_gateway.runtime.log import configure
from linked_fleet_gateway.runtime.redis import BadUrl
from linked_fleet_gateway.runtime.tracing import Tracing, open_tracing
from linked_fleet_gateway.shacl import Unsupported

# An Upgrade that is ignored, and each WebSocket that comes and goes.
_ORDINARY = ("Unsupported upgrade request.", '%s - "WebSocket %s"', "connection open", "connection closed",
             "connection rejected", "HTTP response sent")  # fmt: skip
_UNSENT_BYTES = 16 * 1024
_BACKLOG = 2048  # uvicorn's


_SWITCH_S = 0.0005
_YOUNG = 10_000  # objects made and not unmade, after which those are looked through: a millisecond


def main() -> int:
    logging.getLogger("uvicorn.error").addFilter(_is_news)
    try:
        settings = GatewaySettings.read(os.environ, sys.argv[1:])
        configure(settings.log_format)
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
    # Plans are computed in threads; the event loop is not to wait 5 ms for each piece of their work.
    sys.setswitchinterval(_SWITCH_S)
    try:
        return uvloop.run(_serve(settings, listener, certificate, tracing))
    except (LinkError, BadUrl, BadRoster, Unsupported) as error:
        print(f"gateway: {error}", file=sys.stderr)
        return 1
    finally:
        listener.close()
        if tracing is not None:
            tracing.close()


def _refuse_exposure(settings: GatewaySettings) -> None:
    """ValueError, in one line, for what may not be reached from other machines as it is, or proves nothing."""
    settings.trust  # noqa: B018 -- ValueError
    # Whom a certificate names does not matter where nobody has said what each of them may do.
    proof = settings.credentials if settings.zenoh_access else None
    found = complaints(
        exposed=not is_loopback(settings.host),
        tls=bool(settings.tls_cert),
        identities=bool(settings.identities),
        open_endpoints=open_to_all(settings.listen_endpoints, proof),
        allowed=settings.allow,
    )
    if found:
        raise ValueError(f"refused: {'; '.join(found)}")


def _certificate(settings: GatewaySettings) -> Certificate | None:
    return Certificate(str(settings.tls_cert), str(settings.tls_key)) if settings.tls_cert else None


def _is_news(record: logging.LogRecord) -> bool:
    """Return True if a message of uvicorn is worth a line."""
    return not str(record.msg).startswith(_ORDINARY)


async def _serve(
    settings: GatewaySettings, listener: socket.socket, certificate: Certificate | None, tracing: Tracing | None
) -> int:
    app = create_app(settings, tracing)
    server = Server(app, sockets_of(settings), certificate)
    for number in (signal.SIGINT, signal.SIGTERM):
        asyncio.get_running_loop().add_signal_handler(number, server.leave, number)
    async with app.router.lifespan_context(app), _followed(certificate):
        _settle()
        print(f"serving {settings.public_urls[0]}/", flush=True)
        await server.serve(sockets=[listener])
    return 0


def _settle() -> None:
    """Exempt what is there by now from garbage collection: looking through it held the event loop for 140 ms, and
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
    following = certificate.follow()
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
