"""Mutual authentication of Zenoh links, and detection of endpoints that accept anybody. Pure."""

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
    """PEM files: the certificate authority, and the certificate and private key of this process.

    Raises ValueError with one clear sentence if one is missing or unreadable, or if they do not belong together.
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
        raise ValueError(f"{certificate} and {key} are no certificate and its key: {_reason(error)}") from None


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


def open_to_all(endpoints: Iterable[str], credentials: Credentials | None) -> tuple[str, ...]:
    """Return the listen endpoints that other machines reach without authentication."""
    return tuple(each for each in endpoints if not _guarded(each, credentials is not None))


def _guarded(endpoint: str, proof: bool) -> bool:
    match = _ENDPOINT.fullmatch(endpoint)
    if match is None:  # Zenoh itself refuses an invalid endpoint
        return False
    protocol, address = match.groups()
    return protocol in _LOCAL or is_loopback(address.rpartition(":")[0]) or (protocol in _PROVEN and proof)
