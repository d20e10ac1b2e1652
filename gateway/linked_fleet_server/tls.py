"""The gateway's TLS: a replaceable certificate, and connections that report all buffered bytes."""

import asyncio
import logging
import socket
import ssl
from asyncio.sslproto import SSLProtocol
from asyncio.transports import BaseTransport, Transport
from collections.abc import Callable
from pathlib import Path
from typing import Any, Protocol, cast

from linked_fleet_agent.wire.trust import check_pair
from linked_fleet_server.addresses import network_of

log = logging.getLogger(__name__)
CHECK_S = 10.0
"""Period of checks of the files."""
HANDSHAKE_S = 10
_FAREWELL_S = 10  # for the other side's close, and for buffered bytes
_ENCRYPTED_BYTES = 16 * 1024
_BENEATH = "linked-fleet.beneath"


class Certificate:
    """A certificate chain and its key, PEM files. Raises ValueError with one clear sentence if they do not match."""

    def __init__(self, certificate: str, key: str) -> None:
        self._certificate, self._key = certificate, key
        self._seen = self._state()
        self.context = self._load()
        """The context of new connections."""

    def reload(self) -> None:
        """Use the present files for new connections; files that do not match are logged and ignored."""
        self._seen = self._state()
        try:
            self.context = self._load()
        except ValueError as error:
            log.error("the certificate in use stays: %s", error)
        else:
            log.info("new connections get the certificate of %s as it is now", self._certificate)

    async def reload_if_changed(self) -> None:
        """Reload the files if they have changed; to be called every ``CHECK_S``."""
        if self._state() != self._seen:
            self.reload()

    def _load(self) -> ssl.SSLContext:
        """Return a new context, because one that has certificates keeps those with keys of another kind."""
        check_pair(self._certificate, self._key)
        context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
        context.minimum_version = ssl.TLSVersion.TLSv1_2
        context.set_alpn_protocols(["http/1.1"])
        context.load_cert_chain(self._certificate, self._key)
        return context

    def _state(self) -> list[tuple[int, int, int] | None]:
        """Return stamps of the files."""
        state: list[tuple[int, int, int] | None] = []
        for path in (self._certificate, self._key):
            try:
                status = Path(path).stat()
                state.append((status.st_ino, status.st_mtime_ns, status.st_size))
            except OSError:  # being replaced, or gone: reload reports it
                state.append(None)
        return state


class OpenConnections(Protocol):
    """The part of ``connection_limits.Sockets`` that is used here."""

    def register(self, connection: object, client: str) -> bool: ...
    def mark_idle(self, connection: object, evict: Callable[[], bool]) -> None: ...
    def unregister(self, connection: object) -> None: ...


class TlsProtocol(SSLProtocol):
    """TLS on a connection, with access to the transport below. Until the handshake it counts as an own connection.

    This is asyncio's implementation in Python: uvloop's does not report bytes passed to TCP, so stalled readers would
    not be detected.
    """

    open_connections: OpenConnections

    def connection_made(self, transport: BaseTransport) -> None:
        self._extra[_BENEATH] = transport
        beneath = cast(Transport, transport)
        beneath.set_write_buffer_limits(high=_ENCRYPTED_BYTES)
        super().connection_made(transport)
        peer = transport.get_extra_info("peername")

        def evict() -> bool:
            beneath.abort()
            return True

        if self.open_connections.register(self, network_of(str(peer[0])) if isinstance(peer, tuple) else ""):
            self.open_connections.mark_idle(self, evict)
        else:
            beneath.abort()

    def connection_lost(self, exc: BaseException | None) -> None:
        self.open_connections.unregister(self)
        super().connection_lost(exc)

    def _on_handshake_complete(self, handshake_exc: BaseException | None) -> None:
        self.open_connections.unregister(self)  # the protocol above registers itself
        super()._on_handshake_complete(handshake_exc)


def unsent_bytes(transport: BaseTransport) -> int:
    """Return the bytes buffered in this process for the reader, encrypted or not.

    With TLS ``get_write_buffer_size``, which controls flow, leaves out those of the transport below.
    """
    above = cast(Transport, transport)
    beneath: Transport | None = above.get_extra_info(_BENEATH)
    return above.get_write_buffer_size() + (0 if beneath is None else beneath.get_write_buffer_size())


def file_descriptor(transport: BaseTransport) -> int | None:
    """Return the descriptor of a plain socket; None with TLS."""
    if transport.get_extra_info("sslcontext") is not None:
        return None
    connection: socket.socket = transport.get_extra_info("socket")
    return connection.fileno()


def tls_protocol_factory(
    inner: Callable[..., asyncio.Protocol], certificate: Certificate, open_connections: OpenConnections
) -> Any:
    """Return a factory of protocols that do the TLS handshake and then pass the connection to ``inner``."""

    def make(**arguments: Any) -> asyncio.BaseProtocol:
        protocol = TlsProtocol(
            asyncio.get_running_loop(), inner(**arguments), certificate.context, None,  # type: ignore[arg-type]  # nobody waits for it
            server_side=True,
            ssl_handshake_timeout=HANDSHAKE_S, ssl_shutdown_timeout=_FAREWELL_S,
        )  # fmt: skip
        protocol.open_connections = open_connections
        return protocol

    return make
