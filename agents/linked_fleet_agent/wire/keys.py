"""All Zenoh keys of the fleet are built and parsed here, and nowhere else (PROTOCOL.md, "Keys")."""

import re
from dataclasses import dataclass
from typing import Literal

from linked_fleet_agent.wire.names import escape, unescape

Kind = Literal["description", "state", "command", "stop", "progress", "mesh", "picture", "presence"]

_NAMESPACE = re.compile(r"[A-Za-z0-9_.-]+(/[A-Za-z0-9_.-]+)*")
_ROBOT_KEY = re.compile(
    r"robot/([^/*$?#]+)/(description|state|command|stop|progress|mesh|picture|presence)(?:/(0|[1-9][0-9]{0,18}))?"
)
_GATEWAY_KEY = re.compile(r"gateway/([^/*$?#]+)(?:/heartbeat)?")


@dataclass(frozen=True)
class RobotKey:
    """A parsed key of a robot; ``incarnation`` is set exactly on presence tokens."""

    robot: str
    kind: Kind
    incarnation: int | None = None


@dataclass(frozen=True)
class Keys:
    """All keys under one namespace. Raises ValueError if the namespace is not a plain Zenoh key."""

    namespace: str = "fleet"

    def __post_init__(self) -> None:
        if not _NAMESPACE.fullmatch(self.namespace):
            raise ValueError(f"namespace {self.namespace!r} is not a plain Zenoh key such as 'fleet' or 'site/hall-2'")

    def robot(
        self, robot: str, kind: Literal["description", "state", "command", "stop", "progress", "mesh", "picture"]
    ) -> str:
        return f"{self.namespace}/robot/{escape(robot)}/{kind}"

    def presence(self, robot: str, incarnation: int) -> str:
        """Return the liveliness token of one run of an agent; each run has its own key."""
        return f"{self.namespace}/robot/{escape(robot)}/presence/{incarnation}"

    def presence_of(self, robot: str) -> str:
        return f"{self.namespace}/robot/{escape(robot)}/presence/*"

    @property
    def everything(self) -> str:
        return f"{self.namespace}/**"

    def everything_of(self, robot: str) -> str:
        return f"{self.namespace}/robot/{escape(robot)}/**"

    @property
    def everything_of_robots(self) -> str:
        return f"{self.namespace}/robot/*/**"

    def of_all_robots(self, kind: str) -> str:
        return f"{self.namespace}/robot/*/{kind}"

    @property
    def all_presence(self) -> str:
        return f"{self.namespace}/robot/*/presence/*"

    @property
    def all_states(self) -> str:
        return self.of_all_robots("state")

    @property
    def all_progress(self) -> str:
        return self.of_all_robots("progress")

    @property
    def all_stops(self) -> str:
        """The key on which one query reaches every robot."""
        return self.of_all_robots("stop")

    def gateway(self, gateway: str) -> str:
        """Return the liveliness token of a gateway. A robot holds when the last of them is gone."""
        return f"{self.namespace}/gateway/{escape(gateway)}"

    @property
    def all_gateways(self) -> str:
        return f"{self.namespace}/gateway/*"

    def heartbeat(self, gateway: str) -> str:
        """Return the key of the heartbeats by which the event loop of a gateway shows that it runs."""
        return f"{self.gateway(gateway)}/heartbeat"

    @property
    def all_heartbeats(self) -> str:
        return f"{self.all_gateways}/heartbeat"

    def gateway_of(self, key: str) -> str:
        """Return the gateway of a token or heartbeat key. Raises ValueError for other keys."""
        match = _GATEWAY_KEY.fullmatch(key.removeprefix(self.namespace + "/"))
        if not key.startswith(self.namespace + "/") or match is None:
            raise ValueError(f"{key!r} is not the key of a gateway in namespace {self.namespace!r}")
        return unescape(match[1])

    def parse(self, key: str) -> RobotKey:
        """Parse any key of a robot. Raises ValueError for other keys."""
        match = _ROBOT_KEY.fullmatch(key.removeprefix(self.namespace + "/"))
        if not key.startswith(self.namespace + "/") or match is None:
            raise ValueError(f"{key!r} is not the key of a robot in namespace {self.namespace!r}")
        segment, kind, incarnation = match.groups()
        if (kind == "presence") != (incarnation is not None):
            raise ValueError(f"{key!r}: an incarnation belongs to presence, and only there")
        return RobotKey(unescape(segment), kind, None if incarnation is None else int(incarnation))  # type: ignore[arg-type]
