"""How the ends of a Zenoh link prove who they are, and which endpoints let in whoever comes. Pure."""

import re
import ssl
from collections.abc import Iterable
from dataclasses import dataclass
from ipaddress import ip_address
from pathlib import Path

_PROVEN = ("tls", "quic")
_LOCAL = ("unixsock-stream", "unixpipe")
_ENDPOINT = re.compile(r"([a-z-]+)/(.*?)(?:[?#].*)?")
_NAMED = "LINKED_FLEET_ZENOH_CA, LINKED_FLEET_ZENOH_CERT and LINKED_FLEET_ZENOH_KEY"


@dataclass(frozen=True)
class Credentials:
    """PEM files: the authority whose word counts, and the certificate and key by which this process is known.

    ValueError with one clear sentence when one is missing, cannot be read, or they do not belong together.
    """

    authority: str
    certificate: str
    key: str

    def __post_init__(self) -> None:
        if not (self.authority and self.certificate and self.key):
            raise ValueError(f"{_NAMED} are given together, or none of them")
        check_pair(self.certificate, self.key)
        try:
            ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT).load_verify_locations(self.authority)
        except (OSError, ssl.SSLError) as error:
            raise ValueError(f"{self.authority} is no certificate of an authority: {_reason(error)}") from None

    @classmethod
    def given(cls, authority: str, certificate: str, key: str) -> "Credentials | None":
        """None when none of the three is set."""
        return cls(authority, certificate, key) if authority or certificate or key else None

    def configuration(self) -> dict[str, object]:
        """Values for Zenoh, by key. Without them a tls or quic endpoint has what its own text says."""
        files = (str(Path(path).absolute()) for path in (self.authority, self.certificate, self.key))
        return {"transport/link/tls": mutual_tls(*files)}


def mutual_tls(authority: str, certificate: str, key: str) -> dict[str, object]:
    """Zenoh's ``transport/link/tls``: both ends of every tls and quic link show a certificate of the authority.

    Who connects checks also that the certificate is of the name or address that it asked for.
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
    """ValueError with one clear sentence unless both files can be read and belong together."""
    for path in (certificate, key):
        try:
            Path(path).read_bytes()
        except OSError as error:
            raise ValueError(f"{path} cannot be read: {error.strerror}") from None
    try:
        ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER).load_cert_chain(certificate, key, password="")  # never ask a terminal
    except (OSError, ssl.SSLError, ValueError) as error:
        raise ValueError(f"{certificate} and {key} are no certificate and its key: {_reason(error)}") from None


def _reason(error: Exception) -> str:
    return str(getattr(error, "reason", None) or error).lower().replace("_", " ")


def is_loopback(host: str) -> bool:
    """Return True if only this machine reaches a listener there; every other name may be reached from elsewhere."""
    try:
        return host == "localhost" or ip_address(host.strip("[]")).is_loopback
    except ValueError:
        return False


def open_to_all(endpoints: Iterable[str], credentials: Credentials | None) -> tuple[str, ...]:
    """Those to listen on that other machines reach without proof of who they are."""
    return tuple(each for each in endpoints if not _guarded(each, credentials is not None))


def _guarded(endpoint: str, proof: bool) -> bool:
    match = _ENDPOINT.fullmatch(endpoint)
    if match is None:  # Zenoh refuses what is no endpoint
        return False
    protocol, address = match.groups()
    return protocol in _LOCAL or is_loopback(address.rpartition(":")[0]) or (protocol in _PROVEN and proof)
