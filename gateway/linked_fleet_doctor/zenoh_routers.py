"""Checks of the routers that a gateway connects to: reachable, trusted, and speaking Zenoh."""

import asyncio
import re
import socket
import ssl
from collections.abc import Iterator, Mapping, Sequence

from linked_fleet_agent.wire.keys import Keys
from linked_fleet_agent.wire.trust import Credentials
from linked_fleet_doctor.finding import Finding
from linked_fleet_link.transport import LinkError
from linked_fleet_link.zenoh_session import open_session

_ENDPOINT = re.compile(r"(tcp|tls)/\[?(.*?)\]?:(\d+)(?:[?#].*)?")
_ANSWER_S = 3.0
_REFUSAL_S = 0.5
"""Time in which a router that refuses a certificate closes; with TLS 1.3 it does so after the handshake."""
_LINK_S = 5.0
_LOOK_S = 0.05
_CERTIFICATES = "run deploy/certificates with all names of the routers in --router, and give everybody its files"


def check_endpoints(endpoints: Sequence[str], credentials: Credentials | None) -> Iterator[Finding]:
    """Check each endpoint by itself: a connection, and for tls/ the certificates of both sides."""
    for endpoint in endpoints:
        match = _ENDPOINT.fullmatch(endpoint)
        if match is None:
            yield Finding("zenoh", f"{endpoint} is not tried by itself: that is done for tcp/ and tls/", is_note=True)
            continue
        protocol, host, port = match.groups()
        if protocol == "tls" and credentials is None:
            advice = "give LINKED_FLEET_ZENOH_CA, LINKED_FLEET_ZENOH_CERT and LINKED_FLEET_ZENOH_KEY"
            yield Finding("zenoh", f"{endpoint} asks for a certificate, and none is set", advice)
        else:
            yield _address(endpoint, host, int(port), credentials if protocol == "tls" else None)


def _address(endpoint: str, host: str, port: int, credentials: Credentials | None) -> Finding:
    try:
        with socket.create_connection((host, port), _ANSWER_S) as connection:
            if credentials is None:
                return Finding("zenoh", f"something listens at {endpoint}")
            with _context(credentials).wrap_socket(connection, server_hostname=host) as secured:
                secured.settimeout(_REFUSAL_S)
                _hear_refusal(secured)
    except ssl.SSLCertVerificationError as error:
        return Finding("zenoh", f"the certificate of {endpoint} is not believed: {error.verify_message}", _CERTIFICATES)
    except ssl.SSLError as error:
        reason = (error.reason or str(error)).lower().replace("_", " ")
        return Finding("zenoh", f"{endpoint} refuses our certificate: {reason}", _CERTIFICATES)
    except OSError as error:
        reason = (error.strerror or str(error)).lower()
        return Finding("zenoh", f"nothing answers at {endpoint}: {reason}", "start the router, or correct the address")
    return Finding("zenoh", f"{endpoint} and this gateway believe each other's certificates")


def _hear_refusal(secured: ssl.SSLSocket) -> None:
    """Raise SSLError if the router closes or sends an alert. Otherwise it waits for us to speak first."""
    try:
        if not secured.recv(1):
            raise ssl.SSLError("it closed the connection")
    except TimeoutError:
        return


def _context(credentials: Credentials) -> ssl.SSLContext:
    context = ssl.create_default_context(cafile=credentials.authority)
    context.load_cert_chain(credentials.certificate, credentials.key)
    return context


async def check_link(endpoints: tuple[str, ...], trust: Mapping[str, object], namespace: str) -> Finding:
    """Open a link like a gateway and count the visible robots."""
    try:
        session = await open_session((), endpoints, trust)
    except LinkError as error:
        return Finding("zenoh", str(error), "correct LINKED_FLEET_ZENOH_CONNECT")
    try:
        async with asyncio.timeout(_LINK_S):
            while not session.connected:  # noqa: ASYNC110 -- Zenoh has no event for this
                await asyncio.sleep(_LOOK_S)
        robots, _ = await session.list_tokens(Keys(namespace).all_presence, _ANSWER_S, lambda keys: len(set(keys)))
    except TimeoutError:
        advice = "look whether it is a router of Zenoh 1.10, and at its log"
        return Finding("zenoh", f"no link to {', '.join(endpoints)} within {_LINK_S:.0f} s", advice)
    finally:
        await session.close()
    said = "1 robot is" if robots == 1 else f"{robots} robots are"
    return Finding("zenoh", f"linked; {said} present in the namespace {namespace!r}")
