"""ROS 2 over Zenoh: keys and liveliness tokens of rmw_zenoh and of zenoh-bridge-ros2dds. Pure.

``RmwZenoh`` follows docs/design.md of rmw_zenoh, Humble to Rolling, and ``DdsBridge`` the sources of
zenoh-plugin-ros2dds 1.x. What arrives as a token is hostile until it is parsed: one that is none of ROS yields nothing.
"""

import re
import struct
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Protocol

from linked_fleet_agent.robots.ros2.graph import Interface, Offer, Role

GID_BYTES = 16
# QoS policies: reliability, durability, history and depth, deadline, lifespan, liveliness. A field that has rmw_zenoh's
# default stays empty. Reliable is such a default; durability 1 is transient local.
KEEP_LAST_ONE = "::,1:,:,:,,"
LATCHED = ":1:,1:,:,:,,"
HUMBLE_HASH = "TypeHashNotSupported"
_ROLES: dict[str, Role] = {"MP": "publisher", "MS": "subscription", "SS": "service", "SC": "client"}
_KINDS = {role: kind for kind, role in _ROLES.items()}
_NAME = re.compile(r"(/[A-Za-z_][A-Za-z0-9_]*)+")
_TYPE = re.compile(r"[a-z][a-z0-9_]*/(msg|srv|action)/[A-Za-z][A-Za-z0-9_]*")
_HASH = re.compile(r"RIHS01_[0-9a-f]{64}")
_LONGEST_TOKEN, _LONGEST_NAME = 1024, 255


class Transport(Protocol):
    """The keys of one way to carry ROS over Zenoh."""

    @property
    def tokens(self) -> str:
        """The key expression of the tokens of all nodes."""

    def key(self, interface: Interface, type_hash: str) -> str:
        """Return the key of a topic or service; an empty hash stands for any."""

    def offers_of(self, token: str) -> tuple[Offer, ...]:
        """Return what a token announces; nothing if it is none of this transport."""

    @property
    def attaches(self) -> bool:
        """True if messages and requests have an ``attachment``."""


def attachment(sequence: int, stamp_ns: int, gid: bytes) -> bytes:
    """Return the attachment of a message or request: sequence number from 1, wall time, sender with length prefix."""
    return struct.pack("<qqB16s", sequence, stamp_ns, GID_BYTES, gid)


@dataclass(frozen=True)
class RmwZenoh:
    """rmw_zenoh in one ROS domain. The driver is a node of it, in the Zenoh session with the identifier ``session``."""

    domain: int
    session: str = ""
    node: str = ""
    attaches: bool = True

    @property
    def tokens(self) -> str:
        return f"@ros2_lv/{self.domain}/**"

    def key(self, interface: Interface, type_hash: str) -> str:
        return f"{self.domain}/{interface.name.strip('/')}/{_dds(interface.type)}/{type_hash or '*'}"

    def offers_of(self, token: str) -> tuple[Offer, ...]:
        parts = token.split("/") if len(token) <= _LONGEST_TOKEN else []
        if len(parts) != 13 or parts[:2] != ["@ros2_lv", str(self.domain)] or parts[5] not in _ROLES:
            return ()
        if parts[2] == self.session:
            return ()  # the driver itself
        name, dds, said, quality = parts[9].replace("%", "/"), parts[10], parts[11], parts[12].split(":")
        interface = _interface(name, _ros(dds))
        if interface is None or len(quality) < 3 or (said != HUMBLE_HASH and not _HASH.fullmatch(said)):
            return ()
        hash_ = "" if said == HUMBLE_HASH else said
        return (Offer(_ROLES[parts[5]], interface, hash_, quality[1] == "1", key_hash=said),)

    @property
    def node_token(self) -> str:
        """The token that announces the node of the driver."""
        return self._token(0, "NN")

    def token(self, number: int, role: Role, interface: Interface, type_hash: str, quality: str) -> str:
        """Return the token of a part of the driver's node; each has its own ``number``."""
        of_interface = (_mangled(interface.name), _dds(interface.type), type_hash, quality)
        return "/".join((self._token(number, _KINDS[role]), *of_interface))

    def _token(self, number: int, kind: str) -> str:
        enclave, namespace = _mangled("/"), _mangled("/")
        return f"@ros2_lv/{self.domain}/{self.session}/0/{number}/{kind}/{enclave}/{namespace}/{self.node}"


@dataclass(frozen=True)
class DdsBridge:
    """zenoh-bridge-ros2dds: keys are names, messages have no attachment, and the bridge creates what is missing.

    With its option ``namespace`` all names of its robot begin with that.
    """

    tokens: str = "@/*/@ros2_lv/**"
    attaches: bool = False

    def key(self, interface: Interface, type_hash: str) -> str:
        return interface.name.strip("/")

    def offers_of(self, token: str) -> tuple[Offer, ...]:
        parts = token.split("/") if len(token) <= _LONGEST_TOKEN else []
        if len(parts) < 6 or (parts[0], parts[2]) != ("@", "@ros2_lv"):
            return ()
        kind, quality = parts[3], parts[6].split(":") if len(parts) == 7 else []
        interface = _interface("/" + parts[4].replace("§", "/"), parts[5].replace("§", "/"))
        if interface is None or (kind in ("MP", "MS")) != (len(quality) >= 4) or len(parts) > 7:
            return ()
        if kind == "AS":
            return tuple(_parts_of(interface))
        said = _HASH.search(quality[4]) if len(quality) > 4 else None
        latched = len(quality) > 2 and quality[2] == "1"
        return (Offer(_ROLES[kind], interface, said.group() if said else "", latched),) if kind in _ROLES else ()


def is_bridge(token: str) -> bool:
    """Return True for a token of zenoh-bridge-ros2dds, also that of the bridge itself."""
    return token.startswith("@/") and "/@ros2_lv" in token


def _parts_of(action: Interface) -> Iterator[Offer]:
    """Yield the services and topics of an action (ROS 2 design, "Actions")."""
    of, name = f"{action.name}/_action", action.type
    yield Offer("service", Interface(f"{of}/send_goal", f"{name}_SendGoal"))
    yield Offer("service", Interface(f"{of}/get_result", f"{name}_GetResult"))
    yield Offer("service", Interface(f"{of}/cancel_goal", "action_msgs/srv/CancelGoal"))
    yield Offer("publisher", Interface(f"{of}/feedback", f"{name}_FeedbackMessage"))
    yield Offer("publisher", Interface(f"{of}/status", "action_msgs/msg/GoalStatusArray"), latched=True)


def _interface(name: str, type: str) -> Interface | None:
    fits = len(name) <= _LONGEST_NAME and _NAME.fullmatch(name) and _TYPE.fullmatch(type)
    return Interface(name, type) if fits else None


def _dds(type: str) -> str:
    package, kind, name = type.split("/")
    return f"{package}::{kind}::dds_::{name}_"


def _ros(dds: str) -> str:
    return dds.replace("::dds_::", "::").replace("::", "/").removesuffix("_")


def _mangled(name: str) -> str:
    return name.replace("/", "%")
