"""The keys, liveliness tokens and attachments of rmw_zenoh (its docs/design.md, ROS 2 Jazzy and later). Pure."""

import struct
from dataclasses import dataclass
from typing import Literal

GID_BYTES = 16
Kind = Literal["MP", "MS"]
# Fields of the policies that are rmw_zenoh's own defaults are left empty: reliability, durability, history and depth,
# deadline, lifespan, liveliness. Reliable is one of them; durability 1 is transient local.
KEEP_LAST_ONE = "::,1:,:,:,,"
LATCHED = ":1:,1:,:,:,,"


@dataclass(frozen=True)
class Topic:
    """A topic by its full name, ``type`` as in ``std_msgs/msg/String``, and the hash of that type (REP 2016)."""

    domain: int
    name: str
    type: str
    type_hash: str

    @property
    def key(self) -> str:
        """The key expression of its messages."""
        return f"{self.domain}/{self.name.strip('/')}/{self.dds_type}/{self.type_hash}"

    @property
    def dds_type(self) -> str:
        package, kind, name = self.type.split("/")
        return f"{package}::{kind}::dds_::{name}_"


@dataclass(frozen=True)
class Node:
    """A ROS node in the root namespace; ``session`` is the identifier of its Zenoh session."""

    domain: int
    session: str
    name: str

    @property
    def token(self) -> str:
        """The liveliness token by which ROS knows the node."""
        return self._token(0, "NN")

    def token_of(self, number: int, kind: Kind, topic: Topic, quality: str) -> str:
        """That of one of its publishers (MP) or subscriptions (MS), each with a number of its own."""
        of_topic = (_mangled(topic.name), topic.dds_type, topic.type_hash, quality)
        return "/".join((self._token(number, kind), *of_topic))

    def _token(self, number: int, kind: str) -> str:
        enclave, namespace = _mangled("/"), _mangled("/")
        return f"@ros2_lv/{self.domain}/{self.session}/0/{number}/{kind}/{enclave}/{namespace}/{self.name}"


def attachment(sequence: int, stamp_ns: int, gid: bytes) -> bytes:
    """The attachment of a message: its number from 1, the wall time, and its sender (16 bytes, after their length)."""
    return struct.pack("<qqB16s", sequence, stamp_ns, GID_BYTES, gid)


def _mangled(name: str) -> str:
    return name.replace("/", "%")
