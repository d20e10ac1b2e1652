"""Settings of the gateway and of its extensions, read once (docs/SETTINGS.md).

A gateway that other machines reach has requirements, unless settings waive them by name. ``exposure_problems`` checks
them and is pure.
"""

import socket
from argparse import ArgumentParser
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from linked_fleet_agent.wire.keys import Keys as ZenohKeys
from linked_fleet_agent.wire.trust import Credentials
from linked_fleet_base.settings import (
    FILE,
    NETWORKS,
    ON_OFF,
    PORT,
    PORTS,
    TEXT,
    TEXTS,
    Kind,
    Network,
    Section,
    SectionT,
    choice,
    comma_separated,
    read,
    section,
    setting,
    text_matching,
    whole_number,
)
from linked_fleet_gateway.app.extensions import BUILT_IN, ExtensionSettings, enabled_extensions, foreign_extensions
from linked_fleet_gateway.subscriptions.redis_scripts import Keys
from linked_fleet_link.zenoh_session import trust
from linked_fleet_runtime.log import LOG_FORMATS

EXPOSURES = ("plain-http", "anonymous", "plain-zenoh")
"""Words of LINKED_FLEET_ALLOW, each of which waives one requirement."""


def exposure_problems(
    *, exposed: bool, tls: bool, identities: bool, open_endpoints: Sequence[str], allowed: Collection[str]
) -> list[str]:
    """Return a sentence for each unmet requirement, which names the remedies.

    ``exposed`` means that HTTP is reachable beyond loopback; ``open_endpoints`` are Zenoh endpoints that other machines
    reach without authentication.
    """
    found = []
    if exposed and not tls and "plain-http" not in allowed:
        found.append(
            "without TLS whoever is on the way reads and changes everything: give LINKED_FLEET_TLS_CERT and "
            "LINKED_FLEET_TLS_KEY, listen on loopback, or say LINKED_FLEET_ALLOW=plain-http (behind a front with TLS)"
        )
    if exposed and not identities and "anonymous" not in allowed:
        found.append(
            "without identities anybody moves the robots: give LINKED_FLEET_IDENTITIES, listen on loopback, "
            "or say LINKED_FLEET_ALLOW=anonymous"
        )
    if open_endpoints and "plain-zenoh" not in allowed:
        found.append(
            f"anybody who reaches {', '.join(open_endpoints)} could be a robot or move one: listen on tls/… or quic/… "
            "with LINKED_FLEET_ZENOH_CA, …_CERT, …_KEY and …_ACCESS, on loopback, or nowhere (…_CONNECT to a router), "
            "or say LINKED_FLEET_ALLOW=plain-zenoh"
        )
    return found


_PROGRAM = "python -m linked_fleet_gateway"


def _namespace(text: str) -> str:
    try:
        return ZenohKeys(text).namespace and Keys(text).namespace
    except ValueError:
        raise ValueError(f"not {text!r}") from None


_NAMESPACE = Kind(_namespace, "a plain key such as 'fleet' or 'site/hall-2'")
_ALLOW = comma_separated(choice(*EXPOSURES), f"of {', '.join(EXPOSURES)}")
_ORIGINS = comma_separated(  # as browsers write them: lower case, no path
    text_matching(r"https?://[a-z0-9.\[\]:-]+", "an origin"), "of origins such as https://twin.example:8443"
)


