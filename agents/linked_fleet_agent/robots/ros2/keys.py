"""Keys, liveliness tokens and attachments of rmw_zenoh (its docs/design.md, ROS 2 Jazzy and later). Pure."""

import struct
from dataclasses import dataclass
from typing import Literal

GID_BYTES = 16
Kind = Literal["MP", "MS"]
# QoS policies: reliability, durability, history and depth, deadline, lifespan, liveliness. A field that has rmw_zenoh's
# default stays empty. Reliable is such a default; durability 1 is transient local.
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
        """The liveliness token that announces the node to ROS."""
        return self._token(0, "NN")

    def token_of(self, number: int, kind: Kind, topic: Topic, quality: str) -> str:
        """Return the token of a publisher (MP) or subscription (MS) of the node; each has its own ``number``."""
        of_topic = (_mangled(topic.name), topic.dds_type, topic.type_hash, quality)
        return "/".join((self._token(number, kind), *of_topic))

    def _token(self, number: int, kind: str) -> str:
        enclave, namespace = _mangled("/"), _mangled("/")
        return f"@ros2_lv/{self.domain}/{self.session}/0/{number}/{kind}/{enclave}/{namespace}/{self.name}"


def attachment(sequence: int, stamp_ns: int, gid: bytes) -> bytes:
    """Return the attachment of a message: sequence number from 1, wall time, sender (16 bytes with length prefix)."""
    return struct.pack("<qqB16s", sequence, stamp_ns, GID_BYTES, gid)


def _mangled(name: str) -> str:
    return name.replace("/", "%")
