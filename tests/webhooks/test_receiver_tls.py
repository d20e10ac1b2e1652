"""Deliveries over TLS to a receiver on a socket."""

import asyncio
import ssl
import subprocess
from contextlib import closing
from ipaddress import IPv4Network
from pathlib import Path

import pytest

from linked_fleet_webhooks.network import Network
from linked_fleet_webhooks.receiver import DeliveryOutcome, Receiver, Verdict
from receivers import receiving

pytestmark = pytest.mark.processes


@pytest.fixture(scope="module")
def certificate(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A key and its self-signed certificate for receiver.example, in one file."""
    folder = tmp_path_factory.mktemp("tls")
    both = folder / "both.pem"
    subprocess.run(
        [
            *("openssl", "req", "-x509", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1", "-nodes"),
            *("-subj", "/CN=receiver.example", "-addext", "subjectAltName=DNS:receiver.example", "-days", "2"),
            *("-keyout", str(both), "-out", str(folder / "certificate.pem")),
        ],
        check=True,
        capture_output=True,
    )
    both.write_text(both.read_text() + (folder / "certificate.pem").read_text())
    return both


@pytest.fixture
def server(certificate: Path) -> ssl.SSLContext:
    context = ssl.create_default_context(ssl.Purpose.CLIENT_AUTH)
    context.load_cert_chain(certificate)
    return context


def delivered(url: str, context: ssl.SSLContext) -> DeliveryOutcome:
    """Deliver to a URL whose host has a loopback address."""

    async def run() -> DeliveryOutcome:
        with closing(Network((IPv4Network("127.0.0.0/8"),), lookup=lambda *_: ["127.0.0.1"])) as network:
            receiver = Receiver(network, url, ssl_context=context)
            try:
                return await receiver.deliver(b"<> a <#x> .", "text/turtle", {}, allowed_only=False)
            finally:
                await receiver.aclose()

    return asyncio.run(run())


@pytest.mark.parametrize(
    ("host", "verdict"),
    [
        ("receiver.example", Verdict.DELIVERED),
        ("receiver.example.", Verdict.DELIVERED),
        ("other.example", Verdict.RETRY),
    ],
)
def test_tls_verifies_the_name_although_an_address_is_connected_to(
    server: ssl.SSLContext, certificate: Path, host: str, verdict: Verdict
) -> None:
    asked: list[str | None] = []
    server.sni_callback = lambda _socket, name, _context: asked.append(name)
    with receiving(ssl_context=server) as there:
        outcome = delivered(there.url(host=host), ssl.create_default_context(cafile=certificate))
        assert outcome.verdict is verdict
        assert asked == [host.removesuffix(".")]
        assert len(there.log()) == (verdict is Verdict.DELIVERED)


def test_an_unknown_certificate_is_refused(server: ssl.SSLContext) -> None:
    with receiving(ssl_context=server) as there:
        outcome = delivered(there.url(host="receiver.example"), ssl.create_default_context())
        assert "certificate" in outcome.reason
        assert there.log() == []
