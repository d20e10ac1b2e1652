"""Checks of this machine: its clock, and the ports on which a gateway listens.

The clock is checked by the kernel's state. The clock of Redis is checked in ``redis_server``.
"""

import ctypes
import http.client
import json
import re
import socket
import ssl
import sys
from collections.abc import Iterator, Sequence

from linked_fleet_doctor.finding import Finding

_ERROR = 5  # TIME_ERROR of adjtimex(2): the clock is not synchronised
_TIMEX_BYTES = 1024  # struct timex has 208 bytes on 64 bits; all zeros queries without a change


def check_machine() -> Finding:
    """Check that the clock is synchronised, on which times of values, certificates and lags of frames depend."""
    if not sys.platform.startswith("linux"):
        return Finding("clocks", "that of this machine is not checked: it has no adjtimex", is_note=True)
    state = ctypes.CDLL(None, use_errno=True).adjtimex(ctypes.create_string_buffer(_TIMEX_BYTES))
    if state == _ERROR:
        sentence = "nobody sets the clock of this machine, as far as its kernel knows"
        return Finding("clocks", sentence, "have it set by NTP, on the host if this is a container", is_note=True)
    if state < 0:
        return Finding("clocks", "the kernel does not say whether anybody sets the clock of this machine", is_note=True)
    return Finding("clocks", "that of this machine is set by NTP")


_ANSWER_S = 3.0
_MOST_BYTES = 65_536
_LOCATOR = re.compile(r"(tcp|tls|quic|udp)/\[?(.*?)\]?:(\d+)(?:[?#].*)?")


def check_http_port(host: str, port: int, tls: bool) -> Finding:
    """Check that the HTTP port is free or used by a gateway."""
    taken = _taken(host, port, socket.SOCK_STREAM)
    if not taken:
        return Finding("port", f"{host}:{port} is free for HTTP")
    if _is_gateway(host, port, tls):
        return Finding("port", f"a gateway serves at {host}:{port} already")
    return Finding("port", f"{host}:{port} cannot be listened on: {taken}", "choose another with --port and --host")


def check_zenoh_ports(endpoints: Sequence[str], served: bool) -> Iterator[Finding]:
    """Check the ports on which a gateway listens for robots; ``served`` says that a gateway runs here already."""
    for endpoint in endpoints:
        match = _LOCATOR.fullmatch(endpoint)
        if match is None:
            yield Finding("zenoh", f"{endpoint} is not checked: it is no address of TCP or UDP", is_note=True)
            continue
        protocol, host, port = match.groups()
        kind = socket.SOCK_STREAM if protocol in ("tcp", "tls") else socket.SOCK_DGRAM
        taken = _taken(host, int(port), kind)
        if not taken:
            yield Finding("zenoh", f"{endpoint} is free to listen on")
        elif served:
            yield Finding("zenoh", f"{endpoint} is taken, as it is while a gateway serves")
        else:
            advice = "end that program, or choose another endpoint with --zenoh-listen"
            yield Finding("zenoh", f"{endpoint} cannot be listened on: {taken}", advice)


def _taken(host: str, port: int, kind: socket.SocketKind) -> str:
    """Return the reason why this address cannot be listened on; empty if it can."""
    try:
        (family, _, _, _, address), *_ = socket.getaddrinfo(host, port, type=kind, flags=socket.AI_PASSIVE)
        with socket.socket(family, kind) as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            probe.bind(address)
            if kind == socket.SOCK_STREAM:
                probe.listen(1)
    except OSError as error:
        return (error.strerror or str(error)).lower()
    return ""


def _is_gateway(host: str, port: int, tls: bool) -> bool:
    """Return True if /health/ready answers like a gateway, ready or not."""
    # The request goes to an address of this machine, which the certificate may not name; certificates are checked
    # elsewhere.
    context = ssl._create_unverified_context() if tls else None  # noqa: S323
    reached = {"0.0.0.0": "127.0.0.1", "::": "::1"}.get(host, host)  # noqa: S104 -- only connected to, not listened on
    connection = (
        http.client.HTTPSConnection(reached, port, timeout=_ANSWER_S, context=context)
        if context
        else http.client.HTTPConnection(reached, port, timeout=_ANSWER_S)
    )
    try:
        connection.request("GET", "/health/ready")
        answer = connection.getresponse()
        said = json.loads(answer.read(_MOST_BYTES))
    except (OSError, http.client.HTTPException, ValueError):
        return False
    finally:
        connection.close()
    return answer.status in (200, 503) and isinstance(said, dict)
