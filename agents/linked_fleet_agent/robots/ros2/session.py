"""The Zenoh session of the ROS 2 driver, and the keys, liveliness tokens and attachments of rmw_zenoh.

Keys, tokens and attachments follow docs/design.md of rmw_zenoh (ROS 2 Jazzy and later), and are pure. Apart from
zenoh_session.py, no other module of the agent imports zenoh. The callbacks of the session only put bytes into bounded
queues, which the driver empties in its own thread.
"""

import secrets
import struct
import time
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from typing import Any, Literal

import zenoh
from zenoh import ext

from linked_fleet_agent.robots.ros2.graph import Mailbox
from linked_fleet_agent.zenoh_session import configuration

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


_LEASE_MS = 2_000
_MOST_STATES, _MOST_DESCRIPTIONS = 32, 2


class Outlet:
    """A publisher of one topic."""

    def __init__(self, publisher: Any) -> None:
        self._publisher = publisher
        self._gid, self._sequence = secrets.token_bytes(GID_BYTES), 0

    @property
    def has_subscribers(self) -> bool:
        """True if a subscriber is known to the router."""
        return bool(self._publisher.matching_status.matching)

    def put(self, payload: bytes) -> None:
        """Publish without waiting. Raises zenoh.ZError if the session is closed."""
        self._sequence += 1
        self._publisher.put(payload, attachment=attachment(self._sequence, time.time_ns(), self._gid))


class RosSession:
    """One ROS node with a Zenoh session of its own: a client of ``endpoint``, which is a ROS router or a listening
    node.

    Zenoh reconnects and renews the declarations by itself. Raises ConnectionError if the endpoint does not answer.
    """

    def __init__(self, endpoint: str, domain: int, node: str) -> None:
        config = configuration((endpoint,), (), _LEASE_MS)
        config.insert_json5("timestamping/enabled", "true")  # lets late joiners tell cached messages from newer ones
        try:
            self._session: Any = zenoh.open(config)
        except zenoh.ZError as error:
            raise ConnectionError(str(error).partition(" at /")[0]) from error
        self._declared = ExitStack()
        self._node = Node(domain, str(self._session.info.zid()), node)
        self._number = 0
        self._keep(self._session.liveliness().declare_token(self._node.token))

    def listen(self, topic: Topic, longest: int) -> Mailbox:
        """Subscribe to messages of up to ``longest`` bytes."""
        box = Mailbox(longest, _MOST_STATES)
        self._keep(self._session.declare_subscriber(topic.key, _into(box)))
        self._show("MS", topic, KEEP_LAST_ONE)
        return box

    def listen_latched(self, topic: Topic, longest: int) -> Mailbox:
        """Subscribe, and fetch the last earlier message too (transient local)."""
        box = Mailbox(longest, _MOST_DESCRIPTIONS)
        history = ext.HistoryConfig(detect_late_publishers=True, max_samples=1)
        self._keep(ext.declare_advanced_subscriber(self._session, topic.key, _into(box), history=history))
        self._show("MS", topic, LATCHED)
        return box

    def outlet(self, topic: Topic) -> Outlet:
        """Return a publisher that drops messages under congestion."""
        publisher = self._session.declare_publisher(
            topic.key, congestion_control=zenoh.CongestionControl.DROP, express=True
        )
        self._keep(publisher)
        self._show("MP", topic, KEEP_LAST_ONE)
        return Outlet(publisher)

    def close(self) -> None:
        """Leave the ROS graph. May be called again."""
        self._declared.close()
        self._session.close()

    def _show(self, kind: Kind, topic: Topic, quality: str) -> None:
        self._keep(self._session.liveliness().declare_token(self._next_token(kind, topic, quality)))

    def _next_token(self, kind: Kind, topic: Topic, quality: str) -> str:
        self._number += 1
        return self._node.token_of(self._number, kind, topic, quality)

    def _keep(self, declared: Any) -> None:
        self._declared.callback(declared.undeclare)


def _into(box: Mailbox) -> Callable[[zenoh.Sample], None]:
    """Return a callback that puts samples into the box. Zenoh calls it in a thread of its own."""

    def take(sample: zenoh.Sample) -> None:
        fits = len(sample.payload) <= box.longest
        box.put(sample.payload.to_bytes() if fits else None)

    return take
