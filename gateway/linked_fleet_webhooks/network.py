"""The addresses that callbacks may reach: all in the allowed networks, and public ones elsewhere.

A URL does not tell where it leads (``http://2130706433/`` is loopback, and a name may change its address after a
check). Therefore a host is resolved once, each of its addresses is judged here, and the receiver connects to one of
those.
"""

# ruff: noqa: N818  (named for what is the case)

import asyncio
import ipaddress
import re
import socket
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from ipaddress import IPv4Address, IPv4Network, IPv6Address, IPv6Network

Lookup = Callable[[str, int], Iterable[str]]
"""Returns the addresses of a host and port, including ``%scope``; OSError or ValueError if there are none.

May block.
"""

MAX_URL_LENGTH = 2048
DEFAULT_PORTS = (range(80, 81), range(443, 444), range(8080, 8081), range(8443, 8444))
"""Ports of public receivers unless configured otherwise: those of HTTP and their usual alternatives."""
_RESOLVERS = 8

_CLOSED_V4 = tuple(
    IPv4Network(text)
    for text in (
        "168.63.129.16/32",  # Azure's metadata and agent service, on a public address
        "192.0.0.0/24",  # IETF protocol assignments: Python takes some for global, but they end at the nearest NAT
        "192.88.99.0/24",  # 6to4 relays (RFC 7526)
    )
)
_GLOBAL_UNICAST = IPv6Network("2000::/3")
_CLOSED_V6 = tuple(
    IPv6Network(text)
    for text in (
        "2001::/23",  # IETF protocol assignments, Teredo among them
        "2002::/16",  # 6to4 holds an IPv4 address, possibly a private one
        "3fff::/20",  # documentation (RFC 9637), which Python 3.11 considers public
    )
)


class ForbiddenHost(Exception):
    """None of the host's addresses may be reached. The text contains no address, because it may be internal."""


class UnresolvableHost(Exception):
    """The host has no address, or none could be found in time."""


@dataclass(frozen=True)
class Address:
    """A permitted address. ``allowed``: it is in an allowed network, so its receiver need not consent."""

    ip: str
    allowed: bool


def system_lookup(host: str, port: int) -> list[str]:
    """Return the addresses from the system's resolver."""
    # as bytes, because the idna codec that str goes through fails on names which DNS can answer
    found = socket.getaddrinfo(host.encode("ascii"), port, type=socket.SOCK_STREAM)
    return [
        f"{where[0]}%{where[3]}" if family == socket.AF_INET6 and len(where) > 3 and where[3] else str(where[0])
        for family, _, _, _, where in found
        if family in (socket.AF_INET, socket.AF_INET6)
    ]


class Network:
    """Resolves hosts and judges their addresses, in its own threads: a dead resolver delays only callbacks.

    ``ports``: permitted ports of public addresses; in ``allowed`` networks every port is permitted.
    """

    def __init__(
        self,
        allowed: tuple[IPv4Network | IPv6Network, ...] = (),
        *,
        ports: tuple[range, ...] = DEFAULT_PORTS,
        lookup: Lookup = system_lookup,
        timeout_s: float = 5.0,
    ) -> None:
        self._allowed, self._ports = allowed, ports
        self._lookup = lookup
        self._timeout_s = timeout_s
        self._threads = ThreadPoolExecutor(_RESOLVERS, thread_name_prefix="callback-dns")

    async def resolve(self, host: str, port: int) -> list[Address]:
        """Return the permitted addresses of a host, in the resolver's order, without duplicates and never empty.

        ``host`` is a name or an address as in a URL, without brackets. Raises ForbiddenHost and UnresolvableHost.
        """
        found = await self._addresses(host, port)
        judged = (self._judge(text) for text in found)
        reachable = list(dict.fromkeys(address for address in judged if address is not None))
        served = any(port in each for each in self._ports)
        permitted = [address for address in reachable if served or address.allowed]
        if permitted:
            return permitted
        if reachable:
            ports = ", ".join(f"{each[0]}-{each[-1]}" if len(each) > 1 else str(each[0]) for each in self._ports)
            raise ForbiddenHost(
                f"Callbacks may not reach port {port} of a public address; the operator allows {ports or 'none'} "
                "(LINKED_FLEET_CALLBACK_PORTS)."
            )
        if found:
            raise ForbiddenHost(
                "The callback's host has no address that may be reached: loopback, private, link-local and other "
                "special addresses must be in a network that the operator allows (LINKED_FLEET_CALLBACK_ALLOW)."
            )
        raise UnresolvableHost("The callback's host has no address.")

    def close(self) -> None:
        """Close the threads without waiting for look-ups in progress."""
        self._threads.shutdown(wait=False, cancel_futures=True)

    async def _addresses(self, host: str, port: int) -> list[str]:
        if _literal(host) is not None:
            return [host]
        try:
            async with asyncio.timeout(self._timeout_s):
                loop = asyncio.get_running_loop()
                return list(await loop.run_in_executor(self._threads, self._lookup, host, port))
        except TimeoutError as error:
            raise UnresolvableHost("The callback's host was not resolved in time.") from error
        except (OSError, ValueError) as error:
            raise UnresolvableHost("The callback's host cannot be resolved.") from error

    def _judge(self, text: str) -> Address | None:
        ip = _literal(text)
        if ip is None or (isinstance(ip, IPv6Address) and ip.scope_id is not None):
            return None  # a scope selects a local interface
        if isinstance(ip, IPv6Address) and ip.ipv4_mapped is not None:
            ip = ip.ipv4_mapped
        if any(ip in network for network in self._allowed):
            return Address(str(ip), allowed=True)
        return Address(str(ip), allowed=False) if is_public(ip) else None


