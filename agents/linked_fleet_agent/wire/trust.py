"""Trust in Zenoh links (PROTOCOL.md, "Trust"): mutual authentication and access control. Pure.

Endpoints that accept anybody are detected. Access control is derived from one list of robots: a neighbour is identified
by the common name of its certificate, and its incoming messages are filtered. Accepted messages may be forwarded to
every neighbour that has a common name.
"""

import re
import ssl
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from ipaddress import ip_address
from pathlib import Path

from linked_fleet_agent.wire.keys import Keys, escape

_PROVEN = ("tls", "quic")
_LOCAL = ("unixsock-stream", "unixpipe")
_ENDPOINT = re.compile(r"([a-z-]+)/(.*?)(?:[?#].*)?")
_NAMED = "LINKED_FLEET_ZENOH_CA, LINKED_FLEET_ZENOH_CERT and LINKED_FLEET_ZENOH_KEY"


@dataclass(frozen=True)
class Credentials:
    """PEM files: the certificate authority, and the certificate and private key of this process.

    Raises ValueError with one clear sentence if one is missing or unreadable, or if they do not belong together.
    """

    authority: str
    certificate: str
    key: str

    def __post_init__(self) -> None:
        if not (self.authority and self.certificate and self.key):
            raise ValueError(f"{_NAMED} must be set together or not at all")
        check_pair(self.certificate, self.key)
        try:
            ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT).load_verify_locations(self.authority)
        except (OSError, ssl.SSLError) as error:
            raise ValueError(f"{self.authority} is not the certificate of an authority: {_reason(error)}") from None

    @classmethod
    def from_optional_files(cls, authority: str, certificate: str, key: str) -> "Credentials | None":
        """Return None if none of the three is set."""
        return cls(authority, certificate, key) if authority or certificate or key else None

    def configuration(self) -> dict[str, object]:
        """Return Zenoh settings by key. Without them the text of a tls or quic endpoint decides."""
        files = (str(Path(path).absolute()) for path in (self.authority, self.certificate, self.key))
        return {"transport/link/tls": mutual_tls(*files)}


def mutual_tls(authority: str, certificate: str, key: str) -> dict[str, object]:
    """Return Zenoh's ``transport/link/tls`` with mutual TLS: both ends show a certificate of the authority.

    The connecting side also checks that the certificate names the host or address that it connects to.
    """
    return {
        "root_ca_certificate": authority,
        "enable_mtls": True,
        "verify_name_on_connect": True,
        "close_link_on_expiration": True,
        "listen_certificate": certificate,
        "listen_private_key": key,
        "connect_certificate": certificate,
        "connect_private_key": key,
    }


def check_pair(certificate: str, key: str) -> None:
    """Raise ValueError with one clear sentence unless both files can be read and belong together."""
    for path in (certificate, key):
        try:
            Path(path).read_bytes()
        except OSError as error:
            raise ValueError(f"{path} cannot be read: {error.strerror}") from None
    try:
        # the password argument prevents a prompt on the terminal
        ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER).load_cert_chain(certificate, key, password="")
    except (OSError, ssl.SSLError, ValueError) as error:
        raise ValueError(f"{certificate} and {key} are not a certificate and its key: {_reason(error)}") from None


def _reason(error: Exception) -> str:
    return str(getattr(error, "reason", None) or error).lower().replace("_", " ")


def is_loopback(host: str) -> bool:
    """Return True if only this machine reaches a listener on ``host``; every other name may be reachable from
    elsewhere.
    """
    try:
        return host == "localhost" or ip_address(host.strip("[]")).is_loopback
    except ValueError:
        return False


def unauthenticated_endpoints(endpoints: Iterable[str], credentials: Credentials | None) -> tuple[str, ...]:
    """Return the listen endpoints that other machines reach without authentication."""
    return tuple(each for each in endpoints if not _guarded(each, credentials is not None))


def _guarded(endpoint: str, proof: bool) -> bool:
    match = _ENDPOINT.fullmatch(endpoint)
    if match is None:  # Zenoh itself refuses an invalid endpoint
        return False
    protocol, address = match.groups()
    return protocol in _LOCAL or is_loopback(address.rpartition(":")[0]) or (protocol in _PROVEN and proof)


