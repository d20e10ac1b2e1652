"""The addresses that callbacks may reach, however the URL spells them."""

import asyncio
import ipaddress
import queue
import socket
import threading
from contextlib import closing
from ipaddress import IPv4Network, IPv6Network
from typing import Any

import httpx
import pytest
from hypothesis import given
from hypothesis import strategies as st

from linked_fleet_webhooks.network import (
    Address,
    ForbiddenHost,
    Lookup,
    Network,
    UnresolvableHost,
    check_callback_url,
    is_public,
    system_lookup,
)

LOOPBACK = (IPv4Network("127.0.0.0/8"), IPv6Network("::1/128"))
INSIDE = [
    *("0.0.0.0", "0.1.2.3", "10.0.0.1", "100.64.0.1", "100.100.100.200", "127.0.0.1", "127.255.255.254"),
    *("168.63.129.16", "169.254.169.254", "169.254.170.2", "172.16.0.1", "172.31.255.255", "192.0.0.8", "192.0.0.9"),
    *("192.0.0.192", "192.0.2.1", "192.88.99.1", "192.168.1.1", "198.18.0.1", "198.51.100.1", "203.0.113.1"),
    *("224.0.0.1", "239.255.255.255", "240.0.0.1", "255.255.255.255"),
    *("::", "::1", "::127.0.0.1", "::8.8.8.8", "::ffff:127.0.0.1", "::ffff:169.254.169.254", "::ffff:10.0.0.1"),
    *("::ffff:0:127.0.0.1", "64:ff9b::127.0.0.1", "64:ff9b::8.8.8.8", "64:ff9b:1::1", "100::1", "2001::1"),
    *("2001:10::1", "2001:db8::1", "2002:7f00:1::", "2002:808:808::1", "3fff::1", "4000::1", "5f00::1"),
    *("fc00::1", "fd00:ec2::254", "fd20:ce::254", "fe80::1", "fe80::1%1", "fec0::1", "ff02::1", "ff0e::1"),
    *("2606:4700::1111%1", "::1%1"),
]
PUBLIC = ["1.1.1.1", "8.8.8.8", "193.99.144.80", "2001:4860:4860::8888", "2606:4700::1111", "2a02:2e0:3fe::1"]


def answering(*addresses: str) -> Lookup:
    return lambda host, port: addresses


def resolve(network: Network, host: str = "receiver.example") -> list[Address]:
    with closing(network):
        return asyncio.run(network.resolve(host, 80))


@pytest.mark.parametrize("address", INSIDE)
def test_non_public_addresses_are_forbidden(address: str) -> None:
    with pytest.raises(ForbiddenHost, match="LINKED_FLEET_CALLBACK_ALLOW") as refused:
        resolve(Network(lookup=answering(address)))
    assert address not in str(refused.value)


def test_a_host_is_looked_up_with_its_port_in_threads_for_that() -> None:
    """Not in those of the event loop, which the gateway needs for other work."""
    asked = []

    def lookup(host: str, port: int) -> list[str]:
        asked.append((host, port, threading.current_thread().name.rpartition("_")[0]))
        return ["8.8.8.8"]

    resolve(Network(lookup=lookup))
    assert asked == [("receiver.example", 80, "callback-dns")]


def test_the_system_resolver_is_asked_for_addresses_of_tcp(monkeypatch: pytest.MonkeyPatch) -> None:
    """A scope is part of an address; anything but an IP address is left out."""
    asked = []

    def getaddrinfo(host: bytes, port: int, **options: int) -> list[tuple[object, ...]]:
        asked.append((host, port, options))
        wheres: dict[int, list[Any]] = {
            socket.AF_INET6: [("fe80::1", 80, 0, 2), ("2001:db8::1", 80, 0, 0), ("::1", 80)],
            socket.AF_INET: [("192.0.2.1", 80)],
            socket.AF_UNIX: ["/run/socket"],
        }
        return [(family, 1, 6, "", where) for family, found in wheres.items() for where in found]

    monkeypatch.setattr(socket, "getaddrinfo", getaddrinfo)
    assert system_lookup("receiver.example", 80) == ["fe80::1%2", "2001:db8::1", "::1", "192.0.2.1"]
    assert asked == [(b"receiver.example", 80, {"type": socket.SOCK_STREAM})]


