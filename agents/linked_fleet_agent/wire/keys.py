"""Zenoh keys of the fleet, and the escape of names in them (PROTOCOL.md, "Keys").

Keys are built and parsed here, and nowhere else. The escape makes any name a safe URI path segment and a safe Zenoh key
chunk. Bytes of the UTF-8 form outside ``A-Z a-z 0-9 _ . -`` become ``~XX`` (upper-case hex). If the whole name is
reserved (or ``.`` or ``..``), its first byte is escaped as well. The rule is reversible and every name has exactly one
segment; any other spelling is refused.
"""

import re
from collections.abc import Container
from dataclasses import dataclass
from typing import Literal

MAX_NAME_BYTES = 128
_PLAIN = frozenset(b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789_.-")
_AS_IT_IS = re.compile(r"[A-Za-z0-9_.-]{1,128}", re.ASCII)
"""Names that equal their segment, unless reserved."""


def escape(name: str, reserved: Container[str] = ()) -> str:
    """Return the segment of ``name``. Raises ValueError if it is empty or longer than 128 bytes in UTF-8."""
    escape_first = name in (".", "..") or name in reserved
    if not escape_first and _AS_IT_IS.fullmatch(name):
        return name
    raw = name.encode()
    if not 0 < len(raw) <= MAX_NAME_BYTES:
        raise ValueError(f"a name has 1 to {MAX_NAME_BYTES} bytes, not {len(raw)}")
    return "".join(
        chr(byte) if byte in _PLAIN and not (escape_first and index == 0) else f"~{byte:02X}"
        for index, byte in enumerate(raw)
    )


def unescape(segment: str, reserved: Container[str] = ()) -> str:
    """Return the name of ``segment``. Raises ValueError if the segment is not the canonical one of any name."""
    if segment not in (".", "..") and segment not in reserved and _AS_IT_IS.fullmatch(segment):
        return segment
    head, *rest = segment.split("~")
    try:
        raw = head.encode("ascii") + b"".join(bytes.fromhex(part[:2]) + part[2:].encode("ascii") for part in rest)
        name = raw.decode()
        if escape(name, reserved) == segment:
            return name
    except ValueError:
        pass
    raise ValueError(f"{segment!r} is not the segment of a name")


RobotKind = Literal[
    "description", "state", "command", "stop", "progress", "condition", "mesh", "picture", "values", "operate",
    "event", "sample",
]  # fmt: skip
Kind = Literal[RobotKind, "presence"]

_NAMESPACE = re.compile(r"[A-Za-z0-9_.-]+(/[A-Za-z0-9_.-]+)*")
_ROBOT_KEY = re.compile(
    r"robot/([^/*$?#]+)/(description|state|command|stop|progress|condition|mesh|picture|values|operate|event|sample|presence)(?:/(0|[1-9][0-9]{0,18}))?"
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
    """Builds and parses the keys under one namespace. Raises ValueError if the namespace is not a plain Zenoh key."""

    namespace: str = "fleet"

    def __post_init__(self) -> None:
        if not _NAMESPACE.fullmatch(self.namespace):
            raise ValueError(f"namespace {self.namespace!r} is not a plain Zenoh key such as 'fleet' or 'site/hall-2'")

    def robot(self, robot: str, kind: RobotKind) -> str:
        return f"{self.namespace}/robot/{escape(robot)}/{kind}"

    def presence(self, robot: str, incarnation: int) -> str:
        """Return the liveliness token of one run of an agent; each run has its own key."""
        return f"{self.namespace}/robot/{escape(robot)}/presence/{incarnation}"

    def all_presence_of_robot(self, robot: str) -> str:
        return f"{self.namespace}/robot/{escape(robot)}/presence/*"

    @property
    def all_keys(self) -> str:
        return f"{self.namespace}/**"

    def all_of_robot(self, robot: str) -> str:
        return f"{self.namespace}/robot/{escape(robot)}/**"

    @property
    def all_of_robots(self) -> str:
        return f"{self.namespace}/robot/*/**"

    def all_of_kind(self, kind: str) -> str:
        return f"{self.namespace}/robot/*/{kind}"

    @property
    def all_presence(self) -> str:
        return f"{self.namespace}/robot/*/presence/*"

    @property
    def all_states(self) -> str:
        return self.all_of_kind("state")

    @property
    def all_progress(self) -> str:
        return self.all_of_kind("progress")

    @property
    def all_conditions(self) -> str:
        return self.all_of_kind("condition")

    @property
    def all_values(self) -> str:
        return self.all_of_kind("values")

    @property
    def all_events(self) -> str:
        return self.all_of_kind("event")

    @property
    def all_samples(self) -> str:
        return self.all_of_kind("sample")

    @property
    def all_stops(self) -> str:
        """The key on which one query reaches every robot."""
        return self.all_of_kind("stop")

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
            raise ValueError(f"{key!r}: presence keys, and no others, have an incarnation")
        return RobotKey(unescape(segment), kind, None if incarnation is None else int(incarnation))  # type: ignore[arg-type]
