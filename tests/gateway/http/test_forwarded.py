"""The address of a client behind a proxy, and which proxies are trusted."""

from ipaddress import ip_network

import pytest
from starlette.datastructures import Headers
from starlette.types import Scope

from linked_fleet_gateway.app.settings import GatewaySettings
from linked_fleet_gateway.http.forwarding import find_client, forwarded_client
from linked_fleet_gateway.http.scheduling import bucket_key

_FRONTS = (ip_network("10.0.0.0/24"), ip_network("2001:db8:f::/48"))
_FRONT = "10.0.0.1"


def _client(*fields: tuple[str, str], peer: str = _FRONT) -> str:
    headers = Headers(raw=[(name.encode(), value.encode("latin-1")) for name, value in fields])
    return forwarded_client(peer, headers, _FRONTS)


@pytest.mark.parametrize("name", ["x-forwarded-for", "forwarded"])
@pytest.mark.parametrize("peer", ["192.0.2.7", "2001:db8::7", "10.0.1.1", ""])
def test_forwarding_fields_of_others_than_fronts_are_ignored(peer: str, name: str) -> None:
    """A client cannot choose its own address."""
    prefix = "for=" if name == "forwarded" else ""
    assert _client((name, f"{prefix}198.51.100.1"), peer=peer) == peer


@pytest.mark.parametrize(
    ("said", "client"),
    [
        ("192.0.2.7", "192.0.2.7"),
        (" 192.0.2.7:4711 ", "192.0.2.7"),
        ("2001:db8::7", "2001:db8::7"),
        ("[2001:db8::7]:4711", "2001:db8::7"),
        ("::ffff:192.0.2.7", "192.0.2.7"),
        ("198.51.100.1, 192.0.2.7", "192.0.2.7"),  # what the client itself sent comes first
        ("198.51.100.1, 192.0.2.7, 10.0.0.2", "192.0.2.7"),
        ("192.0.2.7, 2001:db8:f::2, 10.0.0.2", "192.0.2.7"),
        ("10.0.0.3, 10.0.0.2", "10.0.0.3"),  # from the network of the proxies itself
        ("192.0.2.7, unknown, 10.0.0.2", "10.0.0.2"),  # the last known one
        ("192.0.2.7, no address", _FRONT),
        ("", _FRONT),
        (",", _FRONT),
    ],
)
def test_the_rightmost_address_that_is_no_fronts_is_the_client(said: str, client: str) -> None:
    assert _client(("x-forwarded-for", said)) == client


@pytest.mark.parametrize(
    ("said", "client"),
    [
        ("for=192.0.2.7", "192.0.2.7"),
        ('For="[2001:db8::7]:4711";proto=https;by=10.0.0.1', "2001:db8::7"),
        ("for=198.51.100.1, for=192.0.2.7;proto=http, for=10.0.0.2", "192.0.2.7"),
        ('for=192.0.2.7;host="a,for=198.51.100.1"', "192.0.2.7"),  # a comma in quotes separates nothing
        ("for=192.0.2.7, for=_hidden", _FRONT),
        ("for=192.0.2.7, proto=https", _FRONT),
        ('for=198.51.100.1;host=", for=192.0.2.7', _FRONT),  # malformed
        ('for="' + '\\"' * 8000, _FRONT),
    ],
)
def test_forwarded_says_the_same_in_the_form_of_rfc_7239(said: str, client: str) -> None:
    assert _client(("forwarded", said)) == client


def test_lines_of_one_field_are_one_list() -> None:
    assert _client(("x-forwarded-for", "192.0.2.7"), ("x-forwarded-for", "10.0.0.2")) == "192.0.2.7"


def test_two_fields_that_disagree_are_not_believed() -> None:
    """A proxy that writes one of them passes on the other from the client."""
    said = ("x-forwarded-for", "192.0.2.7")
    assert _client(said, ("forwarded", "for=198.51.100.1")) == _FRONT
    assert _client(said, ("forwarded", "nonsense")) == _FRONT
    assert _client(said, ("forwarded", "for=192.0.2.7")) == "192.0.2.7"


@pytest.mark.parametrize("kind", ["http", "websocket"])
def test_clients_behind_a_front_are_told_apart(kind: str) -> None:
    """Each client behind a proxy is counted separately."""

    def counted(scope: Scope) -> str:
        find_client(scope, _FRONTS)
        return bucket_key(scope)

    scopes: list[Scope] = [
        {"type": kind, "client": (host, 1), "headers": [(b"x-forwarded-for", said.encode())]}
        for host, said in ((_FRONT, "192.0.2.7"), (_FRONT, "192.0.2.8"), ("192.0.2.9", "192.0.2.7"))
    ]
    scopes.append({"type": kind, "client": None, "headers": []})
    assert [counted(scope) for scope in scopes] == ["192.0.2.7", "192.0.2.8", "192.0.2.9", ""]


def test_fronts_are_addresses_and_networks() -> None:
    settings = GatewaySettings.read({}, ["--fronts", "192.0.2.1, 2001:db8::/64"])
    assert settings.fronts == (ip_network("192.0.2.1/32"), ip_network("2001:db8::/64"))
    assert GatewaySettings().fronts == ()
    with pytest.raises(ValueError, match="LINKED_FLEET_FRONTS is of networks"):
        GatewaySettings.read({}, ["--fronts", "front.example"])