def is_public(ip: IPv4Address | IPv6Address) -> bool:
    """Return True for an address of the public Internet: no special purpose and no embedded IPv4 address."""
    if not ip.is_global or ip.is_multicast:
        return False
    if isinstance(ip, IPv4Address):
        return not any(ip in network for network in _CLOSED_V4)
    # only global unicast is assigned; outside are NAT64, site-local, IPv4-compatible and future ranges
    return ip in _GLOBAL_UNICAST and not any(ip in network for network in _CLOSED_V6)


def _literal(text: str) -> IPv4Address | IPv6Address | None:
    try:
        return ipaddress.ip_address(text)
    except ValueError:
        return None


_FOREIGN = re.compile(r"[^A-Za-z0-9._~:/?#\[\]@!$&'()*+,;=%-]|%(?![0-9A-Fa-f]{2})")
_URL = re.compile(r"(?P<scheme>[^:/?#]*)://(?P<authority>[^/?#]*)[^#]*")
_AUTHORITY = re.compile(r"(?P<host>\[[^\[\]]*\]|[^:\[\]]*)(?::(?P<port>.*))?")
_LABEL = re.compile(r"[A-Za-z0-9_](?:[A-Za-z0-9_-]{0,61}[A-Za-z0-9_])?")
_LONGEST_NAME = 253
_FOUR_NUMBERS = re.compile(r"\d+\.\d+\.\d+\.\d+")


def check_callback_url(text: str) -> str:
    """Return the text if callbacks can be sent to this URL; raises ValueError with a sentence that says why not.

    Checks syntax only: whether the host may be reached is known when the connection is made.
    """
    if len(text) > MAX_URL_LENGTH:
        raise ValueError(f"The callback URL has {len(text)} characters; at most {MAX_URL_LENGTH} are taken.")
    if foreign := _FOREIGN.search(text):
        raise ValueError(
            f"The callback URL has {foreign[0]!r} at position {foreign.start() + 1}; write what is not ASCII in a name "
            "as Punycode, and elsewhere each such byte as % and two hexadecimal digits."
        )
    if "#" in text:
        raise ValueError("The callback URL has a fragment; leave out # and what follows.")
    parts = _URL.fullmatch(text)
    if parts is None or parts["scheme"].lower() not in ("http", "https"):
        raise ValueError("A callback URL is absolute and begins with http:// or https://.")
    _check_authority(parts["authority"])
    return text


def _check_authority(authority: str) -> None:
    if "@" in authority:
        raise ValueError("The callback URL has a user name or password; leave out what stands before the @.")
    parts = _AUTHORITY.fullmatch(authority)
    if parts is None or not _is_host(parts["host"]):
        raise ValueError(
            "The callback URL has no valid host: a name such as receiver.example, an IPv4 address of four numbers from "
            "0 to 255 without leading zeros, or an IPv6 address in brackets without zone."
        )
    port = parts["port"]
    if port is not None and not (port.isdigit() and 1 <= int(port) <= 65535):
        raise ValueError("The callback URL has no valid port: it is 1 to 65535, or left out together with the colon.")


def _is_host(host: str) -> bool:
    if host.startswith("["):
        return "%" not in host and isinstance(_literal(host[1:-1]), IPv6Address)
    if _FOUR_NUMBERS.fullmatch(host):
        return _literal(host) is not None
    name = host.removesuffix(".")
    return len(name) <= _LONGEST_NAME and all(_LABEL.fullmatch(label) for label in name.split("."))