@pytest.mark.parametrize("address", INSIDE)
def test_an_address_in_the_url_is_judged_like_that_of_a_name(address: str) -> None:
    with pytest.raises(ForbiddenHost):
        resolve(Network(), host=address)


@pytest.mark.parametrize("port", [22, 25, 6379, 8000])
def test_ports_of_other_services_are_forbidden(port: int) -> None:
    """A public address is reached only at the ports of HTTP, unless the operator names others."""

    def at_port(network: Network, port: int) -> list[Address]:
        with closing(network):
            return asyncio.run(network.resolve("receiver.example", port))

    with pytest.raises(ForbiddenHost, match=f"port {port} .* allows 80, 443, 8080, 8443 .LINKED_FLEET_CALLBACK_PORTS"):
        at_port(Network(lookup=answering("8.8.8.8")), port)
    with pytest.raises(ForbiddenHost, match="allows 443, 9000-9001, 9100-9199 "):
        several = (range(443, 444), range(9000, 9002), range(9100, 9200))
        at_port(Network(lookup=answering("8.8.8.8"), ports=several), port)
    with pytest.raises(ForbiddenHost, match="allows none "):
        at_port(Network(lookup=answering("8.8.8.8"), ports=()), port)
    assert at_port(Network(lookup=answering("8.8.8.8"), ports=(range(1, 9000),)), port) == [Address("8.8.8.8", False)]
    assert at_port(Network(LOOPBACK, lookup=answering("127.0.0.1")), port) == [Address("127.0.0.1", True)]
    both = Network(LOOPBACK, lookup=answering("8.8.8.8", "127.0.0.1"))
    assert at_port(both, port) == [Address("127.0.0.1", True)]


@pytest.mark.parametrize("address", PUBLIC)
def test_public_addresses_are_permitted(address: str) -> None:
    assert resolve(Network(lookup=answering(address))) == [Address(address, allowed=False)]


def test_a_mapped_address_is_the_ipv4_address_that_it_leads_to() -> None:
    mapped = answering("::ffff:8.8.8.8", "8.8.8.8", "::ffff:127.0.0.1")
    assert resolve(Network(LOOPBACK, lookup=mapped)) == [Address("8.8.8.8", False), Address("127.0.0.1", True)]


def test_only_the_permitted_addresses_of_a_name_are_given() -> None:
    mixed = answering("10.0.0.1", "127.0.0.1", "8.8.8.8", "::1", "fe80::1%2")
    expected = [Address("127.0.0.1", True), Address("8.8.8.8", False), Address("::1", True)]
    assert resolve(Network(LOOPBACK, lookup=mixed)) == expected


@given(st.ip_addresses())
def test_nothing_private_is_ever_public(ip: ipaddress.IPv4Address | ipaddress.IPv6Address) -> None:
    if is_public(ip):
        assert not (ip.is_private or ip.is_loopback or ip.is_link_local or ip.is_multicast or ip.is_reserved)


@given(st.ip_addresses(v=4))
def test_no_ipv6_address_with_an_ipv4_address_in_it_is_public(inner: ipaddress.IPv4Address) -> None:
    prefixes = ("::", "::ffff:0:0", "::ffff:0:0:0", "64:ff9b::", "64:ff9b:1::", "2001::")
    wrapped = [ipaddress.IPv6Address(int(ipaddress.IPv6Address(prefix)) + int(inner)) for prefix in prefixes]
    six_to_four = ipaddress.IPv6Address((0x2002 << 112) + (int(inner) << 80))
    assert not any(is_public(ip) for ip in [*wrapped, six_to_four])


