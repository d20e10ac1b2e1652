"""Requests that arrive through a front: the address of the client, and the public URL.

A trusted front names the client in ``X-Forwarded-For``, or in ``Forwarded`` (RFC 7239). The ``Host`` field selects the
public URL, and never creates an IRI itself (RFC 9110, 7.4). Pages of other sites are refused: they may neither act nor
listen (RFC 6455, 10.2).
"""

import re
from collections.abc import Awaitable, Callable, Iterable, MutableMapping, Sequence
from ipaddress import IPv4Address, IPv4Network, IPv6Address, IPv6Network, ip_address
from typing import Any
from urllib.parse import unquote, urlsplit

from starlette.datastructures import Headers
from starlette.types import Scope

from linked_fleet_base.errors import BadRequest, FleetError, ForeignOrigin, MisdirectedRequest
from linked_fleet_gateway.http.arrival import arrival_of
from linked_fleet_gateway.http.problem import problem
from linked_fleet_gateway.http.request import html_of

Network = IPv4Network | IPv6Network
_Address = IPv4Address | IPv6Address
# RFC 7239, 4. Many fronts do not quote the colon of a port. Possessive, because hostile quotes could take quadratic
# time.
_PAIR = re.compile(r'\s*+([\w!#$%&\'*+.^`|~-]++)=("(?:[^"\\]|\\.)*+"|[^\s;,"]++)\s*+([;,]|\Z)', re.ASCII)


def find_client(scope: Scope, fronts: Sequence[Network]) -> None:
    """Set ``scope["client"]`` to the client's own address if a trusted proxy (``fronts``) forwards its request.

    These fields are ignored from other peers.
    """
    client = scope.get("client")
    if client and fronts:
        host = forwarded_client(client[0], Headers(scope=scope), fronts)
        if host != client[0]:
            scope["client"] = (host, 0)  # of its port nothing is known


def forwarded_client(peer: str, headers: Headers, fronts: Sequence[Network]) -> str:
    """Return the rightmost address that is not a front, starting with ``peer``, the other end of the connection.

    A front writes one of the two fields and may pass on the other from the client. So if both exist and disagree,
    neither is trusted, and the client counts as the front.
    """
    address = _address(peer)
    if address is None or not _is_front(address, fronts):
        return peer
    hops = []
    if forwarded_for := headers.getlist("x-forwarded-for"):
        hops.append(",".join(forwarded_for).split(","))
    if forwarded := headers.getlist("forwarded"):
        hops.append(_nodes(",".join(forwarded)))
    found = {_rightmost(address, each, fronts) for each in hops}
    return str(found.pop()) if len(found) == 1 else peer


def _rightmost(peer: _Address, hops: Sequence[str], fronts: Sequence[Network]) -> _Address:
    """Return the rightmost hop that is no front, or the last known one before a hidden or invalid hop."""
    known = peer
    for hop in reversed(hops):
        address = _address(hop)
        if address is None:
            return known
        known = address
        if not _is_front(address, fronts):
            return known
    return known


def _nodes(text: str) -> list[str]:
    """Return the ``for`` of each element of ``Forwarded``, in order; an empty list if it is malformed."""
    nodes, node, position = [], "", 0
    while position < len(text):
        pair = _PAIR.match(text, position)
        if pair is None:
            return []
        if pair[1].lower() == "for":
            node = pair[2].strip('"')
        if pair[3] != ";":
            nodes.append(node)
            node = ""
        position = pair.end()
    return nodes


def _address(text: str) -> _Address | None:
    """Return the IP address of a hop, with or without brackets and port; None for a hidden or invalid one."""
    text = text.strip()
    if text.startswith("["):
        text = text[1:].partition("]")[0]
    elif text.count(":") == 1:
        text = text.partition(":")[0]
    try:
        address = ip_address(text.partition("%")[0])
    except ValueError:
        return None
    return (address.ipv4_mapped or address) if isinstance(address, IPv6Address) else address


def _is_front(address: _Address, fronts: Iterable[Network]) -> bool:
    return any(address in network for network in fronts)


Message = MutableMapping[str, Any]
Send = Callable[[Message], Awaitable[None]]

# RFC 3986, 3.2.2: a bracketed IP literal, or a reg-name, which includes IPv4 addresses
_HOST = re.compile(r"(\[[0-9A-Fa-f:.]+\]|(?:[\w.~!$&'()*+,;=-]|%[0-9A-Fa-f]{2})+)(?::([0-9]{0,5}))?", re.ASCII)
# RFC 9112, 3.2.2: the request target may be an absolute URL
_ABSOLUTE = re.compile(r"https?://([^/]*)(/.*)?", re.IGNORECASE | re.DOTALL)
_MOST_SPELLINGS = 1000
_READ = ("GET", "HEAD", "OPTIONS")
_DEFAULT_PORTS = {"http": 80, "ws": 80, "https": 443, "wss": 443}


