"""``linked-fleet doctor``: check all that a gateway with these settings needs, and say what is wrong.

The settings are those of the gateway, as variables and as flags (linked-fleet gateway --help). Nothing is changed. Each
line is a finding: ok, note or WRONG, with what to do. The exit code is 1 when something is wrong, else 0.
"""

import asyncio
import os
import sys
from collections.abc import Iterator, Mapping, Sequence
from datetime import UTC, datetime

from linked_fleet_agent.wire.trust import is_loopback, unauthenticated_endpoints
from linked_fleet_doctor import certificates, libraries, machine, redis_server, zenoh_routers
from linked_fleet_doctor.finding import Finding, format_findings, summary
from linked_fleet_gateway.app.settings import GatewaySettings, exposure_problems

_REDIS_S = 10.0


def main() -> int:
    if {"-h", "--help"} & set(sys.argv[1:]):
        print(f"usage: linked-fleet doctor [flags of the gateway]\n\n{(__doc__ or '').strip()}")
        return 0
    findings = asyncio.run(examine(os.environ, sys.argv[1:]))
    print(format_findings(findings))
    print(summary(findings))
    return int(any(each.is_fault for each in findings))


async def examine(environment: Mapping[str, str], arguments: Sequence[str]) -> list[Finding]:
    """Return all findings for a gateway with these settings."""
    try:
        settings = GatewaySettings.read(environment, arguments)
    except ValueError as error:
        return [Finding("settings", str(error), "docs/SETTINGS.md has all settings")]
    wire = list(_wire(settings))
    found = [*_exposure(settings), *_ports(settings), *_tls(settings), *wire, machine.check_machine()]
    found += await libraries.check_libraries()
    if settings.redis_url:
        answers = redis_server.check_redis(settings.redis_url, settings.namespace)
        found += await redis_server.collect_within(answers, _REDIS_S)
    else:
        found.append(redis_server.check_embedded_redis(settings.state_path))
    if settings.zenoh_connect and not any(each.is_fault for each in wire):
        found.append(await zenoh_routers.check_link(settings.zenoh_connect, settings.trust, settings.namespace))
    return found


def _exposure(settings: GatewaySettings) -> Iterator[Finding]:
    """Yield the requirements that the gateway itself checks at start."""
    try:
        proof = settings.credentials if settings.zenoh_access else None
    except ValueError:
        proof = None  # reported by _tls
    for sentence in exposure_problems(
        exposed=not is_loopback(settings.host),
        tls=bool(settings.tls_cert),
        identities=bool(settings.identities),
        open_endpoints=unauthenticated_endpoints(settings.listen_endpoints, proof),
        allowed=settings.allow,
    ):
        reason, _, advice = sentence.partition(": ")
        yield Finding("settings", reason, advice)


def _ports(settings: GatewaySettings) -> Iterator[Finding]:
    http = machine.check_http_port(settings.host, settings.port, bool(settings.tls_cert))
    yield http
    yield from machine.check_zenoh_ports(settings.listen_endpoints, "already" in http.sentence)


def _tls(settings: GatewaySettings) -> Iterator[Finding]:
    now = datetime.now(UTC)
    if settings.tls_cert:
        yield from certificates.check_http_certificate(
            str(settings.tls_cert), str(settings.tls_key), settings.public_urls, now
        )
    ca, certificate, key = (str(each or "") for each in (settings.zenoh_ca, settings.zenoh_cert, settings.zenoh_key))
    yield from certificates.check_wire_certificates(ca, certificate, key, now)


def _wire(settings: GatewaySettings) -> Iterator[Finding]:
    try:
        credentials = settings.credentials
        settings.trust  # noqa: B018 -- raises ValueError
    except ValueError as error:
        yield Finding("zenoh", f"no router is asked: {error}", "correct the files first")
        return
    yield from zenoh_routers.check_endpoints(settings.zenoh_connect, credentials)


if __name__ == "__main__":
    sys.exit(main())
