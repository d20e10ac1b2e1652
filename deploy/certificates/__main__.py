"""Certificates and access control of Zenoh links: python3 deploy/certificates FOLDER --router NAME --agent NAME ...

Creates in FOLDER what is missing or soon expires, and keeps the rest; run it again whenever a robot joins or leaves,
with all agents of the fleet.

  ca.pem, ca.key               the authority; only this script needs its key: keep it away from robots and gateways
  router.pem, router.key       for routers, with the names and addresses by which they are reached
  gateway.pem, gateway.key     for gateways
  agents/NAME.pem, .key        for each agent
  access.json                  access control of keys, for the agents named now
  router.json5                 the whole configuration of a router: zenohd -c FOLDER/router.json5

An agent that is no longer named is ignored once the router has read its file again, although its certificate is still
valid. Needs Python 3.11 and the command openssl, 1.1.1 or newer.
"""

import argparse
import json
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from authority import CertificateAuthority, CertificateError

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "agents"))

from linked_fleet_agent.wire.keys import Keys
from linked_fleet_agent.wire.trust import GATEWAY, ROUTER, common_name, mutual_tls, router_access_control

_MOST_SESSIONS = 20_000
_LEASE_MS = 2_000


@dataclass(frozen=True)
class Agent:
    """An agent that needs a certificate: robot names that it may use (None: any) and hosts on which it listens."""

    name: str
    robots: tuple[str, ...] | None
    hosts: tuple[str, ...] = ()

    @classmethod
    def parse(cls, text: str) -> "Agent":
        said, _, host = text.partition("@")
        name, separator, robots = said.partition("=")
        common_name(name)  # raises ValueError
        own = tuple(robots.split("+")) if separator else (name,)
        return cls(name, None if robots == "*" else own, (host,) if host else ())


def main() -> int:
    """Return exit code 1, after printing one line, if something cannot be made."""
    arguments = _parser().parse_args()
    try:
        agents = [Agent.parse(text) for text in arguments.agent]
        access = router_access_control(Keys(arguments.namespace), {agent.name: agent.robots for agent in agents})
        _make(CertificateAuthority(arguments.folder), agents, arguments.router, arguments.gateway)
        where = arguments.installed or arguments.folder.resolve()
        _write(arguments.folder / "access.json", access)
        _write(arguments.folder / "router.json5", _router(where, arguments.listen, arguments.connect, access))
    except (CertificateError, OSError, ValueError) as error:
        print(f"certificates: {error}", file=sys.stderr)
        return 1
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python3 deploy/certificates", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folder", type=Path)
    for flag, default, meaning in (
        (
            "agent",
            "",
            "NAME: the robot of that name; NAME=ROBOT+ROBOT: these robots; NAME=*: any robot; …@HOST: it listens there",
        ),
        ("router", "localhost,127.0.0.1", "names and addresses by which routers are reached"),
        ("gateway", "", "names and addresses of gateways, if agents connect to them"),
        ("listen", "tls/[::]:7447", "endpoints on which the router listens"),
        ("connect", "", "endpoints of other routers of the mesh"),
    ):
        said = f"{meaning}; comma-separated" + (f" (default: {default})" if default else "")
        parser.add_argument(f"--{flag}", type=_items, default=_items(default), help=said)
    parser.add_argument("--namespace", default="fleet", help="prefix of every Zenoh key (default: fleet)")
    parser.add_argument(
        "--installed", type=Path, help="path of the folder on the router's machine (default: the same path)"
    )
    return parser


def _items(text: str) -> tuple[str, ...]:
    return tuple(item.strip() for item in text.split(",") if item.strip())


def _make(
    authority: CertificateAuthority, agents: Sequence[Agent], routers: Sequence[str], gateways: Sequence[str]
) -> None:
    authority.create()
    authority.certify("router", ROUTER, routers)
    authority.certify("gateway", GATEWAY, gateways)
    for agent in agents:
        name = common_name(agent.name)
        authority.certify(f"agents/{name}", name, agent.hosts)


def _router(folder: Path, listen: Sequence[str], connect: Sequence[str], access: object) -> dict[str, object]:
    """Return the configuration of deploy/zenoh/router.json5, which explains it, with mutual TLS on every link."""
    proof = mutual_tls(*(str(folder / name) for name in ("ca.pem", "router.pem", "router.key")))
    return {
        "mode": "router",
        "listen": {"endpoints": list(listen)},
        "connect": {"endpoints": list(connect)},
        "scouting": {"multicast": {"enabled": False}},
        "transport": {
            "shared_memory": {"enabled": False},
            "link": {"tx": {"lease": _LEASE_MS}, "protocols": ["tls", "quic"], "tls": proof},
            "unicast": {"max_sessions": _MOST_SESSIONS},
        },
        "access_control": access,
    }


def _write(path: Path, value: object) -> None:
    path.write_text(json.dumps(value, indent=1) + "\n")
    print(f"{path}: written")


if __name__ == "__main__":
    sys.exit(main())