class Authorities:
    """The public URLs of the fleet. ``pages``: further origins whose pages may send requests."""

    def __init__(self, public_urls: tuple[str, ...], allowed_origins: tuple[str, ...] = ()) -> None:
        self._bases: dict[tuple[str, int], str] = {}
        self._asked: dict[tuple[str, bytes | None], str] = {}
        """Cached bases by scheme and Host."""
        for url in public_urls:
            parts = urlsplit(url)
            key = ((parts.hostname or "").lower(), parts.port or _DEFAULT_PORTS[parts.scheme])
            self._bases.setdefault(key, url.rstrip("/"))
        self._origins = {"://".join(urlsplit(url)[:2]).lower() for url in self._bases.values()}
        self._pages = {page.lower() for page in allowed_origins}

    def check_authority(self, scope: Scope) -> None:
        """Store the public URL used by the client, and whether a page of another origin sent the request.

        A target that is a whole URL becomes its path. Does nothing for a request that was admitted before. Raises
        BadRequest, MisdirectedRequest, ForeignOrigin.
        """
        arrival = arrival_of(scope)
        if arrival.base:
            return
        path, host, origin = "", arrival.fields.get(b"host"), arrival.fields.get(b"origin")
        if not scope.get("raw_path", b"/").startswith(b"/") and host is not None and b", " not in host:
            absolute = _ABSOLUTE.fullmatch(scope["raw_path"].decode("latin-1"))
            if absolute:
                host, path = absolute[1].encode("latin-1"), absolute[2] or "/"
        base = self._base(scope.get("scheme", "http"), host)
        arrival.cross_origin = origin is not None and self._is_elsewhere(scope, origin.split(b", "))
        # What follows is for a request that is admitted: one that was refused is refused again.
        arrival.base = base
        if path:
            scope["path"], scope["raw_path"] = unquote(path), path.encode("latin-1")

    def _base(self, scheme: str, said: bytes | None) -> str:
        if found := self._asked.get((scheme, said)):
            return found
        text = "" if said is None else said.decode("latin-1")
        host = _HOST.fullmatch(text)
        if host is None:
            raise BadRequest("the request needs exactly one Host field, such as Host: fleet.example:8000")
        # a TLS front may use plain HTTP to the gateway, so the port of any scheme of this name is accepted
        name, ports = host[1].strip("[]").lower(), [int(host[2])] if host[2] else [80, 443]
        asked = _DEFAULT_PORTS.get(scheme, 80)
        for port in sorted(ports, key=lambda port: port != asked):
            if (name, port) in self._bases:
                if len(self._asked) < _MOST_SPELLINGS:
                    self._asked[scheme, said] = self._bases[name, port]
                return self._bases[name, port]
        raise MisdirectedRequest(f"this fleet is not known as {text}, only as {', '.join(self._bases.values())}")

    def _is_elsewhere(self, scope: Scope, said: Sequence[bytes]) -> bool:
        """Return True if a permitted page of another site asks. Raises ForeignOrigin for one that is not permitted.

        Only browsers send Origin, and they do not let pages forge it.
        """
        origins = {value.decode("latin-1").lower() for value in said}
        reads = scope["type"] == "http" and scope["method"] in _READ and not arrival_of(scope).names_event_stream
        if not reads and not origins <= self._origins | self._pages:
            raise ForeignOrigin(
                f"pages of {', '.join(self._bases.values())} may do this, and clients that are no pages"
            )
        return not origins <= self._origins


async def send_problem(error: FleetError, scope: Scope, send: Send) -> None:
    """Answer with a problem before the request is processed further."""
    accept = b", ".join(value for name, value in scope["headers"] if name == b"accept").decode("latin-1")
    body, fields = problem(error, accept or None, html=html_of(scope))
    fields["content-length"] = str(len(body))
    headers = [(name.encode(), value.encode()) for name, value in fields.items()]
    await send_early(error.status, headers, body, scope, send)


async def send_early(status: int, headers: list[tuple[bytes, bytes]], content: bytes, scope: Scope, send: Send) -> None:
    """Answer before the request is processed further; a WebSocket is refused in its handshake."""
    if scope["type"] == "websocket" and "websocket.http.response" not in scope.get("extensions", {}):
        await send({"type": "websocket.close", "code": 1008})  # the server can only answer 403
        return
    start = "websocket.http.response" if scope["type"] == "websocket" else "http.response"
    await send({"type": f"{start}.start", "status": status, "headers": headers})
    await send({"type": f"{start}.body", "body": content})
