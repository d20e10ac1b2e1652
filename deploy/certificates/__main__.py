"""Certificates and access control of Zenoh links: python3 deploy/certificates FOLDER --router NAME --agent NAME ...

Creates in FOLDER what is missing or soon expires, and keeps the rest. Run it again whenever a robot joins (--agent) or
leaves (--remove). What no option names stays as the earlier run has written it: other agents, addresses, endpoints and
namespace.

  ca.pem, ca.key               the authority; only this script needs its key: keep it away from robots and gateways
  router.pem, router.key       for routers, with the names and addresses by which they are reached
  gateway.pem, gateway.key     for gateways
  agents/NAME.pem, .key        for each agent
  access.json                  access control of keys, for all agents
  router.json5                 the whole configuration of a router: zenohd -c FOLDER/router.json5

An agent that is removed is ignored once the router has read its file again, although its certificate is still valid.
Needs Python 3.11 and the command openssl, 1.1.1 or newer.
"""

import argparse
import json
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from authority import CertificateAuthority, CertificateError

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "agents"))

from earlier_run import EarlierRun, Robots, read_earlier_run

from linked_fleet_agent.wire.keys import Keys
from linked_fleet_agent.wire.trust import GATEWAY, ROUTER, common_name, mutual_tls, router_access_control

_MOST_SESSIONS = 20_000
_LEASE_MS = 2_000
_ROUTER, _LISTEN = "localhost,127.0.0.1", "tls/[::]:7447"


@dataclass(frozen=True)
class Agent:
    """An agent that needs a certificate: robot names that it may use (None: any) and hosts on which it listens."""

    name: str
    robots: Robots
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
        _run(arguments, read_earlier_run(arguments.folder))
    except (CertificateError, OSError, ValueError) as error:
        print(f"certificates: {error}", file=sys.stderr)
        return 1
    return 0


def _run(arguments: argparse.Namespace, earlier: EarlierRun) -> None:
    named = {agent.name: agent for agent in map(Agent.parse, arguments.agent)}
    agents = _agents(earlier.agents, {name: agent.robots for name, agent in named.items()}, arguments.remove)
    keys = Keys(arguments.namespace or earlier.namespace or "fleet")
    access = router_access_control(keys, agents)
    authority = CertificateAuthority(arguments.folder)
    routers = arguments.router or authority.hosts("router") or _items(_ROUTER)
    hosts = {name: named[name].hosts if name in named else () for name in agents}
    _make(authority, hosts, routers, arguments.gateway or authority.hosts("gateway"))
    where = arguments.installed or earlier.installed or arguments.folder.resolve()
    listen = arguments.listen or earlier.listen or _items(_LISTEN)
    connect = arguments.connect or earlier.connect
    _write(arguments.folder / "access.json", access)
    _write(arguments.folder / "router.json5", _router(where, listen, connect, access))
    _report(earlier.agents, agents)


def _agents(earlier: Mapping[str, Robots], named: Mapping[str, Robots], removed: Sequence[str]) -> dict[str, Robots]:
    """Return the robots of each agent from now on. Raises ValueError."""
    for name in removed:
        if name in named:
            raise ValueError(f"{name!r} is in --agent and in --remove; name it in one of them")
        if name not in earlier:
            raise ValueError(f"--remove {name}: there is no such agent; there are {', '.join(earlier) or 'none'}")
    return {name: robots for name, robots in earlier.items() if name not in removed} | dict(named)


def _report(earlier: Mapping[str, Robots], agents: Mapping[str, Robots]) -> None:
    """Print each agent and what this run has done with it."""
    both = [name for name in agents if name in earlier]
    for what, names in (
        ("kept", [name for name in both if agents[name] == earlier[name]]),
        ("changed", [name for name in both if agents[name] != earlier[name]]),
        ("added", [name for name in agents if name not in earlier]),
        ("removed", [name for name in earlier if name not in agents]),
    ):
        if names:
            print(f"agents {what}: {', '.join(names)}")
    if earlier != agents:
        print("restart each router, so that it reads its file again")


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
        ("remove", "", "agents that leave"),
        ("router", _ROUTER, "names and addresses by which routers are reached"),
        ("gateway", "", "names and addresses of gateways, if agents connect to them"),
        ("listen", _LISTEN, "endpoints on which the router listens"),
        ("connect", "", "endpoints of other routers of the mesh"),
    ):
        said = f"{meaning}; comma-separated" + (f" (at first: {default})" if default else "")
        parser.add_argument(f"--{flag}", type=_items, default=(), help=said)
    parser.add_argument("--namespace", default="", help="prefix of every Zenoh key (at first: fleet)")
    parser.add_argument(
        "--installed", type=Path, help="path of the folder on the router's machine (at first: the same path)"
    )
    return parser


def _items(text: str) -> tuple[str, ...]:
    return tuple(item.strip() for item in text.split(",") if item.strip())


def _make(
    authority: CertificateAuthority,
    agents: Mapping[str, Sequence[str]],
    routers: Sequence[str],
    gateways: Sequence[str],
) -> None:
    """Create what is missing; ``agents`` are their hosts by name."""
    authority.create()
    authority.certify("router", ROUTER, routers)
    authority.certify("gateway", GATEWAY, gateways)
    for agent, hosts in agents.items():
        name = common_name(agent)
        authority.certify(f"agents/{name}", name, hosts or authority.hosts(f"agents/{name}"))


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