GATEWAY, ROUTER = "gateway", "router"
"""Common names of gateways and of routers. All gateways share one, all routers the other, each with its own key."""

_PUBLISHING = ("put", "reply", "declare_queryable", "liveliness_token")
_WATCHING = ("liveliness_query", "declare_liveliness_subscriber")
_EVERYTHING = (*_PUBLISHING, *_WATCHING, "delete", "query", "declare_subscriber")
_ASKED = ("description", "command", "stop", "mesh", "picture", "values", "operate")


def common_name(agent: str) -> str:
    """Return the common name of an agent's certificate.

    Raises ValueError for a name reserved for gateways or routers.
    """
    if agent in (GATEWAY, ROUTER):
        raise ValueError(f"the common name {agent!r} is reserved and cannot be that of an agent's certificate")
    return escape(agent)


def router_access_control(keys: Keys, agents: Mapping[str, Iterable[str] | None]) -> dict[str, object]:
    """Return ``access_control`` of a router, or of a gateway that agents connect to.

    ``agents`` maps the name in each agent certificate to its robots; None means any robot, as for simulations of robots
    whose names are not known in advance.
    """
    names = [common_name(agent) for agent in agents]
    access = _Access()
    published = [keys.all_states, keys.all_progress, keys.all_conditions, keys.all_values, keys.all_events]
    access.grant("out", [GATEWAY, ROUTER, *names], "egress", _EVERYTHING, [keys.all_keys])
    access.grant("routers", [ROUTER], "ingress", _EVERYTHING, [keys.all_keys])
    access.grant("gateways hear", [GATEWAY], "ingress", ["declare_subscriber"], published)
    access.grant("gateways ask", [GATEWAY], "ingress", ["query"], [keys.all_of_kind(kind) for kind in _ASKED])
    access.grant("gateways see", [GATEWAY], "ingress", _WATCHING, [keys.all_presence])
    access.grant("gateways are", [GATEWAY], "ingress", ["liveliness_token"], [keys.all_gateways])
    access.grant("gateways beat", [GATEWAY], "ingress", ["put"], [keys.all_heartbeats])
    access.grant("gateways drive", [GATEWAY], "ingress", ["put"], [keys.all_samples])
    access.grant("agents see", names, "ingress", _WATCHING, [keys.all_gateways])
    access.grant("agents hear", names, "ingress", ["declare_subscriber"], [keys.all_heartbeats])
    for agent, robots in agents.items():
        own = [keys.all_of_robot(robot) for robot in robots] if robots is not None else [keys.all_of_robots]
        name = common_name(agent)
        access.grant(f"agent {name}", [name], "ingress", (*_PUBLISHING, "liveliness_query"), own)
        heard = [keys.robot(robot, "sample") for robot in robots] if robots is not None else [keys.all_samples]
        access.grant(f"samples to agent {name}", [name], "ingress", ["declare_subscriber"], heard)
    return access.value


def agent_access_control(keys: Keys) -> dict[str, object]:
    """Return ``access_control`` of a listening agent: gateways and routers may speak to it, no other robot may."""
    access = _Access()
    for flow in ("egress", "ingress"):
        access.grant(f"fleet {flow}", [GATEWAY, ROUTER], flow, _EVERYTHING, [keys.all_keys])
    return access.value


class _Access:
    """Collects grants; everything else is denied."""

    def __init__(self) -> None:
        self._rules: list[object] = []
        self._subjects: list[object] = []
        self._policies: list[object] = []

    def grant(self, grant: str, to: Sequence[str], flow: str, messages: Sequence[str], keys: Sequence[str]) -> None:
        if to:  # a subject without a name would match everybody
            rule = {"permission": "allow", "flows": [flow], "messages": list(messages), "key_exprs": list(keys)}
            self._rules.append({"id": grant, **rule})
            self._subjects.append({"id": grant, "cert_common_names": list(to)})
            self._policies.append({"rules": [grant], "subjects": [grant]})

    @property
    def value(self) -> dict[str, object]:
        lists = {"rules": self._rules, "subjects": self._subjects, "policies": self._policies}
        return {"enabled": True, "default_permission": "deny", **lists}