@pytest.mark.parametrize("host", ["2130706433", "0x7f.1", "0x7f000001", "0177.0.0.1", "127.1", "0", "localhost"])
def test_the_system_resolver_sees_through_numeric_tricks_and_loopback_stays_forbidden(host: str) -> None:
    with pytest.raises(ForbiddenHost):
        resolve(Network(), host=host)


@pytest.mark.parametrize("host", ["localhost.", "127.0.0.1."])
def test_a_trailing_dot_opens_nothing(host: str) -> None:
    with pytest.raises((ForbiddenHost, UnresolvableHost)):  # which of the two depends on the system's resolver
        resolve(Network(), host=host)


def test_the_system_resolver_finds_loopback_where_it_is_allowed() -> None:
    assert Address("127.0.0.1", True) in resolve(Network(LOOPBACK), host="localhost")


@pytest.mark.parametrize("host", ["", "a..b", "x" * 64 + ".example", "nul\0.example", "bücher.example"])
def test_a_host_without_addresses_is_unresolvable(host: str) -> None:
    with pytest.raises(UnresolvableHost, match="cannot be resolved"):
        resolve(Network(), host=host)


def test_no_answer_and_nonsense_permit_nothing() -> None:
    with pytest.raises(UnresolvableHost, match="has no address"):
        resolve(Network(lookup=answering()))
    with pytest.raises(ForbiddenHost):
        resolve(Network(lookup=answering("receiver.example")))


def test_a_dead_resolver_ends_in_time_and_holds_up_no_addresses() -> None:
    dead = threading.Event()

    def stalled(host: str, port: int) -> list[str]:
        dead.wait()
        return ["8.8.8.8"]

    async def run() -> None:
        network = Network(LOOPBACK, lookup=stalled, timeout_s=0.02)
        many = [network.resolve(f"r{n}.example", 80) for n in range(30)]
        outcomes = await asyncio.gather(*many, return_exceptions=True)
        assert all(isinstance(outcome, UnresolvableHost) and "in time" in str(outcome) for outcome in outcomes)
        assert await network.resolve("127.0.0.1", 80) == [Address("127.0.0.1", True)]
        network.close()

    try:
        asyncio.run(run())
    finally:
        dead.set()


def test_the_end_waits_for_no_look_up_and_begins_none() -> None:
    dead, begun = threading.Event(), queue.Queue[str]()

    def stalled(host: str, port: int) -> list[str]:
        begun.put(host)
        dead.wait()
        return ["8.8.8.8"]

    async def run() -> list[object]:
        network = Network(lookup=stalled, timeout_s=600)
        several = [asyncio.create_task(network.resolve(f"r{n}.example", 80)) for n in range(10)]
        for _ in range(8):  # look-ups run concurrently, the others wait for these
            await asyncio.to_thread(begun.get, timeout=60)
        network.close()
        dead.set()
        return await asyncio.gather(*several, return_exceptions=True)

    try:
        outcomes = asyncio.run(run())
    finally:
        dead.set()
    assert outcomes.count([Address("8.8.8.8", False)]) == 8
    assert [type(each) for each in outcomes].count(asyncio.CancelledError) == 2
    assert begun.empty()


