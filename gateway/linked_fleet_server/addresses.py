"""The network of an IP address, by which limits tell clients and destinations apart."""

from functools import lru_cache
from ipaddress import IPv6Address, ip_address

_IPV6_PREFIX_BITS = 64
"""A provider assigns at least a /64 network to one customer, who can use any address in it."""


@lru_cache(maxsize=4096)
def network_of(address: str) -> str:
    """Return the IPv4 address, also of an IPv4-mapped IPv6 address, or the /64 network of an IPv6 address.

    A text that is no IP address is returned unchanged.
    """
    try:
        found = ip_address(address.partition("%")[0])
    except ValueError:
        return address
    if not isinstance(found, IPv6Address):
        return str(found)
    if found.ipv4_mapped is not None:
        return str(found.ipv4_mapped)
    rest = 128 - _IPV6_PREFIX_BITS
    return f"{IPv6Address(int(found) >> rest << rest)}/{_IPV6_PREFIX_BITS}"
