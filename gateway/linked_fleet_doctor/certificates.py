"""Checks of TLS files: readable, a matching pair, with the right names, and valid for some time to come."""

from collections.abc import Iterator, Sequence
from datetime import UTC, datetime, timedelta
from ipaddress import ip_address
from pathlib import Path
from urllib.parse import urlsplit

from cryptography import x509

from linked_fleet_agent.wire.trust import Credentials, check_pair
from linked_fleet_doctor.finding import Finding

_SOON = timedelta(days=21)


def check_http_certificate(certificate: str, key: str, public_urls: Sequence[str], now: datetime) -> Iterator[Finding]:
    """Check the gateway's certificate for HTTPS."""
    try:
        check_pair(certificate, key)
    except ValueError as error:
        yield Finding("tls", str(error), "give a certificate chain and its private key, both PEM, without a password")
        return
    yield from check_validity_periods("tls", certificate, now)
    hosts = {urlsplit(url).hostname or "" for url in public_urls}
    missing = sorted(host for host in hosts if not _names(certificate, host))
    if missing:
        advice = "get a certificate with these names, or correct LINKED_FLEET_PUBLIC_URL"
        yield Finding("tls", f"{certificate} is not for {', '.join(missing)}", advice)


def check_wire_certificates(authority: str, certificate: str, key: str, now: datetime) -> Iterator[Finding]:
    """Check the three files that identify the gateway on Zenoh."""
    advice = "make them with deploy/certificates (deploy/README.md, Who is who on the wire)"
    try:
        given = Credentials.from_optional_files(authority, certificate, key)
    except ValueError as error:
        yield Finding("tls", str(error), advice)
        return
    if given is None:
        return
    for path in (authority, certificate):
        yield from check_validity_periods("tls", path, now)
    if not _signed(certificate, authority):
        yield Finding("tls", f"{certificate} is not signed by {authority}", advice)


def check_validity_periods(subject: str, path: str, now: datetime) -> Iterator[Finding]:
    """Check the validity period of each certificate in a file. ``now`` has a time zone."""
    for each in _read(path):
        first, last = each.not_valid_before_utc, each.not_valid_after_utc
        day = f"{last.astimezone(UTC):%Y-%m-%d}"
        if now > last:
            yield Finding(subject, f"{path} expired on {day}", "renew it")
        elif now < first:
            advice = "wait, or correct the clock of this machine"
            sentence = f"{path} is valid from {first:%Y-%m-%d %H:%M} UTC on, which is later than now"
            yield Finding(subject, sentence, advice)
        elif last - now < _SOON:
            yield Finding(subject, f"{path} expires on {day}", "renew it", is_note=True)
        else:
            yield Finding(subject, f"{path} is valid until {day}")


def _read(path: str) -> list[x509.Certificate]:
    """Return the certificates in a file that ``check_pair`` or ``Credentials`` has read before."""
    return x509.load_pem_x509_certificates(Path(path).read_bytes())


def _names(path: str, host: str) -> bool:
    """Return True if the first certificate of the file is valid for this host."""
    try:
        names = _read(path)[0].extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    except x509.ExtensionNotFound:
        return False
    try:
        return ip_address(host) in names.get_values_for_type(x509.IPAddress)
    except ValueError:
        wild = f"*.{host.partition('.')[2]}"
        return bool({host.lower(), wild.lower()} & {name.lower() for name in names.get_values_for_type(x509.DNSName)})


def _signed(certificate: str, authority: str) -> bool:
    """Return True if one of the authorities issued a certificate in the file."""
    subjects = {each.subject for each in _read(authority)}
    return any(each.issuer in subjects for each in _read(certificate))
