"""The address of a client behind a trusted front: ``X-Forwarded-For``, or ``Forwarded`` (RFC 7239)."""

import re
from collections.abc import Iterable, Sequence
from ipaddress import IPv4Address, IPv4Network, IPv6Address, IPv6Network, ip_address

from starlette.datastructures import Headers
from starlette.types import Scope

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
        host = client_behind(client[0], Headers(scope=scope), fronts)
        if host != client[0]:
            scope["client"] = (host, 0)  # of its port nothing is known


def client_behind(peer: str, headers: Headers, fronts: Sequence[Network]) -> str:
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