@dataclass(frozen=True)
class GatewaySettings(Section):
    """Settings of the core."""

    host: str = setting(TEXT, "127.0.0.1", "address to listen on")
    port: int = setting(PORT, "8000", "port to listen on")
    public_url: tuple[str, ...] = setting(
        TEXTS,
        "",
        "base URLs of the fleet, comma-separated; empty: the address, on loopback with its usual names",
    )
    tls_cert: Path | None = setting(
        FILE, "", "certificate chain (PEM) for HTTPS and WSS; read again after a change and on SIGHUP"
    )
    tls_key: Path | None = setting(FILE, "", "its private key (PEM)")
    identities: Path | None = setting(
        FILE, "", "file of identities (docs/IDENTITIES.md); empty: everybody may do everything"
    )
    allow: tuple[str, ...] = setting(
        _ALLOW,
        "",
        "allowed beyond loopback, comma-separated: `plain-http`, `anonymous`, `plain-zenoh`",
    )
    namespace: str = setting(_NAMESPACE, "fleet", "prefix of every Zenoh and Redis key")
    zenoh_listen: tuple[str, ...] = setting(
        TEXTS, "", "Zenoh endpoints to listen on, comma-separated; empty: tcp/127.0.0.1:7447 without routers"
    )
    zenoh_connect: tuple[str, ...] = setting(TEXTS, "", "Zenoh endpoints of routers, comma-separated")
    zenoh_ca: Path | None = setting(FILE, "", "certificate of the authority for tls and quic links")
    zenoh_cert: Path | None = setting(
        FILE, "", "certificate of the gateway on these links; all three are needed together"
    )
    zenoh_key: Path | None = setting(FILE, "", "its private key")
    zenoh_access: Path | None = setting(
        FILE,
        "",
        "access control of a gateway that listens: `access.json` of deploy/certificates "
        "(deploy/README.md#who-is-who-on-the-wire)",
    )
    redis_url: str = setting(
        TEXT,
        "",
        "`redis://`, `rediss://`, `unix://`, or `redis+cluster://host:port,…`; empty: an embedded server",
        "REDIS_URL",
    )
    state_dir: Path | None = setting(
        FILE,
        "",
        "folder of the embedded server's data and of cached meshes, which gateways may share; empty: "
        "`$XDG_STATE_HOME/linked-fleet`",
    )
    callback_allow: tuple[Network, ...] = setting(
        NETWORKS,
        "",
        "private networks (CIDR) that callbacks may reach, without consent; comma-separated",
    )
    callback_ports: tuple[range, ...] = setting(
        PORTS,
        "80,443,8080,8443",
        "ports of public addresses that callbacks may reach, such as `443` or `8000-8999`, comma-separated; allowed "
        "networks have all ports",
    )
    callback_consent: bool = setting(ON_OFF, "on", "ask other receivers before the first delivery: on or off")
    subscriptions_per_client: int = setting(
        whole_number(), "1000", "subscriptions of one client (an identity, else an address)"
    )
    invocations_per_client: int = setting(
        whole_number(),
        "100",
        "unfinished motions of one client; the next one gets 429. Stops do not count",
    )
    requests_per_client: int = setting(
        whole_number(),
        "1000",
        "requests a second of one client on average, those of ten seconds at once; 0: no bound. Stops do not count",
    )
    sockets: int = setting(
        whole_number(),
        "16000",
        "connections at once; fewer if the process may open fewer files",
    )
    sockets_per_client: int = setting(whole_number(), "12000", "connections of one address")
    fronts: tuple[Network, ...] = setting(
        NETWORKS,
        "",
        "addresses or networks (CIDR) of fronts, comma-separated. Their requests count for the rightmost address in "
        "`X-Forwarded-For` or `Forwarded` that is not a front's. Name no address of clients",
    )
    cors_origins: tuple[str, ...] = setting(
        _ORIGINS,
        "",
        "origins of other sites that may use the fleet with tokens, never with sessions; comma-separated",
    )
    log_format: str = setting(choice(*LOG_FORMATS), "text", "format of log lines: text or json")
    sections: tuple[Section, ...] = ()
    """Other sections that were read."""

    def __post_init__(self) -> None:
        if bool(self.tls_cert) != bool(self.tls_key):
            raise ValueError("LINKED_FLEET_TLS_CERT and LINKED_FLEET_TLS_KEY are given together, or neither")

    @property
    def public_urls(self) -> tuple[str, ...]:
        """Base URLs without trailing slash; on loopback also with its usual names."""
        if self.public_url:
            return tuple(url.rstrip("/") for url in self.public_url)
        host = f"[{self.host}]" if ":" in self.host else self.host
        scheme = "https" if self.tls_cert else "http"
        urls = [f"{scheme}://{host}:{self.port}"]
        if self.host in ("127.0.0.1", "::1", "localhost"):
            urls += [f"{scheme}://{name}:{self.port}" for name in ("127.0.0.1", "localhost", "[::1]")]
        return tuple(dict.fromkeys(urls))

    @property
    def listen_endpoints(self) -> tuple[str, ...]:
        """Zenoh endpoints to listen on; one on loopback if neither listen nor connect endpoints are set."""
        return self.zenoh_listen if self.zenoh_listen or self.zenoh_connect else ("tcp/127.0.0.1:7447",)

    @property
    def credentials(self) -> Credentials | None:
        """The gateway's TLS credentials on Zenoh, or None. Raises ValueError for unusable files."""
        return Credentials.from_optional_files(
            *(str(each or "") for each in (self.zenoh_ca, self.zenoh_cert, self.zenoh_key))
        )

    @property
    def trust(self) -> dict[str, object]:
        """Zenoh's TLS and access configuration. Raises ValueError for unusable files."""
        return trust(self.credentials, str(self.zenoh_access or ""))

    @property
    def state_path(self) -> Path:
        """Folder of the embedded server's data and of the mesh cache."""
        return (self.state_dir or Path.home() / ".local" / "state" / "linked-fleet").absolute()

    @property
    def gateway_name(self) -> str:
        """A unique name: replicas of a container differ in host name, gateways on one host in port."""
        return f"{socket.gethostname()}-{self.port}"

    def section(self, kind: type[SectionT]) -> SectionT:
        """Return the section of this type; with default values if it was not read."""
        try:
            return section(self.sections, kind)
        except LookupError:
            return kind()

    @classmethod
    def read(cls, environment: Mapping[str, str], arguments: Sequence[str]) -> "GatewaySettings":
        """Read settings; flags precede the environment.

        Raises ValueError for an unusable value, SystemExit for an unknown flag.
        """
        state_home = Path(environment.get("XDG_STATE_HOME", ""))  # XDG Base Directory Specification
        if state_home.is_absolute() and not environment.get("LINKED_FLEET_STATE_DIR"):
            environment = {**environment, "LINKED_FLEET_STATE_DIR": str(state_home / "linked-fleet")}
        # The set of flags depends on the extensions of other packages.
        parser = ArgumentParser(_PROGRAM, add_help=False)
        names = read([ExtensionSettings], environment, arguments, parser, others=True)
        extensions = [*BUILT_IN, *foreign_extensions(section(names, ExtensionSettings))]
        parser = ArgumentParser(_PROGRAM, description="Serve the fleet as Linked Data.")
        kinds = [cls, ExtensionSettings, *(each.settings for each in extensions if each.settings)]
        found = read(kinds, environment, arguments, parser)
        enabled_extensions(section(found, ExtensionSettings))
        return replace(section(found, cls), sections=tuple(each for each in found if not isinstance(each, cls)))
