"""Settings of the gateway: environment variables, each also a flag, read once (docs/SETTINGS.md)."""

import argparse
import re
import socket
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from ipaddress import IPv4Network, IPv6Network, ip_network
from pathlib import Path

from agents.wire.keys import Keys as ZenohKeys
from agents.wire.trust import Credentials
from gateway.app.exposure import EXPOSURES
from gateway.link.session_settings import trust
from gateway.runtime.log import FORMS
from gateway.subscriptions.redis_keys import Keys

_ORIGIN = re.compile(r"https?://[a-z0-9.\[\]:-]+")  # as browsers write it: lower case, no path


def _setting(env: str, default: str, meaning: str) -> str:
    return field(default=default, metadata={"env": env, "meaning": meaning})


@dataclass(frozen=True)
class GatewaySettings:
    """Values as strings, exactly as given; the properties below are their parsed forms."""

    host: str = _setting("LINKED_FLEET_HOST", "127.0.0.1", "address on which the gateway listens")
    port: str = _setting("LINKED_FLEET_PORT", "8000", "port on which the gateway listens")
    public_url: str = _setting(
        "LINKED_FLEET_PUBLIC_URL",
        "",
        "base URLs under which the fleet is known, comma-separated (default: the address)",
    )
    tls_cert: str = _setting("LINKED_FLEET_TLS_CERT", "", "certificate chain (PEM) for HTTPS")
    tls_key: str = _setting("LINKED_FLEET_TLS_KEY", "", "private key (PEM) of that certificate")
    identities: str = _setting(
        "LINKED_FLEET_IDENTITIES", "", "file of who may do what (default: everybody may do everything)"
    )
    allow: str = _setting(
        "LINKED_FLEET_ALLOW",
        "",
        "what would be refused beyond loopback: plain-http, anonymous, plain-zenoh; comma-separated",
    )
    namespace: str = _setting("LINKED_FLEET_NAMESPACE", "fleet", "prefix of every Zenoh and Redis key")
    zenoh_listen: str = _setting(
        "LINKED_FLEET_ZENOH_LISTEN", "", "Zenoh endpoints to listen on (default: tcp/127.0.0.1:7447 without a router)"
    )
    zenoh_connect: str = _setting("LINKED_FLEET_ZENOH_CONNECT", "", "Zenoh endpoints to connect to, comma-separated")
    zenoh_ca: str = _setting(
        "LINKED_FLEET_ZENOH_CA", "", "certificate of the authority whose word counts on tls and quic links"
    )
    zenoh_cert: str = _setting(
        "LINKED_FLEET_ZENOH_CERT", "", "certificate by which robots and routers know the gateway"
    )
    zenoh_key: str = _setting("LINKED_FLEET_ZENOH_KEY", "", "its private key")
    zenoh_access: str = _setting(
        "LINKED_FLEET_ZENOH_ACCESS",
        "",
        "who may say what to a gateway that listens: access.json of deploy/certificates",
    )
    redis_url: str = _setting("REDIS_URL", "", "Redis or Valkey that remembers subscriptions (default: embedded)")
    state_dir: str = _setting(
        "LINKED_FLEET_STATE_DIR",
        "",
        "folder of the embedded server's data, and of meshes (default: $XDG_STATE_HOME/linked-fleet)",
    )
    callback_allow: str = _setting(
        "LINKED_FLEET_CALLBACK_ALLOW", "", "networks (CIDR) that callbacks may reach although private, comma-separated"
    )
    callback_ports: str = _setting(
        "LINKED_FLEET_CALLBACK_PORTS",
        "80,443,8080,8443",
        "ports of public addresses that callbacks may reach, such as 443 or 8000-8999, comma-separated",
    )
    callback_consent: str = _setting(
        "LINKED_FLEET_CALLBACK_CONSENT", "on", "whether a receiver is asked before its first delivery: on or off"
    )
    subscriptions_per_client: str = _setting(
        "LINKED_FLEET_SUBSCRIPTIONS_PER_CLIENT", "1000", "subscriptions that one client may have at once"
    )
    invocations_per_client: str = _setting(
        "LINKED_FLEET_INVOCATIONS_PER_CLIENT", "100", "motions that one client may have begun and not ended at once"
    )
    rules_per_client: str = _setting("LINKED_FLEET_RULES_PER_CLIENT", "50", "rules that one client may have at once")
    requests_per_client: str = _setting(
        "LINKED_FLEET_REQUESTS_PER_CLIENT", "1000", "requests a second that one client may make on average; 0: any"
    )
    sockets: str = _setting("LINKED_FLEET_SOCKETS", "16000", "connections that there may be at once")
    sockets_per_client: str = _setting(
        "LINKED_FLEET_SOCKETS_PER_CLIENT", "12000", "connections that one client address may have at once"
    )
    fronts: str = _setting(
        "LINKED_FLEET_FRONTS",
        "",
        "addresses or networks (CIDR) of fronts whose word on the client's address counts, comma-separated",
    )
    cors_origins: str = _setting(
        "LINKED_FLEET_CORS_ORIGINS", "", "origins of other sites' pages that may use the fleet, comma-separated"
    )
    session_key_file: str = _setting(
        "LINKED_FLEET_SESSION_KEY_FILE",
        "",
        "file with the key of sessions, 32 bytes in base64 (default: made, in Redis)",
    )
    history_s: str = _setting("LINKED_FLEET_HISTORY_S", "300", "seconds of each robot that are remembered; 0: none")
    history_hz: str = _setting("LINKED_FLEET_HISTORY_HZ", "10", "samples a second of each robot that are remembered")
    history_mb: str = _setting(
        "LINKED_FLEET_HISTORY_MB", "24", "memory (MB) of all histories; when it is full, older samples are thinned out"
    )
    log_format: str = _setting("LINKED_FLEET_LOG_FORMAT", "text", "form of the log: text or json")

    def __post_init__(self) -> None:
        if not self.port.isdecimal() or not 0 < int(self.port) < 65536:
            raise ValueError(f"LINKED_FLEET_PORT is a port number from 1 to 65535, not {self.port!r}")
        if self.callback_consent not in ("on", "off"):
            raise ValueError(f"LINKED_FLEET_CALLBACK_CONSENT is on or off, not {self.callback_consent!r}")
        for name in (each.name for each in fields(self) if each.name.endswith("_per_client") or each.name == "sockets"):
            if not getattr(self, name).isdecimal():
                raise ValueError(f"LINKED_FLEET_{name.upper()} is a number, not {getattr(self, name)!r}")
        for variable, text, least, most in (
            ("LINKED_FLEET_HISTORY_S", self.history_s, 0, 86_400),
            ("LINKED_FLEET_HISTORY_HZ", self.history_hz, 1, 100),
            ("LINKED_FLEET_HISTORY_MB", self.history_mb, 1, 1_000_000),
        ):
            if not re.fullmatch(r"\d{1,7}", text, re.ASCII) or not least <= int(text) <= most:
                raise ValueError(f"{variable} is a whole number from {least} to {most}, not {text!r}")
        if self.log_format not in FORMS:
            raise ValueError(f"LINKED_FLEET_LOG_FORMAT is text or json, not {self.log_format!r}")
        if bool(self.tls_cert) != bool(self.tls_key):
            raise ValueError("LINKED_FLEET_TLS_CERT and LINKED_FLEET_TLS_KEY are given together, or neither")
        if unknown := [name for name in self.allowed if name not in EXPOSURES]:
            raise ValueError(f"LINKED_FLEET_ALLOW is of {', '.join(EXPOSURES)}, not {', '.join(unknown)}")
        ZenohKeys(self.namespace), Keys(self.namespace)  # ValueError
        for origin in self.cors_pages:
            if not _ORIGIN.fullmatch(origin):
                raise ValueError(
                    f"LINKED_FLEET_CORS_ORIGINS is of origins such as https://twin.example:8443, not {origin!r}"
                )
        self.callback_port_ranges  # noqa: B018 -- ValueError
        for name, given in (("LINKED_FLEET_CALLBACK_ALLOW", self.callback_allow), ("LINKED_FLEET_FRONTS", self.fronts)):
            try:
                _networks(given)
            except ValueError as error:
                raise ValueError(f"{name} is of networks such as 10.0.0.0/8: {error}") from None

    @property
    def port_number(self) -> int:
        return int(self.port)

    @property
    def public_urls(self) -> tuple[str, ...]:
        """Base URLs without a slash at the end; on loopback its usual names as well."""
        if self.public_url:
            return tuple(url.rstrip("/") for url in _items(self.public_url))
        host = f"[{self.host}]" if ":" in self.host else self.host
        scheme = "https" if self.tls_cert else "http"
        urls = [f"{scheme}://{host}:{self.port}"]
        if self.host in ("127.0.0.1", "::1", "localhost"):
            urls += [f"{scheme}://{name}:{self.port}" for name in ("127.0.0.1", "localhost", "[::1]")]
        return tuple(dict.fromkeys(urls))

    @property
    def listen_endpoints(self) -> tuple[str, ...]:
        if not self.zenoh_listen and not self.zenoh_connect:
            return ("tcp/127.0.0.1:7447",)
        return _items(self.zenoh_listen)

    @property
    def connect_endpoints(self) -> tuple[str, ...]:
        return _items(self.zenoh_connect)

    @property
    def allowed(self) -> tuple[str, ...]:
        return _items(self.allow)

    @property
    def credentials(self) -> Credentials | None:
        """By which Zenoh's neighbours know the gateway, and it them; ValueError for files that are none."""
        return Credentials.given(self.zenoh_ca, self.zenoh_cert, self.zenoh_key)

    @property
    def trust(self) -> dict[str, object]:
        """Zenoh's configuration of who proves what to whom; ValueError for files that are none."""
        return trust(self.credentials, self.zenoh_access)

    @property
    def state_path(self) -> Path:
        """Folder of the data of the embedded server and of the cache of meshes."""
        return Path(self.state_dir or Path.home() / ".local" / "state" / "linked-fleet").absolute()

    @property
    def callback_networks(self) -> tuple[IPv4Network | IPv6Network, ...]:
        return _networks(self.callback_allow)

    @property
    def front_networks(self) -> tuple[IPv4Network | IPv6Network, ...]:
        return _networks(self.fronts)

    @property
    def callback_port_ranges(self) -> tuple[range, ...]:
        """Ports of public receivers; ValueError for what is neither a port nor a range of ports."""
        return tuple(_ports(item) for item in _items(self.callback_ports))

    @property
    def cors_pages(self) -> tuple[str, ...]:
        """Origins (RFC 6454) of pages elsewhere that may use the fleet."""
        return _items(self.cors_origins)

    @property
    def gateway_name(self) -> str:
        """Replicas of a container differ in the host name, gateways on one host in the port."""
        return f"{socket.gethostname()}-{self.port}"

    @classmethod
    def read(cls, environment: Mapping[str, str], arguments: Sequence[str]) -> "GatewaySettings":
        """Flags win over the environment; ValueError for an unusable value, SystemExit for an unknown flag."""
        parser = argparse.ArgumentParser(prog="python -m gateway", description="Serve the fleet as Linked Data.")
        # XDG Base Directory Specification
        home = environment.get("XDG_STATE_HOME", "")
        state_dir = str(Path(home) / "linked-fleet") if Path(home).is_absolute() else ""
        for item in fields(cls):
            flag, env = "--" + item.name.replace("_", "-"), item.metadata["env"]
            default = environment.get(env) or (state_dir if item.name == "state_dir" else item.default)
            parser.add_argument(flag, default=default, help=f"{item.metadata['meaning']} ({env})")
        return cls(**vars(parser.parse_args(arguments)))


def _items(text: str) -> tuple[str, ...]:
    return tuple(item.strip() for item in text.split(",") if item.strip())


def _networks(text: str) -> tuple[IPv4Network | IPv6Network, ...]:
    return tuple(ip_network(network) for network in _items(text))


def _ports(text: str) -> range:
    first, _, last = text.partition("-")
    numbers = [int(each) if re.fullmatch(r"\d{1,5}", each, re.ASCII) else 0 for each in (first, last or first)]
    if not 1 <= numbers[0] <= numbers[1] <= 65535:
        raise ValueError(f"LINKED_FLEET_CALLBACK_PORTS is of ports such as 443 or 8000-8999, not {text!r}")
    return range(numbers[0], numbers[1] + 1)