_LONG_NAME = ".".join(["x" * 63, "y" * 63, "z" * 63, "x" * 61])
URLS = [
    *("http://receiver.example", "HTTPS://Receiver.example/", "http://receiver.example:8080/a/b?c=d&e=%20f"),
    *("http://127.0.0.1:9/", "http://[::1]:9/x", "http://[::ffff:127.0.0.1]/", "http://2130706433/", "http://0x7f.1/"),
    *(
        "http://localhost./",
        "https://xn--bcher-kva.example/",
        "http://my_host/",
        "http://a.b.c.d:65535?x",
        "http://h/?/:@!",
    ),
    *("http://h/" + "x" * (2048 - 9), "http://h:1/"),
    *("http://" + "x" * 63 + ".example/", f"http://{_LONG_NAME}/", f"http://{_LONG_NAME}./"),
]
REFUSED = [
    ("", "absolute"),
    ("receiver.example/x", "absolute"),
    ("/callback", "absolute"),
    ("//receiver.example/", "absolute"),
    ("ftp://receiver.example/", "absolute"),
    ("file:///etc/passwd", "absolute"),
    ("gopher://127.0.0.1:6379/_x", "absolute"),
    ("http:receiver.example", "absolute"),
    ("http:///path", "no valid host"),
    ("http://:80/", "no valid host"),
    ("http://.example/", "no valid host"),
    ("http://a..b/", "no valid host"),
    ("http://-a.example/", "no valid host"),
    ("http://%31%32%37.0.0.1/", "no valid host"),
    ("http://0177.0.0.1/", "no valid host"),
    ("http://256.0.0.1/", "no valid host"),
    ("http://[127.0.0.1]/", "no valid host"),
    ("http://[fe80::1%25eth0]/", "no valid host"),
    ("http://[::1/", "no valid host"),
    ("http://::1/", "no valid host"),
    ("http://[::1]x/", "no valid host"),
    ("http://" + "x" * 64 + ".example/", "no valid host"),
    ("http://" + "x." * 127 + "xx/", "no valid host"),
    (f"http://{_LONG_NAME}x/", "no valid host"),
    ("http://user@receiver.example/", "user name"),
    ("http://receiver.example@127.0.0.1/", "user name"),
    ("http://u:p@receiver.example/", "user name"),
    ("http://receiver.example/#x", "fragment"),
    ("http://receiver.example/#", "fragment"),
    ("http://receiver.example:/", "1 to 65535"),
    ("http://receiver.example:0/", "1 to 65535"),
    ("http://receiver.example:65536/", "1 to 65535"),
    ("http://receiver.example:-1/", "1 to 65535"),
    ("http://receiver.example:80:80/", "1 to 65535"),
    ("http://receiver.example:" + "9" * 1000, "1 to 65535"),
    ("http://receiver.example/" + "x" * 2048, "at most 2048"),
    (" http://receiver.example/", "position 1"),
    ("http://receiver.example/a b", "hexadecimal"),
    ("http://receiver.example/\r\nX: y", "hexadecimal"),
    ("http://receiver.example/\t", "hexadecimal"),
    ("http://receiver.example/\x00", "hexadecimal"),
    ("http://receiver.example\\@127.0.0.1/", "hexadecimal"),
    ("http://receiver.example/%zz", "hexadecimal"),
    ("http://bücher.example/", "Punycode"),
    ("http://127。0。0。1/", "Punycode"),
    ("http://receiver.example/ü", "Punycode"),
]


@pytest.mark.parametrize("url", URLS)
def test_a_usable_callback_url_stays_as_it_is(url: str) -> None:
    assert check_callback_url(url) == url


@pytest.mark.parametrize(("url", "right"), REFUSED)
def test_other_urls_are_refused_with_the_valid_form(url: str, right: str) -> None:
    with pytest.raises(ValueError, match=right):
        check_callback_url(url)


@given(st.sampled_from(["http://", "https://"]), st.text(st.sampled_from("aZ09._-:[]@%/?#\\f2\t é"), max_size=30))
def test_accepted_urls_mean_the_same_to_the_http_client(scheme: str, rest: str) -> None:
    try:
        url = check_callback_url(scheme + rest)
    except ValueError:
        return
    parsed = httpx.URL(url)
    authority = rest.lower().partition("/")[0].partition("?")[0]
    host = authority[1:].partition("]")[0] if authority.startswith("[") else authority.partition(":")[0]
    assert parsed.raw_host.decode() == host
    assert not parsed.userinfo
    assert not parsed.fragment
